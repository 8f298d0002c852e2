"""Own bodies forward in time, by chunks of slots: x[d, n] m, v[d, n] m/s, drho[n] kg/m3, with the pair sums (see
`pairs`) as they are: sums[k, n] of forces, sums[at, n] of rates of density.

numbers = (time step, weights of the old state, of the present one and of the rates). factors = (of a sum of forces,
over m: the acceleration without gravity and body force; of a sum of rates: d rho / dt). Wall bodies move as their walls
do, only their density evolves here. flags see sph.kernels.marks.
"""

import numpy as np

from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.vector import (
    Vec,
    bitmask,
    convert,
    first_bit,
    lanes,
    load,
    maximum,
    select,
    splat,
    store,
    total,
)  # fmt: skip
from sph.kernels.marks import FLUID, MINE, NO_DENSITY, OWN, WALL_SHIFT

DIM = 3
REAL = "float64"  # of the sums

N = lanes(np.float64)
F, I, L, S = Vec(N, np.float64), Vec(N, np.int32), Vec(N, np.int64), Vec(N, np.dtype(REAL))


@njit
def keep(chunk, chunks, y, y_old):
    """Remember the state at the start of a step."""
    for b in range(np.uint64(chunks[chunk]), np.uint64(chunks[chunk + 1])):
        for k in range(DIM):
            y_old.x_old[k, b], y_old.v_old[k, b] = y.x[k, b], y.v[k, b]
        y_old.drho_old[b] = y.drho[b]


@njit
def advance(chunk, chunks, numbers, factors, at, flags, external, y, m, sums, y_old):
    """y = old y_old + now y + new dt f(y), a stage of a Runge-Kutta method; numbers[4] != 0: x with the new v."""
    old, now, new = numbers[1], numbers[2], numbers[3] * numbers[0]
    x, v, drho = y.x, y.v, y.drho
    for b in range(np.uint64(chunks[chunk]), np.uint64(chunks[chunk + 1])):
        if flags[b] & OWN == 0:
            continue
        rate = np.float64(sums[at, b]) * factors[1] if flags[b] & NO_DENSITY == 0 else 0.0
        drho[b] = now * drho[b] + new * rate
        if old != 0.0:  # else there may be no old state
            drho[b] += old * y_old.drho_old[b]
        if flags[b] & FLUID == 0:
            drho[b] = max(drho[b], 0.0)  # walls do not suck
            continue
        factor = factors[0] / m[b]
        for k in range(DIM):
            before = v[k, b]
            v[k, b] = now * before + new * (np.float64(sums[k, b]) * factor + external[k])
            if old != 0.0:
                v[k, b] += old * y_old.v_old[k, b]
            speed = v[k, b] if numbers[4] != 0.0 else before
            x[k, b] = now * x[k, b] + new * speed
            if old != 0.0:
                x[k, b] += old * y_old.x_old[k, b]


@njit
def kick(chunk, chunks, numbers, factors, flags, external, v, m, sums):
    """v += dt a."""
    for b in range(chunks[chunk], chunks[chunk + 1], N):
        mine = load(I, flags, b) & MINE == MINE
        factor = factors[0] / load(F, m, b)
        for k in range(DIM):
            a = convert(F, load(S, sums[k], b)) * factor + external[k]
            store(v[k], b, load(F, v[k], b) + select(mine, numbers[0] * a, 0.0))


@njit
def drift(chunk, chunks, numbers, factors, at, flags, x, v, drho, sums):
    """x += dt v, rho += dt d rho / dt."""
    for b in range(chunks[chunk], chunks[chunk + 1], N):
        kinds, dense = load(I, flags, b), load(F, drho, b)
        mine = kinds & MINE == MINE
        rate = convert(F, load(S, sums[at], b)) * factors[1]
        dense = dense + select(kinds & (OWN | NO_DENSITY) == OWN, numbers[0] * rate, 0.0)
        store(drho, b, select(kinds & MINE == OWN, maximum(dense, 0.0), dense))  # walls do not suck
        for k in range(DIM):
            store(x[k], b, load(F, x[k], b) + select(mine, numbers[0] * load(F, v[k], b), 0.0))


