"""Signed distances and normals of the shapes of a case, for points x[n, d]: negative inside, normals outward."""

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space import shapes
from sph.case.config import Shape


def signed_distance(shape: Shape, x: NDArray) -> NDArray[np.float64]:
    """Distance[n] of points from the surface, m, negative inside; of a plane, positive where its normal points."""
    if shape.box:
        return shapes.box(x, shape.box.low, shape.box.high)
    if shape.sphere:
        return shapes.ball(x, shape.sphere.centre, shape.sphere.radius)
    if shape.cylinder:
        return shapes.cylinder(x, shape.cylinder.base, shape.cylinder.top, shape.cylinder.radius)
    if shape.stl:
        from sph.case import stl

        return stl.signed_distance(shape.stl, x)
    assert shape.plane is not None
    return shapes.plane(x, shape.plane.point, shape.plane.normal)


def normals(shape: Shape, x: NDArray, step: float) -> NDArray[np.float64]:
    """Directions[n, d] in which the signed distance grows, of length 1, by differences over `step` m."""
    if shape.stl:
        from sph.case import stl

        return stl.normals(shape.stl, x)
    moves = step * np.eye(x.shape[1])
    slopes = [signed_distance(shape, x + move) - signed_distance(shape, x - move) for move in moves]
    found = np.stack(slopes, axis=1)
    return found / np.maximum(np.sqrt(np.sum(found * found, axis=1)), 1e-300)[:, None]
