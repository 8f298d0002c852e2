"""Walls while the run goes: particles made where the fluid comes, and their motion."""

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.errors import Diverged
from hpcpic.core.space.products import product
from sph.kernels.marks import EDGE, EXTRAPOLATED, NORMAL, REAL, REPULSIVE, SLIPS, SOLID, WALL_BITS
from sph.particles.slabs import Slabs
from sph.particles.storage import Storage
from sph.particles.tasks import Tasks
from sph.setup.particle_lattices import whole_steps
from sph.setup.rigid.edges import at_edges
from sph.setup.rigid.rims import fastest_point
from sph.setup.rigid.surfaces import solids
from sph.setup.scene import AHEAD, Scene, Wall

Corners = tuple[NDArray[np.float64], NDArray[np.float64]]


def shell(inner: Corners | None, outer: Corners) -> Iterator[Corners]:
    """Disjoint boxes that fill `outer` without `inner`, which lies in it."""
    if inner is None:
        yield outer
        return
    low, high = outer[0].copy(), outer[1].copy()
    for axis in range(len(low)):
        for a, b in ((low[axis], inner[0][axis]), (inner[1][axis], high[axis])):
            if a < b:
                part = low.copy(), high.copy()
                part[0][axis], part[1][axis] = a, b
                yield part
        low[axis], high[axis] = inner[0][axis], inner[1][axis]


