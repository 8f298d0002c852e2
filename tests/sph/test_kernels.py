import numpy as np
import pytest

from sph.kernels.functions import SMOOTHING

Q = np.linspace(0.0, 3.0, 300001)


def integral(values):
    return np.sum(values[1:] + values[:-1]) / 2 * (Q[1] - Q[0])


@pytest.mark.parametrize("name", SMOOTHING)
@pytest.mark.parametrize("d", [2, 3])
def test_kernels_are_normalised(name, d):
    shell = 2 * np.pi * Q if d == 2 else 4 * np.pi * Q**2
    assert integral(shell * SMOOTHING[name].w(Q, d)) == pytest.approx(1.0, abs=1e-9)  # of the trapezoidal rule


@pytest.mark.parametrize("name", SMOOTHING)
def test_the_gradient_is_that_of_the_kernel(name):
    kernel = SMOOTHING[name]
    slope = np.diff(kernel.w(Q, 3)) / np.diff(Q)
    middle = (Q[1:] + Q[:-1]) / 2
    assert np.abs(slope - kernel.f(middle, 3) * middle).max() < 1e-9  # (Q step)^2 times a third derivative below 10


@pytest.mark.parametrize("name", SMOOTHING)
@pytest.mark.parametrize("d", [2, 3])
def test_a_linear_field_has_its_gradient(name, d):
    """- integral x F x_a^2 = 1: the gradient of x is 1."""
    kernel = SMOOTHING[name]
    shell = (2 * np.pi * Q if d == 2 else 4 * np.pi * Q**2) * Q**2 / d
    assert integral(-shell * kernel.f(Q, d)) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("name", SMOOTHING)
def test_nothing_beyond_the_support(name):
    kernel = SMOOTHING[name]
    assert np.all(kernel.w(Q[kernel.support <= Q], 3) == 0)
    assert np.all(kernel.f(Q[kernel.support <= Q], 3) == 0)
