"""The moments by vectors: same limbs, bit for bit, as kernels.moments.

A limb is rounded by adding a number so large that its last bit is the unit of the limb (core.space.exact), and the
bits of these sums are added up as integers: what the large numbers contribute is taken off at the end.
"""

import numpy as np

from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.vector import (
    Vec,
    bitmask,
    convert,
    fma,
    halves,
    lane_numbers,
    lane_values,
    load_at,
    prefetch,
    select,
    splat,
    store_at,
)
from hpcpic.core.space.exact import NOT_BOUNDED
from hpcpic.plasma.kernels.lanes import address, bits_of
from hpcpic.plasma.kernels.linear import cell_of, field_at, spread_field
from hpcpic.plasma.kernels.push import PACK_BYTES, PAGE_BYTES, lines_at
from hpcpic.plasma.kernels.simd_base import E8, MAGIC_BITS, F, I
from hpcpic.plasma.kernels.storage import LANES, PAGE

DIM = 2  # axes of the grid
VELOCITIES = 2  # components

WORDS = Vec(8, np.int64)
HIGH, MIDDLE, LOW = 1.5 * 2.0**21, 1.5 * 2.0**-11, 1.5 * 2.0**-43  # with 2^-31, 2^-63, 2^-95 as last bits
BIASES = np.array([HIGH, MIDDLE, LOW]).view(np.int64)
HALVES = LANES // 8  # vectors of float64 in a pack


@njit
def add_split(sums, t):
    """Add the biased limbs of |t| <= 1."""
    high = t + HIGH
    rest = t - (high - HIGH)
    middle = rest + MIDDLE
    rest = rest - (middle - MIDDLE)
    return sums[0] + bits_of(high), sums[1] + bits_of(middle), sums[2] + bits_of(rest + LOW)


@njit
def add_moments(sums, good, vx, vy, vz, ratio_sq, inv_square, inv_scale):
    """Limbs of |v|^2 and of the components, eight particles; and whether these were within the scale so far."""
    square, x = ratio_sq[0] * vx * vx, vx * inv_scale
    good = good & (abs(x) <= 1.0)
    along_x, along_y, along_z = add_split(sums[3:6], x), sums[6:9], sums[9:12]
    if VELOCITIES > 1:
        square, y = square + ratio_sq[1] * vy * vy, vy * inv_scale
        good = good & (abs(y) <= 1.0)
        along_y = add_split(along_y, y)
    if VELOCITIES > 2:
        square, z = square + ratio_sq[2] * vz * vz, vz * inv_scale
        good = good & (abs(z) <= 1.0)
        along_z = add_split(along_z, z)
    return add_split(sums[0:3], square * inv_square) + along_x + along_y + along_z, good


@njit
def half(v, k):
    """Eight lanes of a pack as float64."""
    if LANES == 8:
        return convert(E8, v)
    return convert(E8, halves(v)[0]) if k == 0 else convert(E8, halves(v)[1])


@njit
def centred(at, n, lines, cells, m):
    """v- of one pack; zero from lane n on. `cells` is an address for as many integers."""
    here = lane_numbers(I) < n
    x, vx = select(here, load_at(F, at, 64), 0), load_at(F, at + 64 * DIM, 64)
    y = select(here, load_at(F, at + 64 * (DIM - 1), 64), 0)
    vy = vz = splat(F, 0.0)
    store_at(cells, lines_at(x, y), 64)
    ex, ey = field_at(lines - MAGIC_BITS, cells, x - cell_of(x), y - cell_of(y))
    vx = fma(m[0], ex, vx)
    if DIM == 2:
        vy = fma(m[1], ey, load_at(F, at + 64 * 3, 64))
    elif VELOCITIES > 1:
        vy = load_at(F, at + 64 * 2, 64) + m[1]
    if VELOCITIES > 2:
        vz = load_at(F, at + 64 * (DIM + 2), 64) + m[2]
    return select(here, vx, 0), select(here, vy, 0), select(here, vz, 0)


@njit
def unbiased(sum_of_bits, n, limb):
    """The limb of n vectors from the sum of their bits."""
    total = -8 * n * BIASES[limb]
    for lane in lane_values(sum_of_bits):
        total += lane
    return total


@njit
def moments(block, first, last, n_species, origin, parts, e_x, e_y, scale, half_kick, ratio_sq, inv_scale,
            pool, chain, head, count, limbs, lines, cells):  # fmt: skip
    """limbs[block, species, k] += sums over particles of |v-|^2 (k = 0) and of the components of v- (k > 0).

    See kernels.moments.moments.
    """
    limbs = limbs[block]
    base, to_lines, to_cells = address(pool), address(lines), address(cells)
    ratios, good = (ratio_sq[0], ratio_sq[1], ratio_sq[2]), splat(E8, 0.0) <= 1.0
    inv_square, inv_speed = inv_scale[0], inv_scale[1]
    zero = splat(WORDS, 0)
    for part in range(first, last):
        spread_field(part, origin, parts, e_x, e_y, scale, to_lines)
        for slot in range(part * n_species, (part + 1) * n_species):
            species = slot % n_species
            m = (half_kick[species, 0], half_kick[species, 1], half_kick[species, 2])
            page, used, n = np.int64(head[slot]), (count[slot] - 1) % PAGE + 1, 0
            sums = (zero, zero, zero, zero, zero, zero, zero, zero, zero, zero, zero, zero)
            while page >= 0:
                at, packs = base + page * PAGE_BYTES, (used + LANES - 1) // LANES
                page = np.int64(chain[page])
                ahead = base + page * PAGE_BYTES if page >= 0 else at
                for pack in range(packs):
                    for c in range(0, PACK_BYTES, 64):
                        prefetch(ahead + pack * PACK_BYTES + c)
                    vx, vy, vz = centred(at + pack * PACK_BYTES, used - pack * LANES, to_lines, to_cells, m)
                    sums, good = add_moments(sums, good, half(vx, 0), half(vy, 0), half(vz, 0),
                                             ratios, inv_square, inv_speed)  # fmt: skip
                    if HALVES == 2:
                        sums, good = add_moments(sums, good, half(vx, 1), half(vy, 1), half(vz, 1),
                                                 ratios, inv_square, inv_speed)  # fmt: skip
                n += packs * HALVES
                used = PAGE
            for k in range(3 * (1 + VELOCITIES)):
                limbs[species, k // 3, k % 3] += unbiased(sums[k], n, k % 3)
    return 0 if bitmask(good) == 255 else NOT_BOUNDED
