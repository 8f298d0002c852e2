"""A parabola of the velocity that faces let in: its shape, its mean, what it needs, and the flow that it keeps."""

import numpy as np
import pytest
from app_runner import running

from hpcpic.core.case.config import loads
from hpcpic.core.errors import ConfigError
from lbmdem.configure import configure
from lbmdem.forecast.derived import derived, known_speed
from lbmdem.setup.scene import Scene

BOX = """
simulation = {{ end_time = 1.0; }};
domain = {{ size = [{length}, 0.4, {height}]; spacing = 0.02; periodic = [{periodic}]; }};
fluid = {{ density = 1.0; kinematic_viscosity = 0.01; relaxation_time = 0.8; }};
boundary = ( {{ face = "x-"; type = "{type}"; {given}; profile = "parabolic"; }},
             {{ face = "x+"; type = "pressure"; pressure = 0.0; }} );
"""


def config_of(periodic="", type="velocity", given="velocity = [0.02, 0.0, 0.0]", length=0.8, height=0.6):
    text = BOX.format(periodic=periodic, type=type, given=given, length=length, height=height)
    return configure(loads(text))


@pytest.mark.parametrize("periodic, walls", [("", 2), ('"z"', 1), ('"y", "z"', 0)])
def test_between_walls_it_is_a_product_of_parabolas_with_the_mean_that_is_given(periodic, walls):
    scene = Scene(config_of(periodic))
    axes = [(np.arange(n) + 0.5) * 0.02 for n in scene.points]
    coordinates = axes[0][None, None, :], axes[1][None, :, None], axes[2][:, None, None]
    u = scene.inflow("x-", coordinates)[..., 0] * scene.units.velocity
    y, z = axes[1] / 0.4, axes[2][:, None] / 0.6
    known = 0.02 * np.ones(u.shape[:2]) * (6 * y * (1 - y) if walls else 1) * (6 * z * (1 - z) if walls == 2 else 1)
    np.testing.assert_allclose(u[..., 0], known, rtol=1e-12)
    # the mean of a parabola over the middles of n parts is 1 + 1 / (2 n^2) of its own
    assert u.mean() == pytest.approx(0.02 * (1 + 0.5 / 20**2) ** (walls > 0) * (1 + 0.5 / 30**2) ** (walls == 2))
    assert known_speed(scene.config) == pytest.approx(0.02 * 1.5**walls)


@pytest.mark.parametrize(
    "obstacles, low, high, covered",
    [
        ('box = { low = [0.0, 0.0, 0.0]; high = [0.2, 0.4, 0.2]; }', 0.2, 0.6, 0.0),
        ('box = { low = [0.0, -0.1, 0.4]; high = [0.2, 0.5, 0.7]; }', 0.0, 0.4, 0.0),
        ('plane = { point = [0.0, 0.0, 0.2]; normal = [0.0, 0.0, 1.0]; }', 0.2, 0.6, 0.0),
        ('box = { low = [0.02, 0.0, 0.0]; high = [0.2, 0.4, 0.2]; }', 0.0, 0.6, 0.0),  # further inside
        ('box = { low = [0.0, 0.0, 0.2]; high = [0.2, 0.4, 0.4]; }', 0.0, 0.6, 1 / 3),  # in its way
        ('box = { low = [0.0, 0.0, 0.0]; high = [0.2, 0.2, 0.2]; }', 0.0, 0.6, 1 / 6),  # in a corner
    ],
)  # fmt: skip
def test_it_goes_through_what_obstacles_leave_of_the_face_or_is_warned_of(obstacles, low, high, covered):
    text = BOX.format(periodic="", type="velocity", given="velocity = [0.02, 0.0, 0.0]", length=0.8, height=0.6)
    scene = Scene(config := configure(loads(text + f"obstacle = ({{ shape = {{ {obstacles}; }}; }});")))
    y, z = ((np.arange(n) + 0.5) * 0.02 for n in scene.points[1:])
    u = scene.inflow("x-", (np.full((1, 1, 1), 0.01), y[None, :, None], z[:, None, None]))[:, :, 0, 0]
    share = (z - low) / (high - low)
    known = np.maximum(6 * share * (1 - share), 0.0)[:, None] * 6 * y / 0.4 * (1 - y / 0.4)
    np.testing.assert_allclose(u * scene.units.velocity, 0.02 * known, atol=1e-12)
    row = next(one for one in derived(config) if one.name == "covered part of the parabola at x-")
    assert row.value == pytest.approx(covered) and row.verdict == ("warn" if covered else "ok")


@pytest.mark.parametrize("type, given", [("pressure", "pressure = 0.0"), ("wall", "velocity = [0.0, 0.1, 0.0]")])
def test_other_faces_have_none(type, given):
    with pytest.raises(ConfigError, match=rf"profile: a {type} face has none"):
        config_of(type=type, given=given)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_channel_keeps_the_parabola_that_comes_in(world, axis):
    """From the start, in either direction: half-way walls and two relaxation times have Poiseuille's flow exactly."""
    way, name = [0.0, 0.0], "xy"[axis]
    way[axis] = 0.02
    size = [0.8, 0.4] if axis == 0 else [0.4, 0.8]
    text = f"""
    simulation = {{ end_time = 20.0; }};
    domain = {{ size = {size}; spacing = 0.02; }};
    fluid = {{ density = 1.0; kinematic_viscosity = 0.01; relaxation_time = 0.8; }};
    boundary = ( {{ face = "{name}-"; type = "velocity"; velocity = {way}; profile = "parabolic"; }},
                 {{ face = "{name}+"; type = "pressure"; pressure = 0.0; }} );
    """
    with running(world, "lbmdem", configure(loads(text))) as app:
        while app.iteration < 4000:
            app.advance(4000 - app.iteration)
        u = app.fluid.moments()[1][..., axis] * app.scene.units.velocity
        across = u if axis == 0 else u.T
        low, high = app.domain.row_range(world.rank) if axis == 0 else (0, 20)
        y = (np.arange(low, high) + 0.5) / 20
        assert np.abs(across / (0.02 * 6 * y * (1 - y))[:, None] - 1).max() < 0.02


@pytest.mark.parametrize(
    "type, given, waves", [("velocity", "velocity = [0.02, 0.0, 0.0]", 4), ("pressure", "pressure = 0.0", 2)]
)
def test_the_period_of_sound_between_open_faces_is_told(type, given, waves):
    """A quarter of a wave between velocity and pressure, half a wave between two pressures."""
    text = BOX.format(periodic="", type=type, given=given, length=0.8, height=0.6)
    config = configure(loads(text.replace('; profile = "parabolic"', "")))
    found = {one.name: one.value for one in derived(config)}
    sound = 0.02 / config.time_step / np.sqrt(3.0)
    assert found["period of sound along x"] == pytest.approx(waves * 0.8 / sound)
    assert "period of sound along y" not in found
