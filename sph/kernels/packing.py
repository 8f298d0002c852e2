"""The sums by which particles are spread evenly at the start, over cells of half a reach."""

import numpy as np

from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.scratch import empty, zeros
from hpcpic.core.simd.vector import Vec, lane_numbers, lanes, load, maximum, select, splat, sqrt, total

N = lanes(np.float64)
F, I = Vec(N, np.float64), Vec(N, np.int64)
STIFF = 10.0  # at 0.8 spacings it doubles the push; without it some points came to 0.82, with it to 0.895


@njit
def into_cells(x, solid, low, edge, shape, start, order, placed):
    """Order points x[n, d] by cells, shape[3] of them: order[slot] = point, start[cell] = slot of the first of the cell
    or later, placed[4, slots + N] = x - low, then STIFF for points of a solid, 0 for others. In 2D the first axis has
    one cell, and all points lie at 0 along it.
    """
    n, d = x.shape
    at, cell = zeros(3, np.int64), empty(n, np.int32)
    start[:] = 0
    for i in range(n):
        for k in range(d):
            at[3 - d + k] = min(max(np.int64((x[i, k] - low[k]) / edge), 0), shape[3 - d + k] - 1)
        cell[i] = (at[0] * shape[1] + at[1]) * shape[2] + at[2]
        start[cell[i]] += 1
    for c in range(1, start.size):
        start[c] += start[c - 1]  # end of the cell; becomes its start while points are put in
    for i in range(n - 1, -1, -1):
        start[cell[i]] -= 1
        slot = start[cell[i]]
        order[slot] = i
        for k in range(d):
            placed[3 - d + k, slot] = x[i, k] - low[k]
        placed[3, slot] = STIFF if solid[i] else 0.0


@njit
def pushes(n, reach, core, shape, start, order, placed, found):
    """Find found[n, d] = sum of (1 - r / reach)^3 r_ij over all points, in m, of the first n: the slope of Wendland's
    C2 kernel; and STIFF (core - r) / reach r_ij of those of a solid that are nearer than a core.
    """
    d, edge, within = found.shape[1], reach / 2.0, 1.0 - core / reach
    at, x, lane = zeros(3, np.int64), zeros(3, np.float64), lane_numbers(I)
    for slot in range(order.size):
        i = order[slot]
        if i >= n:
            continue
        for k in range(3):
            x[k] = placed[k, slot]
            at[k] = min(max(np.int64(x[k] / edge), 0), shape[k] - 1)
        a, b, c = splat(F, 0.0), splat(F, 0.0), splat(F, 0.0)
        first, last = max(at[2] - 2, 0), min(at[2] + 3, shape[2])
        for layer in range(max(at[0] - 2, 0), min(at[0] + 3, shape[0])):
            for row in range(max(at[1] - 2, 0), min(at[1] + 3, shape[1])):
                begin = (layer * shape[1] + row) * shape[2]
                end = np.int64(start[begin + last])
                for j in range(np.int64(start[begin + first]), end, N):
                    p = x[0] - load(F, placed[0], j)
                    q = x[1] - load(F, placed[1], j)
                    r = x[2] - load(F, placed[2], j)
                    near = maximum(1.0 - sqrt(p * p + q * q + r * r) / reach, 0.0)
                    weight = near * near * near + load(F, placed[3], j) * maximum(near - within, 0.0)
                    weight = select(lane + j < end, weight, 0.0)
                    a, b, c = a + weight * p, b + weight * q, c + weight * r
        x[0], x[1], x[2] = total(a), total(b), total(c)
        for k in range(d):
            found[i, k] = x[3 - d + k]