@njit
def carry(chunk, chunks, flags, key, wall_shift, wall_speed, x, v):
    """Move wall particles with their walls, by wall_shift[w, d] m, at wall_speed[w, d] m/s."""
    for b in range(chunks[chunk], chunks[chunk + 1]):
        w = (key[b] >> WALL_SHIFT) - 1
        if w >= 0 and flags[b] & OWN:
            for k in range(DIM):
                x[k, b] += wall_shift[w, k]
                v[k, b] = wall_speed[w, k]


@njit
def to_centre(b, key, period, moves, x, r):
    """Number of the body of the wall particle in slot b, -1 for none, and r[d] = its place from the centre, m."""
    n = moves.body_of[(key[b] >> WALL_SHIFT) - 1]
    if n >= 0:
        for k in range(DIM):
            r[k] = x[k, b] - moves.body_centre[n, k]
            if period[k] > 0.0:
                r[k] -= period[k] * np.rint(r[k] / period[k])
    return n


@njit
def move_bodies(chunk, chunks, flags, key, period, moves, x):
    """Move the particles of rigid bodies by the way of the centre and the rotation about it."""
    r = np.zeros(DIM)
    for first in range(chunks[chunk], chunks[chunk + 1], N):
        solids = bitmask(load(I, flags, first) & MINE == OWN)
        while solids != 0:
            b = first + first_bit(solids)
            solids &= solids - 1
            n = to_centre(b, key, period, moves, x, r)
            if n >= 0:
                for k in range(DIM):
                    for j in range(DIM):
                        x[k, b] += moves.body_turn[n, k, j] * r[j]
                    x[k, b] += moves.body_way[n, k]


@njit
def spin_bodies(chunk, chunks, flags, key, period, moves, x, v):
    """Give the particles of rigid bodies the velocity v + w x r that they have where they are."""
    r = np.zeros(DIM)
    for first in range(chunks[chunk], chunks[chunk + 1], N):
        solids = bitmask(load(I, flags, first) & MINE == OWN)
        while solids != 0:
            b = first + first_bit(solids)
            solids &= solids - 1
            n = to_centre(b, key, period, moves, x, r)
            if n >= 0:
                for k in range(DIM):
                    v[k, b] = moves.body_velocity[n, k]
                    for j in range(DIM):
                        v[k, b] += moves.body_spin[n, k, j] * r[j]


@njit
def spread(chunk, chunks, numbers, flags, offset, x):
    """x += numbers[1] offset: move particles of the fluid away from where they are crowded."""
    for b in range(chunks[chunk], chunks[chunk + 1]):
        if flags[b] & FLUID and flags[b] & OWN:
            for k in range(DIM):
                x[k, b] += numbers[1] * offset[k, b]


@njit
def swap(chunk, chunks, flags, mirrors, x, v):
    """A particle that is behind a mirror changes places with its image, which changes nothing else."""
    normals, bounds = mirrors.normals, mirrors.bounds
    at, speed = np.zeros(DIM), np.zeros(DIM)
    for b in range(chunks[chunk], chunks[chunk + 1]):
        if flags[b] & FLUID == 0 or flags[b] & OWN == 0:
            continue
        for f in range(normals.shape[0]):
            behind = True
            for p in range(normals.shape[1]):
                height = 0.0
                for k in range(DIM):
                    height += normals[f, p, k] * x[k, b]
                behind = behind and height < bounds[f, p]
                if not behind:
                    break
            if behind:
                for k in range(DIM):
                    at[k], speed[k] = mirrors.shifts[f, k], mirrors.pushes[f, k]
                    for j in range(DIM):
                        at[k] += mirrors.turns[f, k, j] * x[j, b]
                        speed[k] += mirrors.spins[f, k, j] * v[j, b]
                for k in range(DIM):
                    x[k, b], v[k, b] = at[k], speed[k]


