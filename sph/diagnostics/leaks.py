"""Fluid that went through a wall."""

import math

import numpy as np
from numpy.typing import NDArray

from sph.case import geometry
from sph.kernels import readings
from sph.particles.storage import Slots, Storage
from sph.particles.walls import Walls
from sph.setup.scene import Wall
from sph.setup.tanks import greatest_depth, lost_in, sides

UNKNOWN, SAFE, NEAR = 0, 1, 2  # of a cell: not asked yet; nobody in it is behind the wall; somebody in it may be
MOST_CELLS = 1 << 26  # bytes of address space; of a wall with more the cells are larger
ROUNDING = 1e-6  # of a spacing


class Cells:
    """Cubes of a spacing in the box around a wall at rest, and what is known of each: no depth changes by more than the
    way from one point to another, so that most cells are safe by the depth of their middles. They are asked when fluid
    first comes into them.
    """

    def __init__(self, wall: Wall) -> None:
        self.wall, dp, d = wall, wall.scene.spacing, wall.scene.dimensions
        low, high = map(np.array, wall.corners if wall.shape.plane else geometry.bounds(wall.shape))
        self.low, self.edge, extent = low, dp, high - low
        while math.prod(np.ceil(extent / self.edge).tolist()) > MOST_CELLS:
            self.edge *= 2.0
        self.counts = np.ceil(extent / self.edge).astype(np.int64).clip(1)
        self.known = np.zeros(math.prod(self.counts.tolist()), np.uint8)
        self.reach = math.sqrt(d) / 2 * self.edge + ROUNDING * dp
        self.solid = wall.section.solid and not wall.shape.plane

    def near(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Which of some cells [n] are not safe; -1, beyond the box, is not."""
        new = np.unique(cells[(cells >= 0) & (self.known[cells] == UNKNOWN)])
        middles = self.low + (np.stack(np.unravel_index(new, tuple(self.counts)), axis=1) + 0.5) * self.edge
        safe = greatest_depth(self.wall, middles) + self.reach <= self.wall.scene.spacing
        self.known[new] = np.where(safe, SAFE, NEAR)
        return (cells < 0) | (self.known[cells] != SAFE)


class LeakFinder:
    """Looks for fluid behind walls; `found`: what it says of the first particles seen there."""

    def __init__(self, storage: Storage, walls: Walls) -> None:
        self.storage, self.walls, self.scene = storage, walls, storage.scene
        self.sides = [(wall.index, side) for wall in self.scene.walls for side in sides(wall)]
        self.cells = [Cells(wall) for wall in self.scene.walls]
        self._room = 256  # for suspects
        self.found: str | None = None

    def look(self, box: list[tuple[float, float]]) -> None:
        """Look for a leak where the fluid, which is in the box (lowest and highest place by axis, m), has passed a
        side of an open tank: it may have gone over its edge.
        """
        if not self.found and any(self._outside(box, *side) for side in self.sides):
            self.found = self.through_wall()

    def _outside(self, box: list[tuple[float, float]], index: int, side: tuple[int, float, float]) -> bool:
        axis, sign, place = side
        shift = sign * self.walls.displacement[index, axis] if self.walls.moving else 0.0
        return bool(sign * box[axis][sign > 0] > place + shift)

    def through_wall(self) -> str | None:
        """What to say of the fluid that is more than a spacing behind a wall now, on this rank; None: there is none."""
        scene, storage = self.scene, self.storage
        for wall in scene.walls:
            near = self.suspects(wall)
            if not len(near):
                continue
            x = storage.physical("x", near)
            lost = np.flatnonzero(lost_in(wall, self.walls.at_rest(wall, x)))
            if len(lost):
                place = ", ".join(f"{value:.4g}" for value in x[lost[0]])
                one = f"particle {storage.number(near[lost[0]])} at ({place}) m"
                return f"{len(lost)} particles went through {wall.name}, as {one}"
        return None

    def suspects(self, wall: Wall) -> Slots:
        """Slots of the fluid that may be behind a wall now."""
        storage, scene, d, known = self.storage, self.scene, self.scene.dimensions, self.cells[wall.index]
        ends = np.concatenate([np.zeros((1, d)), np.eye(d)[list(scene.axes)]])  # of the axes of the storage
        start, *axes = (self.walls.at_rest(wall, scene.low + ends) - known.low) / known.edge
        turn = np.ascontiguousarray(np.transpose(axes - start))
        while True:
            slots, cells = np.empty((2, self._room), np.int64)
            where = known.counts, known.known, known.solid, slots, cells
            n = readings.unsafe(storage.end, storage.flags, storage.x, turn, start, *where)
            if n <= self._room:
                return slots[:n][known.near(cells[:n])]
            self._room = 2 * n
