"""Which nodes are fluid, as the sweep wants to know it, and populations that came from another rank."""

import numpy as np

from hpcpic.core.simd.jit import njit
from lbmdem.kernels.layout import FLUID
from lbmdem.kernels.sweep import MIXED, PLAIN, SKIP


@njit
def mark(solid, ghosts, wet, n, low, high):
    """wet[plane, row, vector] of planes low.. (ghosts counted) from solid[planes + 2, rows + 2 ghosts, nx + 2].

    n nodes to a vector; bit b says that node b - 1 of the vector is fluid. `ghosts` rows of solid are outside.
    """
    for z in range(low, high):
        for y in range(solid.shape[1]):
            ids, bits = solid[z, y], wet[z, y + 1 - ghosts]
            for v in range(bits.size):
                word = 0
                for b in range(min(n + 2, ids.size - v * n)):
                    word |= (ids[v * n + b] == FLUID) << b
                bits[v] = word


@njit
def classify(wet, inside, n, flat, kinds, low, high):
    """kinds[plane, row, vector] of planes low..; flat: the rows have no neighbours (2D). Returns nothing."""
    full = (1 << (n + 2)) - 1
    reach = 0 if flat else 1
    for z in range(low, high):
        for y in range(kinds.shape[1]):
            for v in range(kinds.shape[2]):
                if ((wet[z + 1, y + 1, v] >> 1) & inside[v]) == 0:
                    kinds[z, y, v] = SKIP
                    continue
                all_wet = full
                for a in range(z, z + 3):
                    for b in range(y + 1 - reach, y + 2 + reach):
                        all_wet &= wet[a, b, v]
                kinds[z, y, v] = PLAIN if all_wet == full and inside[v] == (full >> 2) else MIXED


@njit
def look_ahead(kinds, strides, bytes_per_element, n, ahead, hops, low, high):
    """hops of planes low.. (see sweep): ring holds the last `ahead` vectors with fluid in the order of the sweep."""
    ring = np.zeros((ahead, 4), np.int64)
    count = 0
    for z in range(low, high):
        for y in range(kinds.shape[1]):
            run = 0
            for v in range(kinds.shape[2] - 1, -1, -1):
                run = run + 1 if kinds[z, y, v] == SKIP else 0
                hops[z, y, v] = run
            for v in range(kinds.shape[2]):
                if kinds[z, y, v] != SKIP:
                    place = z * strides[1] + y * strides[2] + v * n
                    slot = count % ahead
                    if count >= ahead:
                        earlier = ring[slot]
                        hops[earlier[0], earlier[1], earlier[2]] = (place - earlier[3]) * bytes_per_element
                    ring[slot, 0], ring[slot, 1], ring[slot, 2], ring[slot, 3] = z, y, v, place
                    count += 1


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
