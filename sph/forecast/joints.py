"""Walls that meet only along an edge: beyond it there is no wall, and fluid is pressed out between the particles beside
it, which are 1.4 spacings from each other.
"""

import itertools
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.case.derived import Derived
from sph.case import geometry
from sph.case.config import AXES
from sph.setup.scene import Scene, Wall
from sph.setup.tanks import depth_in_wall, rims

OVERLAP = 1.0  # spacings that hold water; so did half a spacing, and none lost a quarter of a tank in 3 s (measured)
RADIUS = 0.5  # spacings, of a circle around a point of an edge
AROUND = 64  # places on that circle
WIDE = AROUND / 6  # of a sector that is no slot between walls; so an overlap of up to a quarter of a spacing is none
ALONG = 8  # points of an edge
SIGHT = 0.25  # spacings beside a wall that fluid does not see through: an edge where walls touch is no gap


def joints(scene: Scene) -> Iterator[Derived]:
    """A row for each pair of walls at rest, one of them a box, that meet only along an edge and let fluid out there."""
    walls = [wall for wall in scene.walls if wall.rule.extrapolated and not wall.moving and not wall.rigid]
    told = set()
    for wall in (wall for wall in walls if wall.shape.box):
        for point, plane in edges(wall):
            other = touching(walls, wall, point)
            pair = other and frozenset((wall.index, other.index))
            if other and pair not in told and leaks(scene, point, plane):
                told.add(pair)
                yield Derived(f"overlap of {wall.name} and {other.name}, which meet only at an edge", "", 0.0, "m",
                              f">= {OVERLAP * scene.spacing:g}", "warn", "fluid runs out there",
                              f"carry one on beyond the edge by {OVERLAP * scene.spacing:g} m",
                              ("wall", wall.index, "shape"))  # fmt: skip


def edges(wall: Wall) -> Iterator[tuple[NDArray[np.float64], tuple[int, int]]]:
    """Points [d] of the edges of a box, and the axes across: where a solid has two faces, a tank has one and an end."""
    (low, high), ends = wall.corners, rims(wall)
    for a, b in itertools.combinations(range(wall.scene.dimensions), 2):
        for one, other in itertools.product("-+", repeat=2):
            faces = {AXES[a] + one, AXES[b] + other}
            if not (faces <= wall.closed if wall.section.solid else faces & ends and faces & wall.closed):
                continue
            for part in (np.arange(ALONG) + 0.5) / ALONG if len(low) == 3 else (0.5,):
                point = low + part * (high - low)
                point[a], point[b] = (high if one == "+" else low)[a], (high if other == "+" else low)[b]
                yield point, (a, b)


def touching(walls: list[Wall], wall: Wall, point: NDArray[np.float64]) -> Wall | None:
    """The first other wall of which the surface is within the circle around a point."""
    reach, others = RADIUS * wall.scene.spacing, (other for other in walls if other is not wall)
    return next((other for other in others if abs(depth_in_wall(other, point[None])[0]) < reach), None)


def leaks(scene: Scene, point: NDArray[np.float64], axes: tuple[int, int]) -> bool:
    """If no wall is in two or more sectors of a small circle around a point of an edge, across it, and a fluid, or what
    flows in, sees some of them and not all.
    """
    turn = (np.arange(AROUND) + 0.5) * (2 * np.pi / AROUND)
    circle = np.tile(point, (AROUND, 1))
    circle[:, axes] += RADIUS * scene.spacing * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    free = ~walled(scene, circle, 0.0)
    starts = np.flatnonzero(free & ~np.roll(free, 1))
    sectors = [np.roll(circle, -start, axis=0)[: int(np.argmin(np.roll(free, -start)))] for start in starts]
    sectors = [sector for sector in sectors if len(sector) >= WIDE]
    if len(sectors) < 2:
        return False
    waters = [geometry.bounds(fluid.shape) for fluid in scene.config.fluid]
    waters += [(inlet.low, inlet.high) for inlet in scene.config.inlet]
    for low, high in waters:
        seen = [any(sees(scene, place, np.array(low), np.array(high)) for place in sector) for sector in sectors]
        if any(seen) and not all(seen):
            return True
    return False


def sees(scene: Scene, place: NDArray[np.float64], low: NDArray[np.float64], high: NDArray[np.float64]) -> bool:
    """If nothing is between a place and the nearest particle of a fluid in the box from low to high."""
    half = np.minimum(scene.spacing, high - low) / 2
    way = np.clip(place, low + half, high - half) - place
    steps = int(np.linalg.norm(way) / (SIGHT * scene.spacing)) + 2
    return not walled(scene, place + np.linspace(0.0, 1.0, steps)[:, None] * way, SIGHT * scene.spacing).any()


def walled(scene: Scene, x: NDArray[np.float64], beside: float) -> NDArray[np.bool_]:
    """Which points x[n, d] are in a wall, or so many m beside one."""
    return np.any([depth_in_wall(wall, x) > -beside for wall in scene.walls], axis=0)
