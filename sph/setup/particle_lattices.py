"""Where particles are at rest: lattices that give the particles of any part of space without holding all of them.

Wall lattices have `near(low, high)`: index[n], x[n, d], normal[n, d] (into the fluid, 0 where there is none) of the
particles in a box, in order of the index. The same box gives the same particles whoever asks. `at(index)` gives x and
normal again.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.products import product
from hpcpic.core.space.shapes import unit
from sph.case import geometry
from sph.case.config import AXES
from sph.case.shapes import Plane, Shape
from sph.setup import signed_distance

Found = tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]
Box = tuple[NDArray, NDArray] | None
Test = Callable[[NDArray], NDArray[np.bool_]]
CHUNK = 1 << 18
LONGEST = 1.1  # spacings between particles of a solid: still water leaks through two layers that are 1.2 apart
ENDLESS = 4.0  # diagonals of the domain that a plane goes on beyond it


def cross(ranges: list[NDArray]) -> NDArray[np.int64]:
    """All combinations[n, d] of indices, the last axis fastest."""
    return np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1).reshape(-1, len(ranges)).astype(np.int64)


def between(coordinates: NDArray, low: float, high: float) -> NDArray[np.int64]:
    """Indices of the ascending coordinates in [low, high)."""
    first, last = np.searchsorted(coordinates, (low, high))
    return np.arange(first, last)


@dataclass(frozen=True, slots=True)
class Grid:
    """A product of ascending coordinates along each axis."""

    coordinates: tuple[NDArray[np.float64], ...]

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(len(c) for c in self.coordinates)

    @property
    def n(self) -> int:
        return math.prod(self.shape)

    def points(self, at: NDArray[np.int64]) -> NDArray[np.float64]:
        """x[n, d] of indices[n, d]."""
        return np.stack([c[at[:, k]] for k, c in enumerate(self.coordinates)], axis=1)

    def flat(self, at: NDArray[np.int64]) -> NDArray[np.int64]:
        flat = np.zeros(len(at), np.int64)
        for k, n in enumerate(self.shape):
            flat = flat * n + at[:, k]
        return flat

    def unflat(self, flat: NDArray[np.int64]) -> NDArray[np.int64]:
        return np.stack(np.unravel_index(flat, self.shape), axis=1).astype(np.int64)

    def within(self, low: NDArray, high: NDArray) -> "Grid":
        """The part of it in [low, high]."""
        return Grid(tuple(c[(c >= a) & (c <= b)] for c, a, b in zip(self.coordinates, low, high)))

    def inside(self, low: NDArray, high: NDArray) -> NDArray[np.int64]:
        """Indices[n, d] of the points in [low, high)."""
        return cross([between(c, low[k], high[k]) for k, c in enumerate(self.coordinates)])


def flagged(grid: Grid, box: Box, bad: Test) -> NDArray[np.int64]:
    """Flat indices, ascending, of the points (in the box) for which bad(x[n, d]) holds."""
    if box is not None:
        at = grid.inside(*box)
        return grid.flat(at[bad(grid.points(at))])
    found = [np.zeros(0, np.int64)]
    for start in range(0, grid.n, CHUNK):
        flat = np.arange(start, min(start + CHUNK, grid.n))
        found.append(flat[bad(grid.points(grid.unflat(flat)))])
    return np.concatenate(found)


def even(low: float, high: float, spacing: float, longest: float = math.inf) -> NDArray[np.float64]:
    """Middles of equal pieces of [low, high], each about `spacing` long, none longer than so many of it."""
    n = geometry.count(high - low, spacing)
    n += (high - low) / n > longest * spacing
    return low + (np.arange(n, dtype=np.float64) + 0.5) * ((high - low) / n)


def dividing(low: Sequence[float], high: Sequence[float], spacing: float) -> Grid:
    """A lattice that divides a box."""
    return Grid(tuple(even(a, b, spacing) for a, b in zip(low, high)))


def grid_of(shape: Shape, spacing: float) -> Grid:
    """The lattice over the box around a shape: exact for a box, of the spacing for what is round."""
    low, high = geometry.bounds(shape)
    if shape.box:
        return dividing(low, high, spacing)
    return Grid(tuple(_centred(a, b, spacing) for a, b in zip(low, high)))


def _centred(low: float, high: float, spacing: float) -> NDArray[np.float64]:
    n = max(1, math.ceil((high - low) / spacing - 1e-4))  # STL files hold float32
    return (low + high) / 2 + (np.arange(n, dtype=np.float64) - (n - 1) / 2) * spacing


class Shell:
    """Layers of particles around a tank: behind each face of a box, half a spacing and more; corners once."""

    def __init__(self, lows: NDArray, highs: NDArray, spacing: float, layers: int, closed: set[str]) -> None:
        self.closed = closed
        depth = (np.arange(layers) + 0.5) * spacing
        coordinates, codes = [], []
        for axis, low, high in zip(AXES, lows, highs):
            below = low - depth[::-1] if f"{axis}-" in closed else np.zeros(0)
            above = high + depth if f"{axis}+" in closed else np.zeros(0)
            middle = even(low, high, spacing)
            coordinates.append(np.concatenate([below, middle, above]))
            codes.append(np.repeat([-1, 0, 1], [len(below), len(middle), len(above)]))
        self.grid, self.codes = Grid(tuple(coordinates)), codes

    def near(self, low: NDArray, high: NDArray) -> Found:
        at = self.grid.inside(low, high)
        code = np.stack([self.codes[k][at[:, k]] for k in range(at.shape[1])], axis=1)
        kept = np.any(code != 0, axis=1)
        at = at[kept]
        return self.grid.flat(at), *self._described(at)

    def at(self, index: NDArray[np.int64]) -> tuple[NDArray, NDArray]:
        return self._described(self.grid.unflat(index))

    def _described(self, at: NDArray[np.int64]) -> tuple[NDArray, NDArray]:
        code = np.stack([self.codes[k][at[:, k]] for k in range(at.shape[1])], axis=1).astype(np.float64)
        return self.grid.points(at), -code / np.sqrt(np.sum(code * code, axis=1))[:, None]


class Filled:
    """The outer layers of a solid, or those around a hollow, of any shape, on one lattice of the spacing."""

    def __init__(self, shape: Shape, spacing: float, layers: int, solid: bool, grid: Grid) -> None:
        self.shape, self.spacing, self.solid, self.grid = shape, spacing, solid, grid
        self.depth = layers * spacing

    def near(self, low: NDArray, high: NDArray) -> Found:
        at = self.grid.inside(low, high)
        x = self.grid.points(at)
        sign = 1.0 if self.solid else -1.0
        depth = -sign * signed_distance.signed_distance(self.shape, x)
        kept = (depth >= 0.0) & (depth < self.depth)
        return self.grid.flat(at[kept]), x[kept], self._normal(x[kept])

    def at(self, index: NDArray[np.int64]) -> tuple[NDArray, NDArray]:
        x = self.grid.points(self.grid.unflat(index))
        return x, self._normal(x)

    def _normal(self, x: NDArray) -> NDArray[np.float64]:
        return (1.0 if self.solid else -1.0) * signed_distance.normals(self.shape, x, 1e-3 * self.spacing)


class Sheet:
    """One layer of particles on a flat face: origin + i s1 t1 (+ j s2 t2), all with the same normal."""

    def __init__(self, origin: NDArray, tangents: NDArray, counts: tuple[int, ...], normal: NDArray) -> None:
        """tangents[d - 1, d] are the steps from one particle to the next."""
        self.origin, self.tangents, self.counts, self.normal = origin, tangents, counts, normal

    def near(self, low: NDArray, high: NDArray) -> Found:
        corners = np.array(np.meshgrid(*zip(low, high))).reshape(len(low), -1).T - self.origin
        steps = np.sum(self.tangents**2, axis=1)
        places = product(corners, self.tangents.T) / steps
        first = np.clip(np.floor(places.min(axis=0)), 0, self.counts).astype(np.int64)
        last = np.clip(np.ceil(places.max(axis=0)) + 1, 0, self.counts).astype(np.int64)
        at = cross([np.arange(a, b) for a, b in zip(first, last)])
        x = self.origin + product(at, self.tangents)
        kept = np.all((x >= low) & (x < high), axis=1)
        at, x = at[kept], x[kept]
        index = at[:, 0] if len(self.counts) == 1 else at[:, 0] * self.counts[1] + at[:, 1]
        return index, x, np.broadcast_to(self.normal, x.shape).copy()

    def at(self, index: NDArray[np.int64]) -> tuple[NDArray, NDArray]:
        at = np.stack(np.unravel_index(index, self.counts), axis=1)
        x = self.origin + product(at, self.tangents)
        return x, np.broadcast_to(self.normal, x.shape).copy()


def along(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit vectors [d - 1, d] in a plane, at right angles; first the axes that lie in it."""
    flat, padded = np.eye(len(normal))[normal == 0.0], np.array([*normal, 0.0][:3])
    first = unit(np.cross(padded, np.eye(3)[np.argmin(np.abs(padded))]))
    oblique = np.stack([first, np.cross(padded, first)])
    return np.concatenate([flat, oblique[: len(normal) - 1 - len(flat), : len(normal)]])


