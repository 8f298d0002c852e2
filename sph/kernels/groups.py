"""Arrays that kernels take together, by the names that they have in the arena of a rank."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]


class Table(NamedTuple):
    """The occupied rows of cells (see kernels.cells)."""

    rows: NDArray[np.int64]
    row_table: NDArray[np.int32]
    fine_total: NDArray[np.int64]
    fine_start: NDArray[np.int32]


class State(NamedTuple):
    """What integrators call y: positions [d, slots] m, velocities [d, slots] m/s, rho - rho0 [slots] kg/m3."""

    x: Reals
    v: Reals
    drho: Reals


class OldState(NamedTuple):
    """The state at the start of a step."""

    x_old: Reals
    v_old: Reals
    drho_old: Reals


class Shown(NamedTuple):
    """What ghosts and images show of a particle: [d, slots], [d d, slots] for shear and matrix, [slots] for others."""

    x: Reals
    v: Reals
    drho: Reals
    gradient: Reals
    own: Reals
    shear: Reals
    matrix: Reals
    key: NDArray[np.int64]
    flags: NDArray[np.int32]
    m: Reals


class Images(NamedTuple):
    """Images k, of which 0 is the body itself. A body has one if x . normals[k, p] < offsets[k, p] for all p. What maps
    do to positions and velocities: matrices turn and spin [k, d, d], shift and push [k, d] that they add, and whether
    it is a wall that does [k]. Centres of point symmetry: origin [k, d] and tangents [k, t, d] of their layer, squares
    of these [k, t], between which of them it ends [k, t, 2], and the matrix that leaves what is across it [k, d, d], 0
    where there are none.
    """

    normals: Reals
    offsets: Reals
    turn: Reals
    shift: Reals
    spin: Reals
    push: Reals
    mirrored: NDArray[np.bool_]
    origin: Reals
    tangents: Reals
    squares: Reals
    ends: Reals
    across: Reals


class Areas(NamedTuple):
    """Areas k of walls: middle [k, d] m, the square of the distance from there that nothing of them is beyond [k] m2,
    their axes [k, d, d] of length 1, along these half their extent [k, d] m or radius [k] m (0 for none) and the places
    of the walls that meet theirs, from the middle [k, d, 2] m, the number of the axis that is their normal [k], that of
    their wall [k] (-1: any), and what makes integers of forces [k] along their normal; the wall + 1 of each image (0:
    none), the first layer here and the one behind the last, spacing and support in m, and the period [d] m, 0 where
    there is none.
    """

    area_middle: Reals
    area_reach: Reals
    area_frame: Reals
    area_half: Reals
    area_radius: Reals
    area_ends: Reals
    area_along: NDArray[np.int64]
    area_wall: NDArray[np.int64]
    area_unit: Reals
    wall_images: NDArray[np.int64]
    slab: NDArray[np.int64]
    lengths: Reals
    period: Reals


class WallMotion(NamedTuple):
    """Accelerations of walls [walls, d] m/s2; of those that turn at their centres [walls, d] m, from which it grows by
    twist [walls, d, d] 1/s2 times the way from there, and the velocity by spin [walls, d, d] 1/s times it; and the
    period [d] m, 0 where there is none.
    """

    wall_acceleration: Reals
    wall_centre: Reals
    wall_twist: Reals
    wall_spin: Reals
    period: Reals


class Moves(NamedTuple):
    """Motions of rigid bodies: number of the body of each wall, -1 for none; by body its centre [d] m and the way that
    it goes [d] m, the rotation about the centre less 1 [d, d], velocity [d] m/s and the matrix of its spin [d, d] 1/s.
    """

    body_of: NDArray[np.int64]
    body_centre: Reals
    body_way: Reals
    body_turn: Reals
    body_velocity: Reals
    body_spin: Reals


class Mirrors(NamedTuple):
    """Faces f that mirror. Behind one is who has x . normals[f, p] < bounds[f, p] for all p; its image is at turns x +
    shifts with the velocity spins v + pushes.
    """

    normals: Reals
    bounds: Reals
    turns: Reals
    shifts: Reals
    spins: Reals
    pushes: Reals


class Scales(NamedTuple):
    """1 / h, 1 / c0, 1 / rho0, 1 / (rho0 h^d), p / (rho0 c0^2) of the background, mu / (rho0 c0 h), Monaghan's
    coefficient against tension; and what the other sums of these kinds are multiplied by, `of_arm` with an acceleration
    in m/s2, `of_spin` an angular velocity in 1/s. least_wet: the sum of weights of fluid below which a particle of a
    wall is dry.
    """

    per_h: float
    per_c: float
    per_rho: float
    per_m: float
    background: float
    viscosity: float
    tensile: float
    of_gradient: float
    of_strain: float
    of_shifting: float
    of_around: float
    of_arm: float
    of_spin: float
    least_wet: float
