"""A body force stands for the pressure gradient that drives the fluid: it acts in the place of a grain too."""

import numpy as np
import pytest
from app_runner import running

PUSH = 0.02  # m/s2
DISC = """
simulation = { end_time = 1.0; };
domain = { size = [8.0e-3, 8.8e-3]; spacing = 2.0e-4; periodic = ["x", "y"]; };
fluid = { viscosity = 1.0e-6; relaxation_time = 0.8; body_force = [0.02, 0.0]; };
coupling = { refill = "conserving"; };
grains = ({ diameter = 2.0e-3; density = 1000.0; position = [4.1e-3, 4.7e-3]; });
"""
CLOSED = "domain.periodic=[]", 'boundary=({face="y-";type="wall";})'


def fluid_nodes(app):
    return int((app.fluid.solid.inner == -1).sum())


@pytest.mark.parametrize("density", [1000.0, 2650.0, 1500.0])
def test_fluid_and_grains_get_all_the_momentum(world, density):
    """Per step density a for each node of the fluid, and density a V for each grain, of any density; whatever its
    links give. Half of the last force is still to come, and what nodes that change hands hold comes a step later."""
    others = f"grains[0].density={density!r}", "grains[0].velocity=[3.0e-3, 2.0e-3]"
    with running(world, "lbmdem", DISC, others) as app:
        units, dt = app.scene.units, app.time_step
        volume, off = np.pi * 1e-6, []
        mass = app.table.mass[0]

        def momentum():
            last = app.immersed.all_forces(1, steps=1)[0][0] * units.force
            fluid = [app.scalars()[f"momentum_{axis}"] for axis in "xy"]
            return np.array(fluid) + mass * app.dem.grains.v[0] + 0.5 * dt * last

        given = momentum()
        given[0] -= 0.5 * dt * 1000.0 * PUSH * fluid_nodes(app) * units.dx**2  # what full steps count in advance
        for _ in range(60):
            given[0] += dt * 1000.0 * PUSH * (fluid_nodes(app) * units.dx**2 + volume)
            app.step()
            ahead = 0.5 * dt * 1000.0 * PUSH * fluid_nodes(app) * units.dx**2
            off.append(np.linalg.norm(momentum() - (ahead, 0.0) - given))
        assert sorted(off)[10] < 1e-12 * np.linalg.norm(given)
        assert off[-1] < 0.03 * np.linalg.norm(given)
        assert abs((fluid_nodes(app) * units.dx**2 + volume) / (8.0e-3 * 8.8e-3) - 1.0) < 2e-3


@pytest.mark.parametrize("place", [5.13e-3, 4.97e-3])
def test_a_grain_of_the_density_of_the_fluid_goes_with_it(world, place):
    """From rest all of the box has the same acceleration, and nothing turns. Links hold the grain to the velocity of
    the fluid within a step, a dt, and the fluid has a t. With "local": whole nodes of momentum ("conserving") scatter
    the grain by up to 2.4 a dt, from place to place.
    """
    sets = 'coupling.refill="local"', f"grains[0].position=[{place!r}, 4.7e-3]"
    with running(world, "lbmdem", DISC, sets) as app:
        while app.time < 0.5:
            app.step()
        reached, within = PUSH * app.time, PUSH * app.time_step
        assert app.dem.grains.v[0, 0] == pytest.approx(reached, abs=within)
        assert app.scalars()["momentum_x"] / app.scalars()["mass"] == pytest.approx(reached, abs=0.1 * within)
        assert abs(app.dem.grains.v[0, 1]) < within
        assert abs(app.dem.grains.omega[0, 0]) * 1e-3 < within


def test_nothing_stays_in_motion_in_a_closed_box(world):
    """The fluid's own pressure balances the gradient that would drive it, also on the grain. Sound swings:
    on the mean of four times, the links give what their volume of the grain has, within 3 % of the exact one."""
    with running(world, "lbmdem", DISC, ["domain.periodic=[]"]) as app:
        pushed = []
        for _ in range(4 * 139):  # steps: 2 x 40 nodes at 3^-1/2 a step
            app.step()
            pushed.append(app.immersed.all_forces(1, steps=1)[0][0] * app.scene.units.force)
        displaced = 1000.0 * np.pi * 1e-6 * PUSH
        assert np.linalg.norm(np.mean(pushed, axis=0) / displaced + (1.0, 0.0)) < 0.03
        assert np.linalg.norm(app.dem.grains.v[0]) < 0.03 * PUSH * app.time
