"""Energy and momentum of the particles of one block at the time of their positions, as exact integer sums."""

import numpy as np

from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.vector import fma
from hpcpic.core.space.exact import add_limbs
from hpcpic.plasma.kernels.plain import gather
from hpcpic.plasma.kernels.storage import LANES, PAGE

DIM = 2  # axes of the grid
VELOCITIES = 2  # components
REAL = np.float64  # precision of a particle


@njit
def moments(block, first, last, n_species, origin, parts, e_x, e_y, scale, half_kick, ratio_sq, inv_scale,
            pool, chain, head, count, values, limbs):  # fmt: skip
    """limbs[block, species, k] += sums over particles of |v-|^2 (k = 0) and of the components of v- (k > 0).

    v- = v^(n-1/2) + half the electric impulse: in a magnetic field only its direction differs from that of v^n.
    half_kick[species, 3]; ratio_sq[3] = squared cell sides, in the side along x; inv_scale[2] for squares and
    components; values[block, 4, PAGE] is scratch. Returns a code of core.space.exact.
    """
    values, limbs = values[block], limbs[block]
    bad = 0
    for part in range(first, last):
        row, column = parts[part, 1] - origin[0], parts[part, 2] - origin[1]
        for slot in range(part * n_species, (part + 1) * n_species):
            species = slot % n_species
            m = half_kick[species]
            page, used = np.int64(head[slot]), (count[slot] - 1) % PAGE + 1
            while page >= 0:
                for place in range(used):
                    pack, lane = place // LANES, place % LANES
                    x, y = pool[page, pack, 0, lane], pool[page, pack, DIM - 1, lane]
                    square = 0.0
                    for c in range(VELOCITIES):
                        v = pool[page, pack, DIM + c, lane]
                        if c == 0:
                            v = fma(m[0], gather(e_x, row, column, x, y, scale), v)
                        elif c < DIM:
                            v = fma(m[1], gather(e_y, row, column, x, y, scale), v)
                        else:
                            v = v + m[c]
                        values[1 + c, place] = v
                        square += ratio_sq[c] * values[1 + c, place] * values[1 + c, place]
                    values[0, place] = square
                for k in range(VELOCITIES + 1):
                    bad |= add_limbs(limbs[species, k], values[k, :used], inv_scale[min(k, 1)])
                page, used = np.int64(chain[page]), PAGE
    return bad
