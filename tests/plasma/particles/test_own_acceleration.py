"""Drags of the user's own of any strength and sharpness, one particle at a time."""

import math

import numpy as np
import pytest
from numba import njit

from hpcpic.plasma.particles.own_acceleration import own_acceleration

STEP = 0.1
HALF = np.eye(3) / 2  # N where there is no magnetic field


def drag(x, v, t):
    """-(x_0 |v| + x_1 + x_2 tanh(1e6 |v|)) v/|v| - x_0 |v|^2 v: of turbulence, dry friction, one that is nearly so."""
    speed = math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
    if speed == 0.0:
        return 0.0, 0.0, 0.0
    over = (x[1] + x[2] * math.tanh(1e6 * speed)) / speed + x[0] * speed
    return -over * v[0], -over * v[1], -over * v[2]


@pytest.fixture(scope="module")
def acceleration():
    return own_acceleration(njit(drag), 3)


def moved(acceleration, strength, before):
    """Velocities of the middle and the end of a step."""
    a = np.array(acceleration(strength, tuple(before), HALF, 0.0, STEP, False))
    return before + a * STEP / 2, before + a * STEP


@pytest.mark.parametrize("strength", [0.1, 10.0, 30.0, 1e3, 1e5, 1e9])
def test_a_drag_by_the_square_of_the_speed_is_that_of_the_middle_of_the_step(acceleration, strength):
    """w (1 + c dt |w|/2) = v: at c dt |v| = 1 one Jacobian for all steps of Newton's method threw particles away."""
    before = np.array([0.6, -0.3, 0.2])
    speed, c = np.linalg.norm(before), strength * STEP
    expected = 2.0 * speed / (1.0 + math.sqrt(1.0 + 2.0 * c * speed))
    middle, after = moved(acceleration, (strength, 0.0, 0.0), before)
    np.testing.assert_allclose(middle, before / speed * expected, rtol=1e-9)
    assert np.linalg.norm(after) <= speed


@pytest.mark.parametrize("friction", [(0.0, 1.0, 0.0), (0.0, 0.0, 1.0)], ids=["dry", "steep"])
@pytest.mark.parametrize("speed", [0.01, 0.05, 0.4])
def test_dry_friction_holds_what_is_slow_and_slows_what_is_fast(acceleration, friction, speed):
    """What it can stop in half a step stays in the mean of the step: nothing creeps. Faster ones lose a dt."""
    before = speed * np.array([0.6, -0.64, 0.48])
    middle, after = moved(acceleration, friction, before)
    expected = max(0.0, 1.0 - STEP / 2 / speed)
    np.testing.assert_allclose(middle, before * expected, atol=1.2e-5)  # the steep one is at 1e-5 m/s what it can be
    assert np.linalg.norm(after) <= speed * (1.0 + 1e-12)


def test_an_acceleration_that_is_no_number_stays_none(acceleration):
    assert np.isnan(acceleration((math.nan, 0.0, 0.0), (0.1, 0.2, 0.3), HALF, 0.0, STEP, False)).all()


def test_a_step_back_that_no_velocity_solves_takes_the_drag_of_the_velocity_itself(acceleration):
    """w = v + c dt |w| w/4 has no root where c dt v > 1: found was what the next steps could not stop."""
    before = (0.6, -0.3, 0.2)
    a = acceleration((100.0, 0.0, 0.0), before, -HALF / 2, 0.0, STEP, True)
    np.testing.assert_allclose(a, drag((100.0, 0.0, 0.0), before, 0.0))
