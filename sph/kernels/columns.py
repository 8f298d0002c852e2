"""What stands around the pair sums: values[column, slot], which they read of bodies besides the state, and their own
sums, of which later ones or the motion need more than forces and rates.

PUSH .. S are the first lines of the columns (see physics.pair_spec), -1 for those that the case does not have. Bodies
are in SI units, columns in those of the pair sums (see `passes`). All slots are looked at, also where nobody is.
"""

import numpy as np

from hpcpic.core.simd.compile import formula, njit
from hpcpic.core.simd.scratch import empty
from hpcpic.core.simd.vector import (
    Vec,
    address_of,
    bitmask,
    convert,
    floor,
    gather_lines,
    lanes,
    load,
    maximum,
    select,
    splat,
    store,
)  # fmt: skip
from sph.kernels.marks import EXTRAPOLATED, FLUID, LIQUID, NORMAL, OWN, REPULSIVE, WALL_SHIFT
from sph.kernels.powers import power
from sph.physics.equation_of_state import ADIABATIC, LEAST, MOST_GAMMA, compression
from sph.physics.pair_spec import UNIT

formula(compression)

DIM = 3
KIND = "float64"  # of columns and sums
SINGLE = False
GAMMA = 7.0
PUSH = -1
LIGHT = -1
S = -1
VOLUME = -1
EXCESS = -1
MASS = -1
V = -1
SWIFT = -1
FLUIDITY = -1
BULK = -1
NORMALS = -1
G = -1
SLOPE = -1
C = -1
TENSION = -1
L = -1
T = -1
DRIVEN = -1
TURN = -1
DENSITIES = False  # there are liquids of several densities
GASES = False  # and gases
ACCELERATED = False  # there are walls that follow the fluid and are accelerated
TURNING = False  # and some of these turn
IN_TURN = False  # LIGHT holds 1 / rho for forces, then volumes for rates

N = lanes(np.float64)
F, I, WIDE, R = Vec(N, np.float64), Vec(N, np.int32), Vec(N, np.int64), Vec(N, np.dtype(KIND))
NEAR_SURFACE = 0.9  # of - sum V_j F r^2 over DIM, 1 inside the fluid (Lee et al. 2008): shifts grow from there to 1
MOST_SHIFTED = 0.5  # of the largest velocity (Sun et al. 2019): fluid flows back, and as fast it would make shifts grow
LEAST_DETERMINANT = 0.1  # of the sum that L inverts, 1 inside the fluid, about 0.25 at a flat free surface in 2D


@njit
def of_liquid(liquids, k, kinds):
    """Line k of the table of the liquids (see physics.liquids) for the bodies of a vector."""
    return gather_lines(F, 1, address_of(liquids[k], 0), (kinds >> LIQUID) * 8)[0]


