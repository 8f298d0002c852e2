"""Sums over the particles of one block at the time of their positions, as exact integers: what the series is made of.

The integrands are functions of the velocity that are compiled for numbers here and for vectors in moments_simd; those
of a run take the place of `integrands` (see physics.moments).
"""

import numpy as np

from hpcpic.core.simd.vector import fma
from hpcpic.core.space.exact import add_limbs
from hpcpic.plasma.kernels.lanes import inlined, kernel
from hpcpic.plasma.kernels.mesh import bounded
from hpcpic.plasma.kernels.storage import LANES, PAGE, place_of
from hpcpic.plasma.kernels.weights import anchor_in, deposit, gather
from hpcpic.plasma.physics.boris import EXACT_ABOUT_ANY, impulse_along
from hpcpic.plasma.sizes import PLACE_BITS

DIM = 2  # axes of the grid
VELOCITIES = 2  # components
ROTATION = 0  # kind of rotation, see physics.boris
REAL = np.float64  # precision of the arithmetic
MOMENTS = 3  # values that `integrands` gives
CELL_PARTS, LAST_PART = 2.0**PLACE_BITS, 2**PLACE_BITS - 1
SAMPLE_LIMBS = 2  # of three: with 2^-63 of the scale as last bit, which no double of a sum can show


@inlined
def integrands(vx, vy, vz, square):
    """|v|^2 and the first components of v."""
    return square, vx, vy


@inlined
def centred_velocity(x, v, where, field, half_kick):
    """v- of a particle at x in cells from an anchor: v^(n-1/2) with half the electric impulse; `where` see gather."""
    ex = gather(field, 0, where, x)
    ey, ez = ex, ex
    vx = fma(REAL(half_kick[0]), ex, REAL(v[0]))
    vy = vz = REAL(0)
    if DIM > 1:
        ey = gather(field, 1, where, x)
        vy = fma(REAL(half_kick[1]), ey, REAL(v[1]))
    elif VELOCITIES > 1:
        vy = REAL(v[1] + half_kick[1])
    if DIM == 3:
        ez = gather(field, 2, where, x)
        vz = fma(REAL(half_kick[2]), ez, REAL(v[2]))
    elif VELOCITIES > 2:
        vz = REAL(v[2] + half_kick[2])
    if ROTATION == EXACT_ABOUT_ANY:
        m = half_kick
        along = impulse_along(ex, ey, ez, REAL(m[3]), REAL(m[4]), REAL(m[5]), DIM)
        vx, vy, vz = fma(REAL(m[6]), along, vx), fma(REAL(m[7]), along, vy), fma(REAL(m[8]), along, vz)
    return np.float64(vx), np.float64(vy), np.float64(vz)


@inlined
def add_place(found, total, anchor, n):
    """found[2] += cells and parts of a cell, carried, of n particles whose places from an anchor add up to a total.

    Of a page at most: its total is rounded by less than a part for each, that of a full tile by what tells damage.
    """
    cells = np.floor(total)
    parts = found[1] + np.int64(np.rint((total - cells) * CELL_PARTS))
    found[0] += n * anchor + np.int64(cells) + (parts >> PLACE_BITS)
    found[1] = parts & LAST_PART


@kernel
def moments(block, first, last, grid, field, pages, moment_sums):
    """limbs[block, species, k] += sums over particles of the k-th integrand of v-.

    v- = v^(n-1/2) + half the electric impulse: in a magnetic field only its direction differs from that of v^n.
    places[block, species, axis] += sums of (x^n + x^(n-1)) / 2 = x^n - v^(n-1/2) / 2 in the box, see add_place.
    Components in cells per step, squares in (side of a cell along x per step)^2. Returns a code of core.space.exact.
    """
    parts, pool, r = grid.parts, pages.pool, moment_sums.ratio_sq
    values, limbs, inv_scale = moment_sums.values[block], moment_sums.limbs[block], moment_sums.inv_scale
    bad, places = 0, moment_sums.places[block]
    for part in range(first, last):
        where = anchor_in(part, grid, field.origin)
        for slot in range(part * grid.n_species, (part + 1) * grid.n_species):
            kind = slot % grid.n_species
            page, used = np.int64(pages.head[slot]), (pages.count[slot] - 1) % PAGE + 1
            while page >= 0:
                for place in range(used):
                    pack, lane = place // LANES, place % LANES
                    x, v = place_of(pool, page, pack, lane), pool[page, pack, DIM:, lane]
                    add_place(places[kind, 0], np.float64(x[0]) - 0.5 * np.float64(v[0]), parts[part, 2], 1)
                    if DIM > 1:
                        add_place(places[kind, 1], np.float64(x[1]) - 0.5 * np.float64(v[1]), parts[part, 1], 1)
                    if DIM == 3:
                        add_place(places[kind, 2], np.float64(x[2]) - 0.5 * np.float64(v[2]), parts[part, 8], 1)
                    vx, vy, vz = centred_velocity(x, v, where, field, moment_sums.half_kick[kind])
                    found = integrands(vx, vy, vz, r[0] * vx * vx + r[1] * vy * vy + r[2] * vz * vz)
                    for k in range(MOMENTS):
                        values[k, place] = found[k]
                for k in range(MOMENTS):
                    bad |= add_limbs(limbs[kind, k], values[k, :used], inv_scale[k])
                    limbs[kind, k, SAMPLE_LIMBS:] = 0
                page, used = np.int64(pages.chain[page]), PAGE
    return bad


@inlined
def whole_velocity(v, side, turn):
    """v^n of v-, in cells along x per step: its rotation by half an angle, `turn` less the identity."""
    x, y, z = v[0] * side[0], v[1] * side[1], v[2] * side[2]
    return (
        x + (turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z),
        y + (turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z),
        z + (turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z),
    )


@kernel
def node_moments(block, first, last, grid, field, pages, node_sums, patch):
    """patch.nodes[0] = particles of a species in parts, nodes[1 + k] = their sums of the k-th integrand of v^n.

    All values of a particle are shared among nodes as charge is. REAL is double precision whatever that of particles.
    """
    pool, nodes = pages.pool, patch.nodes
    kind, whole, per_scale, most = node_sums.sampled[0], node_sums.whole[0], node_sums.per_scale, 0.0
    half_kick, half_turn = node_sums.node_half_kick[kind], node_sums.half_turn[kind]
    nodes[:] = 0
    for part in range(first, last):
        in_field, in_patch = anchor_in(part, grid, field.origin), anchor_in(part, grid, patch.corner)
        slot = part * grid.n_species + kind
        page, used = np.int64(pages.head[slot]), (pages.count[slot] - 1) % PAGE + 1
        while page >= 0:
            for place in range(used):
                pack, lane = place // LANES, place % LANES
                at = place_of(pool, page, pack, lane)
                x = REAL(at[0]), REAL(at[1]), REAL(at[2])
                v = centred_velocity(x, pool[page, pack, DIM:, lane], in_field, field, half_kick)
                vx, vy, vz = whole_velocity(v, node_sums.side, half_turn)
                most = max(most, bounded(max(abs(vx), abs(vy), abs(vz))))
                found = integrands(vx, vy, vz, vx * vx + vy * vy + vz * vz)
                deposit(nodes, 0, whole, in_patch, x)
                for k in range(MOMENTS):
                    value = np.int64(np.rint(found[k] * per_scale[k]))
                    deposit(nodes, 1 + k, value, in_patch, x)
            page, used = np.int64(pages.chain[page]), PAGE
    node_sums.fastest[block] = most
