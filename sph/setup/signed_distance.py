"""Signed distances and normals of the shapes of a case, for points x[n, d]: negative inside, normals outward."""

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.products import product
from sph.case.config import Shape


def signed_distance(shape: Shape, x: NDArray) -> NDArray[np.float64]:
    """Distance[n] of points from the surface, m, negative inside; of a plane, positive where its normal points."""
    if shape.box:
        low, high = np.array(shape.box.low), np.array(shape.box.high)
        beyond = np.maximum(low - x, x - high)
        return np.sqrt(np.sum(np.maximum(beyond, 0.0) ** 2, axis=1)) + np.minimum(beyond.max(axis=1), 0.0)
    if shape.sphere:
        return np.sqrt(np.sum((x - shape.sphere.centre) ** 2, axis=1)) - shape.sphere.radius
    if shape.cylinder:
        across, along, half = _in_cylinder(shape, x)
        a, b = across - shape.cylinder.radius, np.abs(along) - half
        outside = np.hypot(np.maximum(a, 0.0), np.maximum(b, 0.0))
        return outside + np.minimum(np.maximum(a, b), 0.0)
    if shape.stl:
        from sph.case import stl

        return stl.signed_distance(shape.stl, x)
    assert shape.plane is not None
    return product(x - shape.plane.point, unit(shape.plane.normal))


def normals(shape: Shape, x: NDArray, step: float) -> NDArray[np.float64]:
    """Directions[n, d] in which the signed distance grows, of length 1, by differences over `step` m."""
    if shape.stl:
        from sph.case import stl

        return stl.normals(shape.stl, x)
    moves = step * np.eye(x.shape[1])
    slopes = [signed_distance(shape, x + move) - signed_distance(shape, x - move) for move in moves]
    found = np.stack(slopes, axis=1)
    return found / np.maximum(np.sqrt(np.sum(found * found, axis=1)), 1e-300)[:, None]


def unit(v) -> NDArray[np.float64]:
    v = np.asarray(v, np.float64)
    return v / np.sqrt(v @ v)


def _in_cylinder(shape: Shape, x: NDArray) -> tuple[NDArray, NDArray, float]:
    """Distance from the axis, distance along it from the middle, half its length."""
    cylinder = shape.cylinder
    assert cylinder is not None
    base, top = np.array(cylinder.base), np.array(cylinder.top)
    axis = unit(top - base)
    relative = x - (base + top) / 2
    along = product(relative, axis)
    across = relative - along[:, None] * axis
    return np.sqrt(np.sum(across * across, axis=1)), along, float(np.sqrt(np.sum((top - base) ** 2)) / 2)