@njit
def pack(block, blocks, base, scales, powers, liquids, flags, y, m, face_normals, position, values):
    """Fill in all columns but those that come from other pair sums. y: see State; powers: coefficients of (MP 14)."""
    for l in range(blocks[block], blocks[block + 1]):
        for s in range(base[l], base[l + 1], N):
            e, kinds = load(F, y.drho, s) * scales.per_rho, load(I, flags, s)
            rho = e + 1.0
            light, p, mass = 1.0 / rho, power(e, GAMMA, powers), load(F, m, s)
            pressed = light
            if DENSITIES:
                mass = mass * of_liquid(liquids, 0, kinds)
                store(values[SWIFT], s, convert(R, of_liquid(liquids, 1, kinds)))
            if FLUIDITY >= 0:
                store(values[FLUIDITY], s, convert(R, of_liquid(liquids, 2, kinds)))
            if GASES:
                bulk, ambient = rho, of_liquid(liquids, 3, kinds)
                gas = ambient > 0.0
                if bitmask(gas) != 0:
                    u = p / select(gas, ambient, 1.0) + 1.0
                    pressed = select(gas, 1.0 / compression(u), light)
                    softness = raised(rho, light, 1.0 - GAMMA)  # d e / d p in units of rho0 c0^2
                    bulk = select(gas, (ADIABATIC * ambient) * maximum(u, LEAST) * softness, rho)
                store(values[BULK], s, convert(R, bulk if SINGLE else bulk / scales.per_rho))
            if SINGLE:
                mass = mass * scales.per_m
                for k in range(DIM):  # in fixed point, modulo 256 h
                    place = floor(load(F, y.x[k], s) * (scales.per_h * (1.0 / UNIT)))
                    store(position[k], s, convert(I, convert(WIDE, place)))
                    store(values[V + k], s, convert(R, load(F, y.v[k], s) * scales.per_c))
                store(values[EXCESS], s, convert(R, e))
            if MASS >= 0:
                store(values[MASS], s, convert(R, mass))
            store(values[PUSH], s, convert(R, (p + scales.background) * (pressed * pressed)))
            store(values[LIGHT], s, convert(R, pressed))
            if VOLUME >= 0:
                volume = select(kinds & REPULSIVE == REPULSIVE, 0.0, mass) * pressed  # repulsive particles have none
                store(values[VOLUME], s, convert(R, volume))
            if SLOPE >= 0:
                half = 0.5 * raised(rho, light, 2.0 - GAMMA)  # rho / (2 c^2) in units of rho0 / c0^2
                if DENSITIES:
                    half = half / of_liquid(liquids, 0, kinds)
                store(values[SLOPE], s, convert(R, half))
            if C >= 0:
                store(values[C], s, convert(R, raised(rho, light, 0.5 * (GAMMA - 1.0))))  # (MP 15) in c0
            if TENSION >= 0:
                tension = select(p < 0.0, -scales.tensile * p, 0.05 * scales.tensile * p)
                store(values[TENSION], s, convert(R, tension * (pressed * pressed)))
            if NORMALS >= 0:
                for k in range(DIM):
                    normal = gather_lines(F, 1, address_of(face_normals[k], 0), (kinds >> NORMAL) * 8)[0]
                    store(values[NORMALS + k], s, convert(R, normal))


@njit
def raised(rho, light, n):
    """rho^n of a vector, light = 1 / rho."""
    if abs(n) <= MOST_GAMMA and n == np.floor(n):
        found = splat(F, 1.0)
        for _ in range(np.int64(abs(n))):
            found = found * (rho if n > 0.0 else light)
        return found
    line = empty(N, np.float64)
    store(line, 0, rho)
    for k in range(N):
        line[k] = line[k] ** n
    return load(F, line, 0)


@njit
def pack_again(block, blocks, base, scales, liquids, flags, v, drho, m, gradient, values):
    """Bring up to date what changes between forces and rates: velocities, gradients, volumes."""
    for l in range(blocks[block], blocks[block + 1]):
        for b in range(np.uint64(base[l]), np.uint64(base[l + 1])):
            if SINGLE:
                for k in range(DIM):
                    values[V + k, b] = v[k, b] * scales.per_c
            if G >= 0:
                for k in range(DIM):
                    values[G + k, b] = gradient[k, b]
            if IN_TURN:
                mass = m[b] * scales.per_m if SINGLE else m[b]
                if DENSITIES:
                    mass *= liquids[0, flags[b] >> LIQUID]
                values[LIGHT, b] = (mass if flags[b] & REPULSIVE == 0 else 0.0) / (1.0 + drho[b] * scales.per_rho)


@njit
def pack_own(block, blocks, base, scales, own, values):
    """The columns `own`, accelerations of the user's own in the units of those by gravity."""
    for l in range(blocks[block], blocks[block + 1]):
        for b in range(np.uint64(base[l]), np.uint64(base[l + 1])):
            for k in range(DIM):
                values[DRIVEN + k, b] = own[k, b] * scales.of_arm


@njit
def pack_turn(block, blocks, base, scales, flags, key, walls, values):
    """The columns TURN, the angular velocity of walls, in 2D about z; 0 for fluid."""
    for l in range(blocks[block], blocks[block + 1]):
        for b in range(np.uint64(base[l]), np.uint64(base[l + 1])):
            turns, wall = flags[b] & EXTRAPOLATED != 0, (key[b] >> WALL_SHIFT) - 1
            for k in range(2 * DIM - 3):
                row, column = ((k + 2) % 3, (k + 1) % 3) if DIM == 3 else (1, 0)
                values[TURN + k, b] = walls.wall_spin[wall, row, column] * scales.of_spin if turns else 0.0


