"""Nodes inside discs and spheres, as runs along x; compiled.

Axes of all arrays of three here: (x, row, plane), where plane is the slab axis; in two dimensions there is one row, 0.
A grain is held once, at its place in the box; its images in the window of a rank are (grain, offset) with
local node = node in the frame of the grain + offset, integers. Distances are taken in the frame of the grain, so
that they have the same bits on every rank and in every image.
"""

import math

import numpy as np

from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.vector import (
    Vec,
    bitmask,
    convert,
    first_bit,
    floor,
    lane_numbers,
    lanes,
    maximum,
    select,
    splat,
    sqrt,
    store,
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
def chord(x, h_sq):
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
def mark(solid, centres, radii, ids, grain, offset, lost):
    """Write the ids of the grains into the fluid nodes they cover; the lowest id keeps a node.

    lost[g] is set for grains that want a node another grain has.
    """
    flat = solid.reshape(-1)
    for m in range(grain.size):
        c, radius, shift = centres[grain[m]], radii[grain[m]], offset[m]
        number = np.int32(ids[grain[m]])
        p0, p1 = span(c[2], radius, shift[2], 0, solid.shape[0])
        for p in range(p0, p1):
            dz = (p - shift[2]) - c[2]
            r0, r1 = span(c[1], radius, shift[1], 0, solid.shape[1])
            for r in range(r0, r1):
                dy = (r - shift[1]) - c[1]
                a, b = chord(c[0], radius * radius - dz * dz - dy * dy)
                start = (p * solid.shape[1] + r) * solid.shape[2]
                for x in range(max(a + shift[0], 0), min(b + shift[0] + 1, solid.shape[2])):
                    _take(flat, start + x, number, ids, lost)


@njit(inline="always")
def _take(flat, node, number, ids, lost):
    """A grain wants a node: a lower id keeps or takes it, and the other one is noted in `lost`."""
    now = flat[node]
    if now in (FLUID, LEFT):
        flat[node] = number
    elif now > number:
        flat[node] = number
        lost[np.searchsorted(ids, now)] = True
    elif now >= 0 and now != number:
        lost[np.searchsorted(ids, number)] = True


@njit
def moved_images(old, old_images, table, images, points, periodic, places, shifts, numbers):
    """Images that are not where they were, of two lists in the order of ids and of offsets; how many.

    old, table: grains before and now (`fluid.solid_nodes.Table`). places[m, 2, 4]: centre and squared radius before
    and now, the latter below 0 where there is none; shifts[m, 2, 3]: the offsets; numbers[m]: the ids. There is room
    for all.
    """
    count, i, j = 0, 0, 0
    while i < old_images.grain.size or j < images.grain.size:
        order = np.int64(i == old_images.grain.size) - np.int64(j == images.grain.size)  # below 0: the old one alone
        if order == 0:
            g, h = old_images.grain[i], images.grain[j]
            order = np.int64(old.ids[g] > table.ids[h]) - np.int64(old.ids[g] < table.ids[h])
            for a in range(3):
                if order == 0:
                    turns = np.rint((old.centres[g, a] - table.centres[h, a]) / points[a]) if periodic[a] else 0.0
                    further = old_images.offset[i, a] + np.int64(turns) * points[a] - images.offset[j, a]
                    order = np.int64(further > 0) - np.int64(further < 0)
        if order <= 0:
            g = old_images.grain[i]
            _put(places[count], shifts[count], 0, old.centres[g], old.radii[g], old_images.offset[i])
            numbers[count] = old.ids[g]
            i += 1
        if order >= 0:
            g = images.grain[j]
            _put(places[count], shifts[count], 1, table.centres[g], table.radii[g], images.offset[j])
            numbers[count] = table.ids[g]
            j += 1
        if order != 0:
            here = 0 if order < 0 else 1
            _put(places[count], shifts[count], 1 - here, places[count, here, :3], 0.0, shifts[count, here])
            places[count, 1 - here, 3] = -1.0
        count += not _same(places[count], shifts[count])
    return count


@njit(inline="always")
def _put(places, shifts, k, centre, radius, offset):
    for a in range(3):
        places[k, a] = centre[a]
        shifts[k, a] = offset[a]
    places[k, 3] = radius * radius


@njit(inline="always")
def _same(places, shifts):
    for a in range(4):
        if places[0, a] != places[1, a]:
            return False
    for a in range(3):
        if shifts[0, a] != shifts[1, a]:
            return False
    return True


@njit(inline="always")
def joint_span(place, shift, axis, low, high):
    """Local nodes [first, last + 1) along an axis that an image reaches at its two places, cut to [low, high)."""
    reach = math.sqrt(max(place[0, 3], place[1, 3]))
    first, after = span(place[0, axis], reach, shift[0, axis], low, high)
    other, end = span(place[1, axis], reach, shift[1, axis], low, high)
    return min(first, other), max(after, end)


@njit(inline="always")
def chords(c, shift, p, r):
    """First and last local node of rows r, r + 1, ... that a grain c = (centre, squared radius) covers; as `chord`."""
    dy = (convert(F, lane_numbers(H)) + float(r - shift[1])) - c[1]
    dz = (p - shift[2]) - c[2]
    h_sq = (c[3] - dz * dz) - dy * dy
    h, x = sqrt(maximum(h_sq, 0.0)), splat(F, c[0])
    far, there = splat(F, float(_FAR)), h_sq >= 0.0
    return select(there, -floor(h - x) + float(shift[0]), far), select(there, floor(x + h) + float(shift[0]), -far)


@njit
def list_changes(solid, places, shifts, numbers, counts, share, left, left_by, taken, taken_by):
    """List the nodes that images counts[share, 0] .. counts[share + 1, 0] - 1 of `moved_images` leave and take.

    left[share], taken[share] and whose they were; counts[share, 1:]: how many, those for which there is no room too.
    """
    n_left, n_taken, ends = 0, 0, np.empty((4, N))
    leaving, leaving_by, taking, taking_by = left[share], left_by[share], taken[share], taken_by[share]
    for m in range(counts[share, 0], counts[share + 1, 0]):
        place, shift, number = places[m], shifts[m], numbers[m]
        p0, p1 = joint_span(place, shift, 2, 0, solid.shape[0])
        r0, r1 = joint_span(place, shift, 1, 0, solid.shape[1])
        for p in range(p0, p1):
            for low in range(r0, r1, N):
                a, b = chords(place[0], shift[0], p, low)
                first, last = chords(place[1], shift[1], p, low)
                rows = bitmask((a > first) | (first > a) | (b > last) | (last > b)) & ((1 << min(r1 - low, N)) - 1)
                if rows == 0:
                    continue
                store(ends[0], 0, a), store(ends[1], 0, b), store(ends[2], 0, first), store(ends[3], 0, last)
                while rows:
                    r, rows = first_bit(rows), rows & (rows - 1)
                    start = (p * solid.shape[1] + low + r) * solid.shape[2]
                    was = np.int64(ends[0, r]), np.int64(ends[1, r])
                    now = np.int64(ends[2, r]), np.int64(ends[3, r])
                    n_left = _list(start, was, now, solid.shape[2], number, leaving, leaving_by, n_left)
                    n_taken = _list(start, now, was, solid.shape[2], number, taking, taking_by, n_taken)
    counts[share, 1], counts[share, 2] = n_left, n_taken


@njit(inline="always")
def _list(start, chord, other, columns, number, nodes, owners, count):
    """Add the nodes of a chord, within a row of so many columns, that are not in the other one."""
    a, b = max(chord[0], 0), min(chord[1] + 1, columns)
    for x0, x1 in ((a, min(b, other[0])), (max(a, other[0], other[1] + 1), b)):
        for x in range(x0, x1):
            if count < nodes.size:
                nodes[count], owners[count] = start + x, number
            count += 1
    return count


@njit
def claim(solid, ids, counts, left, left_by, taken, taken_by, lost):
    """Mark listed nodes LEFT that their grains have; then give those that grains take to them, in the order of ids.

    In the lists stay the former, and of the latter those that were fluid; counts[share, 1:] are set anew.
    """
    flat = solid.reshape(-1)
    for share in range(left.shape[0]):
        kept = 0
        for k in range(counts[share, 1]):
            node, number = left[share, k], left_by[share, k]
            if flat[node] == number:
                flat[node] = LEFT
                left[share, kept], left_by[share, kept] = node, number
                kept += 1
        counts[share, 1] = kept
    for share in range(taken.shape[0]):
        kept = 0
        for k in range(counts[share, 2]):
            node, number = taken[share, k], taken_by[share, k]
            if flat[node] == FLUID:
                taken[share, kept], taken_by[share, kept] = node, number
                kept += 1
            _take(flat, node, number, ids, lost)
        counts[share, 2] = kept


@njit
def join_lists(solid, counts, left, left_by, taken, taken_by, inner, nodes, own, own_by):
    """The lists of all shares as one: nodes[n] that are LEFT or taken, and which of them are no ghosts.

    own[0, :a], own_by[0, :a]: those that are LEFT and by which id; own[1, :b] and so on: taken. Returns n, a, b.
    """
    flat, count, kept = solid.reshape(-1), 0, np.zeros(2, np.int64)
    for kind in range(2):
        lists, owners = (taken, taken_by) if kind else (left, left_by)
        for share in range(left.shape[0]):
            for k in range(counts[share, 1 + kind]):
                node = lists[share, k]
                if not kind and flat[node] != LEFT:
                    continue
                nodes[count] = node
                count += 1
                p, r = node // (solid.shape[1] * solid.shape[2]), node // solid.shape[2] % solid.shape[1]
                if is_own(node % solid.shape[2], r, p, inner):
                    own[kind, kept[kind]], own_by[kind, kept[kind]] = node, owners[share, k]
                    kept[kind] += 1
    return count, kept[0], kept[1]


@njit
def free_left_nodes(solid, nodes):
    """Make those of the nodes that are LEFT fluid."""
    flat = solid.reshape(-1)
    for node in nodes:
        if flat[node] == LEFT:
            flat[node] = FLUID


@njit
def is_own(x, r, p, inner):
    """True for a local node that is no ghost."""
    along = inner[0, 0] <= x < inner[0, 1] and inner[1, 0] <= r < inner[1, 1]
    return along and inner[2, 0] <= p < inner[2, 1]
