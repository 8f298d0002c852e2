"""A frame that is shaken by a sin(omega t) gives what nothing holds in it the velocity -a/omega (1 - cos omega t)."""

import math
from itertools import pairwise

import numpy as np
import pytest
from app_runner import running

from hpcpic.core.files.rundir import RunDir
from hpcpic.core.run import checkpoint

A, FREQUENCY = (0.3, -0.2, 0.1), 20.0
CASE = """
simulation = {{ dimensions = {d}; end_time = 1.0; }};
domain = {{ size = {size}; spacing = 5.0e-5; periodic = ["x", "y", "z"]; }};
fluid = {{ kinematic_viscosity = 1.0e-6; }};
shaking = {{ acceleration = {a}; frequency = 20.0; }};
"""
DISC = 'grains = ({ name = "disc"; diameter = 5.0e-4; density = 1500.0; position = [5.1e-4, 4.9e-4]; });'
TAU = (1.25, 0.875, 0.6875)  # each has half of the time step of the one before


def case(d, grains=""):
    text = CASE.format(d=d, size=[1e-3] * 2 if d == 2 else [2e-4] * 3, a=list(A[:d]))
    return (text if d == 3 else text.replace(', "z"', "")) + grains


def exact(time, d):
    omega = 2.0 * math.pi * FREQUENCY
    return -np.array(A[:d]) / omega * (1.0 - math.cos(omega * time))


def half_a_period(world, text, tau):
    """Largest errors over the largest velocity: of the fluid's mean, and of the grain if there is one."""
    with running(world, "lbmdem", text, [f"fluid.relaxation_time={tau}"]) as app:
        d, off = app.scene.dimensions, []
        while app.time < 0.5 / FREQUENCY:
            app.step()
            u = app.fluid.moments()[1][app.fluid.solid.inner == -1] * app.scene.units.velocity
            told = [u.mean(axis=0), *([app.dem.grains.v] if app.dem else [])]
            off.append([np.abs(v - exact(app.time, d)).max() for v in told])
        return np.max(off, axis=0) / np.abs(exact(0.5 / FREQUENCY, d)).max()


@pytest.mark.parametrize("d, tau", [(2, TAU), (3, TAU[:2])])
def test_a_shaken_fluid_follows_the_frame_to_second_order(world, d, tau):
    """The trapezoid: omega^2 dt^2 / 12 at most of the largest velocity, a quarter of that with half the step."""
    off = [half_a_period(world, case(d), t)[0] for t in tau]
    for before, after in pairwise(off):
        assert after == pytest.approx(before / 4, rel=0.03)
    time_step = (tau[-1] - 0.5) / 3.0 * 5e-5**2 / 1e-6
    assert off[-1] == pytest.approx((2.0 * math.pi * FREQUENCY * time_step) ** 2 / 12.0, rel=0.03)


def test_a_grain_goes_with_a_shaken_fluid_to_second_order(world):
    """It crosses a node: those that it uncovers are filled with a fluid that goes as fast."""
    off = [half_a_period(world, case(2, DISC), tau) for tau in TAU]
    for before, after in pairwise(off):
        assert after == pytest.approx(before / 4, rel=0.03)


def test_nodes_change_hands_and_a_grain_keeps_the_speed_of_the_fluid(world):
    """Nodes that it has uncovered are off by products of velocities (in nodes a step) alone."""
    with running(world, "lbmdem", case(2, DISC), ["fluid.relaxation_time=1.25"]) as app:
        solid, changed = app.fluid.solid.inner.copy(), 0
        for _ in range(40):
            app.step()
            changed += int((app.fluid.solid.inner != solid).sum())
            solid = app.fluid.solid.inner.copy()
            u = app.fluid.moments()[1][solid == -1] * app.scene.units.velocity
            apart = np.abs(u - app.dem.grains.v) / np.abs(exact(0.5 / FREQUENCY, 2)).max()
            assert apart.max() < 1e-3
            assert apart.mean() < 1e-4
        assert changed > 10


def test_a_run_that_goes_on_tells_what_the_one_before_told(world, tmp_path):
    """Momentum has its half of the force of the step from which a restart goes on."""
    text = case(2, DISC)
    with running(world, "lbmdem", text) as first, running(world, "lbmdem", text) as second:
        for _ in range(5):
            first.step()
        checkpoint.write(world, RunDir(tmp_path), first.iteration, first.time, first.state())
        second.restore(checkpoint.newest(RunDir(tmp_path), world))
        told, before = second.scalars(), first.scalars()
        forces = {f"force_disc_{axis}" for axis in "xy"}  # means of two steps, of which a checkpoint has one
        assert {name for name in told if told[name] != before[name]} <= forces
        assert np.array_equal(second.fluid.moments()[1], first.fluid.moments()[1])
        for app in (first, second):
            app.step()
        assert np.array_equal(second.fluid.moments()[1], first.fluid.moments()[1])
