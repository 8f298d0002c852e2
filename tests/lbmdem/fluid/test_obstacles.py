"""Obstacles: boxes that repeat with the box of the case, planes that grains rest on, forces on both."""

import math

import numpy as np
import pytest
from app_runner import running

from hpcpic.core.errors import ConfigError
from lbmdem.kernels.layout import FLUID
from lbmdem.setup.overlap_survey import starts

DX = 2.0e-4
BOX = """
simulation = {{ end_time = 1.0; }};
domain = {{ size = [3.2e-3, 2.8e-3]; spacing = 2.0e-4; periodic = ["x", "y"]; }};
fluid = {{ viscosity = 1.0e-6; relaxation_time = 0.8; body_force = [1.0e-3, 2.0e-3]; }};
obstacle = ({{ name = "block"; shape = {{ box = {{ low = [{0!r}, {1!r}]; high = [{2!r}, {3!r}]; }}; }}; }});
"""
STEPS = 40


def block(low: tuple[int, int]) -> str:
    """A box of 6.6 x 5.6 nodes whose lower corner is 0.3 nodes before the node `low`."""
    a = [(n + 0.2) * DX for n in low]
    return BOX.format(*a, a[0] + 6.6 * DX, a[1] + 5.6 * DX)


@pytest.mark.parametrize("low", [(0, 3), (12, 11), (-4, 3)])
def test_a_box_across_periodic_sides_is_the_same_box(world, low):
    """The flow around it moves with it; what goes around comes from the other side at once, not from its inside."""
    found = []
    for at in ((5, 3), low):
        with running(world, "lbmdem", block(at)) as app:
            for _ in range(STEPS):
                app.step()
            _, u = app.fluid.moments()
            found.append(np.roll(u, [-at[1], -at[0]], axis=(0, 1)))
    # places differ by 1e-12 nodes, as the corners are rounded
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-12 * np.abs(found[0]).max())


def test_forces_on_an_obstacle_close_the_balance(world):
    """Mean of the last two steps: the change of momentum in them is what the body force gives less what it takes."""
    with running(world, "lbmdem", block((5, 3))) as app:
        for _ in range(STEPS):
            app.step()
        before = app.scalars()
        for _ in range(2):
            app.step()
        after, pushed = app.scalars(), 1e3 * DX**2 * np.count_nonzero(app.fluid.solid.inner == FLUID)  # per volume
        for axis, force in zip("xy", (1e-3, 2e-3)):
            rate = (after[f"momentum_{axis}"] - before[f"momentum_{axis}"]) / (2.0 * app.time_step)
            assert after[f"force_block_{axis}"] == pytest.approx(pushed * force - rate, rel=1e-9)


PLANE = """
simulation = {{ end_time = 1.0; }};
domain = {{ size = [4.0e-3, {height!r}]; spacing = 2.0e-4; periodic = ["x"]; }};
fluid = {{ viscosity = 1.0e-6; relaxation_time = 0.8; }};
grains = ({{ diameter = 1.6e-3; density = 2650.0; position = [2.0e-3, {place!r}]; velocity = [0.0, -1e-3]; }});
contact = {{ normal_stiffness = 50.0; damping = 0.3; friction = 0.4; }};
{floor}
"""


def test_grains_meet_a_plane_as_they_meet_a_side_of_the_box(world):
    """It starts 1 % of its diameter deep; the plane is a side moved by four nodes."""
    sunk, floor = 0.784e-3, "obstacle = ({ shape = { plane = { point = [0.0, 8.0e-4]; normal = [0.0, 2.0]; }; }; });"
    height, overlap = [], []
    for text in (PLANE.format(height=3.2e-3, place=sunk, floor=""),
                 PLANE.format(height=4.0e-3, place=sunk + 8.0e-4, floor=floor)):  # fmt: skip
        with running(world, "lbmdem", text) as app:
            for _ in range(20):
                app.step()
            height.append(float(app.dem.grains.x[0, 1]))
            overlap.append(starts(app.scene.config)[1])
            assert app.scalars()["contact_count"] in (0.0, 1.0)
    assert height[1] - 8.0e-4 == pytest.approx(height[0], abs=1e-7 * DX)
    assert overlap == pytest.approx([0.01, 0.01]) and height[0] > sunk


SLOPE = """
simulation = {{ end_time = 0.02; }};
domain = {{ size = [0.03, 0.03]; }};
{plane}
grains = ({{ diameter = 2.0e-3; density = 2500.0; position = [{place[0]!r}, {place[1]!r}]; }});
contact = {{ normal_stiffness = 1.0e5; damping = 0.5; tangential = "history"; friction = {friction}; }};
gravity = [{gravity[0]!r}, {gravity[1]!r}];
"""
REST = 2500.0 * math.pi * 1.0e-6 * 9.81 * math.cos(math.pi / 6) / 1.0e5  # its overlap, m


@pytest.mark.parametrize("friction", [0.5, 0.1])
def test_a_dry_grain_goes_down_a_plane_as_down_a_floor_where_gravity_is_tilted(world, friction):
    """Rolling, and sliding where friction is below tan(30)/3; contacts know of no axis."""
    along, normal = np.array([math.cos(math.pi / 6), -0.5]), np.array([0.5, math.cos(math.pi / 6)])
    low, found, height = np.array([0.005, 0.02]), [], 1.0e-3 - REST
    plane = f"obstacle = ({{ shape = {{ plane = {{ point = {low.tolist()}; normal = {normal.tolist()}; }}; }}; }});"
    tilted = 9.81 * np.array([0.5, -math.cos(math.pi / 6)])
    for shape, place, gravity, way in (("", np.array([0.005, height]), tilted, np.array([1.0, 0.0])),
                                       (plane, low + height * normal, np.array([0.0, -9.81]), along)):  # fmt: skip
        text = SLOPE.format(plane=shape, place=place.tolist(), gravity=gravity.tolist(), friction=friction)
        with running(world, "lbmdem", text) as app:
            speeds, half = [], app.n_steps // 2  # at first friction is not yet that of a slip
            while app.iteration < app.n_steps:
                app.advance(min(half, app.n_steps - app.iteration))
                speeds.append((app.time, float(app.dem.grains.v[0] @ way), float(app.dem.grains.omega[0, 0])))
            found.append(np.array(speeds))
    np.testing.assert_allclose(found[1], found[0], rtol=1e-6)
    time, speed, _ = (found[0][-1] - found[0][len(found[0]) // 2]).T
    pull = 9.81 / 3.0 if friction > 0.2 else 9.81 * (0.5 - friction * math.cos(math.pi / 6))
    assert speed / time == pytest.approx(pull, rel=1e-3)


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("moving", ["true", "false"])
def test_a_rule_that_needs_one_rank_is_a_fault_of_the_case(world, moving):
    """The quadratic rule reads two nodes beyond a slab: exit code 2, on every rank."""
    sets = ('coupling.bounce_back="quadratic"', f"grains[0].moving={moving}")
    with (
        pytest.raises(ConfigError, match="one rank only"),
        running(world, "lbmdem", PLANE.format(height=3.2e-3, place=1.6e-3, floor=""), sets),
    ):
        pass


def test_without_fluid_work_is_counted_by_grains(world):
    text = PLANE.format(height=3.2e-3, place=1.6e-3, floor="")
    dry = "\n".join(line for line in text.splitlines() if not line.startswith("fluid"))
    for case, unit, items in ((text, "node", 320), (dry, "particle", 1)):
        with running(world, "lbmdem", case) as app:
            assert (app.work_unit, app.work_items) == (unit, items)
