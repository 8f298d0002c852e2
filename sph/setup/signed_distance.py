"""Signed distances and normals of the shapes of a case, for points x[n, d]: negative inside, normals outward."""

import functools

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space import shapes
from hpcpic.core.space.triangles import Surface
from sph.case.shapes import Shape, Stl


@functools.lru_cache(maxsize=16)
def surface(given: Stl) -> Surface:
    """The surface that a case names. Raises ConfigError when it cannot be one."""
    from sph.case.stl import mesh

    found = mesh(given)
    return Surface(np.array(found.vertices, np.float64), np.array(found.faces, np.int64))


def signed_distance(shape: Shape, x: NDArray, reach: float = np.inf) -> NDArray[np.float64]:
    """Distance[n] of points from the surface, m, negative inside; of a plane, positive where its normal points. Beyond
    `reach`, m, it is told of STL surfaces only that it is more, faster for points in turn that are near each other.
    """
    if shape.box:
        return shapes.box(x, shape.box.low, shape.box.high)
    if shape.sphere:
        return shapes.ball(x, shape.sphere.centre, shape.sphere.radius)
    if shape.cylinder:
        return shapes.cylinder(x, shape.cylinder.base, shape.cylinder.top, shape.cylinder.radius)
    if shape.polygon:
        return shapes.polygon(x, shape.polygon.corners)
    if shape.stl:
        return surface(shape.stl).distances(x, reach)
    assert shape.plane is not None
    return shapes.plane(x, shape.plane.point, shape.plane.normal)


def normals(shape: Shape, x: NDArray, step: float) -> NDArray[np.float64]:
    """Directions[n, d] in which the signed distance grows, of length 1, by differences over `step` m; of STL exact."""
    if shape.stl:
        found = surface(shape.stl).directions(x)
    else:
        moves = step * np.eye(x.shape[1])
        slopes = [signed_distance(shape, x + move) - signed_distance(shape, x - move) for move in moves]
        found = np.stack(slopes, axis=1)
    return found / np.maximum(np.sqrt(np.sum(found * found, axis=1)), 1e-300)[:, None]
