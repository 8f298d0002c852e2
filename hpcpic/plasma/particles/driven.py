"""Accelerations of the user's own on the particles of a species. They are compiled by the process that uses them, and
kept by none.
"""

from collections.abc import Callable
from types import ModuleType

import numpy as np

from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.scratch import zeros
from hpcpic.plasma.kernels.storage import GOOD, PAGE
from hpcpic.plasma.particles.own_acceleration import own_acceleration, size, turned

NOT_FINITE = 16  # and the number of the species: what a task returns whose acceleration is no finite number


def driven_kernel(
    acceleration: Callable, kernels: ModuleType, species: int, d: int, spacing: tuple[float, ...]
) -> Callable:
    """The kernel of one species in a scene of these kernels. d: axes of the grid; spacing[v] in m: velocities v are in
    these per time step.
    """
    components, dx = len(spacing), np.array(spacing)
    settled = own_acceleration(njit(cache=False)(acceleration), components)
    anchor_in, place_of, centred_velocity = kernels.anchor_in, kernels.place_of, kernels.centred_velocity
    anchors = (2, 1, 8)  # of x, y, z in `parts`

    @njit(cache=False)
    def driven(first, last, grid, field, pages, half_kick, moment, own):
        """v += M a(x, w, t) dt^2 / spacing in cells per step, with w = P v- + N a(x, w, t) dt the mean of the
        velocities on both sides of the turn; moment = (t, time step, steps), own[species] = (M, P, N).
        """
        t, dt, steps = moment[0], moment[1], moment[2]
        to_turn, mean, share, kick = own[species, 0], own[species, 1], own[species, 2], half_kick[species]
        pool, lanes = pages.pool, pages.pool.shape[3]
        x, u, v = zeros(3, np.float64), zeros(3, np.float64), zeros(3, np.float64)
        for part in range(first, last):
            where = anchor_in(part, grid, field.origin)
            slot = part * grid.n_species + species
            page, used = np.int64(pages.head[slot]), (pages.count[slot] - 1) % PAGE + 1
            while page >= 0:
                for place in range(used):
                    pack, lane = place // lanes, place % lanes
                    for k in range(d):
                        x[k] = (grid.parts[part, anchors[k]] + pool[page, pack, k, lane]) * dx[k]
                    for k in range(components):
                        v[k] = pool[page, pack, d + k, lane]
                    centred = centred_velocity(place_of(pool, page, pack, lane), v, where, field, kick)
                    for k in range(components):
                        u[k] = (v[k] + steps * (centred[k] - v[k])) * (dx[k] / dt)
                    a = settled((x[0], x[1], x[2]), turned(mean, u), share, t, dt, steps < 0.0)
                    if not size(a) < np.inf:
                        return NOT_FINITE + species
                    pushed = turned(to_turn, a)
                    for k in range(components):
                        pool[page, pack, d + k, lane] += pushed[k] * dt * dt / dx[k]
                page, used = np.int64(pages.chain[page]), PAGE
        return GOOD

    return driven
