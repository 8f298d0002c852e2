"""Runs of slots where the neighbours of bodies are, in the order that `cells` gave them; its tables have the names.

Rows of half a neighbourhood: own from the next body on, then in 3D the next row; then the row, or three rows, of the
next layer.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.scratch import zeros
from hpcpic.core.simd.vector import (
    Vec,
    bitmask,
    convert,
    first_bit,
    floor,
    fma,
    lanes,
    largest_lane,
    last_bit,
    load,
    maximum,
    minimum,
    select,
    splat,
    sqrt,
    store,
)  # fmt: skip
from sph.kernels.marks import EXTRAPOLATED, FLOWING_FLUID, FLOWS, FLUID, PARTNERS, PLAIN, REAL, SOLIDS

DIM = 3

AXIS = DIM - 1  # of the fine cells
FAR = 2.0**24  # cells from the corner: see cells
ROWS = 5 if DIM == 3 else 2  # of half a neighbourhood
OWN_ROWS = 2 if DIM == 3 else 1  # of these in the layer of the body
N, M = lanes(np.float64), lanes(np.float32)
F, I, S = Vec(N, np.float64), Vec(N, np.int32), Vec(N, np.float32)
WIDE, KINDS = Vec(M, np.float32), Vec(M, np.int32)
CROWDED = 1
MAX_RUN = 65535  # slots, uint16


class Reach(NamedTuple):
    """Places[k, slot] of the bodies of two layers, in fine cells, and the square of the radius."""

    own: NDArray[np.float32]
    around: NDArray[np.float32]
    limit: np.float32


@njit
def find(block, blocks, base, shape, edge, x, flags, table, run_first, run_length):
    """Find run_first[k, slot], run_length[k, slot]: the slots in row k of the half neighbourhood where all in the
    radius are; and set the flag PLAIN. x[d, slots] m; edge = (edge of a layer, of a row, of a fine cell, pads,
    radius), m.
    """
    rows, row_table, fine_start = table.rows, table.row_table, table.fine_start
    longest = N + longest_row(block, blocks, rows, row_table, fine_start)  # vectors overrun
    height, left = zeros(longest, np.float64), zeros((6, longest), np.float64)
    cells, met = zeros((3, longest), np.int32), zeros(longest, np.int32)
    places = zeros((2, DIM, 2 * M + largest_layer(block, blocks, base)), np.float32)  # of even and odd layers
    low, high, most = blocks[block], blocks[block + 1], np.int64(0)
    far = to_cell_units(low, base, edge, x, flags, places[low & 1]) if low < high else 0.0
    for l in range(low, high):
        farther = to_cell_units(l + 1, base, edge, x, flags, places[(l + 1) & 1])
        limit = square_of_reach(edge, max(far, farther))
        far = farther
        for k in range(rows[l, 1]):
            entry = row_table[rows[l, 2] + k]
            r, first = rows[l, 0] + k, np.int64(entry[0])
            after = np.int64(fine_start[entry[3] + entry[2]])
            spheres(first, after - first, shape[2] + l + 1 - edge[3], r + 1 - edge[3], edge, x, height, left)
            met[: after - first] = 0
            for n in range(ROWS):
                up, side = beside(n)
                at = r + side - rows[l + up, 0]
                if at < 0 or at >= rows[l + up, 1] or (l == 0 and up == 0):
                    run_first[n, first:after], run_length[n, first:after] = 0, 0
                    continue
                other = row_table[rows[l + up, 2] + at]
                chords(height, left[3 * up + 1 + side], after - first, other, cells)
                reach = Reach(places[l & 1], places[(l + up) & 1], limit)
                most = max(most, cut(
                    n == 0, first - base[l], base[l + up], reach, flags[first:after], flags[base[l + up] :], cells,
                    fine_start[other[3] : other[3] + other[2] + 1], other, run_first[n, first:after],
                    run_length[n, first:after], met,
                ))  # fmt: skip
            mark_plain(after - first, met, flags[first:after])
    return CROWDED if most > MAX_RUN else 0


@njit
def square_of_reach(edge, far):
    """Square of the radius in fine cells, and of what rounding of places up to `far` to single precision may add."""
    return np.float32((edge[4] / edge[2] * (1.0 + 2.0**-20) + far * 2.0**-21) ** 2)


@njit
def largest_layer(block, blocks, base):
    """The most slots that a layer of a block or the next one has."""
    largest = 0
    for l in range(blocks[block], blocks[block + 1] + 1):
        largest = max(largest, base[l + 1] - base[l])
    return largest


@njit
def longest_row(block, blocks, rows, row_table, fine_start):
    """The most bodies that a row of a block has."""
    longest = 0
    for l in range(blocks[block], blocks[block + 1]):
        for k in range(rows[l, 2], rows[l, 2] + rows[l, 1]):
            longest = max(longest, fine_start[row_table[k, 3] + row_table[k, 2]] - row_table[k, 0])
    return longest


@njit
def beside(n):
    """How many layers and rows it is from a row to row n of its half neighbourhood."""
    up = np.int64(n >= OWN_ROWS)
    if DIM == 2:
        return up, np.int64(0)
    return up, np.int64(n == 1) if n < 2 else np.int64(n - 3)


@njit
def mark_plain(many, met, flags):
    """Set the flag PLAIN of fluid that met nothing else."""
    for m in range(many):
        if flags[m] & FLOWING_FLUID == FLOWING_FLUID and met[m] == 0:
            flags[m] |= PLAIN


@njit
def to_cell_units(l, base, edge, x, flags, places):
    """Put the places of the bodies of a layer into places[k, slot], in fine cells. Returns the largest."""
    per_cell = 1.0 / edge[2]
    farthest = splat(F, 0.0)
    for k in range(DIM):
        line, to = x[k], places[k]
        for s in range(base[l], base[l + 1], N):
            place = load(F, line, s) * per_cell
            farthest = maximum(farthest, select(load(I, flags, s) != 0, abs(place), 0.0))
            store(to, s - base[l], convert(S, place))
    return largest_lane(farthest)


@njit
def spheres(first, many, layer, row, edge, x, height, left):
    """For the bodies of a row, in fine cells: height[m] along it; left[k, m], the square of the radius less that of the
    distance to a row: before, own and after of the own layer, then of the next one. layer, row: numbers of the next.
    """
    per_cell = 1.0 / edge[2]
    limit, ceiling, wall = edge[4] * per_cell, layer * edge[0], row * edge[1]
    for m in range(many):
        b = np.uint64(first + m)
        height[m] = x[AXIS, b] * per_cell
        up = max(ceiling - x[0, b], 0.0) * per_cell
        after, before = 0.0, 0.0
        if DIM == 3:
            after = max(wall - x[1, b], 0.0) * per_cell
            before = max(x[1, b] - (wall - edge[1]), 0.0) * per_cell
        for u in range(2):
            rest = limit * limit - u * up * up
            left[3 * u, m], left[3 * u + 1, m], left[3 * u + 2, m] = rest - before * before, rest, rest - after * after


@njit
def chords(height, left, many, row, cells):
    """Find the fine cells of a row of the table that chords around the heights reach, which are half as long as the
    root of left: cells[0], cells[1] = the first and the one behind the last; cells[2] is not 0 where a chord leaves the
    cells with fluid only.
    """
    low_cell, n_cells, free, free_end = 1.0 * row[1], 1.0 * row[2], row[4], row[5]
    bottom, top = -FAR - low_cell, FAR - low_cell  # also from one that is farther
    for m in range(0, many, N):
        rest = load(F, left, m)
        half = sqrt(maximum(rest, 0.0))
        z = load(F, height, m) - low_cell
        low = minimum(maximum(minimum(floor(z - half), top), 0.0), n_cells)
        high = minimum(maximum(maximum(floor(z + half), bottom) + 1.0, 0.0), n_cells)
        first, end = convert(I, low), convert(I, select(rest > 0.0, high, low))
        store(cells[0], m, first)
        store(cells[1], m, end)
        beside = select(first < np.int32(free), end - first, select(end > np.int32(free_end), end - first, 0))
        store(cells[2], m, beside)


@njit
def cut(same, first, since, reach, kinds, flags, cells, start, row, begins, lengths, met):
    """Find the runs of the bodies of a row. In another row than their own they go from about the first to about the
    last body that is within the radius and of a class that the body has to do with. met[m] is not 0 from now on where
    there is one without FLOWS. Walls only meet fluid and rigid bodies, which are in a part of the row; bodies meet all
    but themselves. Returns the longest.
    """
    longest, wet, wet_end = 0, np.int64(row[6]) - since, np.int64(row[7]) - since
    for m in range(np.uint64(kinds.size)):
        b = np.uint64(first) + m
        at, end = start[np.uint32(cells[0, m])] - since, start[np.uint32(cells[1, m])] - since
        if same:
            at = max(at, np.int64(b) + 1)  # each pair once
        if cells[2, m] == 0 and kinds[m] & PARTNERS == PARTNERS:
            if not same:  # there most are within it
                at, end = cut_ends(reach, b, at, end)
        else:
            if kinds[m] & (FLUID | SOLIDS) == 0:
                at, end = max(at, wet), min(end, wet_end)
            at, end, without_flow = cut_classes(reach, flags, kinds[m], b, at, end)
            met[m] |= without_flow != 0
        length = max(end - at, 0)
        longest = max(longest, length)
        begins[m], lengths[m] = at + since, length
    return longest


@njit
def cut_ends(reach, b, at, end):
    """Shorten a run by the bodies beyond the radius in its first and its last vector."""
    back = max(end - M, at)
    valid = (1 << min(end - at, np.int64(M))) - 1
    ahead, behind = reached(reach, b, at) & valid, reached(reach, b, back) & valid
    return min(at + min(first_bit(ahead), M), end), back + last_bit(behind) + 1


@njit
def cut_classes(reach, flags, kind, b, at, end):
    """Shorten a run to the first and the last body that body b has to do with. Returns also bits of those that lack
    FLOWS.
    """
    low, high, without_flow = end, min(at, end), np.int64(0)
    while at < end:
        kinds = load(KINDS, flags, at)
        bits = bitmask((kinds | kind) & PARTNERS == PARTNERS)
        if kind & EXTRAPOLATED != 0:
            bits |= bitmask(across_a_film(kinds, kind))
        bits &= reached(reach, b, at)
        bits &= (1 << min(end - at, np.int64(M))) - 1
        without_flow |= bits & bitmask(kinds & FLOWS == 0)
        if bits != 0:
            low, high = min(low, at + first_bit(bits)), at + last_bit(bits) + 1
        at += M
    return min(low, high), high, without_flow


@njit
def across_a_film(kinds, kind):
    """Whether two are of a solid that presses across films, as rigid bodies do, and of another solid, both with the
    pressure of the fluid between these.
    """
    meet = ((kinds | kind) & REAL != 0) & ((kinds ^ kind) & SOLIDS != 0)
    return meet & (kinds & kind & EXTRAPOLATED != 0)


@njit
def reached(reach, b, j):
    """Bits of those of the M bodies from j on that are within the radius around body b."""
    square = splat(WIDE, 0.0)
    for k in range(DIM):
        d = load(WIDE, reach.around[k], j) - reach.own[k, b]
        square = fma(d, d, square)
    return bitmask(square <= reach.limit)
