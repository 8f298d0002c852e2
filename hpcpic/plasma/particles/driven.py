"""Accelerations of the user's own on the particles of a species. They are compiled by the process that uses them, and
kept by none.
"""

from collections.abc import Callable
from types import ModuleType

import numpy as np

from hpcpic.core.simd.compile import njit
from hpcpic.plasma.kernels.storage import PAGE

MOST_TURNS = 40  # of the iteration below, which gains a factor of wc dt/2 or nu dt/2 each time
SETTLED = 1e-12  # of a velocity


def driven_kernel(
    acceleration: Callable, kernels: ModuleType, species: int, d: int, spacing: tuple[float, ...]
) -> Callable:
    """The kernel of one species in a scene of these kernels. d: axes of the grid; spacing[v] in m: velocities v are in
    these per time step.
    """
    of, components, dx = njit(cache=False)(acceleration), len(spacing), np.array(spacing)
    anchor_in, place_of, centred_velocity = kernels.anchor_in, kernels.place_of, kernels.centred_velocity
    anchors = (2, 1, 8)  # of x, y, z in `parts`

    @njit(cache=False)
    def turned(m, v):
        return (
            m[0, 0] * v[0] + m[0, 1] * v[1] + m[0, 2] * v[2],
            m[1, 0] * v[0] + m[1, 1] * v[1] + m[1, 2] * v[2],
            m[2, 0] * v[0] + m[2, 1] * v[1] + m[2, 2] * v[2],
        )

    @njit(cache=False)
    def driven(first, last, grid, field, pages, half_kick, moment, own):
        """v += M a(x, w, t) dt^2 / spacing in cells per step, with w = P v- + N a(x, w, t) dt the mean of the
        velocities before and after all impulses of the time; moment = (t, time step, steps), own[species] = (M, P, N).
        """
        t, dt, steps = moment[0], moment[1], moment[2]
        to_turn, mean, share, kick = own[species, 0], own[species, 1], own[species, 2], half_kick[species]
        pool, lanes = pages.pool, pages.pool.shape[3]
        x, u, v = np.zeros(3), np.zeros(3), np.zeros(3)
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
                    without = turned(mean, u)
                    w = without
                    for _ in range(MOST_TURNS):
                        a = of((x[0], x[1], x[2]), w, t)
                        gained, before = turned(share, a), w
                        w = (without[0] + gained[0] * dt, without[1] + gained[1] * dt, without[2] + gained[2] * dt)
                        change = abs(w[0] - before[0]) + abs(w[1] - before[1]) + abs(w[2] - before[2])
                        if change <= SETTLED * (abs(w[0]) + abs(w[1]) + abs(w[2])):
                            break
                    pushed = turned(to_turn, a)
                    for k in range(components):
                        pool[page, pack, d + k, lane] += pushed[k] * dt * dt / dx[k]
                page, used = np.int64(pages.chain[page]), PAGE

    return driven
