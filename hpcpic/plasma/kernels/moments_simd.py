"""The moments by vectors: the same limbs, bit for bit, as kernels.moments.

A limb is rounded by adding a number so large that its last bit is the unit of the limb (core.space.exact), and the
bits of these sums are added up as integers: what the large numbers contribute is taken off at the end. As in the
push, one loop over a page tells where the lines of the cells are, and another reads them: no load waits for a store.
"""

import numpy as np

from hpcpic.core.simd.vector import (
    Vec,
    bitmask,
    convert,
    fma,
    halves,
    lane_numbers,
    load_at,
    prefetch,
    select,
    splat,
    store_at,
    total,
)
from hpcpic.core.space.exact import NOT_BOUNDED
from hpcpic.plasma.kernels.cell_lines import opaque
from hpcpic.plasma.kernels.lanes import address, bits_of, inlined, kernel
from hpcpic.plasma.kernels.linear import EDGE, field_at, spread_field
from hpcpic.plasma.kernels.moments import MOMENTS, SAMPLE_LIMBS, add_place, integrands
from hpcpic.plasma.kernels.push import PACK_BYTES, PAGE_BYTES, find_lines, park, place_in_cell
from hpcpic.plasma.kernels.simd_base import E8, MAGIC_BITS, F, I, position_at
from hpcpic.plasma.kernels.storage import LANES, PAGE
from hpcpic.plasma.physics.boris import EXACT_ABOUT_ANY, impulse_along

DIM = 2  # axes of the grid
VELOCITIES = 2  # components
ROTATION = 0  # kind of rotation, see physics.boris

WORDS = Vec(8, np.int64)
HIGH, MIDDLE = 1.5 * 2.0**21, 1.5 * 2.0**-11  # with 2^-31 and 2^-63 as last bits
BIASES = np.array([HIGH, MIDDLE]).view(np.int64)
HALVES = LANES // 8  # vectors of float64 in a pack
MOMENT_BYTES = SAMPLE_LIMBS * 64  # of the sums of bits of one moment


@inlined
def add_moments(bits, good, vx, vy, vz, ratio_sq, inv_scale):
    """Add the biased limbs of the moments of eight particles at an address; good: all were within the scales."""
    found = integrands(vx, vy, vz, ratio_sq[0] * vx * vx + ratio_sq[1] * vy * vy + ratio_sq[2] * vz * vz)
    for k in range(MOMENTS):
        at, high = bits + k * MOMENT_BYTES, fma(found[k], inv_scale[k], HIGH)
        whole = high - HIGH
        good = good & (abs(whole) <= 1.0)
        middle = fma(found[k], inv_scale[k], -whole) + MIDDLE
        store_at(at, load_at(WORDS, at, 64) + bits_of(high), 64)
        store_at(at + 64, load_at(WORDS, at + 64, 64) + bits_of(middle), 64)
    return good


@inlined
def half(v, k):
    """Eight lanes of a pack as float64."""
    if LANES == 8:
        return convert(E8, v)
    return convert(E8, halves(v)[0]) if k == 0 else convert(E8, halves(v)[1])


@inlined
def centred(at, n, lines, cells, m):
    """v- of one pack, whose lanes from n on are parked: zero there. `cells`: see find_lines."""
    vx = load_at(F, at + 64 * DIM, 64)
    vy = vz = splat(F, 0.0)
    ex, ey, ez = field_at(lines - MAGIC_BITS, cells, place_in_cell(position_at(F, at)))
    vx = fma(m[0], ex, vx)
    if DIM > 1:
        vy = fma(m[1], ey, load_at(F, at + 64 * (DIM + 1), 64))
    elif VELOCITIES > 1:
        vy = select(lane_numbers(I) < n, load_at(F, at + 64 * 2, 64) + m[1], 0)
    if DIM == 3:
        vz = fma(m[2], ez, load_at(F, at + 64 * 5, 64))
    elif VELOCITIES > 2:
        vz = select(lane_numbers(I) < n, load_at(F, at + 64 * (DIM + 2), 64) + m[2], 0)
    if ROTATION == EXACT_ABOUT_ANY:
        along = select(lane_numbers(I) < n, impulse_along(ex, ey, ez, m[3], m[4], m[5], DIM), 0)
        vx, vy, vz = fma(m[6], along, vx), fma(m[7], along, vy), fma(m[8], along, vz)
    return vx, vy, vz


