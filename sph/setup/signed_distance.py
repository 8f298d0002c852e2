"""Signed distances and normals of the shapes of a case, for points x[n, d]: negative inside, normals outward."""

import functools

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space import shapes
from hpcpic.core.space.triangles import Surface
from sph.case import geometry
from sph.case.shapes import Shape, Stl

ALONG = 3  # places on a side of a polygon before which discs are tried
HALVINGS = 20


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


def thickness(shape: Shape) -> float:
    """Diameter of the largest disc or ball in a solid, m; of an STL surface, the least extent of the box around it."""
    if shape.polygon:
        return inscribed(np.array(shape.polygon.corners))
    low, high = map(np.array, geometry.bounds(shape))
    least = float((high - low).min())
    if shape.cylinder:
        length = float(np.linalg.norm(np.subtract(shape.cylinder.top, shape.cylinder.base)))
        least = min(2.0 * shape.cylinder.radius, length)
    return least


def inscribed(corners: NDArray) -> float:
    """Diameter of the largest disc in a polygon [n, 2], m: the largest that touches a side from within at one of some
    places, moved until it finds no larger room.
    """
    side = np.roll(corners, -1, axis=0) - corners
    inward = np.stack([-side[:, 1], side[:, 0]], axis=1) * np.sign(geometry.polygon_area(corners.tolist()))
    inward /= np.sqrt(np.sum(side * side, axis=1))[:, None]
    part = (np.arange(ALONG) + 0.5)[:, None, None] / ALONG
    place, way = (corners + part * side).reshape(-1, 2), np.tile(inward, (ALONG, 1))
    low, high = np.zeros(len(place)), np.full(len(place), float(np.ptp(corners, axis=0).max()))
    for _ in range(HALVINGS):  # as far as a place is from the side it is from all of them
        middle = (low + high) / 2
        fits = -shapes.polygon(place + middle[:, None] * way, corners.tolist()) >= middle * (1 - 1e-9)
        low, high = np.where(fits, middle, low), np.where(fits, high, middle)
    best = int(np.argmax(low))
    centre, largest = place[best] + low[best] * way[best], float(low[best])
    angle, step = np.arange(16) * (np.pi / 8), largest
    while step > 1e-6 * largest > 0.0:
        around = centre + step * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        depth = -shapes.polygon(around, corners.tolist())
        if depth.max() > largest * (1 + 1e-9):
            centre, largest = around[np.argmax(depth)], float(depth.max())
        else:
            step /= 2
    return 2.0 * largest