class Walls:
    """The walls of a scene at the present time: displacement[wall, d] m, velocity[wall, d] m/s and
    acceleration[wall, d] m/s2, in physical axes; `made`: the box in which the particles of a wall exist, at
    displacement 0; measured[wall]: its force is. taken_back[wall, d] m: how far the particles of a plane stay behind
    it, so that it never ends.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.walls: list[Wall] = [wall for wall in scene.walls if not wall.rule.images]
        self.made: dict[int, Corners] = {}
        self.moving = any(wall.moving for wall in scene.walls)
        self.measured = np.array([wall.measure_force for wall in scene.walls], bool)
        self._solids = solids(scene.walls)
        self.displacement = np.zeros((len(scene.walls), scene.dimensions))
        self.velocity, self.acceleration, self.taken_back = np.zeros((3, len(scene.walls), scene.dimensions))
        self.turns: dict[int, Corners] = {}  # of rigid bodies: centre at t = 0 and matrix
        self.spin = np.zeros((len(scene.walls), 3))  # of rigid bodies, 1/s
        self.move(0.0)

    def move(self, t: float) -> tuple[NDArray, NDArray]:
        """Shift since the last call and velocity of each wall [walls, d] at time t."""
        before = self.displacement.copy()
        for wall in self.scene.walls:
            if wall.rigid:
                continue  # see Bodies
            k = wall.index
            self.displacement[k], self.velocity[k], self.acceleration[k] = wall.motion(t)
        return self.displacement - before, self.velocity

    def at_rest(self, wall: Wall, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where points x[n, d] would be if they had gone back with a wall to where it was at t = 0, [n, d] m."""
        x = x - self.displacement[wall.index]
        if wall.index not in self.turns:
            return x
        centre, turn = self.turns[wall.index]
        return centre + product(x - centre, turn)

    def now(self, wall: Wall, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where points x[n, d] m of a wall at t = 0 are now: the inverse of `at_rest`."""
        if wall.index in self.turns:
            centre, turn = self.turns[wall.index]
            x = centre + product(x - centre, turn.T)
        return x + self.displacement[wall.index]

    def middle(self, wall: Wall) -> NDArray[np.float64]:
        """The middle [d] of the box around a wall now; of a body, its centre of mass, m."""
        at = wall.rigid.centre[: self.scene.dimensions] if wall.rigid else (wall.corners[0] + wall.corners[1]) / 2
        return at + self.displacement[wall.index]

    def fastest(self) -> float:
        """Largest speed of any point of a wall now, m/s."""
        speeds = [0.0, *np.sqrt(np.sum(self.velocity**2, axis=1)).tolist()]
        for wall in self.scene.walls:
            if wall.rigid:  # in the frame of the body, where its shape is that of t = 0
                turn, d = np.eye(3), self.scene.dimensions
                turn[:d, :d] = self.turns[wall.index][1]
                velocity = np.pad(self.velocity[wall.index], (0, 3 - d))
                moves = product(velocity, turn), product(self.spin[wall.index], turn)
                speeds.append(fastest_point(wall.section.shape, wall.rigid.centre, *moves))
        return max(speeds)

    def take_back(self, storage: Storage) -> None:
        """Put the particles of planes that slide along themselves back by whole spacings, where others have been."""
        for wall in self.walls:
            if wall.moving and wall.shape.plane:
                now = whole_steps(wall, self.displacement[wall.index])
                back = now - self.taken_back[wall.index]
                if back.any():
                    own = storage.own_slots[storage.own_values("wall") == wall.index + 1]
                    storage.x[:, own] -= back[list(self.scene.axes), None]
                    self.taken_back[wall.index] = now

    def _boxes_to_make(self, low: NDArray, high: NDArray) -> list[tuple[Wall, Corners]]:
        """Boxes where walls are to be made, for fluid in the box (low, high); in the frame of the wall at rest."""
        found, scene, support = [], self.scene, self.scene.support
        for wall in self.walls:
            limits, made = wall.bounds, self.made.get(wall.index)
            shift = self.displacement[wall.index] - self.taken_back[wall.index]
            if wall.rigid:  # whole, before it moves
                found += [] if made else [(wall, limits)]
                self.made[wall.index] = limits
                continue
            beyond = (low - shift - support < scene.low) | (high - shift + support > scene.high)
            around = np.where(beyond & scene.periodic, np.inf, 0.0)  # through a side the fluid is near any part
            first, last = low - shift - around, high - shift + around
            needed = np.maximum(first - support, limits[0]), np.minimum(last + support, limits[1])
            if np.any(needed[0] >= needed[1]):
                continue
            if made and np.all(made[0] <= needed[0]) and np.all(made[1] >= needed[1]):
                continue
            outer = first - AHEAD * support, last + AHEAD * support
            if made:
                outer = np.minimum(outer[0], made[0]), np.maximum(outer[1], made[1])
            outer = np.maximum(outer[0], limits[0]), np.minimum(outer[1], limits[1])
            found += [(wall, part) for part in shell(made, outer)]
            self.made[wall.index] = outer
        return found

    def boxes(self) -> NDArray[np.float64]:
        """Where walls are made, for a checkpoint: [walls, 2, d], not a number where nothing is."""
        boxes = np.full((len(self.scene.walls), 2, self.scene.dimensions), np.nan)
        for index, corners in self.made.items():
            boxes[index] = corners
        return boxes

    def restore(self, boxes: NDArray[np.float64], t: float) -> None:
        """Take the boxes of a checkpoint at time t. Raises Diverged for a box that is not of numbers throughout."""
        nothing = np.array([np.isnan(box).all() for box in boxes], bool)
        if not np.isfinite(boxes[~nothing]).all():
            raise Diverged("the box where a wall is made is not of finite numbers")
        self.made = {k: (box[0], box[1]) for k, box in enumerate(boxes) if not nothing[k]}
        self.move(t)
        for wall in self.walls:
            self.taken_back[wall.index] = whole_steps(wall, self.displacement[wall.index])

    def grow(self, box: Corners, storage: Storage, slabs: Slabs) -> None:
        """Make wall particles where the fluid, which is in the box now, will be soon."""
        scene, axes = self.scene, list(self.scene.axes)
        self.take_back(storage)
        ahead = 0.5 * scene.support  # more than it moves in a step
        for wall, part in self._boxes_to_make(box[0] - ahead, box[1] + ahead):
            ids, x, _ = wall.near(*part)
            drho = scene.rest_density(x) if wall.rule.layered else np.zeros(len(x))
            x = (x + self.displacement[wall.index] - self.taken_back[wall.index])[:, axes] - scene.low[axes]
            mine = np.flatnonzero(slabs.owner[slabs.grid.layer(x[:, 0])] == slabs.world.rank)
            self.add(storage, ids[mine], x[mine].T, drho[mine])

    def add(self, storage: Storage, ids: NDArray[np.int64], x: NDArray, drho: NDArray) -> None:
        """Append wall particles: x[d, n] m and drho[n] kg/m3 as the storage has them."""
        index, scene = (ids >> WALL_BITS) - 1, self.scene
        rules = [wall.rule for wall in scene.walls]
        kinds = np.array(
            [REAL | REPULSIVE * r.repulsive | EXTRAPOLATED * r.extrapolated | SLIPS * r.slips for r in rules]
        )
        kinds |= [number << SOLID for number in self._solids]
        mass = np.full(len(ids), scene.rho0 * scene.spacing**scene.dimensions)
        v = self.velocity[index][:, list(scene.axes)].T
        flags = kinds[index] | scene.normal_of(ids) << NORMAL
        for wall in self.walls:
            if wall.rule.has_edges(bool(wall.rigid), scene.liquids):
                own = np.flatnonzero(index == wall.index)
                flags[own] |= EDGE * at_edges(scene, wall, wall.at(ids[own])[0])
        storage.append(x, v, drho, mass, ids, flags)

    def carry(self, time: float, tasks: Tasks, carry: Callable) -> None:
        """Move the wall particles to where their walls are at `time`, by the kernel `carry`."""
        if self.moving:
            shift, speed = self.move(time)
            tasks.arena["wall_shift"][:] = shift[:, list(self.scene.axes)]
            tasks.arena["wall_speed"][:] = speed[:, list(self.scene.axes)]
            tasks.each(carry)
