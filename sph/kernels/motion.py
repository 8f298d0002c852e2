"""Own bodies forward in time, by chunks of slots: x[d, n] m, v[d, n] m/s, drho[n] kg/m3, with the pair sums (see
`pairs`) as they are: sums[k, n] of forces, sums[at, n] of rates of density.

numbers = (time step, weights of the old state, of the present one and of the rates). factors = (of a sum of forces,
over m: the acceleration without gravity and body force; of a sum of rates: d rho / dt). Wall bodies move as their walls
do, only their density evolves here. flags see sph.kernels.marks.
"""

import numpy as np

from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.scratch import zeros
from hpcpic.core.simd.vector import (
    Vec,
    bitmask,
    bits,
    convert,
    first_bit,
    lanes,
    largest_lane,
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
def clear_own(chunk, chunks, own):
    """Nobody has an acceleration of the user's own, until `kernels.driven` finds it."""
    for k in range(DIM):
        own[k, chunks[chunk] : chunks[chunk + 1]] = 0.0


@njit
def add_own(chunk, chunks, factors, flags, own, m, sums):
    """Sums of forces get those by accelerations of the user's own."""
    for b in range(chunks[chunk], chunks[chunk + 1]):
        if flags[b] & MINE == MINE:
            for k in range(DIM):
                sums[k, b] += m[b] * own[k, b] / factors[0]


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
    r = zeros(DIM, np.float64)
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
    r = zeros(DIM, np.float64)
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
def set_off(chunk, chunks, numbers, flags, offset, v, v_old):
    """v += numbers[1] offset, and remember v: particles of the fluid go away from where they are crowded."""
    for b in range(chunks[chunk], chunks[chunk + 1]):
        if flags[b] & FLUID and flags[b] & OWN:
            for k in range(DIM):
                v_old[k, b] = v[k, b]
                v[k, b] += numbers[1] * offset[k, b]


@njit
def arrive(chunk, chunks, flags, v, v_old):
    """Give particles of the fluid the velocity that they had when they set off."""
    for b in range(chunks[chunk], chunks[chunk + 1]):
        if flags[b] & FLUID and flags[b] & OWN:
            for k in range(DIM):
                v[k, b] = v_old[k, b]


@njit
def swap(chunk, chunks, flags, mirrors, x, v):
    """A particle that is behind a mirror changes places with its image, which changes nothing else."""
    normals, bounds = mirrors.normals, mirrors.bounds
    at, speed = zeros(DIM, np.float64), zeros(DIM, np.float64)
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
    found = splat(L, 0)
    for b in range(first, last, N):
        found = found + select(load(I, flags, b) & among == wanted, bits(load(F, line, b)), 0)
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
