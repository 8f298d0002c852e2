"""Scalars of a fluid whose sums are known."""

from types import SimpleNamespace

import numpy as np
import pytest
from app_runner import running

from hpcpic.core.case.config import loads
from hpcpic.core.comm.world import World
from lbmdem.configure import configure
from lbmdem.diagnostics.fluid_scalars import FluidScalars
from lbmdem.kernels.layout import FLUID
from lbmdem.setup.scene import Scene

CHANNEL = """
simulation = {{ dimensions = 3; end_time = 1.0; }};
domain = {{ size = [1.2e-3, 1.0e-3, 1.6e-3]; spacing = 1.0e-4; periodic = ["x", "y"{more}]; }};
fluid = {{ density = 800.0; kinematic_viscosity = 2.0e-6; relaxation_time = 0.8; {force} }};
{faces}
grains = ({{ name = "ball"; diameter = 4.0e-4; moving = false; position = [6.0e-4, 5.0e-4, 8.0e-4]; }});
"""
FACES = """boundary = ( { face = "z-"; type = "pressure"; pressure = 0.1; pressure_rate = 40.0; },
  { face = "z+"; type = "pressure"; pressure = 0.02; } );"""
SHAPE = (16, 10, 12)  # nodes along z, y, x


def permeability_of_planes(text: str, sample: tuple[float, float], pull: float, step: int = 0) -> dict[str, float]:
    """Scalars of fluid between two planes 1 mm apart across y, in the flow that `pull` (m/s2) drives along z."""
    scene = Scene(configure(loads(text)))
    y = (np.arange(10) + 0.5) * 1e-4
    u = np.broadcast_to((pull / (2 * 2e-6) * y * (1e-3 - y) / scene.units.velocity)[:, None], SHAPE)
    rows = np.zeros((160, 9))  # nodes, excess, momentum, energy, flow
    rows[:, 0], rows[:, 8] = 12, u.sum(axis=2).ravel()
    solid = np.full(SHAPE, FLUID)
    solid[7:9, 4:6, 5:7] = FLUID + 1
    fluid = SimpleNamespace(row_sums=lambda: (rows, u**2), solid=SimpleNamespace(inner=solid))
    drive, heights = SimpleNamespace(ramp_steps=lambda step: step), (np.arange(16) + 0.5) * 1e-4
    scalars = FluidScalars(scene, World.alone(), fluid, drive, None, sample, heights)
    return scalars.scalars(step, np.zeros(0))


def test_the_permeability_of_a_channel_is_a_twelfth_of_its_width_squared():
    """By a force on the fluid; the sum over ten nodes is larger than the integral by 1 / (2 n^2)."""
    text = CHANNEL.format(more=', "z"', force="body_force = [0.0, 0.0, 0.03];", faces="")
    found = permeability_of_planes(text, (6e-4, 1e-3), 0.03)
    assert found["permeability"] == pytest.approx(1e-6 / 12 * (1 + 0.5 / 10**2), rel=1e-9)
    assert found["hydraulic_gradient"] == pytest.approx(0.03 / 9.81)
    assert found["porosity"] == pytest.approx(1 - 8 / 1920)


def test_pressures_at_both_ends_drive_it_over_the_height_of_the_sample():
    """0.08 Pa, and 40 Pa/s more, over 0.4 mm."""
    text = CHANNEL.format(more="", force="", faces=FACES)
    scene = Scene(configure(loads(text)))
    for step in (0, 100):
        pull = (0.08 + 40.0 * step * scene.units.dt) / 800.0 / 4e-4
        found = permeability_of_planes(text, (6e-4, 1e-3), pull, step)
        assert found["permeability"] == pytest.approx(1e-6 / 12 * (1 + 0.5 / 10**2), rel=1e-9)
        assert found["hydraulic_gradient"] == pytest.approx(pull / 9.81)
        assert found["porosity"] == pytest.approx(1 - 8 / 480)  # of the four layers of the sample


@pytest.mark.parametrize("along", [0, 1])
def test_a_channel_tells_its_flow_along_any_axis(world, along):
    """Poiseuille's flow rate in 2D is a H^3/(12 nu), of nodes by 1 / (2 n^2) more; there is none across."""
    other, size, force = 1 - along, [4e-4, 4e-4], [0.0, 0.0]
    size[other], force[along] = 1e-3, 0.01
    text = f"""
    simulation = {{ end_time = 2.0; }};
    domain = {{ size = {size}; spacing = 1.0e-4; periodic = ["{"xy"[along]}"]; }};
    fluid = {{ kinematic_viscosity = 1.0e-6; relaxation_time = 1.0; body_force = {force}; }};"""
    with running(world, "lbmdem", text) as app:
        while app.time < 2.0:
            app.step()
        found = app.scalars()
    assert found[f"flow_rate_{'xy'[along]}"] == pytest.approx(0.01 * 1e-9 / 12e-6 * (1 + 0.5 / 10**2), rel=1e-6)
    assert abs(found[f"flow_rate_{'xy'[other]}"]) < 1e-12
