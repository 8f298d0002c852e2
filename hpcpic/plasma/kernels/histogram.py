"""Counts of the particles of one block in bins of position and velocity, at the time of their positions."""

import numpy as np

from hpcpic.plasma.kernels.lanes import kernel
from hpcpic.plasma.kernels.moments import DIM, REAL, centred_velocity, whole_velocity
from hpcpic.plasma.kernels.storage import COMPONENTS, LANES, PAGE

SECOND = min(DIM + 1, COMPONENTS - 1)  # place of vy, or of any number where there is none

@kernel
def count_particles(block, first, last, grid, field, pages, histogram):
    """counts[block, bin] = particles of a species in parts, the bins of the last axis fastest; counts[block, -1] =
    those that lie in none.

    Coordinates: x and y in cells of the grid, v^n in cells along x per step, of which t = c per_unit - low is in bins.
    A bin begins at its lower edge; the last one holds its upper edge too. REAL is double precision.
    """
    parts, pool, origin, counts = grid.parts, pages.pool, field.origin, histogram.counts[block]
    kind, axes, bins = histogram.species[0], histogram.axes, histogram.bins
    half_kick, half_turn = histogram.node_half_kick[kind], histogram.half_turn[kind]
    counts[:] = 0
    for part in range(first, last):
        row, column, slot = parts[part, 1], parts[part, 2], part * grid.n_species + kind
        page, used = np.int64(pages.head[slot]), (pages.count[slot] - 1) % PAGE + 1
        while page >= 0:
            for place in range(used):
                pack, lane = place // LANES, place % LANES
                one = pool[page, pack]
                x, y = REAL(one[0, lane]), REAL(one[DIM - 1, lane])
                stored = one[DIM, lane], one[SECOND, lane], one[COMPONENTS - 1, lane]
                v = centred_velocity(x, y, stored, row - origin[0], column - origin[1], field, half_kick)
                vx, vy, vz = whole_velocity(v, histogram.side, half_turn)
                coordinates, at = (column + x, row + y, vx, vy, vz), 0
                for k in range(len(axes)):
                    t = coordinates[axes[k]] * histogram.per_unit[k] - histogram.low[k]
                    if at >= 0 and 0.0 <= t <= bins[k]:
                        at = at * bins[k] + min(np.int64(t), bins[k] - 1)
                    else:
                        at = -1
                counts[at] += 1
            page, used = np.int64(pages.chain[page]), PAGE
