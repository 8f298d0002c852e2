"""Searches among the bodies of a rank, in slots up to `end`: the edge of the fluid, spray, leaks, and walls."""

import numpy as np

from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.vector import (
    Vec,
    bitmask,
    first_bit,
    fma,
    lanes,
    largest_lane,
    load,
    maximum,
    rint,
    select,
    splat,
)
from sph.kernels.marks import BODY, CODES, FLUID, MINE, WALL_SHIFT

N = lanes(np.float64)
F, I = Vec(N, np.float64), Vec(N, np.int32)


@njit
def farthest(end, sign, flags, x):
    """Largest sign x[n] of the own fluid; -inf where none is."""
    best = splat(F, -np.inf)
    for b in range(0, end, N):
        mine = load(I, flags, b) & MINE == MINE
        best = maximum(best, select(mine, load(F, x, b) * sign, -np.inf))
    return largest_lane(best)


@njit
def beside(end, flags, x, at, reach, period, slots):
    """Find own fluid at most reach[d] m from at[d] along every axis, by the nearest image where period[d] > 0: its
    slots, as many as there is room for in slots[n]. Returns how many there are.
    """
    n = 0
    for b in range(0, end, N):
        near = load(I, flags, b) & MINE == MINE
        for k in range(at.size):
            d = load(F, x[k], b) - at[k]
            if period[k] > 0.0:
                d = d - rint(d / period[k]) * period[k]
            near = near & (abs(d) <= reach[k])
        found = bitmask(near)
        while found != 0:
            if n < slots.size:
                slots[n] = b + first_bit(found)
            n += 1
            found &= found - 1
    return n


@njit
def with_few(end, flags, key, x, slots, support, most, found):
    """Set found[n] where the fluid in slots[n] has at most so many neighbours of other fluid; its own images are none.
    Neighbours mostly are in slots nearby, which come first.
    """
    every = (end + N - 1) // N
    for n in range(slots.size):
        s = np.uint64(slots[n])
        count, here = 0, slots[n] // N
        for step in range(2 * every):
            block = here + ((step + 1) >> 1) * (1 - 2 * (step & 1))
            if block < 0 or block >= every:
                continue
            b = block * N
            square = splat(F, 0.0)
            for k in range(len(x)):
                d = load(F, x[k], b) - x[k, s]
                square = fma(d, d, square)
            near = bitmask((load(I, flags, b) & FLUID == FLUID) & (square < support * support))
            while near != 0:
                other = np.uint64(b + first_bit(near))
                count += key[other] // CODES != key[s] // CODES
                near &= near - 1
            if count > most:
                break
        found[n] = count <= most


@njit
def unsafe(end, flags, x, turn, start, counts, known, solid, slots, cells):
    """Find own fluid that is in no cell with known[cell] = 1: its slots and cells, as many as there is room for in
    slots[n], cells[n]. Places in edges of cells are start[d] + turn[d, d] x. Beyond all of counts[d] cells nobody is
    found around a solid, and everybody elsewhere, in cell -1. Returns how many there are.
    """
    n, d = 0, counts.size
    for s in range(end):
        if flags[s] & MINE != MINE:
            continue
        cell = 0
        for k in range(d):
            place = start[k]
            for j in range(d):
                place += turn[k, j] * x[j, s]
            if not 0.0 <= place < counts[k]:
                cell = -1
                break
            cell = cell * counts[k] + int(place)
        if known[cell] != 1 if cell >= 0 else not solid:
            if n < slots.size:
                slots[n], cells[n] = s, cell
            n += 1
    return n


@njit
def wall_of(key, images):
    """Number of the wall of a particle or of an image in one (images[number] = 1 + wall, 0 for none), -1 for none."""
    image = key % CODES
    return images[image] - 1 if image > 0 else (key >> WALL_SHIFT) - 1


@njit
def of_walls(end, flags, key, images, wanted, slots, walls):
    """Find bodies of the walls wanted[wall], and images of the fluid in them (images[number] = 1 + wall, 0 for none):
    their slots and walls, as many as there is room for in slots[n], walls[n]. Returns how many there are.
    """
    n = 0
    for b in range(0, end, N):
        kinds = load(I, flags, b)
        others = bitmask((kinds & BODY == BODY) & (kinds & MINE != MINE))
        while others != 0:
            s = np.uint64(b + first_bit(others))
            others &= others - 1
            wall = wall_of(key[s], images)
            if wall >= 0 and wanted[wall]:
                if n < slots.size:
                    slots[n], walls[n] = s, wall
                n += 1
    return n
