"""Accelerations of the user's own on the particles of a species. They are compiled by the process that uses them, and
kept by none.
"""

from collections.abc import Callable

import numpy as np

from hpcpic.core.simd.compile import njit
from hpcpic.plasma.kernels.storage import PAGE


def driven_kernel(acceleration: Callable, species: int, d: int, spacing: tuple[float, ...]) -> Callable:
    """The kernel of one species. d: axes of the grid; spacing[v] in m: velocities v are in these per time step."""
    of, components, dx = njit(cache=False)(acceleration), len(spacing), np.array(spacing)
    anchors = (2, 1, 8)  # of x, y, z in `parts`

    @njit(cache=False)
    def driven(first, last, grid, pages, moment):
        """v += M a(x, v, t) dt^2 / spacing in cells per step; moment = (t, time step, M of each species, by rows)."""
        t, dt, m = moment[0], moment[1], moment[2 + 9 * species :]
        lanes = pages.pool.shape[3]
        x, v = np.zeros(3), np.zeros(3)
        for part in range(first, last):
            slot = part * grid.n_species + species
            page, used = np.int64(pages.head[slot]), (pages.count[slot] - 1) % PAGE + 1
            while page >= 0:
                for place in range(used):
                    here, lane = pages.pool[page, place // lanes], place % lanes
                    for k in range(d):
                        x[k] = (grid.parts[part, anchors[k]] + here[k, lane]) * dx[k]
                    for k in range(components):
                        v[k] = here[d + k, lane] * dx[k] / dt
                    a = of((x[0], x[1], x[2]), (v[0], v[1], v[2]), t)
                    for k in range(components):
                        pushed = m[3 * k] * a[0] + m[3 * k + 1] * a[1] + m[3 * k + 2] * a[2]
                        here[d + k, lane] += pushed * dt * dt / dx[k]
                page, used = np.int64(pages.chain[page]), PAGE

    return driven