@njit
def pack_stress(block, blocks, base, scales, flags, drho, shear, values):
    """The columns T, stress / rho^2 (MP 22), or S = mu ((grad v)^T - I div v), 0 in walls, from the velocity gradient
    shear[DIM a + b, slot] = d v_b / d x_a; mu that of the reference liquid.
    """
    for l in range(blocks[block], blocks[block + 1]):
        for b in range(np.uint64(base[l]), np.uint64(base[l + 1])):
            trace = shear[0, b]
            for i in range(1, DIM):
                trace += shear[i * (DIM + 1), b]
            if S >= 0:
                factor = 0.0 if flags[b] & EXTRAPOLATED != 0 else scales.viscosity
                for i in range(DIM):
                    for j in range(DIM):
                        values[S + i * DIM + j, b] = (shear[i * DIM + j, b] - (trace if i == j else 0.0)) * factor
                continue
            trace *= 2.0 / DIM
            rho = 1.0 + drho[b] * scales.per_rho
            factor, column = scales.viscosity / (rho * rho), T
            for i in range(DIM):
                for j in range(i, DIM):
                    strain = shear[i * DIM + j, b] + shear[j * DIM + i, b]
                    values[column, b] = (strain - trace if i == j else strain) * factor
                    column += 1


@njit
def unpack_walls(block, blocks, base, scales, at, flags, key, walls, x, sums, drho):
    """rho - rho0 of particles of walls: that of the fluid before them, carried on with its acceleration (see
    `terms.rise`) less that of the wall (Adami et al. 2012); never below 0, and 0 where there is no fluid.
    """
    for l in range(blocks[block], blocks[block + 1]):
        for b in range(np.uint64(base[l]), np.uint64(base[l + 1])):
            if flags[b] & (EXTRAPOLATED | OWN) != EXTRAPOLATED | OWN:
                continue
            weight, total = np.float64(sums[at, b]), np.float64(sums[at + 1, b])
            if ACCELERATED:
                wall = (key[b] >> WALL_SHIFT) - 1
                for k in range(DIM):
                    a = walls.wall_acceleration[wall, k]
                    if TURNING:
                        for j in range(DIM):
                            off = x[j, b] - walls.wall_centre[wall, j]
                            if walls.period[j] > 0.0:
                                off -= walls.period[j] * np.rint(off / walls.period[j])
                            a += walls.wall_twist[wall, k, j] * off
                    total -= scales.of_arm * a * np.float64(sums[at + 2 + k, b])
            excess = total / weight if weight > 0.0 else 0.0
            if not GASES:
                excess = max(excess, 0.0)  # walls do not suck
            drho[b] = excess / scales.per_rho if SINGLE else excess


@njit
def unpack_wetted(block, blocks, base, scales, at, first, sums, wetted):
    """mu / mu0 of the fluid before particles of walls, 0 where there is little; first: the sum of weights."""
    for l in range(blocks[block], blocks[block + 1]):
        for b in range(np.uint64(base[l]), np.uint64(base[l + 1])):
            weight = np.float64(sums[first, b])
            wetted[b] = np.float64(sums[at, b]) / weight if weight > scales.least_wet else 0.0


@njit
def cofactors(sums, at, b, factor):
    """Cofactors, as an upper triangle, and determinant of a symmetric matrix: that whose upper triangle begins in line
    `at` of the sums, times a factor.
    """
    m00, m01 = np.float64(sums[at, b]) * factor, np.float64(sums[at + 1, b]) * factor
    if DIM == 2:
        m11 = np.float64(sums[at + 2, b]) * factor
        return (m11, -m01, m00), m00 * m11 - m01 * m01
    m02, m11 = np.float64(sums[at + 2, b]) * factor, np.float64(sums[at + 3, b]) * factor
    m12, m22 = np.float64(sums[at + 4, b]) * factor, np.float64(sums[at + 5, b]) * factor
    c00, c01, c02 = m11 * m22 - m12 * m12, m02 * m12 - m01 * m22, m01 * m12 - m02 * m11
    c11, c12, c22 = m00 * m22 - m02 * m02, m01 * m02 - m00 * m12, m00 * m11 - m01 * m01
    return (c00, c01, c02, c11, c12, c22), m00 * c00 + m01 * c01 + m02 * c02


