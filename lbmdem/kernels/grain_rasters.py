"""Nodes inside discs and spheres, as runs along x; compiled.

Axes of all arrays of three here: (x, row, plane), where plane is the slab axis; in two dimensions there is one row, 0.
A grain is held once, at its place in the box; its images in the window of a rank are (grain, offset) with
local node = node in the frame of the grain + offset, integers. Distances are taken in the frame of the grain, so
that they have the same bits on every rank and in every image.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.scratch import empty, zeros
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
# what `lengths` holds: of the lists in use, then the longest list of a block, with what did not fit
GRAINS, IMAGES, IMAGES_BEFORE, CLAIMANTS, CHANGED, UNCOVERED, COVERED, LONGEST = range(8)
MARGIN = 1.0  # nodes
_FAR = 1 << 40
ONE_BLOCK = 64  # images that one block does by itself
N = lanes(np.float64)
F, H = Vec(N, np.float64), Vec(N, np.int32)


class Table(NamedTuple):
    """Grains in the order of ids: centres[n, 3], motion[n, 6] (velocity, angular velocity) in the axes of kernels."""

    ids: NDArray[np.int64]
    centres: NDArray[np.float64]
    radii: NDArray[np.float64]
    motion: NDArray[np.float64]


class Images(NamedTuple):
    """Grains as they are seen in a window: row of the grain, and what to add to its nodes to get local ones [m, 3]."""

    grain: NDArray[np.int64]
    offset: NDArray[np.int64]


class Before(NamedTuple):
    """Table and images before the last move."""

    ids_before: NDArray[np.int64]
    centres_before: NDArray[np.float64]
    radii_before: NDArray[np.float64]
    grain_before: NDArray[np.int64]
    offset_before: NDArray[np.int64]


class Lists(NamedTuple):
    """Nodes that the images of each block leave and take, and whose they are; counts[block]: the first image of a
    block, how many nodes, those for which there is no room too.
    """

    counts: NDArray[np.int64]
    left: NDArray[np.int64]
    left_by: NDArray[np.int32]
    taken: NDArray[np.int64]
    taken_by: NDArray[np.int32]


@njit
def find_images(table, lengths, window, images):
    """Find the images of the grains within the margin of the window, in the order of the grains.

    They are stored while there is room; lengths[IMAGES]: how many.
    """
    count, origin, shape, points = 0, window.origin, window.shape, window.points
    first, last = zeros(3, np.int64), zeros(3, np.int64)
    for g in range(lengths[GRAINS]):
        for a in range(3):
            centre, reach = table.centres[g, a], table.radii[g] + MARGIN
            low, high = np.int64(math.ceil(centre - reach)), np.int64(math.floor(centre + reach))
            if window.periodic[a]:
                first[a] = -((high - origin[a]) // points[a])
                last[a] = (origin[a] + shape[a] - 1 - low) // points[a]
            else:
                first[a] = 0
                last[a] = 0 if low < origin[a] + shape[a] and high >= origin[a] else -1
        for i in range(first[0], last[0] + 1):
            for j in range(first[1], last[1] + 1):
                for k in range(first[2], last[2] + 1):
                    if count < images.grain.size:
                        images.grain[count] = g
                        images.offset[count, 0] = i * points[0] - origin[0]
                        images.offset[count, 1] = j * points[1] - origin[1]
                        images.offset[count, 2] = k * points[2] - origin[2]
                    count += 1
    lengths[IMAGES] = count


@njit(forceinline=True)
def chord(x, h_sq):
    """First and last node within sqrt(h_sq) of x; the first is above the last when there is none."""
    if h_sq < 0.0:
        return _FAR, -_FAR
    h = math.sqrt(h_sq)
    return np.int64(math.ceil(x - h)), np.int64(math.floor(x + h))


@njit(forceinline=True)
def span(x, reach, offset, low, high):
    """Local nodes [first, last + 1) within reach of x, cut to [low, high)."""
    first = np.int64(math.ceil(x - reach)) + offset
    after = np.int64(math.floor(x + reach)) + offset + 1
    return max(first, low), min(after, high)


@njit
def mark(solid, table, images, lengths, window, claimants):
    """Find the images and write the ids of the grains into the fluid nodes that they cover; the lowest id keeps a node.

    claimants: the ids of grains that want a node which another grain has. Nothing is marked where images lack room.
    """
    find_images(table, lengths, window, images)
    if lengths[IMAGES] <= images.grain.size:
        ids = table.ids[: lengths[GRAINS]]
        lost = zeros(ids.size, np.bool_)
        for m in range(lengths[IMAGES]):
            mark_image(solid, table, images, m, ids, lost)
        keep_claimants(ids, lost, lengths, claimants)


@njit
def mark_image(solid, table, images, m, ids, lost):
    """Write the id of a grain where its image m is; lost[g] is set for grains that want a node of another one."""
    flat, g = solid.reshape(-1), images.grain[m]
    c, radius, shift, number = table.centres[g], table.radii[g], images.offset[m], np.int32(ids[g])
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


@njit
def keep_claimants(ids, lost, lengths, claimants):
    """claimants[:lengths[CLAIMANTS]]: the ids of the grains that have lost a node."""
    count = 0
    for g in range(ids.size):
        claimants[count] = ids[g]
        count += lost[g]
    lengths[CLAIMANTS] = count


@njit
def row_of(ids, count, number):
    """Row of a number in ids[:count], which ascend; -1 where there is none."""
    low, high = 0, count
    while low < high:
        middle = (low + high) // 2
        if ids[middle] < number:
            low = middle + 1
        else:
            high = middle
    return low if low < count and ids[low] == number else -1


@njit(forceinline=True)
def _take(flat, node, number, ids, lost):
    """A grain wants a node: a lower id keeps or takes it, and the other one is noted in `lost`."""
    now = flat[node]
    if now in (FLUID, LEFT):
        flat[node] = number
    elif now > number:
        flat[node] = number
        lost[row_of(ids, ids.size, np.int64(now))] = True
    elif now >= 0 and now != number:
        lost[row_of(ids, ids.size, np.int64(number))] = True


@njit
def find_moved(table, images, before, lengths, window, places, shifts, numbers, counts):
    """Find the images, and those of them and of the ones before that are not where they were; blocks share these.

    Both lists are in the order of ids and of offsets. places[m, 2, 4]: centre and squared radius before and now, the
    latter below 0 where there is none; shifts[m, 2, 3]: the offsets; numbers[m]: the ids. Without room for all images
    there are none.
    """
    find_images(table, lengths, window, images)
    counts[:] = 0
    if lengths[IMAGES] + lengths[IMAGES_BEFORE] > numbers.size:
        return
    ids, centres, radii, grain, offset = before
    count, i, j = 0, 0, 0
    while i < lengths[IMAGES_BEFORE] or j < lengths[IMAGES]:
        order = np.int64(i == lengths[IMAGES_BEFORE]) - np.int64(j == lengths[IMAGES])  # below 0: the old one alone
        if order == 0:
            g, h = grain[i], images.grain[j]
            order = np.int64(ids[g] > table.ids[h]) - np.int64(ids[g] < table.ids[h])
            for a in range(3):
                if order == 0:
                    points = window.points[a]
                    turns = np.rint((centres[g, a] - table.centres[h, a]) / points) if window.periodic[a] else 0.0
                    further = offset[i, a] + np.int64(turns) * points - images.offset[j, a]
                    order = np.int64(further > 0) - np.int64(further < 0)
        if order <= 0:
            g = grain[i]
            _put(places[count], shifts[count], 0, centres[g], radii[g], offset[i])
            numbers[count] = ids[g]
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
    blocks = counts.shape[0] - 1 if count > ONE_BLOCK else 1
    for k in range(counts.shape[0]):
        counts[k, 0] = min(k * count // blocks, count)


@njit(forceinline=True)
def _put(places, shifts, k, centre, radius, offset):
    for a in range(3):
        places[k, a] = centre[a]
        shifts[k, a] = offset[a]
    places[k, 3] = radius * radius


@njit(forceinline=True)
def _same(places, shifts):
    for a in range(4):
        if places[0, a] != places[1, a]:
            return False
    for a in range(3):
        if shifts[0, a] != shifts[1, a]:
            return False
    return True


@njit(forceinline=True)
def joint_span(place, shift, axis, low, high):
    """Local nodes [first, last + 1) along an axis that an image reaches at its two places, cut to [low, high)."""
    reach = math.sqrt(max(place[0, 3], place[1, 3]))
    first, after = span(place[0, axis], reach, shift[0, axis], low, high)
    other, end = span(place[1, axis], reach, shift[1, axis], low, high)
    return min(first, other), max(after, end)


@njit(forceinline=True)
def chords(c, shift, p, r):
    """First and last local node of rows r, r + 1, ... that a grain c = (centre, squared radius) covers; as `chord`."""
    dy = (convert(F, lane_numbers(H)) + float(r - shift[1])) - c[1]
    dz = (p - shift[2]) - c[2]
    h_sq = (c[3] - dz * dz) - dy * dy
    h, x = sqrt(maximum(h_sq, 0.0)), splat(F, c[0])
    far, there = splat(F, float(_FAR)), h_sq >= 0.0
    return select(there, -floor(h - x) + float(shift[0]), far), select(there, floor(x + h) + float(shift[0]), -far)


@njit
def list_changes(solid, places, shifts, numbers, lists, share):
    """List the nodes that the images of a block leave and take."""
    counts = lists.counts
    n_left, n_taken, ends = 0, 0, empty((4, N), np.float64)
    leaving, leaving_by = lists.left[share], lists.left_by[share]
    taking, taking_by = lists.taken[share], lists.taken_by[share]
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


@njit(forceinline=True)
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
def claim(solid, table, images, lengths, window, lists, claimants, changed, own, own_by):
    """Give the nodes to the grains that have come to them, or have wanted them before, in the order of ids.

    Nodes that grains have left become LEFT, fluid only by `free_left_nodes`. changed: all nodes that are other than
    before, ghosts too; own[2, n] and own_by: those that are no ghosts, LEFT and taken from the fluid, and by which id.
    Does nothing where a list lacks room.
    """
    lengths[CHANGED], lengths[LONGEST] = 0, 0
    for block in range(lists.left.shape[0]):
        for kind in range(1, 3):
            lengths[CHANGED] += lists.counts[block, kind]
            lengths[LONGEST] = max(lengths[LONGEST], lists.counts[block, kind])
    moved = lengths[IMAGES] + lengths[IMAGES_BEFORE]
    if moved > images.grain.size or lengths[LONGEST] > lists.left.shape[1] or lengths[CHANGED] > changed.size:
        return
    ids = table.ids[: lengths[GRAINS]]
    lost = zeros(ids.size, np.bool_)
    _hand_over(solid, ids, lists, lost)
    for m in range(lengths[IMAGES]):
        if row_of(claimants, lengths[CLAIMANTS], ids[images.grain[m]]) >= 0:
            mark_image(solid, table, images, m, ids, lost)
    keep_claimants(ids, lost, lengths, claimants)
    _join(solid, lengths, window.inner, lists, changed, own, own_by)


@njit
def _hand_over(solid, ids, lists, lost):
    """Mark listed nodes LEFT that their grains have; then give those that grains take to them.

    In the lists stay the former, and of the latter those that were fluid; counts are set anew.
    """
    flat, (counts, left, left_by, taken, taken_by) = solid.reshape(-1), lists
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
def _join(solid, lengths, inner, lists, changed, own, own_by):
    """The lists of all blocks as one."""
    flat, (counts, left, left_by, taken, taken_by) = solid.reshape(-1), lists
    count, kept = 0, zeros(2, np.int64)
    for kind in range(2):
        nodes, owners = (taken, taken_by) if kind else (left, left_by)
        for share in range(left.shape[0]):
            for k in range(counts[share, 1 + kind]):
                node = nodes[share, k]
                if not kind and flat[node] != LEFT:
                    continue
                changed[count] = node
                count += 1
                p, r = node // (solid.shape[1] * solid.shape[2]), node // solid.shape[2] % solid.shape[1]
                if is_own(node % solid.shape[2], r, p, inner):
                    own[kind, kept[kind]], own_by[kind, kept[kind]] = node, owners[share, k]
                    kept[kind] += 1
    lengths[CHANGED], lengths[UNCOVERED], lengths[COVERED] = count, kept[0], kept[1]


@njit
def free_left_nodes(solid, lengths, changed):
    """Make those of the nodes that have changed and are LEFT fluid."""
    flat = solid.reshape(-1)
    for k in range(lengths[CHANGED]):
        if flat[changed[k]] == LEFT:
            flat[changed[k]] = FLUID


@njit
def is_own(x, r, p, inner):
    """True for a local node that is no ghost."""
    along = inner[0, 0] <= x < inner[0, 1] and inner[1, 0] <= r < inner[1, 1]
    return along and inner[2, 0] <= p < inner[2, 1]