def plane_sheet(scene: Any, plane: Plane, recess: float) -> Sheet:
    """A sheet of spacing dp, far beyond the domain; along periodic axes, which lie in it, over a period."""
    normal, dp = unit(plane.normal), scene.spacing
    flat = np.flatnonzero(normal == 0.0)
    basis = along(normal)
    middle, reach = (scene.low + scene.high) / 2, (ENDLESS + 0.5) * scene.diagonal
    origin = middle - (product(middle - plane.point, normal) + recess) * normal
    steps, counts = np.full(len(basis), dp), np.full(len(basis), 2 * math.ceil(reach / dp) + 1)
    for row, k in enumerate(flat):
        if scene.periodic[k]:
            length = scene.high[k] - scene.low[k]
            counts[row] = geometry.count(length, dp)
            steps[row] = length / counts[row]
    tangents = basis * steps[:, None]
    return Sheet(origin - product((counts - 1) / 2, tangents), tangents, tuple(counts.tolist()), normal)


def whole_steps(wall: Any, way: NDArray[np.float64]) -> NDArray[np.float64]:
    """The part of a way [d] of a wall, m, after which its particles lie as before: of a plane, whole spacings along
    itself. Nothing along periods, through which they go on.
    """
    found = np.zeros_like(way)
    for layer in wall.lattice.parts[:1] if wall.shape.plane and wall.lattice else []:
        for step in layer.tangents:
            if not step[wall.scene.periodic].any():
                found += np.rint(product(way, step) / product(step, step)) * step
    return found


