"""The sums by which particles are spread evenly at the start, over pairs of them."""

import numpy as np

from hpcpic.core.simd.compile import njit


@njit
def pushes(x, first, second, reach, period, found):
    """Add (1 - r / reach)^3 r_ij of the pairs `first`, `second` to found[n, d] of first, less it to that of second: the
    slope of Wendland's C2 kernel, in m. x[n, d] m; period[d] m, 0: none.
    """
    d = x.shape[1]
    apart = np.zeros(d)
    for pair in range(first.size):
        i, j, square = first[pair], second[pair], 0.0
        for k in range(d):
            apart[k] = x[i, k] - x[j, k]
            if period[k] > 0.0:
                apart[k] -= period[k] * np.rint(apart[k] / period[k])
            square += apart[k] * apart[k]
        if square < reach * reach:
            far = 1.0 - np.sqrt(square) / reach
            for k in range(d):
                push = far * far * far * apart[k]
                found[i, k] += push
                found[j, k] -= push