@njit
def rewrap(chunk, chunks, period, x):
    """Bring positions back into [0, period) along periodic axes (period > 0)."""
    for k in range(DIM):
        if period[k] > 0.0:
            for b in range(chunks[chunk], chunks[chunk + 1]):
                if x[k, b] < 0.0:
                    x[k, b] += period[k]
                if x[k, b] >= period[k]:
                    x[k, b] -= period[k]


@njit
def bits_of(first, last, flags, among, wanted, line):
    """Sum of the bits of a line over bodies whose flags, of these among, are those wanted; modulo 2^64."""
    found, numbers = splat(L, 0), line.view(np.int64)
    for b in range(first, last, N):
        found = found + select(load(I, flags, b) & among == wanted, load(L, numbers, b), 0)
    return total(found)


@njit
def ends_of(first, last, flags, line):
    """Largest -x and x of the own fluid along one axis."""
    below, above = splat(F, -np.inf), splat(F, -np.inf)
    for b in range(first, last, N):
        mine, at = load(I, flags, b) & MINE == MINE, load(F, line, b)
        below, above = maximum(below, select(mine, -at, -np.inf)), maximum(above, select(mine, at, -np.inf))
    return largest_lane(below), largest_lane(above)


@njit
def largest_lane(vector):
    """The largest of the lanes."""
    line = np.empty(N)
    store(line, 0, vector)
    return line.max()


@njit
def largest(chunk, chunks, factors, flags, external, x, v, m, sums, drho, part_extremes, bits_found):
    """part_extremes[chunk] = largest v^2 of all, a^2 of the fluid, |drho| of all, -x and x of the fluid; not a number
    where one is not. bits_found[chunk, k] = sum of the bits of line k of the state, as kernels.cells.put_back has it.
    """
    first, last, zero = chunks[chunk], chunks[chunk + 1], splat(F, 0.0)
    finite, fastest, hardest, densest = zero, splat(F, -np.inf), splat(F, -np.inf), splat(F, -np.inf)
    for b in range(first, last, N):
        kinds = load(I, flags, b)
        mine, own = kinds & MINE == MINE, kinds & OWN == OWN
        factor = factors[0] / load(F, m, b)
        v2, a2 = zero, zero
        for k in range(DIM):
            speed = load(F, v[k], b)
            a = convert(F, load(S, sums[k], b)) * factor + external[k]
            v2, a2 = v2 + speed * speed, a2 + a * a
        v2, a2, excess = select(own, v2, 0.0), select(mine, a2, 0.0), select(own, abs(load(F, drho, b)), 0.0)
        finite = finite + v2 + a2 + excess
        fastest, hardest, densest = maximum(fastest, v2), maximum(hardest, a2), maximum(densest, excess)
    found = part_extremes[chunk]
    found[0], found[1], found[2] = largest_lane(fastest), largest_lane(hardest), largest_lane(densest)
    for k in range(DIM):
        found[3 + k], found[3 + DIM + k] = ends_of(first, last, flags, x[k])
        bits_found[chunk, k] = bits_of(first, last, flags, OWN, OWN, x[k])
        bits_found[chunk, DIM + k] = bits_of(first, last, flags, OWN, OWN, v[k])
    bits_found[chunk, 2 * DIM] = bits_of(first, last, flags, OWN | NO_DENSITY, OWN, drho)
    bits_found[chunk, 2 * DIM + 1] = bits_of(first, last, flags, OWN, OWN, m)
    if not np.isfinite(total(finite)):
        found[:] = np.nan


@njit
def within(x, b, normals, offsets):
    """True if x . normals[p] < offsets[p] for all p, for the body in slot b."""
    for p in range(offsets.size):
        along = 0.0
        for a in range(DIM):
            if normals[p, a] != 0.0:
                along += normals[p, a] * x[a, b]
        if not along < offsets[p]:
            return False
    return True


@njit
def imaged(layer, x, normals, offsets, rows, codes):
    """Find the images of own bodies (layer >= 0), image after image: a body has image k > 0 if x . normals[k, p] <
    offsets[k, p] for all p. rows = slots of the bodies, codes = numbers of the images, as far as there is room. Returns
    how many there are.
    """
    count = 0
    for k in range(1, normals.shape[0]):
        for b in range(layer.size):
            if layer[b] >= 0 and within(x, b, normals[k], offsets[k]):
                if count < rows.size:
                    rows[count], codes[count] = b, k
                count += 1
    return count


