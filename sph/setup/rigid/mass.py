"""Rigid bodies: mass and inertia of shapes, and rotations."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.products import product
from sph.case import geometry
from sph.case.shapes import Shape
from sph.setup import signed_distance

Reals = NDArray[np.float64]


@dataclass(frozen=True)
class Rigid:
    """Mass kg (2D: kg/m), centre of mass [3] m and inertia about it [3, 3] kg m2 (2D: kg m), at t = 0."""

    mass: float
    centre: Reals
    inertia: Reals


def rigid_of(shape: Shape, density: float) -> Rigid:
    """Mass and inertia of a shape of even density, exact: those of a surface of triangles are of the triangles."""
    mass = density * geometry.volume(shape)
    if shape.stl:
        from sph.case.stl import mesh

        found = mesh(shape.stl)
        return Rigid(mass, np.array(found.center_mass), density * np.array(found.moment_inertia))
    middle = geometry.centroid(shape.polygon.corners) if shape.polygon else geometry.middle(shape)
    d, centre, second = len(middle), np.zeros(3), np.zeros((3, 3))
    centre[:d], second[:d, :d] = middle, mass * mean_square(shape, d)
    return Rigid(mass, centre, np.trace(second) * np.eye(3) - second)


def mean_square(shape: Shape, d: int) -> Reals:
    """Mean over a shape of r_a r_b [d, d], m2; r from its centre of mass."""
    if shape.sphere:
        return shape.sphere.radius**2 / (d + 2) * np.eye(d)
    if shape.cylinder:
        axis = np.subtract(shape.cylinder.top, shape.cylinder.base)
        along = np.outer(axis, axis)
        across = np.eye(d) - along / np.trace(along)
        return along / 12 + shape.cylinder.radius**2 / (3 if d == 2 else 4) * across
    if shape.polygon:
        return np.array(geometry.polygon_squares(shape.polygon.corners))
    low, high = geometry.bounds(shape)
    return np.diag(np.square(np.subtract(high, low))) / 12


def rotation(q: Reals) -> Reals:
    """The matrix [3, 3] of a unit quaternion (w, x, y, z)."""
    w, x, y, z = q
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


def times(a: Reals, b: Reals) -> Reals:
    """Product of two quaternions: first the rotation b, then a."""
    (p, x, y, z), (q, u, v, w) = a.tolist(), b.tolist()
    real = p * q - float(np.sum(a[1:] * b[1:]))
    return np.array([
        real, p * u + q * x + (y * w - z * v), p * v + q * y + (z * u - x * w), p * w + q * z + (x * v - y * u),
    ])  # fmt: skip


def turning(angle: Reals) -> Reals:
    """The unit quaternion of a rotation by |angle| rad about the direction of angle[3]."""
    half = 0.5 * math.hypot(*angle)
    return np.array([math.cos(half), *(0.5 * (math.sin(half) / half if half else 1.0) * angle)])


def angle_of(q: Reals) -> Reals:
    """The vector [3] whose rotation a unit quaternion is, rad."""
    sine = math.hypot(*q[1:])
    return q[1:] * (2 * math.atan2(sine, q[0]) / sine if sine else 2.0)


def skew(w: Reals) -> Reals:
    """The matrix [3, 3] that gives w x r of r."""
    return np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])


def inverse(m: Reals, free: Reals) -> Reals:
    """m[3, 3] inverted, symmetric, among the axes that are free (1, else 0); 0 for all others."""
    m = m * np.outer(free, free) + np.diag(1.0 - free)
    across = np.cross(m[[1, 2, 0]], m[[2, 0, 1]])
    return across.T / product(m[0], across[0]) * np.outer(free, free)


def share(wall: Any, x: Reals) -> float:
    """Mass of a body, with outer particles at x[n, d] at t = 0, over that of it and a layer of fluid dp thick."""
    dp = wall.scene.spacing
    layer = np.count_nonzero(signed_distance.signed_distance(wall.shape, x) > -dp) * dp ** x.shape[1]
    return wall.rigid.mass / (wall.rigid.mass + wall.scene.rho0 * layer)
