"""Signed distances of points x[n, d] from shapes of which formulas are known: negative inside; of a plane, positive
where its normal points.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hpcpic.core.space.products import product

Distances = NDArray[np.float64]


def box(x: NDArray, low: ArrayLike, high: ArrayLike) -> Distances:
    """From a box between two corners."""
    beyond = np.maximum(low - x, x - high)
    return lengths(np.maximum(beyond, 0.0)) + np.minimum(beyond.max(axis=1), 0.0)


def ball(x: NDArray, centre: ArrayLike, radius: float) -> Distances:
    """From a sphere; in 2D from a disc."""
    return lengths(x - np.asarray(centre)) - radius


def cylinder(x: NDArray, base: ArrayLike, top: ArrayLike, radius: float) -> Distances:
    """From a closed cylinder between the middles of its ends; in 2D from a rectangle."""
    base, top = np.asarray(base), np.asarray(top)
    axis = unit(top - base)
    relative = x - (base + top) / 2
    along = product(relative, axis)
    across = lengths(relative - along[:, None] * axis) - radius
    beyond = np.abs(along) - float(np.sqrt(np.sum((top - base) ** 2)) / 2)
    outside = np.hypot(np.maximum(across, 0.0), np.maximum(beyond, 0.0))
    return outside + np.minimum(np.maximum(across, beyond), 0.0)


def polygon(x: NDArray, corners: ArrayLike) -> Distances:
    """From a polygon with these corners [k, 2] in turn; 2D."""
    ends = np.asarray(corners, np.float64)
    squares, inside = np.full(len(x), np.inf), np.zeros(len(x), np.bool_)
    for a, b in zip(ends, np.roll(ends, -1, axis=0)):
        side, off = b - a, x - a
        along = np.clip((off[:, 0] * side[0] + off[:, 1] * side[1]) / np.sum(side * side), 0.0, 1.0)
        away = off - along[:, None] * side
        squares = np.minimum(squares, away[:, 0] * away[:, 0] + away[:, 1] * away[:, 1])
        if a[1] != b[1]:  # a ray along x meets it
            level = (a[1] <= x[:, 1]) != (b[1] <= x[:, 1])
            inside ^= level & (off[:, 0] < off[:, 1] * (side[0] / side[1]))
    return np.where(inside, -1.0, 1.0) * np.sqrt(squares)


def plane(x: NDArray, point: ArrayLike, normal: ArrayLike) -> Distances:
    """From a plane through a point."""
    return product(x - np.asarray(point), unit(normal))


def unit(v: ArrayLike) -> NDArray[np.float64]:
    """The vector of length 1 in the direction of v[d]."""
    v = np.asarray(v, np.float64)
    return v / np.sqrt(np.sum(v * v))


def lengths(x: NDArray) -> Distances:
    """Lengths [n] of the vectors x[n, d]."""
    return np.sqrt(np.sum(x * x, axis=1))


def in_three(x: NDArray) -> NDArray[np.float64]:
    """Vectors x[n, d] with three components, of which those beyond d are 0."""
    return np.pad(x, ((0, 0), (0, 3 - x.shape[1])))