@njit
def entry(i, j):
    """Place of (i, j) in the upper triangle of a symmetric matrix."""
    return min(i, j) * (2 * DIM - 1 - min(i, j)) // 2 + max(i, j)


@njit
def unpack_gradient(block, blocks, base, scales, at, sums, gradient):
    """Half of the renormalised gradient, L b / 2, in the units of pair sums; 0 where too few neighbours are there."""
    for l in range(blocks[block], blocks[block + 1]):
        for b in range(np.uint64(base[l]), np.uint64(base[l + 1])):
            matrix, det = cofactors(sums, at, b, scales.of_gradient)
            factor = 0.5 / det if det > 1e-3 else 0.0
            for i in range(DIM):
                found = 0.0
                for j in range(DIM):
                    step = np.float64(sums[at + len(matrix) + j, b]) * scales.of_gradient
                    found += matrix[entry(i, j)] * step
                gradient[i, b] = found * factor


@njit
def unpack_strain(block, blocks, base, scales, at, sums, shear):
    """The velocity gradient, shear[DIM a + b, slot] = d v_b / d x_a; renormalised for S where there are neighbours."""
    for l in range(blocks[block], blocks[block + 1]):
        for b in range(np.uint64(base[l]), np.uint64(base[l + 1])):
            for k in range(DIM * DIM):
                shear[k, b] = np.float64(sums[at + k, b]) * scales.of_strain
            if S >= 0:
                inverse, det = cofactors(sums, at + DIM * DIM, b, scales.of_gradient)
                if det > LEAST_DETERMINANT:
                    for j in range(DIM):
                        for i in range(DIM):
                            total = 0.0
                            for k in range(DIM):
                                total += inverse[entry(i, k)] * np.float64(sums[at + k * DIM + j, b])
                            shear[i * DIM + j, b] = total / det * scales.of_strain


@njit
def unpack_matrix(block, blocks, base, scales, at, flags, sums, matrix):
    """Renormalisation L; the identity where too few neighbours are there, and in walls, whose particles do not meet."""
    for l in range(blocks[block], blocks[block + 1]):
        for b in range(np.uint64(base[l]), np.uint64(base[l + 1])):
            inverse, det = cofactors(sums, at, b, scales.of_gradient)
            good = det > LEAST_DETERMINANT and flags[b] & FLUID == FLUID
            for i in range(DIM):
                for j in range(DIM):
                    matrix[i * DIM + j, b] = inverse[entry(i, j)] / det if good else np.float64(i == j)


@njit
def pack_matrix(block, blocks, base, matrix, values):
    """The columns L, upper triangles of the renormalisation."""
    for l in range(blocks[block], blocks[block + 1]):
        for b in range(np.uint64(base[l]), np.uint64(base[l + 1])):
            for i in range(DIM):
                for j in range(i, DIM):
                    values[L + entry(i, j), b] = matrix[i * DIM + j, b]


@njit
def unpack_shifting(block, blocks, base, scales, at, flags, sums, offset):
    """offset[d, slot], velocities of shifts over the largest velocity. Particles near a surface are not shifted: they
    would be to where none are.
    """
    for l in range(blocks[block], blocks[block + 1]):
        for b in range(np.uint64(base[l]), np.uint64(base[l + 1])):
            around = np.float64(sums[at + DIM, b]) * scales.of_around
            inside = (around / DIM - NEAR_SURFACE) / (1.0 - NEAR_SURFACE) if flags[b] & FLUID == FLUID else 0.0
            factor = -4.0 * scales.of_shifting * min(max(inside, 0.0), 1.0)
            square = 0.0
            for k in range(DIM):
                offset[k, b] = factor * np.float64(sums[at + k, b])
                square += offset[k, b] * offset[k, b]
            if square > MOST_SHIFTED * MOST_SHIFTED:
                for k in range(DIM):
                    offset[k, b] *= MOST_SHIFTED / np.sqrt(square)
