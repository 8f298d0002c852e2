"""What takes particles away from the lattice of a fluid: sides of the domain, inlets, walls, bodies, earlier fluids."""

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sph.case import geometry
from sph.case.shapes import Shape
from sph.setup.particle_lattices import Box, Grid, Test
from sph.setup.rigid import fit
from sph.setup.signed_distance import signed_distance
from sph.setup.tanks import behind, depth_in

NEAR = 0.25  # of a spacing: fluid nearer to a solid is taken away
HELD = 0.4  # of a spacing: fluid that a body moves nearer to another solid is in a core of it, and would be thrown off
DOMAIN = "the domain"  # as what takes particles away


def obstacles(scene: Any, grid: Grid, step: float) -> Iterator[tuple[str, Box, Test]]:
    """Name, box in which it takes particles away (None: everywhere), test of points x[n, d] of the grid, which are
    `step` m from each other where they are nearest.
    """
    if not grid.n:
        return
    ends = np.array([(c[0], c[-1]) for c in grid.coordinates])
    if np.any(ends[:, 0] < scene.low) or np.any(ends[:, 1] > scene.high):
        yield DOMAIN, None, lambda x: np.any((x < scene.low) | (x > scene.high), axis=1)
    yield from ((one.name, (one.low, one.high), lambda x: np.ones(len(x), bool)) for one in scene.inlets)
    margin = NEAR * scene.spacing
    for wall in scene.walls:
        if fit.fits(wall):
            yield wall.name, fit.around(wall), partial(fit.taken_by, wall, step)
            yield wall.name, fit.around(wall), partial(squeezed, wall, ends, step)
        elif wall.section.solid or wall.shape.plane or cuts(wall, ends):
            yield wall.name, fit.around(wall), partial(too_near, wall, ends, margin)
    for fluid in scene.fluids:
        shape = fluid.section.shape
        low, high = map(np.array, geometry.bounds(shape))
        yield fluid.section.name, (low, high), partial(_within, shape)


def _within(shape: Shape, x: NDArray) -> NDArray[np.bool_]:
    return signed_distance(shape, x) <= 0.0


def cuts(wall: Any, ends: NDArray) -> bool:
    """True where a fluid between ends[d, 2] does not lie in a tank whole."""
    low, high = map(np.array, geometry.bounds(wall.shape))
    return bool(not wall.shape.box or np.any(ends[:, 0] < low) or np.any(ends[:, 1] > high))


def too_near(wall: Any, ends: NDArray, margin: float, x: NDArray) -> NDArray[np.bool_]:
    """Which points x[n, d] of a fluid between ends[d, 2] are in a wall, or nearer to it than a margin, m."""
    if wall.section.solid or wall.shape.plane:
        return signed_distance(wall.shape, x, margin) < margin
    low, high = map(np.array, geometry.bounds(wall.shape))
    apart = wall.shape.box and (np.any(ends[:, 1] < low) or np.any(ends[:, 0] > high))
    depth = depth_in if apart else behind  # what lies beside a tank is not its own
    return depth(wall, x) > -margin


def squeezed(one: Any, ends: NDArray, step: float, x: NDArray) -> NDArray[np.bool_]:
    """Which points x[n, d] that a wall moves come out of the domain or to another solid, when all have moved them."""
    scene, found = one.scene, np.zeros(len(x), bool)
    moved = np.flatnonzero(np.any(fit.beside([one], x, step) != x, axis=1))
    places = fit.beside(scene.walls, x[moved], step)
    found[moved] = np.any((places < scene.low) | (places > scene.high), axis=1)
    for wall in scene.walls:
        found[moved] |= too_near(wall, ends, HELD * scene.spacing, places)
    return found
