"""Positions of fluid nodes one behind the other: tables for the sweep, and what crosses to other ranks; compiled."""

import numpy as np

from hpcpic.core.simd.jit import njit
from lbmdem.kernels.layout import arrival, element
from lbmdem.kernels.sparse import FIRST, MANY, PLAIN, SECOND, SHUT, TWO


@njit
def tables(positions, row_ghosts, ways, n, first, kinds, words, shifts, more, more_way, more_word, more_shift):
    """The tables of kernels.sparse, from positions[planes + 2, rows + 2 row_ghosts, nx + 2]; ways[i - 1] = e_i.

    Returns how many pieces are left over; they are stored if there is room for all.
    """
    words[:, :, SHUT] = (1 << n) - 1  # also in lanes without a node, whose values stay where they are
    lost, lost_at = np.zeros((ways.shape[0], n), np.int64), np.zeros((ways.shape[0], n), np.int64)
    n_lost, total = np.zeros(ways.shape[0], np.int64), 0
    for z in range(first.size - 1):
        v = first[z]
        more[v] = total
        for y in range(row_ghosts, positions.shape[1] - row_ghosts):
            for x in range(1, positions.shape[2] - 1):
                here = np.int64(positions[z + 1, y, x])
                if here < 0:
                    continue
                if here // n != v:
                    total = _put(v, n_lost, lost, lost_at, total, more_way, more_word, more_shift)
                    v = here // n
                    more[v] = total
                for i in range(ways.shape[0]):
                    there = np.int64(positions[z + 1 + ways[i, 0], y + ways[i, 1], x + ways[i, 2]])
                    if there >= 0:
                        _find(words[v, i], shifts[v, i], there - here, 1 << (here % n), n_lost, lost[i], lost_at[i], i)
        total = _put(v, n_lost, lost, lost_at, total, more_way, more_word, more_shift)
    more[kinds.size] = total
    for v in range(kinds.size):
        kinds[v] = PLAIN if (words[v, :, FIRST] == (1 << n) - 1).all() else TWO
        if more[v + 1] > more[v]:
            kinds[v] = MANY
    return total


@njit(inline="always")
def _find(word, shift, distance, lane, n_lost, lost, lost_at, i):
    """Note a lane whose neighbour is so far from it: in one of the two pieces, or as left over."""
    word[SHUT] &= ~lane
    if word[FIRST] == 0 or shift[0] == distance:
        shift[0] = distance
        word[FIRST] |= lane
    elif word[SECOND] == 0 or shift[1] == distance:
        shift[1] = distance
        word[SECOND] |= lane
    else:
        k = 0
        while k < n_lost[i] and lost[k] != distance:
            k += 1
        if k == n_lost[i]:
            lost[k], lost_at[k] = distance, 0
            n_lost[i] += 1
        lost_at[k] |= lane


@njit
def _put(v, n_lost, lost, lost_at, total, more_way, more_word, more_shift):
    for i in range(n_lost.size):
        for k in range(n_lost[i]):
            if total < more_way.size:
                more_way[total], more_word[total], more_shift[total] = i, lost_at[i, k], lost[i, k]
            total += 1
        n_lost[i] = 0
    return total


@njit
def take_over(f, strides, slots, shifts, old, old_strides, old_slots, old_shifts, positions, parity, nx, low, high):
    """Populations of fluid nodes of planes low..high from the array `old` of `kernels.layout`."""
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
