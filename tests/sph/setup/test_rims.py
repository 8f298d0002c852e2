"""Speeds of the points of a rigid body."""

import numpy as np
import pytest

from sph.case import geometry
from sph.case.shapes import Box, Cylinder, Polygon, Shape, Sphere
from sph.setup.rigid.rims import fastest_point
from sph.setup.signed_distance import signed_distance

SHAPES = {
    "box": Shape(box=Box(low=(0.1, 0.2), high=(0.5, 0.3))),
    "disc": Shape(sphere=Sphere(centre=(0.3, 0.1), radius=0.2)),
    "strip": Shape(cylinder=Cylinder(base=(0.1, 0.1), top=(0.4, 0.5), radius=0.05)),
    "wedge": Shape(polygon=Polygon(corners=((0.1, 0.1), (0.5, 0.2), (0.2, 0.4)))),
    "block": Shape(box=Box(low=(0.1, 0.2, 0.0), high=(0.5, 0.3, 0.3))),
    "ball": Shape(sphere=Sphere(centre=(0.3, 0.1, 0.2), radius=0.2)),
    "pipe": Shape(cylinder=Cylinder(base=(0.1, 0.1, 0.1), top=(0.4, 0.5, 0.3), radius=0.1)),
}


@pytest.mark.parametrize("velocity", [0.0, 0.7])
@pytest.mark.parametrize("name", SHAPES)
def test_no_point_of_a_shape_is_faster_and_one_is_nearly_as_fast(name, velocity):
    shape, rng = SHAPES[name], np.random.default_rng(5)
    (low, high), d = geometry.bounds(shape), len(geometry.middle(shape))
    x = rng.uniform(low, high, (400_000, d))
    x = np.pad(x[signed_distance(shape, x) < 0.0], ((0, 0), (0, 3 - d)))
    centre = np.array([0.2, 0.2, 0.1][:d] + [0.0] * (3 - d))
    spin = np.array([0.0, 0.0, 3.0]) if d == 2 else np.array([1.0, -2.0, 3.0])
    drift = velocity * np.array([1.0, -0.5, 0.4][:d] + [0.0] * (3 - d))
    speeds = np.linalg.norm(drift + np.cross(spin, x - centre), axis=1)
    assert speeds.max() == pytest.approx(fastest_point(shape, centre, drift, spin), rel=0.03)
    assert speeds.max() < 1.0013 * fastest_point(shape, centre, drift, spin)
