"""How fast the points of rigid bodies go."""

import functools
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.products import product
from hpcpic.core.space.shapes import in_three
from sph.case import geometry
from sph.case.config import Wall
from sph.case.shapes import Shape
from sph.setup.particle_lattices import along
from sph.setup.rigid.mass import rigid_of, skew

ROUND = 64  # points on the edge of a cylinder: speeds are found to 0.12 %

Reals = NDArray[np.float64]


@functools.lru_cache(maxsize=16)
def rim(shape: Shape) -> tuple[Reals, float]:
    """Points [n, 3] m, and how far from each the shape goes all around, m: however it moves, its fastest point is one
    of these or as far from one of them.
    """
    if shape.sphere:
        points: Any = [shape.sphere.centre]
    elif shape.stl:
        from sph.case.stl import mesh

        points = mesh(shape.stl).vertices
    elif shape.polygon:
        points = shape.polygon.corners
    elif shape.cylinder:
        base, top = np.array(shape.cylinder.base), np.array(shape.cylinder.top)
        across = along((top - base) / math.dist(base, top))
        angles = 2 * math.pi * np.arange(ROUND) / ROUND
        circle = np.stack([np.cos(angles), np.sin(angles)], axis=1) if len(across) == 2 else np.array([[1.0], [-1.0]])
        out = shape.cylinder.radius * product(circle, across)
        points = np.concatenate([base + out, top + out])
    else:
        points = geometry.corners(shape)
    found = np.array(points, float)
    return in_three(found), shape.sphere.radius if shape.sphere else 0.0


def fastest_point(shape: Shape, centre: Reals, velocity: Reals, spin: Reals) -> float:
    """Largest |v + w x r|, m/s, in a shape that turns about its centre [3] m with the spin w [3] 1/s while that goes
    with the velocity v [3] m/s; r from the centre.
    """
    points, radius = rim(shape)
    speeds, w = velocity + product(points - centre, skew(spin).T), math.hypot(*spin)
    axial = product(speeds, spin / w) if w else np.zeros(len(points))
    across = np.sqrt(np.maximum(np.sum(speeds * speeds, axis=1) - axial * axial, 0.0))
    return float(np.hypot(axial, across + w * radius).max())


def start_speed(wall: Wall) -> float:
    """Largest speed of any point of a body at t = 0, m/s."""
    body: Any = wall.body
    centre = rigid_of(wall.shape, body.density).centre
    velocity = np.array([*body.velocity, 0.0, 0.0, 0.0][:3])
    spin = np.array([0.0, 0.0, 0.0, *body.angular_velocity][-3:])
    if body.hinge:
        velocity = np.cross(spin, centre - np.array([*body.hinge.point, 0.0][:3]))
    return fastest_point(wall.shape, centre, velocity, spin)