@inlined
def kick_of(kicks, kind):
    """The row of a species in half_kick (Scene.half_kicks), as numbers."""
    m = kicks[kind]
    return m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8]


@inlined
def middle(at, axis, k):
    """x^n - v^(n-1/2) / 2 along an axis of eight lanes of a pack, parked ones included."""
    return half(load_at(F, at + 64 * axis, 64), k) - 0.5 * half(load_at(F, at + 64 * (DIM + axis), 64), k)


@kernel
def moments(block, first, last, grid, field, pages, scratch, moment_sums):
    """limbs[block, species, k] += sums over particles of the k-th integrand of v-. See kernels.moments.moments."""
    limbs, bits = moment_sums.limbs[block], moment_sums.bits[block]
    base, to_bits = address(pages.pool), address(bits)
    to_lines, to_cells = address(scratch.lines[block]), address(scratch.cells[block])
    r, inv_scale, half_kick = moment_sums.ratio_sq, moment_sums.inv_scale, moment_sums.half_kick
    ratios, good = (r[0], r[1], r[2]), splat(E8, 0.0) <= 1.0
    places = moment_sums.places[block]
    for part in range(first, last):
        row = grid.parts[part]
        spread_field(part, grid, field, to_lines)
        for slot in range(part * grid.n_species, (part + 1) * grid.n_species):
            kind = slot % grid.n_species
            m = kick_of(half_kick, kind)
            page, used, n = np.int64(pages.head[slot]), (pages.count[slot] - 1) % PAGE + 1, 0
            bits[:] = 0
            if page >= 0:
                park(pages.pool, page, used)
            while page >= 0:
                at, packs = base + page * PAGE_BYTES, (used + LANES - 1) // LANES
                page = np.int64(pages.chain[page])
                ahead = base + page * PAGE_BYTES if page >= 0 else at
                along = across = up = splat(E8, 0.0)
                for pack in range(packs):
                    find_lines(opaque(at + pack * PACK_BYTES), opaque(to_cells + pack * 64))
                for pack in range(packs):
                    for c in range(0, PACK_BYTES, 64):
                        prefetch(ahead + pack * PACK_BYTES + c)
                    here, cells = opaque(at + pack * PACK_BYTES), opaque(to_cells + pack * 64)
                    vx, vy, vz = centred(here, used - pack * LANES, to_lines, cells, m)
                    for k in range(HALVES):
                        along = along + middle(here, 0, k)
                        if DIM > 1:
                            across = across + middle(here, 1, k)
                        if DIM == 3:
                            up = up + middle(here, 2, k)
                    good = add_moments(to_bits, good, half(vx, 0), half(vy, 0), half(vz, 0), ratios, inv_scale)
                    if HALVES == 2:
                        good = add_moments(to_bits, good, half(vx, 1), half(vy, 1), half(vz, 1), ratios, inv_scale)
                at_edge = float(EDGE * (packs * LANES - used))  # parked, at rest at EDGE of the last axis
                add_place(places[kind, 0], total(along) - (at_edge if DIM == 1 else 0.0), row[2], used)
                if DIM > 1:
                    add_place(places[kind, 1], total(across) - (at_edge if DIM == 2 else 0.0), row[1], used)
                if DIM == 3:
                    add_place(places[kind, 2], total(up) - at_edge, row[8], used)
                n += packs * HALVES
                used = PAGE
            for k in range(MOMENTS):
                for limb in range(SAMPLE_LIMBS):
                    limbs[kind, k, limb] += bits[k, limb].sum() - 8 * n * BIASES[limb]
    return 0 if bitmask(good) == 255 else NOT_BOUNDED
