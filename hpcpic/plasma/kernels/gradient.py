"""E = -grad phi by centred differences (5.13), with its own spacing along each axis."""

import numpy as np

from hpcpic.core.simd.compile import njit

_1, _2 = np.uint64(1), np.uint64(2)  # signed indices would keep the loops scalar


@njit
def embed(first, last, row, column, n_columns, inner, values):
    """values[row:, column:] = inner[:, :n_columns] for the rows first:last of inner."""
    for r in range(first, last):
        values[row + r, column : column + n_columns] = inner[r, :n_columns]


@njit
def minus_gradient_1d(first, last, phi, e, per_2dx, e0_x):
    """E_x(i) = e0_x + (phi(i - 1) - phi(i + 1)) / (2 dx) on nodes first..last - 1 of e[0].

    phi has one node more than e on each side: phi[nx + 3] with one ghost left and two right for e[1, nx + 1]
    with one ghost right, or wider; per_2dx = 1 / (2 dx).
    """
    for i in range(np.uint64(first), np.uint64(last)):
        e[0, i] = e0_x + per_2dx * (phi[i] - phi[i + _2])


@njit
def minus_gradient_2d(first, last, phi, e, per_2dx, per_2dy, e0_x, e0_y):
    """E = e0 - grad phi (5.13) on rows first..last - 1 of e; the bits do not depend on how rows are cut.

    phi has one node more than e on each side: phi[ny + 3, nx + 3] with one ghost row below and two above, one
    ghost column left and two right for e[2, ny + 1, nx + 1] (components x and y), or wider;
    per_2dx = 1 / (2 dx), per_2dy = 1 / (2 dy); the uniform external field (e0_x, e0_y) is added.
    """
    for j in range(first, last):
        below, here, above = phi[j], phi[j + 1], phi[j + 2]
        e_x, e_y = e[0, j], e[1, j]
        for i in range(np.uint64(e_x.size)):
            e_x[i] = e0_x + per_2dx * (here[i] - here[i + _2])
            e_y[i] = e0_y + per_2dy * (below[i + _1] - above[i + _1])
