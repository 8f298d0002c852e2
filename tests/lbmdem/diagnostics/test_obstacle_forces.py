"""Forces on obstacles: of the fluid, and of the grains and films that it does not resolve."""

import numpy as np
import pytest
from app_runner import running

SHEARED = """
simulation = { end_time = 1.0; };
domain = { size = [2.4e-3, 2.4e-3, 2.4e-3]; spacing = 2.0e-4; periodic = ["x", "y"]; };
fluid = { density = 1000.0; kinematic_viscosity = 1.0e-4; relaxation_time = 1.1; };
obstacle = (
  { name = "floor"; shape = { plane = { point = [0.0, 0.0, 3.0e-4]; normal = [0.0, 0.0, 1.0]; }; };
    velocity = [-0.02, 0.0, 0.0]; },
  { name = "lid"; shape = { plane = { point = [0.0, 0.0, 2.1e-3]; normal = [0.0, 0.0, -1.0]; }; };
    velocity = [0.02, 0.0, 0.0]; } );
grains = ({ diameter = 1.0e-3; density = 1000.0; position = [1.2e-3, 1.2e-3, 8.1e-4]; });
"""


def test_the_forces_on_floor_and_lid_close_with_that_of_the_film(world):
    """In a steady flow; the film of the ball is half of the friction of the floor."""
    with running(world, "lbmdem", SHEARED) as app:
        for _ in range(400):
            app.step()
        found = [app.scalars()]
        for _ in range(20):
            app.step()
            found.append(app.scalars())
        assert app.diagnostics.units["contact_floor_x"] == "N"
    names = ("force_floor_x", "force_lid_x", "contact_floor_x", "force_grains_1_x")
    floor, lid, film, ball = (np.mean([one[name] for one in found]) for name in names)
    assert all(one["contact_lid_x"] == 0.0 for one in found)
    assert film > 0.4 * floor and film == pytest.approx(ball, rel=0.05)  # what the fluid gives the ball the floor takes
    assert abs(floor + lid + film) < 0.05 * film  # 0.012: the flow is not quite steady yet


@pytest.mark.parametrize("d", [2, 3])
def test_a_plane_bears_the_weight_of_a_grain_that_lies_on_it(world, d):
    """Less its buoyancy; along gravity, and of no other plane."""
    size, down, place = ["2.4e-3"] * d, ["0.0"] * (d - 1), ["1.2e-3"] * (d - 1)
    plane = f"{{ point = [{', '.join(down)}, 3.0e-4]; normal = [{', '.join(down)}, 1.0]; }}"
    case = f"""
    simulation = {{ end_time = 1.0; }};
    domain = {{ size = [{", ".join(size)}]; spacing = 2.0e-4; periodic = ["x"]; }};
    fluid = {{ density = 1000.0; kinematic_viscosity = 1.0e-4; relaxation_time = 1.1; }};
    obstacle = ({{ name = "floor"; shape = {{ plane = {plane}; }}; }});
    grains = ({{ diameter = 1.0e-3; density = 2000.0; position = [{", ".join(place)}, 7.975e-4]; }});
    gravity = [{", ".join(down)}, -9.81];
    contact = {{ normal_stiffness = {3.0e3 if d == 2 else 2.0}; damping = 0.8; }};
    """
    with running(world, "lbmdem", case) as app:
        for _ in range(600):
            app.step()
        found = app.scalars()
        weight = float((app.table.mass * 9.81 * 0.5)[0])
    last = "xyz"[d - 1]
    total = found[f"contact_floor_{last}"]
    assert total == pytest.approx(-weight, rel=0.02) and abs(found["contact_floor_x"]) < 1e-3 * weight


def test_a_plane_bears_dry_grains_too(world):
    case = """
    simulation = { dimensions = 3; end_time = 1.0; time_step = 1.0e-5; };
    domain = { size = [2.4e-3, 2.4e-3, 2.4e-3]; };
    obstacle = ({ name = "floor"; shape = { plane = { point = [0.0, 0.0, 3.0e-4]; normal = [0.0, 0.0, 1.0]; }; }; });
    grains = ({ diameter = 1.0e-3; density = 2000.0; position = [1.2e-3, 1.2e-3, 7.975e-4]; });
    gravity = [0.0, 0.0, -9.81];
    contact = { normal_stiffness = 2.0; damping = 0.8; };
    """
    with running(world, "lbmdem", case) as app:
        while app.iteration < 20000:
            app.advance(20000 - app.iteration)
        assert app.scalars()["contact_floor_z"] == pytest.approx(-float(app.table.mass[0]) * 9.81, rel=1e-3)
