"""Accelerations of the user's own on grains. They are compiled by the process that uses them, and kept by none."""

import functools
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.simd.compile import njit


def driven(acceleration: Callable, x: NDArray, v: NDArray, t: float) -> NDArray[np.float64]:
    """a[n, d] in m/s2 of grains at x[n, d] in m, with velocities v[n, d] in m/s, at the time t in s."""
    n, d = x.shape
    full = np.zeros((3, n, 3))
    full[0, :, :d], full[1, :, :d] = x, v
    _loop(acceleration)(full, t)
    return full[2, :, :d]


@functools.cache
def _loop(acceleration: Callable) -> Callable:
    of = njit(cache=False)(acceleration)

    @njit(cache=False)
    def loop(full, t):
        x, v, a = full[0], full[1], full[2]
        for i in range(x.shape[0]):
            a[i, 0], a[i, 1], a[i, 2] = of((x[i, 0], x[i, 1], x[i, 2]), (v[i, 0], v[i, 1], v[i, 2]), t)

    return loop
