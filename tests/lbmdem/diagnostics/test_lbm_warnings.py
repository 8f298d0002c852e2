"""What a run says when something goes wrong offers what would help."""

from types import SimpleNamespace

import pytest
from app_runner import running

from hpcpic.core.case import accelerations
from lbmdem.diagnostics.guard import CURE, fault

CLOSED = """
simulation = {{ end_time = 0.01; }};
domain = {{ size = [0.004, 0.004]; spacing = 2.0e-4; }};
fluid = {{ density = 1000.0; kinematic_viscosity = 1.0e-6; relaxation_time = 0.6; }};
grains = ({{ diameter = 2.0e-3; density = 2000.0; position = [0.002, 0.002]; }});
coupling = {{ refill = "{refill}"; }};
"""


@pytest.mark.parametrize("refill, helps", [("mass-conserving", False), ("conserving", False), ("average", True)])
def test_a_refill_that_keeps_the_mass_is_no_cure_where_it_is_on(world, caplog, refill, helps):
    with running(world, "lbmdem", CLOSED.format(refill=refill)) as app:
        app.diagnostics._of_fluid(SimpleNamespace(fastest=0.0, drift=-2e-3, scalars=lambda *_: {}), 1)
    told = [one.getMessage() for one in caplog.records if "mean density" in one.getMessage()]
    assert len(told) == (world.rank == 0) and all(("mass-conserving" in text) == helps for text in told)


@pytest.mark.parametrize(
    "collision, tau, steps_help",
    [("TRT", 0.512, False), ("BGK", 0.512, False), ("TRT", 0.6, True), ("central", 0.512, True)],
)
def test_a_fluid_that_diverges_near_one_half_is_not_told_to_make_shorter_steps(world, collision, tau, steps_help):
    """Past a cylinder steps of 8, 4 and 2e-4 s diverged the earlier the shorter; central moments did not."""
    sets = (f'fluid.collision="{collision}"', f"fluid.relaxation_time={tau}")
    with running(world, "lbmdem", CLOSED.format(refill="average"), sets=sets) as app:
        seen = SimpleNamespace(fluid=SimpleNamespace(fastest=1.0), grains_stay=False)
        said, beside_grains = (fault(seen, app.fluid, grains, 0.1) for grains in (None, app.dem))
        seen.grains_stay = True
        assert ("holds back what flows" in fault(seen, app.fluid, None, 0.1)) != steps_help
        deep = SimpleNamespace(fluid=None, overlap=0.15)
        assert "normal_stiffness = 1.5e+05 gives 1 % where a load" in (told := str(fault(deep, None, app.dem, 0.1)))
        assert "2.2e+06 where they strike" in told and fault(deep, None, app.dem, 0.2) is None  # of 1e4 N/m
    assert (CURE in said) == steps_help and ('fluid.collision = "central"' in said) != steps_help
    assert "brakes" not in said and ("brakes grains" in beside_grains) != steps_help


def test_mass_that_links_of_grains_that_stay_take_is_told_with_its_cure(world):
    """Twelve spheres in a periodic box lost 1e-5 of it a step in a fast flow, and their run ended without a cure."""
    with running(world, "lbmdem", DENSE) as app:
        app.step()
        assert app.diagnostics.grains_stay
        app.diagnostics.fluid.fastest, app.diagnostics.fluid.drift = 0.0, -0.02
        told = fault(app.diagnostics, app.fluid, None, 0.1)
    assert "-2.00%" in told and 'coupling.refill = "mass-conserving" gives it back' in told


DENSE = """
simulation = { end_time = 1.0; };
domain = { size = [1.0e-3, 1.0e-3, 1.0e-3]; spacing = 1.0e-4; periodic = ["x", "y", "z"]; };
fluid = { density = 1000.0; kinematic_viscosity = 1.0e-4; body_force = [0.0, 0.0, 1.0]; };
grains = ({ diameter = 6.59e-4; moving = false;
            position = ([0.0, 0.0, 0.0], [0.0, 5e-4, 5e-4], [5e-4, 0.0, 5e-4], [5e-4, 5e-4, 0.0]); });
"""


PRESSED = """
simulation = { end_time = 0.2; };
domain = { size = [4.0e-3, 4.0e-3]; };
grains = ({ diameter = 1.0e-3; density = 2000.0; position = [2.0e-3, 5.1e-4]; acceleration = "pressing"; });
contact = { normal_stiffness = 1e3; damping = 0.3; friction = 0.0; };
"""


def pressing(x, v, t):
    """Towards the floor, the more the later: 0.2 diameters of overlap a second."""
    return 0.0, -127.0 * t, 0.0


@pytest.mark.parametrize(("stiffness", "told"), [(1e3, ["1.0%", "2.0%"]), (1e4, [])])
def test_overlaps_that_check_did_not_foretell_are_told_as_they_double(world, caplog, stiffness, told):
    accelerations.register("pressing", pressing)
    with running(world, "lbmdem", PRESSED, (f"contact.normal_stiffness={stiffness}",)) as app:
        while app.time < 0.15:
            app.step()
            if app.iteration % 20 == 0:
                app.scalars()
        deepest = app.scalars()["overlap"]
    texts = [one.getMessage() for one in caplog.records if "grains overlap" in one.getMessage()]
    assert [text.split(" of a")[0].split()[-1] for text in texts] == (told if world.rank == 0 else [])
    assert all("normal_stiffness" in text for text in texts) and deepest == pytest.approx(30.0 / stiffness, rel=0.05)


@pytest.mark.parametrize("spacing, share, lost", [(1e-4, "51.7%", "45 %"), (5e-5, "15.6%", "7 %")])
def test_links_without_room_for_their_rule_are_told_with_what_that_costs(world, caplog, spacing, share, lost):
    """Of a face-centred array of spheres, whose permeability is 8.525e-4 d2 with 33 nodes across each."""
    with running(world, "lbmdem", DENSE, (f"domain.spacing={spacing}",)) as app:
        while app.time < 2e-3:
            app.step()
        values = app.scalars()
    told = [one.getMessage() for one in caplog.records if "no room" in one.getMessage()]
    assert len(told) == (world.rank == 0) and all(share in text and lost in text for text in told)
    less = 1.0 - values["permeability"] / 6.59e-4**2 / 8.525e-4
    assert less == pytest.approx(float(lost.split()[0]) / 100.0, abs=0.005)
