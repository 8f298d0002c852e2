"""Walls while the run goes: particles made where the fluid comes, their motion, and the force of the fluid on them."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.world import World
from hpcpic.core.errors import Diverged
from hpcpic.core.space.exact import LIMBS, add_limbs, power_of_two_above, value
from sph.kernels.marks import NORMAL, REAL, REPULSIVE, WALL_BITS
from sph.setup.scene import AHEAD
from sph.setup.signed_distance import signed_distance
from sph.setup.tanks import depth_in

if TYPE_CHECKING:
    from sph.setup.scene import Scene, Wall
    from sph.step import Sph

WALL_FLAGS = {"pressure-continuity": REAL, "repulsive": REAL | REPULSIVE}  # of walls made of particles
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
    """The walls made of particles; boxes and positions in physical axes."""

    def __init__(self, scene: "Scene", world: World) -> None:
        self.scene, self.world = scene, world
        self.walls: list[Wall] = [wall for wall in scene.walls if wall.type in WALL_FLAGS]
        self.made: dict[int, Corners] = {}
        self.moving = any(wall.moving for wall in scene.walls)
        self.displacement = np.zeros((len(scene.walls), scene.dimensions))
        self.velocity = np.zeros((len(scene.walls), scene.dimensions))
        self.move(0.0)

    def move(self, t: float) -> tuple[NDArray, NDArray]:
        """Shift since the last call and velocity of each wall [walls, d] at time t."""
        before = self.displacement.copy()
        for wall in self.scene.walls:
            self.displacement[wall.index], self.velocity[wall.index] = wall.motion(t)
        return self.displacement - before, self.velocity

    def grow(self, low: NDArray, high: NDArray) -> list[tuple["Wall", Corners]]:
        """Boxes where walls are to be made, for fluid in the box (low, high); in the frame of the wall at rest."""
        found, scene, support = [], self.scene, self.scene.support
        for wall in self.walls:
            shift, limits = self.displacement[wall.index], wall.bounds
            beyond = (low - shift - support < scene.low) | (high - shift + support > scene.high)
            around = np.where(beyond & scene.periodic, np.inf, 0.0)  # through a side the fluid is near any part
            first, last = low - shift - around, high - shift + around
            needed = np.maximum(first - support, limits[0]), np.minimum(last + support, limits[1])
            made = self.made.get(wall.index)
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
        """Made are the walls whose boxes are numbers. Diverged for a box that is one in part."""
        nothing = np.isnan(boxes).all(axis=(1, 2))
        if not np.isfinite(boxes[~nothing]).all():
            raise Diverged("the box where a wall is made is not of finite numbers")
        self.made = {k: (box[0], box[1]) for k, box in enumerate(boxes) if not nothing[k]}
        self.move(t)


def grow_walls(engine: "Sph") -> None:
    """Make wall particles where the fluid will be soon."""
    ahead = 0.5 * engine.scene.support  # more than it moves in a step
    for wall, part in engine.walls.grow(engine.box[0] - ahead, engine.box[1] + ahead):
        ids, x, _ = wall.near(*part)
        drho = engine.scene.rest_density(x) if wall.type == "pressure-continuity" else np.zeros(len(x))
        x = (x + engine.walls.displacement[wall.index])[:, engine.axes] - engine.origin
        mine = np.flatnonzero(engine.slabs.owner[engine.grid.layer(x[:, 0])] == engine.world.rank)
        add_walls(engine, ids[mine], x[mine].T, drho[mine])


def add_walls(engine: "Sph", ids: NDArray, x: NDArray, drho: NDArray) -> None:
    """Append wall particles, x[d, n] in storage axes."""
    index, scene = (ids >> WALL_BITS) - 1, engine.scene
    kinds = np.array([WALL_FLAGS.get(wall.type, REAL) for wall in scene.walls])
    mass = np.full(len(ids), scene.rho0 * scene.spacing**scene.dimensions)
    v = engine.walls.velocity[index][:, engine.axes].T
    engine.bodies.append(x, v, drho, mass, ids, kinds[index] | scene.normal_of(ids) << NORMAL)


def exact_sums(world: World, groups: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """[group, k]: sums over all ranks of groups[group][k, n]; the same bits for any ranks. Collective."""
    scale = power_of_two_above(world.max(max(float(np.abs(values).max(initial=0.0)) for values in groups)))
    limbs = np.zeros((len(groups), len(groups[0]), LIMBS), np.int64)
    for own, values in zip(limbs, groups):
        for line, terms in zip(own, values):
            add_limbs(line, terms, 1.0 / scale)
    total = world.sum_int(limbs)
    return np.array([[value(line, scale) for line in lines] for lines in total])


def wall_forces(engine: "Sph") -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Force [d] in N (2D: N/m) and torque [3] about `torque_about` of the fluid on each measured wall. Collective."""
    engine.current_forces()
    bodies, d = engine.bodies, engine.scene.dimensions
    measured = [wall for wall in engine.scene.walls if wall.measure_force]
    slots, of = bodies.of_walls(np.array([wall.measure_force for wall in engine.scene.walls], bool))
    low, high = engine.domain.row_range(engine.world.rank)
    layer = engine.grid.layer(bodies.x[0, slots])
    here = (layer >= low) & (layer < high)  # images in this slab's layers hold what they do to this slab
    groups = []
    for wall in measured:
        own = slots[here & (of == wall.index)]
        force, arm = np.zeros((3, len(own))), np.zeros((3, len(own)))
        force[engine.axes] = engine.sums.forces_on(own)
        centre = wall.torque_about + engine.walls.displacement[wall.index] - engine.scene.low
        arm[engine.axes] = bodies.x[:, own] - centre[engine.axes, None]
        (x, y, z), (fx, fy, fz) = arm, force
        groups.append(np.concatenate([force, [y * fz - z * fy, z * fx - x * fz, x * fy - y * fx]]))
    sums = exact_sums(engine.world, groups) if groups else []
    return {wall.name: (total[:d], total[3:]) for wall, total in zip(measured, sums)}


