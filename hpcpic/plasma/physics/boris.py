"""The numbers of the Boris mover (5.4.1) for every species, as the kernels take them."""

import numpy as np
from numpy.typing import NDArray

from hpcpic.plasma.case.config import rotation
from hpcpic.plasma.setup.scene import Scene, cross_matrix


def mover(scene: Scene, field_scale: float, steps: float = 1.0) -> NDArray[np.float64]:
    """mover[species, 10] of kernels.plain.boris for `steps` time steps; e times field_scale is what kernels gather.

    steps = -1/2 rewinds: half the impulse, and half the angle that the mover turns in a step, backwards.
    """
    kind, rows = rotation(scene.config), np.zeros((len(scene.species), 10))
    side = np.array((*scene.spacing, scene.spacing[0], scene.spacing[0])[:3])  # an axis without grid: that of x
    uniform = np.array(scene.config.field.electric)
    for row, species in zip(rows, scene.species):
        impulse = np.zeros(3)
        impulse[: scene.velocity_components] = species.half_kick * steps * (1 if kind else 2)
        row[: scene.dimensions] = impulse[: scene.dimensions] / field_scale
        row[2:4] = [impulse[1] * uniform[1] if scene.dimensions == 1 else 0.0, impulse[2] * uniform[2]]
        t, s = species.boris
        if steps != 1.0:
            t, s = part_of_turn(t, steps)
        if kind == 1:
            row[4:6] = t[2] * side[1] / side[0], -s[2] * side[0] / side[1]
        elif kind == 2:
            row[4:] = shears(t, s, side)
    return rows


def part_of_turn(t: NDArray, steps: float) -> tuple[NDArray, NDArray]:
    """t and s of `steps` times the angle 2 atan |t|."""
    length = np.sqrt(t @ t)
    if length:
        t = t * (np.tan(steps * np.arctan(length)) / length)
    return t, 2 * t / (1 + t @ t)


def shears(t: NDArray, s: NDArray, side: NDArray) -> list[float]:
    """The rotation v + v x s + (v x t) x s as rotations about x, then y, then z, each of three shears.

    Returns tangents of half the angles and sines, (z, y, x) in pairs, in units of the cell sides.
    """
    kt, ks = cross_matrix(t), cross_matrix(s)
    r = np.eye(3) + ks + ks @ kt
    about_z, about_y = np.arctan2(r[1, 0], r[0, 0]), np.arcsin(-r[2, 0])
    about_x = np.arctan2(r[2, 1], r[2, 2])
    numbers = []
    for angle, (p, q) in ((about_z, (0, 1)), (about_y, (2, 0)), (about_x, (1, 2))):
        numbers += [-np.tan(angle / 2) * side[q] / side[p], np.sin(angle) * side[p] / side[q]]
    return numbers
