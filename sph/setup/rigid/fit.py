"""How a rigid body and the fluid around it share space at t = 0: points x[n, d] of a lattice that the surface cuts.

The density of fluid has a history, so what is missing around a body at the start is missing for ever: it displaces as
many particles as it has volume, and the nearest ones lie half a spacing off its surface on both sides of it.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sph.case.config import Shape
from sph.setup.particle_lattices import Filled, Found, Grid
from sph.setup.signed_distance import normals, signed_distance

Reals = NDArray[np.float64]
UNIT = 1 << 20  # parts of a cell, so that their sum has no order
GOLDEN = 0.6180339887498949  # multiples of it, less their whole parts, fill [0, 1) evenly
NEAREST = 0.499  # spacings off the surface; of lattices along a box the nearest points lie at 0.5, but for rounding
STEP = 1e-3  # of a spacing: over which normals are differences


def taken(shape: Shape, spacing: float, x: Reals) -> NDArray[np.bool_]:
    """Which points[n] of a lattice a body takes: the deepest ones, as many as it has cells. A cell that the surface
    cuts counts by the depth of its middle, as if cut along a side. On average that is exact for flat faces, and of a
    disc too much by a share of (dp / R)^2 / 12, of a ball by (dp / R)^2 / 4.
    """
    off = signed_distance(shape, x) / spacing
    n = (int(np.rint(UNIT * np.clip(0.5 - off, 0.0, 1.0)).astype(np.int64).sum()) + UNIT // 2) // UNIT
    turn = np.arange(len(x)) * GOLDEN % 1.0  # which of those as deep as each other: from all sides
    found = np.zeros(len(x), bool)
    found[np.lexsort((turn, np.round(off, 6)))[:n]] = True
    return found


def cleared(shape: Shape, x: Reals, spacing: float, side: float) -> Reals:
    """x[n, d] of fluid (side = 1) or of the body (-1), those nearer than half a spacing to its surface moved there."""
    for _ in range(x.shape[1]):  # inside an edge from one face after the other
        apart = side * signed_distance(shape, x)
        near = apart < NEAREST * spacing
        if not near.any():
            break
        x = x.copy()
        x[near] += (side * (0.5 * spacing - apart[near]))[:, None] * normals(shape, x[near], STEP * spacing)
    return x


def beside(walls: list[Any], x: Reals, spacing: float) -> Reals:
    """x[n, d] of fluid where it is clear of all rigid bodies among the walls."""
    for wall in walls:
        if wall.rigid:
            x = cleared(wall.shape, x, spacing, 1.0)
    return x


class Fitted(Filled):
    """The outer layers of a body that is no box along the axes: as many particles as it has cells."""

    def __init__(self, shape: Shape, spacing: float, layers: int, grid: Grid) -> None:
        ends = [np.concatenate([[c[0] - spacing], c, [c[-1] + spacing]]) for c in grid.coordinates]
        super().__init__(shape, spacing, layers, True, Grid(tuple(ends)))
        x = self.grid.points(self.grid.unflat(np.arange(self.grid.n)))
        outer = signed_distance(shape, x) > -self.depth
        self.kept = np.flatnonzero(taken(shape, spacing, x) & outer)

    def near(self, low: NDArray, high: NDArray) -> Found:
        x = self.grid.points(self.grid.unflat(self.kept))
        index = self.kept[np.all((x >= low) & (x < high), axis=1)]
        return index, *self.at(index)

    def at(self, index: NDArray[np.int64]) -> tuple[NDArray, NDArray]:
        x = cleared(self.shape, self.grid.points(self.grid.unflat(index)), self.spacing, -1.0)
        return x, self._normal(x)
