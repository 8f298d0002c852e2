"""Fluid that went through a wall."""

import numpy as np
from numpy.typing import NDArray

from sph.particles.storage import Slots, Storage
from sph.particles.walls import Walls
from sph.setup.scene import Wall
from sph.setup.tanks import depth_in_wall, sides


class LeakFinder:
    """Looks for fluid behind walls; `found`: what it says of the first particles seen there."""

    def __init__(self, storage: Storage, walls: Walls) -> None:
        self.storage, self.walls, self.scene = storage, walls, storage.scene
        self.sides = [(wall.index, side) for wall in self.scene.walls for side in sides(wall)]
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
            shift = self.walls.displacement[wall.index]
            near = self._suspects(wall, shift)
            if not len(near):
                continue
            x = storage.physical("x", near)
            lost = np.flatnonzero(depth_in_wall(wall, self.walls.at_rest(wall, x)) > scene.spacing)
            if len(lost):
                place = ", ".join(f"{value:.4g}" for value in x[lost[0]])
                one = f"particle {storage.number(near[lost[0]])} at ({place}) m"
                return f"{len(lost)} particles went through {wall.name}, as {one}"
        return None

    def _suspects(self, wall: Wall, shift: NDArray[np.float64]) -> Slots:
        """Slots of fluid that may be behind a wall: not inside a tank that is a box, nor outside the box of a solid."""
        scene, fluid, box = self.scene, self.storage.fluid_slots, wall.shape.box
        if not box or wall.rigid:
            return fluid
        low, high = (np.array(corner) + shift - scene.low for corner in (box.low, box.high))
        inside = np.ones(len(fluid), bool)
        for axis, physical in enumerate(scene.axes):
            x = self.storage.x[axis, fluid]
            inside &= (x > low[physical]) & (x < high[physical])
        return fluid[inside == wall.section.solid]
