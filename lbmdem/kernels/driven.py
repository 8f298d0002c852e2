"""Accelerations of the user's own on grains. They are compiled by the process that uses them, and kept by none."""

import functools
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.simd.compile import njit


def substep_kernel(acceleration: Callable, which: int, d: int) -> Callable:
    """A task of the kernel that ends a substep of the grains that have this acceleration."""
    of = njit(cache=False)(acceleration)

    @njit(cache=False)
    def own_acceleration(part, grain_cuts, grains, own, mass, clock, dt):
        """After the second half: velocities get half the change of this acceleration, own[n, 4], and the given forces
        all of it. clock[part, 2]: time at the start of the call (s), substeps done since.
        """
        clock[part, 1] += 1.0
        rows, given, t = grains.row, grains.given, clock[part, 0] + clock[part, 1] * dt
        for i in range(grain_cuts[part], grain_cuts[part + 1]):
            if own[i, 3] == which and rows[i, 7] > 0.0:
                row = rows[i]
                a = of((row[0], row[1], row[2]), (row[4], row[5], row[6]), t)
                for c in range(d):
                    change = mass[i] * (a[c] - own[i, c])
                    row[4 + c] += 0.5 * dt * row[7] * change
                    given[i, c] += change
                    own[i, c] = a[c]

    return own_acceleration


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
