"""Grains alone in a shaken frame: many steps in a call give the bits of single ones."""

import math

import numpy as np
import pytest
from app_runner import running
from dem_scenes import HISTORY, RADIUS, Saved, by_id, cloud, dem, grains

from hpcpic.core.case.config import loads
from hpcpic.core.run.balance import PERIOD
from hpcpic.core.tasks.graph import Pool
from lbmdem.configure import configure
from lbmdem.forecast.estimate import estimate
from lbmdem.physics.plane_walls import PlaneWall
from lbmdem.sizes import STEPS_PER_CALL

CASE = """
simulation = { dimensions = 2; end_time = 0.01; };
domain = { size = [0.05, 0.01]; periodic = ["x"]; };
grains = ({ diameter = 2.0e-3; position = ([0.025, 0.9999e-3], [0.0271, 0.9999e-3], [0.01, 0.004]); });
contact = { normal_stiffness = 1.0e5; tangential = "history"; friction = 0.5; };
gravity = [0.0, -9.81];
shaking = { acceleration = [20.0, -3.0]; frequency = 200.0; };
"""
STILL = CASE[: CASE.index("shaking")]


def in_the_box(world, d, n, threads, lengths):
    wall = PlaneWall((0.0,) * d, (0.0,) * (d - 1) + (1.0,), (0.0,) * (d - 1) + (0.2,))
    ends = {"periodic": (True,) * (d - 1) + (False,), "walls": (wall,)}
    return dem(world, cloud(n, d, lengths), HISTORY, lengths, **ends, pool=Pool(threads))


@pytest.mark.parametrize("d, n, threads", [(2, 60, 1), (3, 60, 1), (2, 1200, 2)])
def test_steps_of_a_shaken_frame_are_those_of_single_calls(world, d, n, threads):
    """On one thread, 600 substeps: more than walls have their places made for at a time."""
    lengths, dt, each, steps = (2.2 * RADIUS * math.ceil(n ** (1 / d)),) * d, 2e-5, 3, 200 if n < 100 else 10
    times = np.arange(steps) * (each * dt)
    frame = np.outer(np.sin(200.0 * times), 50.0 * np.arange(1, d + 1))
    one, many = (in_the_box(world, d, n, threads, lengths) for _ in range(2))
    mass = cloud(n, d, lengths)["mass"]
    constant = mass[:, None] * np.linspace(-1.0, 1.0, n * d).reshape(n, d)
    many.advance_shaken(dt, each, constant, frame, times)
    for acceleration, time in zip(frame, times.tolist()):
        own = one.grains.ids[: one.grains.n]
        one.advance(dt, each, constant[own] - mass[own, None] * acceleration, time=time)
    assert one.time == many.time
    assert Saved(one).digest == Saved(many).digest


def test_shaken_grains_alone_go_many_steps_in_a_call(world):
    """The same state as step by step, and `estimate` says of a step what it says of one that is not shaken."""
    with running(world, "lbmdem", CASE) as many, running(world, "lbmdem", CASE) as one:
        many.advance(10000)
        assert many.iteration == min(STEPS_PER_CALL, PERIOD) < many.n_steps
        while one.iteration < many.iteration:
            one.step()
        assert Saved(one).digest == Saved(many).digest
        steps = [estimate(configure(loads(text)), 1, 1, {}).step_seconds for text in (CASE, STILL)]
    assert steps[0] == pytest.approx(steps[1], rel=0.01)


def test_a_free_grain_goes_against_the_frame(world):
    """In the frame it gets -a/omega (1 - cos omega t)."""
    a, omega, dt = 3.0, 50.0, 1e-4
    scene = dem(world, grains([[0.5, 0.5]]), HISTORY, (1.0, 1.0))
    times = np.arange(400) * dt
    frame = np.outer(np.sin(omega * times), [a, 0.0])
    scene.advance_shaken(dt, 1, np.zeros((1, 2)), frame, times)
    if scene.grains.n:
        expected = -a / omega * (1.0 - math.cos(omega * 400 * dt))
        assert by_id(scene, scene.grains.v)[0, 0] == pytest.approx(expected, abs=0.6 * a * dt)
