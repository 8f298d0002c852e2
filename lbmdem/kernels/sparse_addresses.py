"""Positions of fluid nodes one behind the other: tables for the sweep, and what crosses to other ranks; compiled."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.scratch import zeros
from lbmdem.kernels.layout import arrival, element
from lbmdem.kernels.sparse import BROKEN, FIRST, SHUT, WHOLE
from lbmdem.sizes import SPARSE_BLOCK as BLOCK


class Neighbours(NamedTuple):
    """Where vectors of nodes have their neighbours: see `kernels.sparse`."""

    kinds: NDArray[np.int8]
    masks: NDArray
    shifts: NDArray[np.int32]
    rest: NDArray[np.int64]
    where: NDArray
    code: NDArray[np.uint32]


@njit
def tables(positions, row_ghosts, ways, n, stride, first, blocks, found):
    """Fill the Neighbours `found`, from positions[planes + 2, rows + 2 row_ghosts, nx + 2]; ways[i - 1] = e_i.

    Returns how many other pieces there are; they are stored if there is room for all.
    """
    kinds, masks, shifts, rest, where, code = found
    masks[:, :, SHUT] = (1 << n) - 1  # also in lanes without a node, whose values stay where they are
    q, total = ways.shape[0], 0
    n_others, others, others_at = zeros(q, np.int64), zeros((q, n), np.int64), zeros((q, n), np.int64)
    for z in range(first.size - 1):
        v = first[z]
        rest[blocks[z]] = total
        for y in range(row_ghosts, positions.shape[1] - row_ghosts):
            for x in range(1, positions.shape[2] - 1):
                here = np.int64(positions[z + 1, y, x])
                if here < 0:
                    continue
                if here // n != v:
                    total = _put(v, (v - first[z]) % BLOCK, n, stride, n_others, others, others_at, total, where, code)
                    v = here // n
                    if (v - first[z]) % BLOCK == 0:
                        rest[blocks[z] + (v - first[z]) // BLOCK] = total
                for i in range(q):
                    there = np.int64(positions[z + 1 + ways[i, 0], y + ways[i, 1], x + ways[i, 2]])
                    if there >= 0:
                        word, distance, lane = masks[v, i], there - here, 1 << (here % n)
                        word[SHUT] &= ~lane
                        if word[FIRST] == 0 or shifts[v, i] == distance:
                            shifts[v, i] = distance
                            word[FIRST] |= lane
                        else:
                            n_others[i] = _find(distance, lane, n_others[i], others[i], others_at[i])
        total = _put(v, (v - first[z]) % BLOCK, n, stride, n_others, others, others_at, total, where, code)
    rest[blocks[-1]] = total
    for v in range(kinds.size):
        kinds[v] = WHOLE if (masks[v, :, FIRST] == (1 << n) - 1).all() else BROKEN
    return total


@njit(forceinline=True)
def _find(distance, lane, count, others, others_at):
    """Note a lane whose neighbour is so far from it; how many pieces there are now."""
    k = 0
    while k < count and others[k] != distance:
        k += 1
    if k == count:
        others[k], others_at[k] = distance, 0
        count += 1
    others_at[k] |= lane
    return count


@njit
def _put(v, row, n, stride, n_others, others, others_at, total, where, code):
    """List the other pieces of a vector, and forget them."""
    q = n_others.size
    for i in range(q):
        for k in range(n_others[i]):
            if total < code.size:
                where[total] = (i + 1) * stride + v * n + others[i, k]
                code[total] = ((row * q + i) << 16) | others_at[i, k]
            total += 1
        n_others[i] = 0
    return total


@njit
def take_over(f, places, old, old_places, parity, nx, low, high):
    """Populations of fluid nodes of planes low..high from the array `old`; places, old_places: `layout.Addresses`."""
    strides, slots, shifts, positions = places
    old_strides, old_slots, old_shifts, _ = old_places
    rows = positions.shape[1] - 2 * strides[1]
    for z in range(low, high):
        for y in range(rows):
            for x in range(nx):
                if positions[z + 1, y + strides[1], x + 1] >= 0:
                    for i in range(shifts.shape[0]):
                        value = old[arrival(old_strides, old_slots, old_shifts, parity, z, y, x, i)]
                        f[element(strides, slots, shifts, positions, parity, z, y, x, i)] = value


@njit
def returned(f, buffer, strides, shifts, positions, ways, plane):
    """Put what the rank beyond has written for own nodes of a plane: buffer[k] of the direction ways[k].

    Only from its fluid nodes: elsewhere the node's own bounced population waits.
    """
    for k in range(ways.size):
        i, count = ways[k], 0
        for y in range(strides[1], positions.shape[1] - strides[1]):
            for x in range(1, positions.shape[2] - 1):
                here = positions[plane + 1, y, x]
                if here < 0:
                    continue
                if positions[plane + 1 + shifts[i, 0], y + shifts[i, 1], x + shifts[i, 2]] >= 0:
                    f[i * strides[0] + here] = buffer[k, count]
                count += 1
