"""Sums over the particles of one block at the time of their positions, as exact integers: what the series is made of.

The integrands are functions of the velocity that are compiled for numbers here and for vectors in moments_simd; those
of a run take the place of `integrands` (see physics.moments).
"""

import numpy as np

from hpcpic.core.simd.vector import fma
from hpcpic.core.space.exact import add_limbs
from hpcpic.plasma.kernels.lanes import inlined, kernel
from hpcpic.plasma.kernels.plain import gather
from hpcpic.plasma.kernels.storage import LANES, PAGE

DIM = 2  # axes of the grid
VELOCITIES = 2  # components
MOMENTS = 3  # values that `integrands` gives


@inlined
def integrands(vx, vy, vz, square):
    """|v|^2 and the first components of v."""
    return square, vx, vy


@inlined
def centred_velocity(x, y, v, row, column, field, half_kick):
    """v- of a particle at (x, y) in cells from an anchor: v^(n-1/2) with half the electric impulse."""
    e_x, e_y, scale = field.e_x, field.e_y, field.scale
    vx = np.float64(fma(half_kick[0], gather(e_x, row, column, x, y, scale), v[0]))
    vy = vz = 0.0
    if DIM == 2:
        vy = np.float64(fma(half_kick[1], gather(e_y, row, column, x, y, scale), v[1]))
    elif VELOCITIES > 1:
        vy = np.float64(v[1] + half_kick[1])
    if VELOCITIES > 2:
        vz = np.float64(v[2] + half_kick[2])
    return vx, vy, vz


@kernel
def moments(block, first, last, grid, field, pages, moment_sums):
    """limbs[block, species, k] += sums over particles of the k-th integrand of v-.

    v- = v^(n-1/2) + half the electric impulse: in a magnetic field only its direction differs from that of v^n.
    Components in cells per step, squares in (side of a cell along x per step)^2. Returns a code of core.space.exact.
    """
    parts, pool, origin, r = grid.parts, pages.pool, field.origin, moment_sums.ratio_sq
    values, limbs, inv_scale = moment_sums.values[block], moment_sums.limbs[block], moment_sums.inv_scale
    bad = 0
    for part in range(first, last):
        row, column = parts[part, 1] - origin[0], parts[part, 2] - origin[1]
        for slot in range(part * grid.n_species, (part + 1) * grid.n_species):
            kind = slot % grid.n_species
            page, used = np.int64(pages.head[slot]), (pages.count[slot] - 1) % PAGE + 1
            while page >= 0:
                for place in range(used):
                    pack, lane = place // LANES, place % LANES
                    x, y = pool[page, pack, 0, lane], pool[page, pack, DIM - 1, lane]
                    v = pool[page, pack, DIM:, lane]
                    vx, vy, vz = centred_velocity(x, y, v, row, column, field, moment_sums.half_kick[kind])
                    found = integrands(vx, vy, vz, r[0] * vx * vx + r[1] * vy * vy + r[2] * vz * vz)
                    for k in range(MOMENTS):
                        values[k, place] = found[k]
                for k in range(MOMENTS):
                    bad |= add_limbs(limbs[kind, k], values[k, :used], inv_scale[k])
                page, used = np.int64(pages.chain[page]), PAGE
    return bad