def through_wall(engine: "Sph", fluid: NDArray[np.int64]) -> str | None:
    """A word on a particle of the fluid (their rows) that is more than a spacing behind a wall."""
    scene, bodies = engine.scene, engine.bodies
    for wall in scene.walls:
        shape, shift = wall.shape, engine.walls.displacement[wall.index]
        near = _suspects(engine, wall, fluid, shift)
        if not len(near):
            continue
        x = np.empty((len(near), scene.dimensions))
        x[:, engine.axes] = (bodies.x[:, near] + engine.origin[:, None]).T
        at = x - shift
        if wall.section.solid or shape.plane:
            depth = -signed_distance(shape, at)
        else:
            depth = depth_in(wall, at)
        lost = np.flatnonzero(depth > scene.spacing)
        if len(lost):
            place = ", ".join(f"{value:.4g}" for value in x[lost[0]])
            one = f"particle {bodies.number(near[lost[0]])} at ({place}) m"
            return f"{len(lost)} particles went through {wall.name}, as {one}"
    return None


def _suspects(engine: "Sph", wall: "Wall", fluid: NDArray[np.int64], shift: NDArray) -> NDArray[np.int64]:
    """Those of the fluid that may be behind a wall: not inside a tank that is a box, nor outside the box of a solid."""
    shape = wall.shape
    if not shape.box:
        return fluid
    low, high = (np.array(corner) + shift - engine.scene.low for corner in (shape.box.low, shape.box.high))
    inside = np.ones(len(fluid), bool)
    for axis, physical in enumerate(engine.axes):
        x = engine.bodies.x[axis, fluid]
        inside &= (x > low[physical]) & (x < high[physical])
    return fluid[inside == wall.section.solid]
