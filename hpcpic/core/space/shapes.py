"""Solid shapes in d dimensions that say which points are inside; boundaries count as inside."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.products import product

Point = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Box:
    """Points between two corners, coordinate by coordinate."""

    low: Point
    high: Point

    def __post_init__(self) -> None:
        if len(self.low) != len(self.high) or any(a > b for a, b in zip(self.low, self.high)):
            raise ValueError(f"no box from {self.low} to {self.high}")

    def contains(self, x: NDArray) -> NDArray[np.bool_]:
        """Whether each of the points x[n, d] is inside: bool[n]."""
        return np.all((x >= self.low) & (x <= self.high), axis=1)


@dataclass(frozen=True, slots=True)
class Sphere:
    """Points up to `radius` from the centre; a disc in two dimensions."""

    centre: Point
    radius: float

    def contains(self, x: NDArray) -> NDArray[np.bool_]:
        """Whether each of the points x[n, d] is inside: bool[n]."""
        return np.sum((x - np.asarray(self.centre)) ** 2, axis=1) <= self.radius**2


@dataclass(frozen=True, slots=True)
class Cylinder:
    """Points up to `radius` from the axis, between its ends; a strip in two dimensions."""

    base: Point
    top: Point
    radius: float

    def __post_init__(self) -> None:
        if self.base == self.top:
            raise ValueError(f"cylinder of no length at {self.base}")

    def contains(self, x: NDArray) -> NDArray[np.bool_]:
        """Whether each of the points x[n, d] is inside: bool[n]."""
        axis = np.subtract(self.top, self.base)
        from_base = x - np.asarray(self.base)
        along = product(from_base, axis) / (axis @ axis)  # 0 at the base, 1 at the top
        distance_sq = np.sum((from_base - along[:, None] * axis) ** 2, axis=1)
        return (along >= 0.0) & (along <= 1.0) & (distance_sq <= self.radius**2)


@dataclass(frozen=True, slots=True)
class Plane:
    """The half-space behind a plane through `point`: where the outward `normal` does not point."""

    point: Point
    normal: Point

    def __post_init__(self) -> None:
        if not any(self.normal):
            raise ValueError("a plane needs a normal other than zero")

    def contains(self, x: NDArray) -> NDArray[np.bool_]:
        """Whether each of the points x[n, d] is inside: bool[n]."""
        return product(x - np.asarray(self.point), np.asarray(self.normal)) <= 0.0
