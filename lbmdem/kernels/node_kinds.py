"""Which nodes are fluid, as the sweep wants to know it, and populations that came from another rank."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.scratch import zeros
from lbmdem.kernels.layout import FLUID
from lbmdem.kernels.sweep import MIXED, PLAIN, SKIP


class Vectors(NamedTuple):
    """What the sweep knows of vectors of n nodes: see `mark`, `classify` and `look_ahead`."""

    n: int
    wet: NDArray[np.int32]
    free: NDArray[np.int32]
    inside: NDArray[np.int32]
    kinds: NDArray[np.uint8]
    hops: NDArray[np.int32]


@njit
def mark(solid, ghosts, least, words, n, low, high):
    """words[plane, row, vector] of planes low.. (ghosts counted) from solid[planes + 2, rows + 2 ghosts, nx + 2].

    n nodes to a vector; bit b says that node b - 1 of the vector is fluid or, with least = 0, a grain. `ghosts` rows of
    solid are outside.
    """
    for z in range(low, high):
        for y in range(solid.shape[1]):
            ids, bits = solid[z, y], words[z, y + 1 - ghosts]
            for v in range(bits.size):
                word = 0
                for b in range(min(n + 2, ids.size - v * n)):
                    number = ids[v * n + b]
                    word |= (number == FLUID or number >= least) << b
                bits[v] = word


@njit
def classify(wet, free, inside, flat, kinds, low, high):
    """kinds[plane, row, vector] of planes low..; flat: the rows have no neighbours (2D). Returns nothing.

    free: as wet, of the nodes from which the sweep need not bounce anything back.
    """
    for z in range(low, high):
        for y in range(kinds.shape[1]):
            for v in range(kinds.shape[2]):
                kinds[z, y, v] = kind_of(wet, free, inside, flat, z, y, v)


@njit(forceinline=True)
def kind_of(wet, free, inside, flat, z, y, v):
    around, reach = with_neighbours(inside[v]), 0 if flat else 1
    if ((wet[z + 1, y + 1, v] >> 1) & inside[v]) == 0:
        return SKIP
    for a in range(z, z + 3):
        for b in range(y + 1 - reach, y + 2 + reach):
            if (free[a, b, v] & around) != around:
                return MIXED
    return PLAIN


@njit(forceinline=True)
def with_neighbours(inside):
    """Bits, as in wet, of the nodes of a vector and of those beside them in the row."""
    return inside | (inside << 1) | (inside << 2)


@njit
def look_ahead(kinds, strides, bytes_per_element, n, ahead, hops, low, high):
    """hops of planes low.. (see sweep): bytes to the vector with fluid that is `ahead` later in the order of the sweep.

    The last ones of the planes look at themselves.
    """
    for z in range(low, high):
        for y in range(kinds.shape[1]):
            _skip(kinds, hops, z, y)
    first, most = np.int64(0), np.int64(1 << 40)  # as typed as in `renew`, so that `_fetch` is compiled once
    _fetch(kinds, strides, bytes_per_element, n, ahead, hops, low, first, high, most)


@njit(forceinline=True)
def _skip(kinds, hops, z, y):
    """Vectors without fluid from each vector of a row on."""
    run = 0
    for v in range(kinds.shape[2] - 1, -1, -1):
        run = run + 1 if kinds[z, y, v] == SKIP else 0
        hops[z, y, v] = run


@njit
def _fetch(kinds, strides, bytes_per_element, n, ahead, hops, low, row, high, most):
    """Hops of the `most` first vectors with fluid from a row of the plane low on, before the plane high."""
    ring = zeros((ahead, 4), np.int64)  # the last `ahead` vectors with fluid
    count = 0
    for z in range(low, high):
        for y in range(row if z == low else 0, kinds.shape[1]):
            for v in range(kinds.shape[2]):
                if kinds[z, y, v] == SKIP:
                    continue
                place = z * strides[1] + y * strides[2] + v * n
                slot = count % ahead
                if count >= ahead:
                    earlier = ring[slot]
                    hops[earlier[0], earlier[1], earlier[2]] = (place - earlier[3]) * bytes_per_element
                ring[slot, 0], ring[slot, 1], ring[slot, 2], ring[slot, 3] = z, y, v, place
                count += 1
                if count >= ahead + most:
                    return


@njit
def renew(solid, ghosts, vectors, same, flat, strides, bytes_per_element, ahead, changed):
    """What mark, classify and look_ahead say after edits of `solid` at the flat places `changed` alone.

    same: free is wet; else it does not change. Rows whose vectors do not change between with and without fluid keep
    their hops.
    """
    n, wet, free, inside, kinds, hops = vectors
    rows, columns = solid.shape[1], solid.shape[2]
    for place in changed:
        x, row, z = place % columns, place // columns % rows + 1 - ghosts, place // (columns * rows)
        is_wet = np.int32(solid[z, row - 1 + ghosts, x] == FLUID)
        for v in range(max((x - 2) // n, 0), min(x // n + 1, wet.shape[2])):
            word = (wet[z, row, v] & ~(1 << (x - v * n))) | (is_wet << (x - v * n))
            wet[z, row, v] = word
            if 0 < z <= kinds.shape[0] and 0 < row <= kinds.shape[1]:
                before, now = kinds[z - 1, row - 1, v], kind_of(wet, free, inside, flat, z - 1, row - 1, v)
                kinds[z - 1, row - 1, v] = now
                if (before == SKIP) != (now == SKIP):
                    _skip(kinds, hops, z - 1, row - 1)
                    in_row = np.int64(0)
                    for kind in kinds[z - 1, row - 1]:
                        in_row += kind != SKIP
                    end = min(z + 1, kinds.shape[0])
                    _fetch(kinds, strides, bytes_per_element, n, ahead, hops, z - 1, row - 1, end, in_row)
            around = with_neighbours(inside[v])
            if not same or (is_wet and (word & around) != around):
                continue  # neighbours cannot be surrounded by fluid
            for a in range(max(z - 2, 0), min(z + 1, kinds.shape[0])):
                for b in range(max(row - 2, 0), min(row + 1, kinds.shape[1])):
                    if is_wet and kinds[a, b, v] == MIXED:
                        kinds[a, b, v] = kind_of(wet, free, inside, flat, a, b, v)
                    elif not is_wet and kinds[a, b, v] == PLAIN:
                        kinds[a, b, v] = MIXED


@njit
def receive(f, buffer, strides, wet, n, slots, moves, plane, beyond, sign):
    """Put what arrived from the plane `beyond` (its index in wet) into f; buffer[k, row stride x rows] for slots[k].

    moves[k] = (row, x) step of the first of the pair. sign 1: the message of the plane above, for its nodes' seconds
    of pairs, put into the stored plane `plane` where those below look for them; -1: from below, into plane 0. Values
    of solid nodes are left out: there the node's own bounced population waits.
    """
    rows, row_stride, first = strides[5], strides[2], strides[3]
    for k in range(slots.size):
        row_step, x_step = sign * moves[k, 0], sign * moves[k, 1]
        source = buffer[k]
        for y in range(wet.shape[1] - 2):
            at = y + row_step if sign > 0 else y
            at = 0 if at == rows else (rows - 1 if at < 0 else at)
            shift = x_step if sign > 0 else 0
            begin = at * row_stride + first + shift
            target = slots[k] * strides[0] + plane * strides[1]
            for v in range(wet.shape[2]):
                bits = wet[beyond, y + 1 + row_step, v] >> (1 + x_step)
                for b in range(n):
                    if (bits >> b) & 1:
                        i = begin + v * n + b
                        f[target + i] = source[i]
