"""Ghosts: images k of bodies at turn x + shift with the velocity spin v + push, and what they show. Image 0 is the body
itself.
"""

import numpy as np

from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.vector import Vec, bitmask, first_bit, lanes, load, splat
from sph.kernels.marks import FLOWS, OWN, REAL

DIM = 3
NAMES = 3  # columns of what does not change with time: key, flags, mass

N = lanes(np.float64)
F, I = Vec(N, np.float64), Vec(N, np.int32)

# What allocates nothing does not count the owners of arrays; a call would hand over arrays by dozens of numbers.
kernel, inlined = njit(_nrt=False), njit(_nrt=False, forceinline=True)


@inlined
def with_image(first, k, layer, x, images):
    """Bits of the own bodies (layer >= 0) in N slots that have image k: x . normals[k, p] < offsets[k, p] for all p."""
    found = bitmask(load(I, layer, first) >= 0)
    for p in range(images.offsets.shape[1]):
        if found == 0:
            break
        along = splat(F, 0.0)
        for a in range(DIM):
            along = along + images.normals[k, p, a] * load(F, x[a], first)
        found &= bitmask(along < images.offsets[k, p])
    return found


@inlined
def beside_peers(first, layer, spans):
    """Bits of the own bodies in N slots whose layers are in or beside those of other ranks."""
    l, found = load(I, layer, first), 0
    for r in range(1, spans.shape[0]):
        found |= bitmask((l >= spans[r, 0] - 1) & (l <= spans[r, 1]))
    return found & bitmask(l >= 0)


@inlined
def find_shift(b, k, x, images, centre, shift):
    """shift[d] of image k of the body in slot b, m: that of the map and, of a layer of centres, across it twice the
    nearest one. centre[d]: room.
    """
    for a in range(DIM):
        centre[a] = 0.0
    for t in range(images.tangents.shape[1]):
        along = 0.0
        for a in range(DIM):
            along += (x[a, b] - images.origin[k, a]) * images.tangents[k, t, a]
        along = min(max(np.rint(along / images.squares[k, t]), images.ends[k, t, 0]), images.ends[k, t, 1])
        for a in range(DIM):
            centre[a] += along * images.tangents[k, t, a]
    for a in range(DIM):
        across = 0.0
        for j in range(DIM):
            across += (images.origin[k, j] + centre[j]) * images.across[k, j, a]
        shift[a] = images.shift[k, a] + 2.0 * across


@inlined
def turned(matrix, vector, b, k, moved):
    """moved + sum of matrix[k, j] vector[j, b] over j."""
    for j in range(DIM):
        if matrix[k, j] != 0.0:
            moved += matrix[k, j] * vector[j, b]
    return moved


@kernel
def choose(layer, x, images, grid, spans, centre, rows, codes, shift, seers):
    """Find who is a ghost where: image codes[g] (0: itself) of the own body (layer >= 0) in slot rows[g], shifted by
    shift[g], of each rank r with bit r in seers[g]. Returns how many there are; the last place is for those too many.

    Rank r, of which 0 is this one, needs what is in or beside its layers spans[r] = (first, behind the last). grid =
    (layers per m, pads, layers).
    """
    count, ranks = 0, spans.shape[0]
    for first in range(0, layer.size, N):
        for k in range(images.turn.shape[0]):
            bits = with_image(first, k, layer, x, images) if k > 0 else beside_peers(first, layer, spans)
            while bits != 0:
                b, g, seen = first + first_bit(bits), min(count, rows.size - 1), 0
                bits &= bits - 1
                find_shift(b, k, x, images, centre, shift[g])
                at = np.floor(turned(images.turn[k], x, b, 0, shift[g, 0]) * grid[0]) + grid[1]
                at = min(max(at, 0.0), grid[2] - 1.0)
                for r in range(0 if k > 0 else 1, ranks):
                    if spans[r, 0] - 1 <= at and at <= spans[r, 1]:
                        seen |= 1 << r
                rows[g], codes[g], seers[g] = b, k, seen
                count += seen != 0
    return count


@inlined
def turned_tensor(left, right, tensor, b, values):
    """values[DIM k + l] = sum of left[k, i] right[l, j] tensor[DIM i + j, b] over i and j."""
    for k in range(DIM):
        for l in range(DIM):
            entry = 0.0
            for i in range(DIM):
                for j in range(DIM):
                    entry += left[k, i] * right[l, j] * tensor[DIM * i + j, b]
            values[DIM * k + l] = entry


