"""How a solid and the fluid around it share space at t = 0: points x[n, d] of a lattice that the surface cuts.

The density of fluid has a history, so what is missing around a solid at the start is missing for ever: it displaces as
many particles as it has volume, and the nearest ones lie half a spacing off its surface on both sides of it.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sph.case import geometry
from sph.case.shapes import Shape
from sph.setup.particle_lattices import Filled, Found, Grid, flagged
from sph.setup.signed_distance import normals, signed_distance

Reals = NDArray[np.float64]
UNIT = 1 << 20  # parts of a cell, so that their sum has no order
GOLDEN = 0.6180339887498949  # multiples of it, less their whole parts, fill [0, 1) evenly
NEAREST = 0.499  # spacings off the surface; of lattices along a box the nearest points lie at 0.5, but for rounding
DEEP = 2.0  # spacings: more than anything moves a particle that is kept
STEP = 1e-3  # of a spacing: over which normals are differences


def fits(wall: Any) -> bool:
    """Whether fluid is fitted to a wall: a body, or what has layers of particles, but for tanks and hollows that are
    boxes: these have lattices that start from their faces.
    """
    box = wall.shape.box
    return bool(wall.rigid) or (wall.rule.layered and not (box and (box.open or not wall.section.solid)))


def around(wall: Any) -> tuple[Reals, Reals] | None:
    """The box in which a solid takes fluid away; None: everywhere."""
    if wall.shape.plane or not wall.section.solid:
        return None
    low, high = map(np.array, geometry.bounds(wall.shape))
    return low - wall.scene.spacing, high + wall.scene.spacing


def outward(wall: Any) -> float:
    """1 where fluid is outside the shape of a wall, -1 in a tank."""
    return 1.0 if wall.section.solid or wall.shape.plane else -1.0


def taken(off: Reals) -> NDArray[np.bool_]:
    """Which points[n] of a lattice, off[n] spacings off its surface, a solid takes: the deepest ones, as many as it has
    cells. A cell that the surface cuts counts by the depth of its middle, as if cut along a side. On average that is
    exact for flat faces, and of a disc too much by a share of (dp / R)^2 / 12, of a ball by (dp / R)^2 / 4.
    """
    found = off <= -0.5
    cut = np.flatnonzero(~found & (off < 0.5))
    n = (int(np.rint(UNIT * (0.5 - off[cut])).astype(np.int64).sum()) + UNIT // 2) // UNIT
    turn = cut * GOLDEN % 1.0  # which of those as deep as each other: from all sides
    found[cut[np.lexsort((turn, np.round(off[cut], 6)))[:n]]] = True
    return found


def taken_by(wall: Any, step: float, x: Reals) -> NDArray[np.bool_]:
    """Which points x[n, d] of a lattice a wall takes, `step` m from each other where they are nearest."""
    return taken(outward(wall) * signed_distance(wall.shape, x, step) / step)


def cleared(shape: Shape, x: Reals, spacing: float, side: float) -> Reals:
    """x[n, d] outside of a surface (side = 1) or in it (-1); what was nearer than half a spacing to it has moved. What
    lies deep on its other side stays: it is taken away.
    """
    moved, x = np.arange(len(x)), x.copy()
    for _ in range(x.shape[1]):  # inside an edge from one face after the other
        apart = side * signed_distance(shape, x[moved], DEEP * spacing)
        near = (apart < NEAREST * spacing) & (apart > -DEEP * spacing)
        moved, apart = moved[near], apart[near]
        if not len(moved):
            break
        x[moved] += (side * (0.5 * spacing - apart))[:, None] * normals(shape, x[moved], STEP * spacing)
    return x


def beside(walls: list[Any], x: Reals, step: float) -> Reals:
    """x[n, d] of fluid where it is clear of all walls that it is fitted to, by half of the step of its lattice, m."""
    for wall in filter(fits, walls):
        box = around(wall)
        near = np.all((x > box[0]) & (x < box[1]), axis=1) if box else np.ones(len(x), bool)
        if near.any():
            x = x.copy()
            x[near] = cleared(wall.shape, x[near], step, outward(wall))
    return x


class Fitted(Filled):
    """The outer layers of a solid, or those around a hollow, that is no box along the axes: as many particles as it has
    cells, of a grid that goes on by a spacing where it ends.
    """

    def __init__(self, shape: Shape, spacing: float, layers: int, solid: bool, grid: Grid) -> None:
        super().__init__(shape, spacing, layers, solid, grid)
        self.side = 1.0 if solid else -1.0  # on which fluid is
        self.kept = flagged(grid, None, self._own)

    def _own(self, x: Reals) -> NDArray[np.bool_]:
        off = self.side * signed_distance(self.shape, x, self.depth + self.spacing)
        return taken(off / self.spacing) & (off > -self.depth)

    def near(self, low: NDArray, high: NDArray) -> Found:
        x = self.grid.points(self.grid.unflat(self.kept))
        index = self.kept[np.all((x >= low) & (x < high), axis=1)]
        return index, *self.at(index)

    def at(self, index: NDArray[np.int64]) -> tuple[NDArray, NDArray]:
        x = cleared(self.shape, self.grid.points(self.grid.unflat(index)), self.spacing, -self.side)
        return x, self._normal(x)
