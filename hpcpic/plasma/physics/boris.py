"""The rotation of the Boris mover (5.4.1): its vectors, its matrix, and the shears that kernels.plain.boris takes.

The rotation turns v- into v+ = v- + (v- + v- x t) x s, by the angle 2 atan |t| about B.
"""

import numpy as np
from numpy.typing import NDArray


def rotation_vectors(
    magnetic: tuple[float, ...], charge_to_mass: float, time_step: float, exact_phase: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The vectors t[3] and s[3]: t = (q/m) B dt/2, s = 2 t / (1 + t.t).

    With exact_phase, t has the length tan(wc dt/2), and the angle per step is exactly wc dt.
    """
    t = np.array(magnetic) * (charge_to_mass * time_step / 2)
    length = np.sqrt(t @ t)
    if exact_phase and length:
        t = t * (np.tan(length) / length)
    return t, 2 * t / (1 + t @ t)


def part_of_turn(t: NDArray[np.float64], part: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The vectors t[3] and s[3] of a rotation by `part` times the angle 2 atan |t|."""
    length = np.sqrt(t @ t)
    if length:
        t = t * (np.tan(part * np.arctan(length)) / length)
    return t, 2 * t / (1 + t @ t)


def cross_matrix(w: NDArray[np.float64]) -> NDArray[np.float64]:
    """The matrix K[3, 3] with K x = x cross w."""
    return np.array([[0.0, w[2], -w[1]], [-w[2], 0.0, w[0]], [w[1], -w[0], 0.0]])


def turn(t: NDArray[np.float64], s: NDArray[np.float64]) -> NDArray[np.float64]:
    """A[3, 3] with v+ = v- + A v-: the rotation less the identity, so that small angles keep their precision."""
    kt, ks = cross_matrix(t), cross_matrix(s)
    return ks + ks @ kt


def shears(t: NDArray[np.float64], s: NDArray[np.float64], side: NDArray[np.float64]) -> list[float]:
    """The rotation as rotations about x, then y, then z, each of three shears.

    Returns tangents of half the angles and sines, (z, y, x) in pairs, in units of the cell sides `side`[3].
    """
    kt, ks = cross_matrix(t), cross_matrix(s)
    r = np.eye(3) + ks + ks @ kt
    about_z, about_y = np.arctan2(r[1, 0], r[0, 0]), np.arcsin(-r[2, 0])
    about_x = np.arctan2(r[2, 1], r[2, 2])
    numbers: list[float] = []
    for angle, (p, q) in ((about_z, (0, 1)), (about_y, (2, 0)), (about_x, (1, 2))):
        numbers += [-np.tan(angle / 2) * side[q] / side[p], np.sin(angle) * side[p] / side[q]]
    return numbers