@dataclass(frozen=True, slots=True)
class Face:
    """A flat piece of a wall: a point on it, its normal into the fluid, the box that holds it (m)."""

    point: NDArray[np.float64]
    normal: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]


PART = 44  # bits of the index inside one part of a wall


class Parts:
    """Several lattices as one."""

    def __init__(self, parts: list) -> None:
        self.parts = parts

    def near(self, low: NDArray, high: NDArray) -> Found:
        found = [part.near(low, high) for part in self.parts]
        if not found:
            return np.zeros(0, np.int64), np.zeros((0, len(low))), np.zeros((0, len(low)))
        index = [i + (k << PART) for k, (i, _, _) in enumerate(found)]
        return np.concatenate(index), np.concatenate([f[1] for f in found]), np.concatenate([f[2] for f in found])

    def at(self, index: NDArray[np.int64]) -> tuple[NDArray, NDArray]:
        d = self.parts[0].origin.size
        x, normal = np.zeros((len(index), d)), np.zeros((len(index), d))
        for k, part in enumerate(self.parts):
            own = index >> PART == k
            x[own], normal[own] = part.at(index[own] & ((1 << PART) - 1))
        return x, normal


def box_sheets(
    low: NDArray, high: NDArray, closed: set[str], spacing: float, solid: bool, ends: NDArray[np.bool_]
) -> list[Sheet]:
    """The closed faces of a box as sheets. ends[d]: particles on the edges across this axis too, else half a spacing
    inside them.

    The edges of a box without thickness are no faces.
    """
    d, sheets = len(low), []
    for axis in range(d):
        others = [k for k in range(d) if k != axis]
        for sign, face in ((-1.0, low[axis]), (1.0, high[axis])):
            if AXES[axis] + ("-" if sign < 0 else "+") not in closed:
                continue
            if any(high[k] <= low[k] for k in others):
                continue
            pieces = [geometry.count(high[k] - low[k], spacing) for k in others]
            steps = [(high[k] - low[k]) / n for k, n in zip(others, pieces)]
            origin, tangents, normal = np.array(low, float), np.zeros((d - 1, d)), np.zeros(d)
            origin[axis], normal[axis] = face, sign if solid else -sign
            for row, (k, step) in enumerate(zip(others, steps)):
                tangents[row, k] = step
                origin[k] += 0.0 if ends[k] else step / 2
            counts = tuple(n + int(ends[k]) for n, k in zip(pieces, others))
            sheets.append(Sheet(origin, tangents, counts, normal))
    return sheets
