"""What stays in a fluid, walls of any form and grains that do not move, and where links cross it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.products import product
from lbmdem.fluid.solid_nodes import Window, kernel_axes, kernel_rotation
from lbmdem.kernels.layout import WALL

NODES = 1 << 16  # whose links are found at a time: on the way they are several times as large
_HALVINGS = 53  # of the interval that holds a crossing


@dataclass(frozen=True, slots=True)
class Wall:
    """A solid body given by its signed distance, in nodes, positive in the fluid; it may slide along itself.

    distance(points[n, d]) -> [n]. The wall at a point x moves with velocity + angular_velocity x (x - centre).
    """

    distance: Callable[[NDArray], NDArray]
    velocity: tuple[float, ...] = ()
    angular_velocity: tuple[float, ...] = ()
    centre: tuple[float, ...] = ()

    def speed(self, arm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Velocity [n, 3] of the wall at places [n, 3] from the centre, axes of the kernels."""
        u, w = self.velocity, self.angular_velocity
        moving = np.zeros_like(arm)
        if u:
            moving += kernel_axes([u])
        if w:
            moving += np.cross(kernel_rotation([w])[0], arm)
        return moving


def mark_walls(window: Window, nodes: NDArray[np.int32], walls: Sequence[Wall], dimensions: int) -> None:
    """Nodes of `nodes` (as in Solid) in or on a wall become WALL."""
    flat = nodes.reshape(-1)
    for wall in walls:
        places = np.arange(flat.size)
        flat[wall.distance(coordinates(window, places, dimensions)) <= 0.0] = WALL


def coordinates(window: Window, places: NDArray[np.int64], dimensions: int) -> NDArray[np.float64]:
    """Coordinates [n, d] in the box of the nodes at flat places."""
    nx, rows, _ = window.shape
    local = np.column_stack((places % nx, places // nx % rows, places // (nx * rows))) + window.origin
    return local[:, _axes(dimensions)].astype(np.float64)


def _axes(dimensions: int) -> list[int]:
    return [0, 1, 2] if dimensions == 3 else [0, 2]


@dataclass(frozen=True, slots=True)
class Bodies:
    """What links may end at: grains that stay, then walls. Rows of the sums of momentum in this order."""

    ids: NDArray[np.int64]  # ascending
    centres: NDArray[np.float64]  # [n, 3] (x, row, plane)
    radii: NDArray[np.float64]
    motion: NDArray[np.float64]  # [n, 6] velocity and angular velocity of the surface
    walls: tuple[Wall, ...] = ()

    def __len__(self) -> int:
        return len(self.ids) + len(self.walls)


def ids_at(window: Window, solid: NDArray[np.int32], local: NDArray[np.int64]) -> NDArray[np.int32]:
    """What is at nodes [n, 3] (x, row, plane) of a slab or one beyond it; solid as in `Solid`, ghosts among it."""
    x, row, plane = (local + window.inner[:, 0]).T
    return solid[plane, row, x]


class Crossings(NamedTuple):
    """Links that end at bodies; arrays of three in the order (x, row, plane)."""

    local: NDArray[np.int64]  # [n, 3] node of the slab
    way: NDArray[np.int64]  # direction
    body: NDArray[np.int64]
    q: NDArray[np.float64]  # fraction of the link
    arm: NDArray[np.float64]  # [n, 3] from the centre of the body to the crossing
    speed: NDArray[np.float64]  # [n, 3] of the body there


@dataclass(frozen=True, slots=True)
class Surfaces:
    """Surfaces of bodies, as links of one slab meet them; e[q, 3] in the axes of kernels."""

    window: Window
    solid: NDArray[np.int32]  # as in `Solid`, [planes, rows, x] with ghosts
    bodies: Bodies
    e: NDArray[np.int64]
    dimensions: int

    def crossings(self, nodes: NDArray[np.int64]) -> Crossings:
        """Crossings of the links from nodes [n, 3] that are in none of them."""
        if not len(self.bodies):
            nodes = nodes[:0]
        found = [self._of_direction(i, nodes) for i in range(1, len(self.e))]
        return Crossings(*(np.concatenate(column) for column in zip(*found)))

    def _of_direction(self, i: int, nodes: NDArray) -> tuple[NDArray, ...]:
        """Crossings of one direction."""
        e, bodies = self.e[i], self.bodies
        beyond = ids_at(self.window, self.solid, nodes + e)
        grain = np.isin(beyond, bodies.ids)
        parts = [self._at_grains(nodes[grain], np.searchsorted(bodies.ids, beyond[grain]), e)]
        parts += self._at_walls(nodes[beyond == WALL], e)
        local, body, q, arm, speed = (np.concatenate(column) for column in zip(*parts))
        return local, np.full(len(local), i), body, q, arm, speed

    def _at_grains(self, local: NDArray, at: NDArray, e: NDArray) -> tuple[NDArray, ...]:
        """Crossings with grains that do not move; distances in the frame of the grain, of its nearest image."""
        window, bodies = self.window, self.bodies
        node = local + window.inner[:, 0] + window.origin
        turns = np.where(window.periodic, np.rint((node + e - bodies.centres[at]) / window.points), 0).astype(np.int64)
        d = (node - turns * window.points) - bodies.centres[at]
        d_sq = np.sum(d * d, axis=1) - bodies.radii[at] ** 2
        along, e_sq = product(d, e), float(e @ e)
        q = np.clip((-along - np.sqrt(np.maximum(along * along - e_sq * d_sq, 0.0))) / e_sq, 0.0, 1.0)
        arm = d + q[:, None] * e
        motion = bodies.motion[at]
        return local, at, q, arm, motion[:, :3] + np.cross(motion[:, 3:], arm)

    def _at_walls(self, local: NDArray, e: NDArray) -> list[tuple[NDArray, NDArray, NDArray, NDArray, NDArray]]:
        """Crossings with the first wall that each link meets; links to walls of other kinds are left to the sweep."""
        axes = _axes(self.dimensions)
        x = (local + self.window.inner[:, 0] + self.window.origin)[:, axes].astype(np.float64)
        fractions = [_crossing(wall.distance, x, e[axes]) for wall in self.bodies.walls]
        parts = []
        for number, (wall, fraction) in enumerate(zip(self.bodies.walls, fractions)):
            mine = (np.argmin(fractions, axis=0) == number) & np.isfinite(fraction)
            q = fraction[mine]
            centre = np.asarray(wall.centre) if wall.centre else np.zeros(len(axes))
            arm = kernel_axes(x[mine] + q[:, None] * e[axes] - centre)
            body = np.full(len(q), len(self.bodies.ids) + number)
            parts.append((local[mine], body, q, arm, wall.speed(arm)))
        return parts


def _crossing(distance: Callable[[NDArray], NDArray], x: NDArray, e: NDArray) -> NDArray[np.float64]:
    """Fraction of the way from x[n, d] to x + e where a wall is met, by halving; infinite where it is not."""
    low, high = np.zeros(len(x)), np.ones(len(x))
    meets = distance(x + e) <= 0.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        inside = distance(x + middle[:, None] * e) <= 0.0
        low, high = np.where(inside, low, middle), np.where(inside, middle, high)
    return np.where(meets, high, np.inf)
