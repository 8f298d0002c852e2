"""Many substeps in one call, for grains that are few enough for one thread."""

import numpy as np

from hpcpic.core.simd.atomics import call_address
from hpcpic.core.simd.compile import njit


@njit
def distance_moved(farthest):
    """Distance (m) that no grain has moved beyond since pairs were listed; farthest[parts, 8]: squares by axis."""
    most = 0.0
    for part in range(farthest.shape[0]):
        most = max(most, farthest[part, 0] + farthest[part, 1] + farthest[part, 2])
    return np.sqrt(most)


@njit
def wall_distance(walls, listed):
    """Distance (m) of the plane that moved most since pairs were listed."""
    most = 0.0
    for w in range(walls.shape[0] - 1):
        square = 0.0
        for c in range(3):
            square += (walls[w, c] - listed[w, c]) ** 2
        most = max(most, square)
    return np.sqrt(most)


@njit
def shake(pushed, constant, acceleration):
    """Forces in a frame of this acceleration [d]: constant[n, d] by numbers of grains less mass x acceleration."""
    given, numbers, mass = pushed
    for i in range(constant.shape[0]):
        for c in range(constant.shape[1]):
            given[i, c] = constant[numbers[i], c] - mass[i] * acceleration[c]


@njit
def substeps(done, steps, begun, skin, kernels, farthest, motion, walls, listed, frame, pushed):
    """Substeps done..steps; kernels[m, 2] = (function, context) of the tasks of a substep, the first half first.

    motion[steps or 1] are the planes at the end of each. Stops in a step, after its first half, when the list is too
    old or a position is no number; `begun`: goes on there. Returns how many are done; -1 - that when stopped.
    In a shaken frame forces change where a step of it begins.
    """
    first, each, accelerations, constant = frame
    for k in range(done, steps):
        if not begun:
            if accelerations.shape[0] and (first + k) % each == 0:
                shake(pushed, constant, accelerations[(first + k) // each])
            call_address(kernels[0, 0], kernels[0, 1])
            if motion.shape[0] > 1:
                for w in range(walls.shape[0]):
                    for c in range(walls.shape[1]):
                        walls[w, c] = motion[k, w, c]
            moved = distance_moved(farthest)
            if not moved + max(moved, wall_distance(walls, listed)) <= skin:
                return -1 - k
        begun = False
        for task in range(1, kernels.shape[0]):
            call_address(kernels[task, 0], kernels[task, 1])
    return steps