@inlined
def trace(matrix):
    entries = 0.0
    for k in range(DIM):
        entries += matrix[k, k]
    return entries


@inlined
def way_off(turn, at, b, a, x):
    """z n[a]: from a wall to the body in slot b, whose image is at `at`."""
    off = 0.0
    for j in range(DIM):
        off += 0.25 * (np.float64(a == j) - turn[a, j]) * (x[j, b] - at[j])
    return off


@inlined
def wall_slopes(turn, at, speed, near, b, shown, values):
    """Give the image of a body in a no-slip mirror, at `at` with the velocity `speed`, the slope of the velocity at the
    wall: n . shear = 2 (v - v_wall) / z - n . shear of the body, which a parabola has. A mirrored slope has a kink at
    the wall, whose divergence drives waves of two spacings. near = (the least z looked at, m; c0 / h, 1/s).
    """
    square = 0.0
    for a in range(DIM):
        off = way_off(turn, at, b, a, shown.x)
        square += off * off
    square = max(square, near[0] * near[0])
    for a in range(DIM):
        off = way_off(turn, at, b, a, shown.x)
        for k in range(DIM):
            own = 0.0
            for j in range(DIM):
                own += 0.5 * (np.float64(a == j) - turn[a, j]) * shown.shear[DIM * j + k, b]
            steep = off * 0.5 * (shown.v[k, b] - speed[k]) / (square * near[1])
            values[DIM * a + k] += 2.0 * (steep - own)


@kernel
def show(rows, codes, shift, images, shown, near, values):
    """values[g] = x, v, drho, and gradient, own, shear, matrix where they are kept, of image codes[g] of the body in
    slot rows[g], shifted by shift[g]; shear[a, b] = d v_b / d x_a; and its names, if there are columns for them. near:
    see `wall_slopes`.
    """
    numbers = values.view(np.int64)
    for g in range(rows.size):
        b, code = rows[g], codes[g]
        turn, spin, column = images.turn[code], images.spin[code], 2 * DIM + 1
        for k in range(DIM):
            values[g, k] = turned(turn, shown.x, b, k, shift[g, k])
            values[g, DIM + k] = turned(spin, shown.v, b, k, images.push[code, k])
        values[g, 2 * DIM] = shown.drho[b]
        for vector in (shown.gradient, shown.own):
            if vector.shape[1] > 0:
                for k in range(DIM):
                    values[g, column + k] = turned(turn, vector, b, k, 0.0)
                column += DIM
        if shown.shear.shape[1] > 0:
            turned_tensor(turn, spin, shown.shear, b, values[g, column:])
            mirrors, sticks = DIM - 2.0, -1.0 * DIM  # traces of one reflection, and of velocities that turn round
            if trace(turn) == mirrors and trace(spin) == sticks:
                wall_slopes(turn, values[g], values[g, DIM:], near, b, shown, values[g, column:])
            column += DIM * DIM
        if shown.matrix.shape[1] > 0:
            turned_tensor(turn, turn, shown.matrix, b, values[g, column:])
            column += DIM * DIM
        if column < values.shape[1]:
            hidden = OWN | (REAL if code > 0 else 0) | (FLOWS if images.mirrored[code] else 0)
            numbers[g, column], numbers[g, column + 1] = shown.key[b] + code, shown.flags[b] & ~hidden
            values[g, column + 2] = shown.m[b]


@kernel
def take(values, rows, shown):
    """Put values[g], as `show` made them, into the ghosts in slots rows[g]."""
    numbers = values.view(np.int64)
    for g in range(values.shape[0]):
        b, column = rows[g], 2 * DIM + 1
        for k in range(DIM):
            shown.x[k, b], shown.v[k, b] = values[g, k], values[g, DIM + k]
        shown.drho[b] = values[g, 2 * DIM]
        for lines in (shown.gradient, shown.own, shown.shear, shown.matrix):
            if lines.shape[1] > 0:
                for k in range(lines.shape[0]):
                    lines[k, b] = values[g, column + k]
                column += lines.shape[0]
        if column < values.shape[1]:
            shown.key[b], shown.flags[b] = numbers[g, column], numbers[g, column + 1]
            shown.m[b] = values[g, column + 2]
