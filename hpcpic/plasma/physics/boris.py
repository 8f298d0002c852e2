"""The Boris mover (5.4.1), and its rotation as vectors, as a matrix and as the shears that the mover takes.

The rotation turns v- into v+ = v- + (v- + v- x t) x s, by the angle 2 atan |t| about B.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.simd.formulas import fma
from hpcpic.core.space.products import product

NO_ROTATION, ABOUT_Z, ABOUT_ANY, EXACT_ABOUT_ANY = 0, 1, 2, 3  # kinds of rotation


def sheared(p: Any, q: Any, t: Any, s: Any) -> Any:
    """(p, q) turned in their plane by three shears: exactly reversible, and the length does not drift however s is
    rounded. t and s hold the ratio of the cell sides.
    """
    p = fma(t, q, p)
    q = fma(s, p, q)
    return fma(t, q, p), q


def impulse_along(ex: Any, ey: Any, ez: Any, x: Any, y: Any, z: Any, dimensions: int) -> Any:
    """The part along B of an electric impulse: x, y and z are its parts by E along axes with a grid, and those of the
    uniform field along others.
    """
    along = x * ex
    along = fma(y, ey, along) if dimensions > 1 else along + y
    return fma(z, ez, along) if dimensions == 3 else along + z


def boris(
    vx: Any, vy: Any, vz: Any, ex: Any, ey: Any, ez: Any, m: Any, dimensions: int, rotation: int
) -> Any:  # fmt: skip
    """The velocity after a step: half of the electric impulse, rotation about B, the other half.

    m[16] = impulse of E along x and y; of the uniform field along an axis y and z without a grid, or of E along a z
    with one; t and s of the rotations about z, y and x (see `shears`); where the impulse is corrected across any axis,
    what E along that axis is too much by, in parts by x, y and z, and the axis. Without a rotation the impulse is the
    whole one.
    """
    ux = fma(m[0], ex, vx)  # v-
    uy = fma(m[1], ey, vy) if dimensions > 1 else vy + m[2]
    uz = fma(m[3], ez, vz) if dimensions == 3 else vz + m[3]
    if rotation == NO_ROTATION:
        return ux, uy, uz
    if rotation >= ABOUT_ANY:
        uy, uz = sheared(uy, uz, m[8], m[9])
        uz, ux = sheared(uz, ux, m[6], m[7])
    ux, uy = sheared(ux, uy, m[4], m[5])
    ux = fma(m[0], ex, ux)
    uy = fma(m[1], ey, uy) if dimensions > 1 else uy + m[2]
    uz = fma(m[3], ez, uz) if dimensions == 3 else uz + m[3]
    if rotation == EXACT_ABOUT_ANY:
        along = impulse_along(ex, ey, ez, m[10], m[11], m[12], dimensions)
        ux, uy, uz = fma(m[13], along, ux), fma(m[14], along, uy), fma(m[15], along, uz)
    return ux, uy, uz


def impulse_across(angle: float) -> float:
    """By what an electric impulse across B is multiplied, beside a turn by the angle in a step: tan(angle/2)/(angle/2).

    With an exact angle particles then drift by E x B/B^2 in uniform fields, whatever the step. It is the mover that
    turns by 2 atan(wc dt/2), of particles whose mass across B is m over this factor (Birdsall & Langdon, chapter 4).
    """
    half = 0.5 * abs(angle)
    return math.tan(half) / half if half else 1.0


def rotation_vectors(
    magnetic: tuple[float, ...], charge_to_mass: float, time_step: float, exact_phase: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The vectors t[3] and s[3]: t = (q/m) B dt/2, s = 2 t / (1 + t.t).

    With exact_phase, t has the length tan(wc dt/2), and the angle per step is exactly wc dt.
    """
    t = np.array(magnetic) * (charge_to_mass * time_step / 2)
    length = math.sqrt(product(t, t))
    if exact_phase and length:
        t = t * (math.tan(length) / length)
    return t, 2 * t / (1 + product(t, t))


def part_of_turn(t: NDArray[np.float64], part: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The vectors t[3] and s[3] of a rotation by `part` times the angle 2 atan |t|."""
    length = math.sqrt(product(t, t))
    if length:
        t = t * (math.tan(part * math.atan(length)) / length)
    return t, 2 * t / (1 + product(t, t))


def cross_matrix(w: NDArray[np.float64]) -> NDArray[np.float64]:
    """The matrix K[3, 3] with K x = x cross w."""
    return np.array([[0.0, w[2], -w[1]], [-w[2], 0.0, w[0]], [w[1], -w[0], 0.0]])


def turn(t: NDArray[np.float64], s: NDArray[np.float64]) -> NDArray[np.float64]:
    """A[3, 3] with v+ = v- + A v-: the rotation less the identity, so that small angles keep their precision."""
    kt, ks = cross_matrix(t), cross_matrix(s)
    return ks + product(ks, kt)


def shears(t: NDArray[np.float64], s: NDArray[np.float64], side: NDArray[np.float64]) -> list[float]:
    """The rotation as rotations about x, then y, then z, each of three shears.

    Returns tangents of half the angles and sines, (z, y, x) in pairs, in units of the cell sides `side`[3].
    """
    kt, ks = cross_matrix(t), cross_matrix(s)
    r = np.eye(3) + ks + product(ks, kt)
    about_z, about_y = math.atan2(r[1, 0], r[0, 0]), math.asin(-r[2, 0])
    about_x = math.atan2(r[2, 1], r[2, 2])
    numbers: list[float] = []
    for angle, (p, q) in ((about_z, (0, 1)), (about_y, (2, 0)), (about_x, (1, 2))):
        numbers += [-math.tan(angle / 2) * side[q] / side[p], math.sin(angle) * side[p] / side[q]]
    return numbers
