"""Many substeps in one call, for grains that are few enough for one thread."""

import numpy as np

from hpcpic.core.simd.jit import njit
from lbmdem.kernels.contacts import grain_pairs, wall_pairs
from lbmdem.kernels.contacts_motion import finish, start


@njit
def greatest_shift(walls, listed):
    """Of the planes since they were listed."""
    most = 0.0
    for w in range(walls.shape[0] - 1):
        square = 0.0
        for c in range(3):
            square += (walls[w, c] - listed[w, c]) ** 2
        most = max(most, square)
    return np.sqrt(most)


@njit
def substeps(done, steps, begun, skin, n, rows, pull, forces, given, heat, work, gravity, origin, lengths, periodic,
             inverses, planar, farthest, low, high, damping, lines, springs, busy, begins, slots, first_wall, n_slots,
             motion, walls, listed, law, dt):  # fmt: skip
    """Substeps done..steps of the n grains here; motion[steps or 1] are the planes at the end of each.

    Stops in a step, after its first half, when the list is too old or a position is no number. `begun`: goes on there.
    Returns how many are done; -1 - that when stopped in the next one.
    """
    for k in range(done, steps):
        if not begun:
            start(0, n, rows, pull, forces, given, gravity, origin, lengths, periodic, planar, dt, farthest, 0)
            if motion.shape[0] > 1:
                for w in range(walls.shape[0]):
                    for c in range(walls.shape[1]):
                        walls[w, c] = motion[k, w, c]
            moved = np.sqrt(farthest[0])
            if not moved + max(moved, greatest_shift(walls, listed)) <= skin:
                return -1 - k
        begun = False
        grain_pairs(0, first_wall, low, high, damping, rows, lengths, inverses, law, dt, lines, springs, busy)
        wall_pairs(first_wall, n_slots, low, high, damping, rows, walls, law, dt, lines, springs, busy)
        finish(0, n, rows, lines, begins, slots, first_wall, high, walls, forces, heat, work, 0.5 * dt)
    return steps
