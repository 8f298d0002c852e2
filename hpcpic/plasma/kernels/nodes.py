"""Sums over the nodes of a slab as integers, so that no order shows: the field's energy and E_x by columns."""

import numpy as np

from hpcpic.core.simd.compile import njit

LIMIT = 2.0**900  # terms beyond it are no numbers of a solution


@njit
def bounded(magnitude):
    """The magnitude, infinity if it is beyond LIMIT or not a number."""
    return magnitude if magnitude < LIMIT else np.inf


@njit
def node_sums(first, last, share, corners, background, inv_scale, rho, phi, e_x, limbs, columns, most):
    """Sums over rows first .. last of rho[rows, columns], into [share] of limbs, columns and most.

    limbs[share, 3]: (rho + background) phi, inv_scale[0] = 1 / scale (core.space.exact); columns[share, columns]:
    E_x in units of 1 / inv_scale[1], rounded; both are garbage beyond their scale. most[share, 2]: the largest
    magnitude of a term of each, or infinity. corners[2, 2]: where the slab begins in phi and in e_x.
    """
    limbs, columns, most = limbs[share], columns[share], most[share]
    limbs[:], columns[:], most[:] = 0, 0, 0
    top, left, row, column = corners[0, 0], corners[0, 1], corners[1, 0], corners[1, 1]
    for i in range(first, last):
        high, middle, low = np.int64(0), np.int64(0), np.int64(0)
        energy = field = 0.0
        for j in range(rho.shape[1]):
            term = (rho[i, j] + background) * phi[top + i, left + j]
            t = term * inv_scale[0] * 2.0**31
            h = np.rint(t)
            t = (t - h) * 2.0**32
            m = np.rint(t)
            high += np.int64(h)
            middle += np.int64(m)
            low += np.int64(np.rint((t - m) * 2.0**32))
            e = e_x[row + i, column + j]
            columns[j] += np.int64(np.rint(e * inv_scale[1]))
            energy, field = max(energy, bounded(abs(term))), max(field, bounded(abs(e)))
        limbs[0] += high
        limbs[1] += middle
        limbs[2] += low
        most[0], most[1] = max(most[0], energy), max(most[1], field)
