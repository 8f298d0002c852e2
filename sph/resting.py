"""Where fluid rests before repulsive walls: from nearer it would be thrown off them, from farther it would fall."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.products import product

if TYPE_CHECKING:
    from sph.scene import Scene

STRENGTH = 0.01  # of c0^2 / h: the acceleration by a repulsive wall where S = 1 (SC 8)


def distance(strength: NDArray[np.float64]) -> NDArray[np.float64]:
    """y / h at which S(y) of (SC 9), b = 1, s = 8, has a value above 0."""
    return np.where(strength < 1.0, 1.0 - 0.2 * np.sqrt(strength), 0.8 * np.maximum(strength, 1.0) ** -0.125)


def before_walls(scene: "Scene", x: NDArray, drho: NDArray) -> NDArray[np.float64]:
    """x[n, d] of the fluid at t = 0: what repulsive faces reach is moved to where they push as much as the pressure
    beside them. A layer of thickness dp and pressure p is held by p / (rho0 dp), and half of its own weight.
    """
    walls = [wall for wall in scene.walls if wall.type == "repulsive"]
    if not walls:
        return x
    needed = np.maximum(scene.pressure(drho), 0.0) / (scene.rho0 * scene.spacing) + np.linalg.norm(scene.gravity) / 2
    rest = distance(needed * scene.h / (STRENGTH * scene.c0**2)) * scene.h
    for wall in walls:
        for face in wall.flat_faces():
            along = np.abs(face.normal) > 0.5
            before = np.all(along | ((x >= face.low) & (x <= face.high)), axis=1)
            off = product(x - face.point, face.normal)
            y = off + wall.recess[np.argmax(np.abs(face.normal))]
            reached = before & (off > 0.0) & (y < scene.h)
            x = x + np.where(reached, rest - y, 0.0)[:, None] * face.normal
    return x
