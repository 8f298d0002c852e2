import numpy as np
import pytest

from sph.kernels import cells, marks, motion, readings, runs, totals
from sph.physics.smoothing import SMOOTHING

Q = np.linspace(0.0, 3.0, 300001)


def integral(values):
    return np.sum(values[1:] + values[:-1]) / 2 * (Q[1] - Q[0])


@pytest.mark.parametrize("name", SMOOTHING)
@pytest.mark.parametrize("d", [2, 3])
def test_kernels_are_normalised(name, d):
    shell = 2 * np.pi * Q if d == 2 else 4 * np.pi * Q**2
    assert integral(shell * SMOOTHING[name].value(Q, d)) == pytest.approx(1.0, abs=1e-9)  # of the trapezoidal rule


@pytest.mark.parametrize("name", SMOOTHING)
def test_the_gradient_is_that_of_the_kernel(name):
    kernel = SMOOTHING[name]
    slope = np.diff(kernel.value(Q, 3)) / np.diff(Q)
    middle = (Q[1:] + Q[:-1]) / 2
    assert np.abs(slope - kernel.gradient(middle, 3) * middle).max() < 1e-9  # (Q step)^2 times a third derivative below 10


@pytest.mark.parametrize("name", SMOOTHING)
@pytest.mark.parametrize("d", [2, 3])
def test_a_linear_field_has_its_gradient(name, d):
    """- integral x F x_a^2 = 1: the gradient of x is 1."""
    kernel = SMOOTHING[name]
    shell = (2 * np.pi * Q if d == 2 else 4 * np.pi * Q**2) * Q**2 / d
    assert integral(-shell * kernel.gradient(Q, d)) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("name", SMOOTHING)
def test_nothing_beyond_the_support(name):
    kernel = SMOOTHING[name]
    assert np.all(kernel.value(Q[kernel.support <= Q], 3) == 0)
    assert np.all(kernel.gradient(Q[kernel.support <= Q], 3) == 0)


@pytest.mark.parametrize("n", [0, 1, 7, 500])
def test_readings_find_what_all_bodies_show(n):
    """Own fluid, images of it in wall 0, bodies of two walls, ghosts and empty slots; beyond the end is nobody."""
    rng = np.random.default_rng(n)
    flags, key = np.zeros(n + 16, np.int32), rng.integers(0, 3, n + 16) << 56 | rng.integers(0, 3, n + 16)
    flags[:n], x = rng.choice([0, 33, 97, 34, 98], n), rng.normal(size=n + 16)
    own, images, wanted = flags & 65 == 65, np.array([0, 1, 0]), np.array([True, False])
    for sign in (1.0, -1.0):
        assert readings.farthest(n, sign, flags, x) == (sign * x[own]).max(initial=-np.inf)
    wall = np.where(key % 64 > 0, images[key % 64], key >> 56) - 1
    right = np.flatnonzero((flags != 0) & ~own & (wall == 0))
    slots, walls = np.empty((2, len(right)), np.int64)
    assert readings.of_walls(n, flags, key, images, wanted, slots[:0], walls[:0]) == len(right)
    readings.of_walls(n, flags, key, images, wanted, slots, walls)
    assert slots.tolist() == right.tolist() and not walls.any()


@pytest.mark.parametrize("template", [cells, motion, runs, totals])
def test_templates_mean_the_same_flags_and_keys(template):
    same = [name for name in vars(marks) if isinstance(getattr(template, name, None), int)]
    assert same and all(getattr(template, name) == getattr(marks, name) for name in same)
