"""Sizes of the shapes of a case, by plain arithmetic: what `check` needs before any array is made.

A shape is a `config.Shape`; 2D shapes have two coordinates.
"""

import itertools
import math

from sph.case.config import Shape

Point = tuple[float, ...]


def length(v: Point) -> float:
    return math.hypot(*v)


def linear(gradient: Point, centre: Point, x: Point) -> Point:
    """G (x - centre), with G row by row."""
    d = len(x)
    return tuple(sum(gradient[i * d + j] * (x[j] - centre[j]) for j in range(d)) for i in range(d))


def bounds(shape: Shape) -> tuple[Point, Point]:
    """Lower and upper corner of the smallest box around a shape; of a plane, its point twice."""
    if shape.box:
        return shape.box.low, shape.box.high
    if shape.sphere:
        centre, r = shape.sphere.centre, shape.sphere.radius
        return tuple(x - r for x in centre), tuple(x + r for x in centre)
    if shape.cylinder:
        base, top, r = shape.cylinder.base, shape.cylinder.top, shape.cylinder.radius
        axis = [b - a for a, b in zip(base, top)]
        along = math.hypot(*axis) or 1.0
        reach = [r * math.sqrt(max(0.0, 1 - (a / along) ** 2)) for a in axis]
        low = tuple(min(a, b) - e for a, b, e in zip(base, top, reach))
        return low, tuple(max(a, b) + e for a, b, e in zip(base, top, reach))
    if shape.stl:
        from sph.case.stl import mesh

        low, high = mesh(shape.stl).bounds
        return tuple(map(float, low)), tuple(map(float, high))
    assert shape.plane is not None
    return shape.plane.point, shape.plane.point


def corners(shape: Shape) -> list[Point]:
    """The corners of the box around a shape."""
    return list(itertools.product(*zip(*bounds(shape))))


def middle(shape: Shape) -> Point:
    return tuple((a + b) / 2 for a, b in zip(*bounds(shape)))


def apart(low: Point, high: Point, a: Point, b: Point) -> float:
    """How far a box from low to high is from one from a to b, m."""
    return math.hypot(*(max(0.0, p - d, c - q) for p, q, c, d in zip(low, high, a, b)))


def volume(shape: Shape) -> float:
    """Volume in 3D, m3; area in 2D, m2."""
    d = len(bounds(shape)[0])
    if shape.box:
        return math.prod(b - a for a, b in zip(shape.box.low, shape.box.high))
    if shape.sphere:
        r = shape.sphere.radius
        return math.pi * r * r if d == 2 else 4 / 3 * math.pi * r**3
    if shape.cylinder:
        r, along = shape.cylinder.radius, math.dist(shape.cylinder.base, shape.cylinder.top)
        return 2 * r * along if d == 2 else math.pi * r * r * along
    if shape.stl:
        from sph.case.stl import mesh

        return float(mesh(shape.stl).volume)
    return math.inf


def count(extent: float, spacing: float) -> int:
    """Particles along a box edge: as near to the spacing as possible, at least one."""
    return max(1, round(extent / spacing))
