"""Where fluid rests before repulsive walls: from nearer it would be thrown off them, from farther it would fall."""

import math
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.products import product
from sph.case.config import Fluid
from sph.setup.flows import Liquid
from sph.setup.particle_lattices import Face

STRENGTH = 0.01  # of c0^2 / h: the acceleration by a repulsive wall where S = 1 (SC 8)


class Surroundings(Liquid, Protocol):
    """What is read of a scene besides: its walls, lengths in m, c0 in m/s."""

    walls: list[Any]
    spacing: float
    h: float
    c0: float
    periodic: NDArray[np.bool_]


def distance(strength: NDArray[np.float64]) -> NDArray[np.float64]:
    """y / h at which S(y) of (SC 9), b = 1, s = 8, has a value above 0."""
    eighth_root = np.sqrt(np.sqrt(np.sqrt(np.maximum(strength, 1.0))))
    return np.where(strength < 1.0, 1.0 - 0.2 * np.sqrt(strength), 0.8 / eighth_root)


def before_walls(scene: Surroundings, section: Fluid, x: NDArray, drho: NDArray) -> NDArray[np.float64]:
    """x[n, d] of a fluid at t = 0: what is nearer to repulsive faces than where these push as much as the pressure
    beside them is moved there; where walls hold all of the fluid, also what is farther and feels them. A layer of
    thickness dp and pressure p is held by p / (rho0 dp), and half of its own weight.
    """
    walls = [wall for wall in scene.walls if wall.rule.repulsive]
    if not walls:
        return x
    p = np.maximum(scene.eos.pressure(drho), 0.0)
    needed = p / (scene.eos.rho0 * scene.spacing) + math.hypot(*scene.gravity) / 2
    rest = distance(needed * scene.h / (STRENGTH * scene.c0**2)) * scene.h
    farthest = scene.h if held(scene, section) else rest
    for wall in walls:
        for face in wall.flat_faces():
            along = np.abs(face.normal) > 0.5
            before = np.all(along | ((x >= face.low) & (x <= face.high)), axis=1)
            off = product(x - face.point, face.normal)
            y = off + wall.recess[np.argmax(np.abs(face.normal))]
            moved = before & (off > 0.0) & (y < farthest)
            x = x + np.where(moved, rest - y, 0.0)[:, None] * face.normal
    return x


def held(scene: Surroundings, section: Fluid) -> bool:
    """Whether a fluid lies in a box with flat walls that stay on all sides but the upper one: it will not run out."""
    box, gravity = section.shape.box, scene.gravity
    if not box or np.count_nonzero(gravity) != 1:
        return False
    flat = [wall for wall in scene.walls if (wall.shape.box or wall.shape.plane) and not wall.moving]
    faces = [face for wall in flat for face in wall.flat_faces()]
    low, high = np.array(box.low), np.array(box.high)
    for axis in np.flatnonzero(~scene.periodic).tolist():
        for sign, corner in ((1.0, low), (-1.0, high)):
            side = np.where(np.arange(len(low)) == axis, corner, (low + high) / 2)
            covered = any(_covers(face, side, axis, sign, scene.spacing) for face in faces)
            if sign * gravity[axis] <= 0.0 and not covered:
                return False
    return True


def _covers(face: Face, side: NDArray, axis: int, sign: float, spacing: float) -> bool:
    """Whether a face looks along an axis from the middle of a side."""
    off = abs(product(side - face.point, face.normal))
    across = np.arange(len(side)) == axis
    inside = np.all(across | ((side >= face.low) & (side <= face.high)))
    return bool(face.normal[axis] * sign > 1.0 - 1e-9 and off < spacing / 2 and inside)