@njit
def turned_tensor(left, right, tensor, b, values):
    """values[DIM k + l] = sum of left[k, i] right[l, j] tensor[DIM i + j, b] over i and j."""
    for k in range(DIM):
        for l in range(DIM):
            entry = 0.0
            for i in range(DIM):
                for j in range(DIM):
                    entry += left[k, i] * right[l, j] * tensor[DIM * i + j, b]
            values[DIM * k + l] = entry


@njit
def wall_slopes(turn, at, speed, near, b, shown, values):
    """Give the image of a body in a no-slip mirror, at `at` with the velocity `speed`, the slope of the velocity at the
    wall: n . shear = 2 (v - v_wall) / z - n . shear of the body, which a parabola has. A mirrored slope has a kink at
    the wall, whose divergence drives waves of two spacings. near = (the least z looked at, m; c0 / h, 1/s).
    """
    square = 0.0
    off = np.zeros(DIM)  # z n
    for a in range(DIM):
        for j in range(DIM):
            off[a] += 0.25 * (np.float64(a == j) - turn[a, j]) * (shown.x[j, b] - at[j])
        square += off[a] * off[a]
    square = max(square, near[0] * near[0])
    for a in range(DIM):
        for k in range(DIM):
            own = 0.0
            for j in range(DIM):
                own += 0.5 * (np.float64(a == j) - turn[a, j]) * shown.shear[DIM * j + k, b]
            steep = off[a] * 0.5 * (shown.v[k, b] - speed[k]) / (square * near[1])
            values[DIM * a + k] += 2.0 * (steep - own)


@njit
def ghost_values(rows, codes, shift, turns, shown, near, values):
    """values[g] = x, v, drho, and gradient, shear, matrix where they are kept, of image codes[g] of the body in slot
    rows[g]: x -> turn x + shift[g], v -> spin v + push; shear[a, b] = d v_b / d x_a. near: see `wall_slopes`.
    """
    for g in range(rows.size):
        b, code = rows[g], codes[g]
        turn, spin, column = turns.turn[code], turns.spin[code], 2 * DIM + 1
        for k in range(DIM):
            at, speed = shift[g, k], turns.push[code, k]
            for j in range(DIM):
                if turn[k, j] != 0.0:
                    at += turn[k, j] * shown.x[j, b]
                if spin[k, j] != 0.0:
                    speed += spin[k, j] * shown.v[j, b]
            values[g, k], values[g, DIM + k] = at, speed
        values[g, 2 * DIM] = shown.drho[b]
        if shown.gradient.shape[1] > 0:
            for k in range(DIM):
                slope = 0.0
                for j in range(DIM):
                    slope += turn[k, j] * shown.gradient[j, b]
                values[g, column + k] = slope
            column += DIM
        if shown.shear.shape[1] > 0:
            turned_tensor(turn, spin, shown.shear, b, values[g, column:])
            mirrors, sticks = DIM - 2.0, -1.0 * DIM  # traces of one reflection, and of velocities that turn round
            if np.trace(turn) == mirrors and np.trace(spin) == sticks:
                wall_slopes(turn, values[g], values[g, DIM:], near, b, shown, values[g, column:])
            column += DIM * DIM
        if shown.matrix.shape[1] > 0:
            turned_tensor(turn, turn, shown.matrix, b, values[g, column:])


@njit
def take_ghosts(values, rows, shown):
    """Put values[g], as `ghost_values` made them, into the ghosts in slots rows[g]."""
    for g in range(values.shape[0]):
        b, column = rows[g], 2 * DIM + 1
        for k in range(DIM):
            shown.x[k, b], shown.v[k, b] = values[g, k], values[g, DIM + k]
        shown.drho[b] = values[g, 2 * DIM]
        for lines in (shown.gradient, shown.shear, shown.matrix):
            if lines.shape[1] > 0:
                for k in range(lines.shape[0]):
                    lines[k, b] = values[g, column + k]
                column += lines.shape[0]
