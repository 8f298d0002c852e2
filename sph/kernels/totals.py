"""Sums over the own fluid of a rank for the series, by chunks: largest terms first, then exact limbs of their sums."""

import numpy as np

from hpcpic.core.simd.compile import formula, njit
from hpcpic.core.simd.scratch import empty, zeros
from hpcpic.core.simd.vector import (
    Vec,
    address_of,
    bitmask,
    fma,
    gather_lines,
    lane_numbers,
    lanes,
    largest_lane,
    load,
    maximum,
    rint,
    select,
    splat,
    store,
    to_fixed,
    total,
)
from sph.kernels.marks import LIQUID, MINE
from sph.kernels.powers import power
from sph.physics.equation_of_state import compression, compression_work

formula(compression), formula(compression_work)

DIM = 3
DENSITIES = False  # there are liquids of several densities
GASES = False  # and gases

TERMS = 4 + DIM  # kinetic, potential, internal energy, mass, momentum
_FIRST, _NEXT = 2.0**31, 2.0**32  # as core.space.exact
N = lanes(np.float64)
F, I, L = Vec(N, np.float64), Vec(N, np.int32), Vec(N, np.int64)
# constants = (rho0, stiffness, background pressure, gamma - 1, gravity, lower corner of the domain), SI


@njit
def fill(b, last, flags, constants, powers, liquids, x, v, m, drho, terms):
    """Find terms[k, N] of the sums for the N bodies from b on; 0 for those that are no fluid and from `last` on.

    powers: coefficients of ((1 + e)^(gamma - 1) - 1) / (gamma - 1) in e.
    """
    fluid = load(I, flags, b) & np.int32(MINE) == np.int32(MINE)
    mass = select(fluid, load(F, m, b), 0.0)
    mass = select(lane_numbers(I) < np.int32(last - b), mass, 0.0)
    counts = mass > 0.0
    square, height = splat(F, 0.0), splat(F, 0.0)
    for k in range(DIM):
        speed = select(counts, load(F, v[k], b), 0.0)
        square = fma(speed, speed, square)
        height = fma(select(counts, load(F, x[k], b), 0.0) + constants[4 + DIM + k], constants[4 + k], height)
        store(terms[4 + k], 0, mass * speed)
    change = select(counts, load(F, drho, b), 0.0) / constants[0]
    volume = change / (change + 1.0)  # rho0 (1 / rho0 - 1 / rho)
    bent = power(change, constants[3], powers)
    store(terms[0], 0, 0.5 * mass * square)
    store(terms[1], 0, -mass * height)
    rest, inner = mass, (bent - volume) * constants[1] + volume * constants[2]
    if DENSITIES:  # the mass that the reference liquid would have
        kinds = (load(I, flags, b) >> LIQUID) * 8
        rest = mass * gather_lines(F, 1, address_of(liquids[0], 0), kinds)[0]
        if GASES:
            ambient = gather_lines(F, 1, address_of(liquids[3], 0), kinds)[0]
            gas = counts & (ambient > 0.0)
            if bitmask(gas) != 0:
                gamma = constants[3] + 1.0
                p = (change + (gamma - 1.0) * bent * (change + 1.0)) / gamma  # in rho0 c0^2
                u = p / select(gas, ambient, 1.0) + 1.0
                y = compression(u)
                worked = compression_work(u, y) * (ambient * (constants[1] * gamma)) + (1.0 - 1.0 / y) * constants[2]
                inner = select(gas, worked, inner)
    store(terms[2], 0, rest * (inner / constants[0]))
    store(terms[3], 0, mass)


@njit
def extremes(chunk, chunks, flags, x, v, m, drho, part_maxima):
    """part_maxima[chunk] = largest mass, |v|^2, |drho|, x and -x of the fluid; not a number where one is not."""
    best = empty((3 + 2 * DIM, N), np.float64)
    for k in range(3 + 2 * DIM):
        store(best[k], 0, splat(F, -np.inf))
    finite = splat(F, 0.0)
    last = chunks[chunk + 1]
    for b in range(chunks[chunk], last, N):
        fluid = load(I, flags, b) & np.int32(MINE) == np.int32(MINE)
        mass = select(fluid, load(F, m, b), 0.0)
        mass = select(lane_numbers(I) < np.int32(last - b), mass, 0.0)
        counts = mass > 0.0
        square = splat(F, 0.0)
        for k in range(DIM):
            speed = select(counts, load(F, v[k], b), 0.0)
            square = fma(speed, speed, square)
            at = load(F, x[k], b)
            finite = finite + select(counts, at, 0.0)
            for n, side in ((3 + k, at), (3 + DIM + k, -at)):
                reached = load(F, best[n], 0)
                store(best[n], 0, maximum(reached, select(counts, side, reached)))
        excess = abs(select(counts, load(F, drho, b), 0.0))
        finite = finite + square + excess
        for n, one in ((0, mass), (1, square), (2, excess)):
            store(best[n], 0, maximum(load(F, best[n], 0), one))
    for k in range(3 + 2 * DIM):
        part_maxima[chunk, k] = largest_lane(load(F, best[k], 0)) if np.isfinite(total(finite)) else np.nan


@njit
def add(chunk, chunks, flags, constants, powers, liquids, x, v, m, drho, inverse, limbs):
    """limbs[chunk, k, 3] = exact limbs of the sum of terms k, |term inverse[k]| <= 1."""
    terms, parts = zeros((TERMS, N), np.float64), zeros((3 * TERMS, N), np.int64)
    last = chunks[chunk + 1]
    for b in range(chunks[chunk], last, N):
        fill(b, last, flags, constants, powers, liquids, x, v, m, drho, terms)
        for k in range(TERMS):
            t = load(F, terms[k], 0) * (inverse[k] * _FIRST)
            for limb in range(3):
                whole = rint(t)
                line = parts[3 * k + limb]
                store(line, 0, load(L, line, 0) + to_fixed(whole, 1.0))
                t = (t - whole) * _NEXT
    for k in range(TERMS):
        for limb in range(3):
            limbs[chunk, k, limb] = total(load(L, parts[3 * k + limb], 0))
