"""Own bodies forward in time, by chunks: x[d, n] m, v[d, n] m/s, drho[n] kg/m3, with the rates of the pair sums.

numbers = (time step, weights of the old state, of the present one and of the rates); wall bodies move as told elsewhere,
only their density evolves.
"""

import numpy as np

from hpcpic.core.simd.jit import njit

DIM = 3

FLUID = 1


@njit
def keep(chunk, chunks, x, v, drho, x_old, v_old, drho_old):
    """Remember the state at the start of a step."""
    for b in range(chunks[chunk], chunks[chunk + 1]):
        for k in range(DIM):
            x_old[k, b], v_old[k, b] = x[k, b], v[k, b]
        drho_old[b] = drho[b]


@njit
def advance(chunk, chunks, numbers, flags, external, x, v, drho, a, rate, x_old, v_old, drho_old):
    """y = old y_old + now y + new dt f(y), a stage of a Runge-Kutta method; numbers[4] != 0: x with the new v."""
    dt, old, now, new = numbers[0], numbers[1], numbers[2], numbers[3] * numbers[0]
    for b in range(chunks[chunk], chunks[chunk + 1]):
        drho[b] = old * drho_old[b] + now * drho[b] + new * rate[b]
        if flags[b] & FLUID:
            for k in range(DIM):
                before = v[k, b]
                v[k, b] = old * v_old[k, b] + now * before + new * (a[k, b] + external[k])
                speed = v[k, b] if numbers[4] != 0.0 else before
                x[k, b] = old * x_old[k, b] + now * x[k, b] + new * speed


@njit
def kick(chunk, chunks, numbers, flags, external, v, a):
    """v += dt a."""
    for b in range(chunks[chunk], chunks[chunk + 1]):
        if flags[b] & FLUID:
            for k in range(DIM):
                v[k, b] += numbers[0] * (a[k, b] + external[k])


@njit
def drift(chunk, chunks, numbers, flags, x, v, drho, rate):
    """x += dt v, rho += dt d rho / dt."""
    for b in range(chunks[chunk], chunks[chunk + 1]):
        drho[b] += numbers[0] * rate[b]
        if flags[b] & FLUID:
            for k in range(DIM):
                x[k, b] += numbers[0] * v[k, b]


@njit
def rewrap(chunk, chunks, period, x):
    """Positions back into [0, period) along periodic axes (period > 0)."""
    for k in range(DIM):
        if period[k] > 0.0:
            for b in range(chunks[chunk], chunks[chunk + 1]):
                if x[k, b] < 0.0:
                    x[k, b] += period[k]
                if x[k, b] >= period[k]:
                    x[k, b] -= period[k]


@njit
def largest(chunk, chunks, flags, external, v, a, drho, found):
    """found[chunk] = largest v^2, a^2 of the fluid, |drho|; not a number where one is not."""
    speed, force, density, sound = 0.0, 0.0, 0.0, 0.0
    for b in range(chunks[chunk], chunks[chunk + 1]):
        v2, a2 = 0.0, 0.0
        for k in range(DIM):
            v2 += v[k, b] * v[k, b]
            if flags[b] & FLUID:
                a2 += (a[k, b] + external[k]) ** 2
        speed = speed if speed >= v2 else v2  # what is not a number goes through
        force = force if force >= a2 else a2
        density = density if density >= abs(drho[b]) else abs(drho[b])
        sound += v2 + a2 + drho[b]
    if not np.isfinite(sound):
        speed = np.nan
    found[chunk, 0], found[chunk, 1], found[chunk, 2] = speed, force, density


@njit
def ghost_values(rows, codes, turn, shift, spin, push, x, v, drho, gradient, values):
    """values[g] = x, v, drho, gradient of body rows[g] under map codes[g]: x -> turn x + shift, v -> spin v + push."""
    for g in range(rows.size):
        b, code = rows[g], codes[g]
        for k in range(DIM):
            at, speed, slope = shift[code, k], push[code, k], 0.0
            for j in range(DIM):
                if turn[code, k, j] != 0.0:
                    at += turn[code, k, j] * x[j, b]
                    slope += turn[code, k, j] * gradient[j, b]
                if spin[code, k, j] != 0.0:
                    speed += spin[code, k, j] * v[j, b]
            values[g, k], values[g, DIM + k], values[g, 2 * DIM + 1 + k] = at, speed, slope
        values[g, 2 * DIM] = drho[b]


@njit
def take_ghosts(values, n, x, v, drho, gradient):
    """Ghosts behind the n own bodies."""
    for g in range(values.shape[0]):
        for k in range(DIM):
            x[k, n + g], v[k, n + g] = values[g, k], values[g, DIM + k]
            gradient[k, n + g] = values[g, 2 * DIM + 1 + k]
        drho[n + g] = values[g, 2 * DIM]
