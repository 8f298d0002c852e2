"""Nodes inside discs and spheres, as runs along x; compiled.

Axes of all arrays of three here: (x, row, plane), where plane is the slab axis; in two dimensions there is one row, 0.
A grain is held once, at its place in the box; its images in the window of a rank are (grain, offset) with
local node = node in the frame of the grain + offset, integers. Distances are taken in the frame of the grain, so
that they have the same bits on every rank and in every image.
"""

import math

import numpy as np

from hpcpic.core.simd.jit import njit
from hpcpic.core.simd.vector import (
    Vec,
    bitmask,
    convert,
    first_bit,
    floor,
    lane_numbers,
    lanes,
    maximum,
    minimum,
    select,
    splat,
    sqrt,
)
from lbmdem.kernels import layout

FLUID = np.int32(layout.FLUID)
LEFT = np.int32(-9)  # for the time of an update: a grain has just left this node
_FAR = 1 << 40
_NOWHERE = 1e9  # nodes
N = lanes(np.float64)
F, H = Vec(N, np.float64), Vec(N, np.int32)


@njit
def images(centres, radii, margin, origin, shape, points, periodic, grain, offset):
    """How many images of grains come within `margin` nodes of the window; they are stored if there is room.

    centres[n, 3], radii[n] in nodes; the window starts at the node origin[3] and has shape[3] nodes of points[3].
    """
    count = 0
    first, last = np.zeros(3, np.int64), np.zeros(3, np.int64)
    for g in range(radii.size):
        for a in range(3):
            reach = radii[g] + margin
            low, high = np.int64(math.ceil(centres[g, a] - reach)), np.int64(math.floor(centres[g, a] + reach))
            if periodic[a]:
                first[a] = -((high - origin[a]) // points[a])
                last[a] = (origin[a] + shape[a] - 1 - low) // points[a]
            else:
                first[a] = 0
                last[a] = 0 if low < origin[a] + shape[a] and high >= origin[a] else -1
        for i in range(first[0], last[0] + 1):
            for j in range(first[1], last[1] + 1):
                for k in range(first[2], last[2] + 1):
                    if count < grain.size:
                        grain[count] = g
                        offset[count, 0] = i * points[0] - origin[0]
                        offset[count, 1] = j * points[1] - origin[1]
                        offset[count, 2] = k * points[2] - origin[2]
                    count += 1
    return count


@njit(inline="always")
def run(x, h_sq):
    """First and last node within sqrt(h_sq) of x; the first is above the last when there is none."""
    if h_sq < 0.0:
        return _FAR, -_FAR
    h = math.sqrt(h_sq)
    return np.int64(math.ceil(x - h)), np.int64(math.floor(x + h))


@njit(inline="always")
def span(x, reach, offset, low, high):
    """Local nodes [first, last + 1) within reach of x, cut to [low, high)."""
    first = np.int64(math.ceil(x - reach)) + offset
    after = np.int64(math.floor(x + reach)) + offset + 1
    return max(first, low), min(after, high)


@njit
def mark(solid, centres, radii, ids, grain, offset, low, high, lost):
    """Write the ids of the grains into the fluid nodes they cover, planes [low, high); the lowest id keeps a node.

    lost[g] is set for grains that want a node another grain has.
    """
    for m in range(grain.size):
        c, radius, shift = centres[grain[m]], radii[grain[m]], offset[m]
        p0, p1 = span(c[2], radius, shift[2], low, high)
        for p in range(p0, p1):
            dz = (p - shift[2]) - c[2]
            r0, r1 = span(c[1], radius, shift[1], 0, solid.shape[1])
            for r in range(r0, r1):
                dy = (r - shift[1]) - c[1]
                a, b = run(c[0], radius * radius - dz * dz - dy * dy)
                for x in range(max(a + shift[0], 0), min(b + shift[0] + 1, solid.shape[2])):
                    _claim(solid, p, r, x, ids, grain[m], lost)


@njit(inline="always")
def _claim(solid, p, r, x, ids, g, lost):
    """Grain g wants a node: a lower id keeps or takes it, and the other one is noted in `lost`."""
    now, number = solid[p, r, x], np.int32(ids[g])
    if now in (FLUID, LEFT):
        solid[p, r, x] = number
    elif now > number:
        solid[p, r, x] = number
        lost[np.searchsorted(ids, now)] = True
    elif now >= 0 and now != number:
        lost[g] = True


@njit(inline="always")
def stays(centre, other, offset, other_offset):
    """Whether two places are the same."""
    for a in range(3):
        if centre[a] != other[a] or offset[a] != other_offset[a]:
            return False
    return True


@njit(inline="always")
def chords(c, other, radius, shift, towards, p, r, columns):
    """First and last node of a row that a grain covers at one place, within the row, and at another one.

    The first is above the last where there is none.
    """
    dy, dz = (r - shift[1]) - c[1], (p - shift[2]) - c[2]
    ey, ez = (r - towards[1]) - other[1], (p - towards[2]) - other[2]
    a, b = run(c[0], radius * radius - dz * dz - dy * dy)
    first, last = run(other[0], radius * radius - ez * ez - ey * ey)
    return max(a + shift[0], 0), min(b + shift[0], columns - 1), first + towards[0], last + towards[0]


@njit(inline="always")
def ends(c, radius, shift, p, r):
    """First and last node of rows r, r + 1, ... that a grain covers, a vector of rows; as `run`."""
    dy = (convert(F, lane_numbers(H)) + float(r - shift[1])) - c[1]
    dz = (p - shift[2]) - c[2]
    h_sq = (radius * radius - dz * dz) - dy * dy
    h, x = sqrt(maximum(h_sq, 0.0)), splat(F, c[0])
    far, there = splat(F, float(_FAR)), h_sq >= 0.0
    return select(there, -floor(h - x) + float(shift[0]), far), select(there, floor(x + h) + float(shift[0]), -far)


@njit(inline="always")
def outgrown(c, other, radius, shift, towards, p, r, after, columns):
    """Bits of the rows r, r + 1, ... before `after` with nodes that a grain covers here, but not at the other place."""
    a, b = ends(c, radius, shift, p, r)
    first, last = ends(other, radius, towards, p, r)
    a, b = maximum(a, 0.0), minimum(b, float(columns - 1))
    rows = bitmask((a <= b) & ((first > a) | (last < b)))
    return rows & ((1 << (after - r)) - 1) if after - r < N else rows


@njit
def change(
    solid, centres, radii, ids, grain, offset, other, other_offset, low, high, entering, nodes, owners, lost
):  # fmt: skip
    """Nodes that grains cover at one place and not at another one. How many are listed, with the ids.

    Images (grain[m], offset[m]) of the places `centres`; other[m], other_offset[m]: the other place of each. entering:
    these are the new places, in the order of the ids: nodes are claimed, and listed if they were fluid. Else the old
    ones: nodes that the grain has are listed and marked LEFT.
    """
    count = 0
    for m in range(grain.size):
        c, o, radius, number = centres[grain[m]], other[m], radii[grain[m]], np.int32(ids[grain[m]])
        shift, towards, wanted = offset[m], other_offset[m], FLUID if entering else number
        if stays(c, o, shift, towards):
            continue
        p0, p1 = span(c[2], radius, shift[2], low, high)
        for p in range(p0, p1):
            r0, r1 = span(c[1], radius, shift[1], 0, solid.shape[1])
            for low_r in range(r0, r1, N):
                rows = outgrown(c, o, radius, shift, towards, p, low_r, r1, solid.shape[2])
                while rows:
                    r, rows = low_r + first_bit(rows), rows & (rows - 1)
                    a, b, first, last = chords(c, o, radius, shift, towards, p, r, solid.shape[2])
                    for x in range(a, b + 1):
                        if first <= x <= last:
                            continue
                        if solid[p, r, x] == wanted:
                            if count < nodes.size:
                                nodes[count] = (p * solid.shape[1] + r) * solid.shape[2] + x
                                owners[count] = number
                            count += 1
                            if not entering:
                                solid[p, r, x] = LEFT
                        if entering:
                            _claim(solid, p, r, x, ids, grain[m], lost)
    return count


@njit
def elsewhere(centres, ids, grain, offset, others, other_ids, points, periodic, place, place_offset):
    """Of the grain of each image: its centre in another list, and the offset of its nearest image there.

    place[m, 3], place_offset[m, 3]; a place that is never near for grains that are not in the list. Ids ascend.
    """
    for m in range(grain.size):
        at = np.searchsorted(other_ids, ids[grain[m]])
        place_offset[m] = offset[m]
        if at == other_ids.size or other_ids[at] != ids[grain[m]]:
            place[m] = _NOWHERE
            continue
        place[m] = others[at]
        for a in range(3):
            if periodic[a]:
                turns = np.rint((centres[grain[m], a] - others[at, a]) / points[a])
                place_offset[m, a] += np.int64(turns) * points[a]


@njit
def keep(solid, kind, nodes, owners):
    """Keep the listed nodes of a kind, in order; how many."""
    flat = solid.reshape(-1)
    kept = 0
    for k in range(nodes.size):
        if flat[nodes[k]] == kind:
            nodes[kept] = nodes[k]
            owners[kept] = owners[k]
            kept += 1
    return kept


@njit
def within(x, r, p, inner):
    """Whether a local node is no ghost."""
    along = inner[0, 0] <= x < inner[0, 1] and inner[1, 0] <= r < inner[1, 1]
    return along and inner[2, 0] <= p < inner[2, 1]


@njit
def keep_inner(solid, nodes, owners, inner):
    """Keep the listed nodes that are no ghosts, in order; how many."""
    kept = 0
    for k in range(nodes.size):
        x = nodes[k] % solid.shape[2]
        r = nodes[k] // solid.shape[2] % solid.shape[1]
        if within(x, r, nodes[k] // (solid.shape[1] * solid.shape[2]), inner):
            nodes[kept] = nodes[k]
            owners[kept] = owners[k]
            kept += 1
    return kept
