"""Counts of the particles of one block in bins of position and velocity, at the time of their positions.

As in moments_simd, from which the velocities are: one loop over a page tells where the lines of the cells are, the next
one leaves the bins of a pack where these were, and a last one counts.
"""

import numpy as np

from hpcpic.core.simd.vector import Vec, convert, floor, fma, lane_numbers, minimum, prefetch, select, splat, store_at
from hpcpic.plasma.kernels.cell_lines import add_whole, opaque
from hpcpic.plasma.kernels.lanes import address, inlined, kernel
from hpcpic.plasma.kernels.linear import spread_field
from hpcpic.plasma.kernels.moments_simd import HALVES, centred, half, kick_of
from hpcpic.plasma.kernels.push import PACK_BYTES, PAGE_BYTES, find_lines, park
from hpcpic.plasma.kernels.simd_base import E8, F, position_at
from hpcpic.plasma.kernels.storage import LANES, PAGE

DIM = 2  # axes of the grid

COUNTS = Vec(8, np.int32)  # 2^32 particles of a species: read as numbers without sign


@inlined
def bin_along(u, w, bins):
    """The bin in which u.w + w[6] lies, and whether it is one. A bin begins at its lower edge; the last one holds its
    upper edge too.
    """
    t = fma(u[3], w[3], fma(u[4], w[4], fma(u[5], w[5], splat(E8, w[6]))))
    if DIM == 3:
        t = fma(u[2], w[2], t)
    t = fma(u[0], w[0], fma(u[1], w[1], t))
    inside = (t >= 0.0) & (t <= bins)
    return floor(minimum(select(inside, t, 0.0), splat(E8, bins - 1))), inside


@inlined
def store_bins(at, u, used, weights, bins):
    """Places [bytes] in the counts of eight particles, of which the first `used` are some, to an address."""
    slow, inside = bin_along(u, weights[0], bins[0])
    fast, too = bin_along(u, weights[1], bins[1])
    place = select(inside & too, fma(slow, bins[1], fast), bins[0] * bins[1])
    place = select(convert(E8, lane_numbers(COUNTS)) < used, place, bins[0] * bins[1] + 1)
    store_at(at, convert(COUNTS, place * 4.0), 32)


@kernel
def count_particles(block, first, last, grid, field, pages, scratch, moment_sums, histogram):
    """counts[block, bin] = particles of a species in parts, the bins of the last axis fastest; the last two counts are
    those of particles in no bin, and of no particles.

    u = x, y and z in cells of the grid and v- (see kernels.moments) in cells per step; along axis k a particle is
    u.weights[k, :6] + weights[k, 6] bins from the lower end.
    """
    counts, kind, w = histogram.counts[block], histogram.species[0], histogram.weights
    base = address(pages.pool)
    to_lines, to_cells = address(scratch.lines[block]), address(scratch.cells[block])
    kick, bins = kick_of(moment_sums.half_kick, kind), (histogram.bins[0], histogram.bins[1])
    weights = ((w[0, 0], w[0, 1], w[0, 2], w[0, 3], w[0, 4], w[0, 5], w[0, 6]),
               (w[1, 0], w[1, 1], w[1, 2], w[1, 3], w[1, 4], w[1, 5], w[1, 6]))  # fmt: skip
    counts[:] = 0
    for part in range(first, last):
        row, column, slot = float(grid.parts[part, 1]), float(grid.parts[part, 2]), part * grid.n_species + kind
        plane = float(grid.parts[part, 8]) if DIM == 3 else 0.0
        page, used = np.int64(pages.head[slot]), (pages.count[slot] - 1) % PAGE + 1
        if page >= 0:
            spread_field(part, grid, field, to_lines)
            park(pages.pool, page, used)
        while page >= 0:
            at, packs = base + page * PAGE_BYTES, (used + LANES - 1) // LANES
            page = np.int64(pages.chain[page])
            ahead = base + page * PAGE_BYTES if page >= 0 else at
            for pack in range(packs):
                find_lines(opaque(at + pack * PACK_BYTES), opaque(to_cells + pack * 64))
            for pack in range(packs):
                for c in range(0, PACK_BYTES, 64):
                    prefetch(ahead + pack * PACK_BYTES + c)
                here, cells, n = opaque(at + pack * PACK_BYTES), opaque(to_cells + pack * 64), used - pack * LANES
                x, y, z = position_at(F, here)
                vx, vy, vz = centred(here, n, to_lines, cells, kick)
                for k in range(HALVES):
                    u = half(x, k) + column, half(y, k) + row, half(z, k) + plane, half(vx, k), half(vy, k), half(vz, k)
                    store_bins(cells + 32 * k, u, float(n - 8 * k), weights, bins)
            for pack in range(packs):
                for k in range(HALVES):
                    place = opaque(to_cells + pack * 64 + 32 * k)
                    add_whole(address(counts), place, 0, splat(COUNTS, 1))
            used = PAGE
