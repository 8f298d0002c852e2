"""Accelerations of the user's own on particles of fluids. They are compiled by the process that uses them, and kept by
none.
"""

from collections.abc import Callable

import numpy as np

from hpcpic.core.simd.compile import njit
from sph.kernels.marks import CODES, MINE


def driven_kernel(acceleration: Callable, axes: tuple[int, ...], first: int, end: int) -> Callable:
    """The kernel for fluid of the numbers first to end; storage axis k is physical axis axes[k]."""
    of = njit(cache=False)(acceleration)
    d = len(axes)
    at = np.array([axes.index(k) for k in range(d)] + [0] * (3 - d))
    there = np.array([1.0] * d + [0.0] * (3 - d))

    @njit(cache=False)
    def driven(chunk, chunks, flags, key, moment, corner, x, v, own):
        """own = a(x, v, t); moment[0] = t, corner: of the domain, m."""
        for b in range(chunks[chunk], chunks[chunk + 1]):
            number = key[b] // CODES
            if flags[b] & MINE == MINE and first <= number < end:
                p, q, r = at[0], at[1], at[2]
                place = (x[p, b] + corner[p], x[q, b] + corner[q], there[2] * (x[r, b] + corner[r]))
                a = of(place, (v[p, b], v[q, b], there[2] * v[r, b]), moment[0])
                for k in range(d):
                    own[at[k], b] = a[k]

    return driven
