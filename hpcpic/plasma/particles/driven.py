"""Accelerations of the user's own on the particles of a species. They are compiled by the process that uses them, and
kept by none.
"""

from collections.abc import Callable
from types import ModuleType

import numpy as np

from hpcpic.core.simd.compile import njit
from hpcpic.plasma.kernels.storage import PAGE

MOST_CHORDS = 20  # of Newton's method with one Jacobian: 1 where the acceleration is linear in the velocity
SETTLED = 1e-12  # of a velocity


@njit(cache=False)
def turned(m, v):
    return (
        m[0, 0] * v[0] + m[0, 1] * v[1] + m[0, 2] * v[2],
        m[1, 0] * v[0] + m[1, 1] * v[1] + m[1, 2] * v[2],
        m[2, 0] * v[0] + m[2, 1] * v[1] + m[2, 2] * v[2],
    )


@njit(cache=False)
def cross(p, q):
    return p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]


@njit(cache=False)
def dot(p, q):
    return p[0] * q[0] + p[1] * q[1] + p[2] * q[2]


@njit(cache=False)
def size(v):
    return abs(v[0]) + abs(v[1]) + abs(v[2])


@njit(cache=False)
def beyond(v, a, dt):
    return v[0] + a[0] * dt, v[1] + a[1] * dt, v[2] + a[2] * dt


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
    def column(x, w, a, t, h, axis, share, dt):
        """A column of the derivative by w of w - N a(x, w, t) dt, by a finite change h of w along an axis."""
        unit = (1.0 * (axis == 0), 1.0 * (axis == 1), 1.0 * (axis == 2))
        if axis >= components:
            return unit
        there = of(x, beyond(w, unit, h), t)
        return beyond(unit, turned(share, (there[0] - a[0], there[1] - a[1], there[2] - a[2])), -dt / h)

    @njit(cache=False)
    def settled(x, without, share, t, dt):
        """a(x, w, t) at w = without + N a(x, w, t) dt."""
        first = of(x, without, t)
        w = beyond(without, turned(share, first), dt)
        a = of(x, w, t)
        h = size(w) + abs(dt) * size(a)
        if (a[0] == first[0] and a[1] == first[1] and a[2] == first[2]) or h == 0.0:
            return a
        p, q = column(x, w, a, t, h, 0, share, dt), column(x, w, a, t, h, 1, share, dt)
        r = column(x, w, a, t, h, 2, share, dt)
        qr, rp, pq = cross(q, r), cross(r, p), cross(p, q)
        for _ in range(MOST_CHORDS):
            misses = beyond(beyond(without, turned(share, a), dt), w, -1.0)
            change = dot(misses, qr), dot(misses, rp), dot(misses, pq)
            w = beyond(w, change, 1.0 / dot(p, qr))
            if size(change) <= SETTLED * abs(dot(p, qr)) * size(w):
                break
            a = of(x, w, t)
        return a

    @njit(cache=False)
    def driven(first, last, grid, field, pages, half_kick, moment, own):
        """v += M a(x, w, t) dt^2 / spacing in cells per step, with w = P v- + N a(x, w, t) dt the mean of the
        velocities on both sides of the turn; moment = (t, time step, steps), own[species] = (M, P, N).
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
                    a = settled((x[0], x[1], x[2]), turned(mean, u), share, t, dt)
                    pushed = turned(to_turn, a)
                    for k in range(components):
                        pool[page, pack, d + k, lane] += pushed[k] * dt * dt / dx[k]
                page, used = np.int64(pages.chain[page]), PAGE

    return driven
