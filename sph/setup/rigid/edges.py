"""Edges of the walls of a scene, taken together: less solid is around a particle there than in a flat wall."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sph.setup.signed_distance import signed_distance

if TYPE_CHECKING:
    from sph.setup.scene import Scene, Wall

AROUND = {2: 32, 3: 64}  # places around a particle, by dimensions, at the distance of the support
LESS = 0.08  # of them that are not in a wall, beside a flat one; a right angle lacks a quarter


def places(d: int) -> NDArray[np.float64]:
    """Directions [n, d], evenly."""
    n = AROUND[d]
    k = np.arange(n) + 0.5
    if d == 2:
        return np.stack([np.cos(k * (2 * np.pi / n)), np.sin(k * (2 * np.pi / n))], axis=1)
    z, turn = 1 - 2 * k / n, k * (np.pi * (3 - np.sqrt(5)))
    return np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z], axis=1)


def depth(wall: "Wall", x: NDArray[np.float64]) -> NDArray[np.float64]:
    """How deep points x[n, d] are in a wall at t = 0, m; negative where they are not."""
    side = signed_distance(wall.shape, x)
    if wall.section.solid or wall.shape.plane:
        return -side
    for k, axis in enumerate("xyz"[: x.shape[1]]):  # a tank goes on beyond its faces, not where it has none
        low, high = wall.corners[0][k], wall.corners[1][k]
        for face, beyond in ((axis + "-", low - x[:, k]), (axis + "+", x[:, k] - high)):
            if wall.shape.box and face not in wall.closed and not wall.scene.periodic[k]:
                side = np.minimum(side, -beyond)
    return side


def at_edges(scene: "Scene", wall: "Wall", x: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which of the particles x[n, d] of a wall, at t = 0, are near an edge of the walls."""
    reach, around = scene.support, places(x.shape[1])
    inside = np.zeros((len(x), len(around)), bool)
    for other in scene.walls:
        low, high = other.corners if other.section.solid else (-np.inf, np.inf)
        for k, way in enumerate(around):
            there = x + reach * way
            some = np.flatnonzero(np.all((there >= low) & (there <= high), axis=1) & ~inside[:, k])
            if some.size:
                inside[some, k] = depth(other, there[some]) >= 0.0
    sine = np.clip(depth(wall, x) / reach, 0.0, 1.0)
    flat = 0.5 + (np.arcsin(sine) / np.pi if x.shape[1] == 2 else sine / 2)
    return np.mean(inside, axis=1) < flat - LESS
