"""Obstacles of a case as walls of the fluid, by their signed distance in nodes."""

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space import shapes
from lbmdem.case.boundaries import BoxShape
from lbmdem.fluid.surfaces import Wall
from lbmdem.setup.scene import Scene

Distance = Callable[[NDArray], NDArray]


def obstacle_walls(scene: Scene) -> list[Wall]:
    """A wall for each obstacle of the case, in lattice units."""
    dx, unit = scene.units.dx, scene.units.velocity
    walls = []
    for obstacle in scene.config.obstacle:
        shape = obstacle.shape
        if shape.plane is not None:
            point = np.array(shape.plane.point) / dx - 0.5
            distance: Distance = partial(shapes.plane, point=point, normal=shape.plane.normal)
        elif shape.box is not None:
            distance = periodic_box(shape.box, dx, np.where(scene.periodic, scene.points, np.inf))
        walls.append(Wall(distance, tuple(u / unit for u in obstacle.velocity)))
    return walls


def periodic_box(shape: BoxShape, dx: float, repeats: NDArray[np.float64]) -> Distance:
    """Distance from a box with the fluid outside; repeats[d]: nodes after which it comes again, or infinity."""
    low, high = np.array(shape.low) / dx - 0.5, np.array(shape.high) / dx - 0.5
    length = np.where(np.isinf(repeats), 0.0, repeats)

    def distance(points: NDArray) -> NDArray:
        nearest = points - np.rint((points - 0.5 * (low + high)) / repeats) * length  # image
        return shapes.box(nearest, low, high)

    return distance
