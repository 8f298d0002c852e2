"""Sizes of the shapes of a case, by plain arithmetic: what `check` needs before any array is made.

A shape is a `config.Shape`; 2D shapes have two coordinates.
"""

import itertools
import math
from collections.abc import Iterator, Sequence

from sph.case.shapes import Shape

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
    if shape.polygon:
        xs, ys = zip(*shape.polygon.corners)
        return (min(xs), min(ys)), (max(xs), max(ys))
    if shape.stl:
        from sph.case.stl import mesh

        low, high = mesh(shape.stl).bounds
        return tuple(map(float, low)), tuple(map(float, high))
    assert shape.plane is not None
    return shape.plane.point, shape.plane.point


def corners(shape: Shape) -> list[Point]:
    """The corners of the box around a shape."""
    return list(itertools.product(*zip(*bounds(shape))))


def outline(shape: Shape) -> Sequence[Point]:
    """The corners in turn of a polygon, and of a strip in 2D; none of other shapes."""
    strip = shape.cylinder
    if strip and len(strip.base) == 2:
        (a, b), (c, d) = strip.base, strip.top
        along = math.hypot(c - a, d - b) or 1.0
        x, y = -strip.radius * (d - b) / along, strip.radius * (c - a) / along
        return (a - x, b - y), (c - x, d - y), (c + x, d + y), (a + x, b + y)
    return shape.polygon.corners if shape.polygon else ()


def middle(shape: Shape) -> Point:
    return tuple((a + b) / 2 for a, b in zip(*bounds(shape)))


def joined(shape: Shape, others: Sequence[Shape], least: float) -> tuple[Point, Point]:
    """The box around a shape; of a polygon, around it and all others whose boxes overlap that by more than a least
    length along each axis, so that what goes on beyond a side that slopes lies on one lattice.
    """
    low, high = bounds(shape)
    for _ in others if shape.polygon else ():
        for a, b in map(bounds, others):
            if all(min(q, d) - max(p, c) > least for p, q, c, d in zip(low, high, a, b)):
                low, high = tuple(map(min, low, a)), tuple(map(max, high, b))
    return low, high


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
    if shape.polygon:
        return abs(polygon_area(shape.polygon.corners))
    if shape.stl:
        from sph.case.stl import mesh

        return float(mesh(shape.stl).volume)
    return math.inf


def triangles(corners: Sequence[Point]) -> Iterator[tuple[Point, Point, float]]:
    """The sides of a polygon: both ends, from its first corner, and the area of the triangle with that, below 0 where
    the corners go round clockwise.
    """
    x, y = corners[0]
    ends = [(a - x, b - y) for a, b in corners]
    for one, other in itertools.pairwise(ends):
        yield one, other, 0.5 * (one[0] * other[1] - one[1] * other[0])


def polygon_area(corners: Sequence[Point]) -> float:
    """Area, m2, below 0 where the corners go round clockwise."""
    return sum(area for _, _, area in triangles(corners))


def centroid(corners: Sequence[Point]) -> Point:
    """Centre of mass of a polygon."""
    whole, first = polygon_area(corners), corners[0]
    return tuple(
        first[k] + sum(area * (a[k] + b[k]) for a, b, area in triangles(corners)) / 3 / whole for k in range(2)
    )


def polygon_squares(corners: Sequence[Point]) -> list[list[float]]:
    """Mean over a polygon of r_a r_b, m2; r from its centre of mass."""
    whole, first, middle = polygon_area(corners), corners[0], centroid(corners)
    out = [[0.0, 0.0], [0.0, 0.0]]
    for i, j in itertools.product(range(2), repeat=2):
        mean = sum(
            area * ((a[i] + b[i]) * (a[j] + b[j]) + a[i] * a[j] + b[i] * b[j]) for a, b, area in triangles(corners)
        )
        out[i][j] = mean / 12 / whole - (middle[i] - first[i]) * (middle[j] - first[j])
    return out


def crossing(corners: Sequence[Point]) -> tuple[int, int] | None:
    """The first two sides of a polygon that meet but in a corner which both have, by the corners where they begin."""
    sides = enumerate(zip(corners, (*corners[1:], corners[0])))
    for (i, (a, b)), (j, (c, d)) in itertools.combinations(sides, 2):
        if b == c or d == a:
            one, shared, other = (a, b, d) if b == c else (c, d, b)
            met = turn(one, shared, other) == 0.0 and not between(one, other, shared)
        else:
            across = turn(a, b, c) * turn(a, b, d) < 0.0 and turn(c, d, a) * turn(c, d, b) < 0.0
            ends = ((a, b, c), (a, b, d), (c, d, a), (c, d, b))
            met = across or any(turn(*end) == 0.0 and between(*end) for end in ends)
        if met:
            return i, j
    return None


def turn(a: Point, b: Point, c: Point) -> float:
    """Twice the area of a triangle: above 0 where c lies left of the way from a to b, 0 on their line."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def between(a: Point, b: Point, c: Point) -> bool:
    """Whether c is in the box that has a and b as corners."""
    return all(min(p, q) <= r <= max(p, q) for p, q, r in zip(a, b, c))


def count(extent: float, spacing: float) -> int:
    """Particles along a box edge: as near to the spacing as possible, at least one."""
    return max(1, round(extent / spacing))
