"""Where solids touch: spheres that lie in a body and touch its surface from within, and how far points are from others.

The spheres are about a spacing apart and half of one in radius, those of the outer particles of the body: its corners
are as round as they, which is below what the run resolves. A ball is one sphere. They are held against the surface
itself, whose distance has no kinks outside, so the force of a contact has a potential.
"""

import itertools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sph.case.config import AXES
from sph.case.shapes import Shape
from sph.setup import tanks
from sph.setup.particle_lattices import grid_of
from sph.setup.signed_distance import normals, signed_distance

Reals = NDArray[np.float64]
TOUCHING = 1e-3  # spacings of overlap that rounding of places in a case may make
SLOPE = 1e-3  # of a spacing: over which normals are differences
LAYER = 0.25, 1.25  # depths in spacings of outer particles


def spheres(shape: Shape, spacing: float) -> tuple[Reals, Reals]:
    """Centres[n, d] and radii[n] of the spheres of a body, m."""
    if shape.sphere:
        return np.array([shape.sphere.centre]), np.array([shape.sphere.radius])
    grid = grid_of(shape, spacing)
    x = grid.points(grid.unflat(np.arange(grid.n)))
    depth = -signed_distance(shape, x)
    outer = (depth >= LAYER[0] * spacing) & (depth < LAYER[1] * spacing)
    return x[outer], depth[outer]


def surfaces(wall: Any, x: Reals) -> Iterator[tuple[Reals, Any]]:
    """The surfaces of a wall at rest that spheres at x[n, d] may touch: distances[n] from each, m, infinite where they
    are past its edges, and a function that gives the normals[m, d] there of points x[m, d].
    """
    box, outside = wall.shape.box, wall.section.solid or wall.shape.plane
    if outside or not box:
        step, sign = SLOPE * wall.scene.spacing, 1.0 if outside else -1.0
        yield sign * signed_distance(wall.shape, x), lambda at: sign * normals(wall.shape, at, step)
        return
    thick, over = wall.layers * wall.scene.spacing, np.zeros(len(x), bool)
    if tanks.rims(wall):
        over = tanks.beyond(wall, x, tanks.rims(wall)).max(axis=1) > 0.0
    for face in sorted(wall.closed):
        apart, normal = -tanks.beyond(wall, x, {face})[:, 0], np.zeros(x.shape[1])
        normal[AXES.index(face[0])] = -1.0 if face[1] == "+" else 1.0
        yield np.where(over | (apart < -thick), np.inf, apart), lambda at, n=normal: np.broadcast_to(n, at.shape)


def sides(a: Any, b: Any) -> list[tuple[Any, Any]]:
    """Those of two solids that have spheres, each with the other one."""
    return [(one, other) for one, other in ((a, b), (b, a)) if one.rigid]


def gap(a: Any, b: Any) -> float:
    """Distance of two solids at t = 0, m; below 0: they are in each other."""
    return min((off(one, other) for one, other in sides(a, b)), default=math.inf)


def off(one: Any, other: Any) -> float:
    """How far the spheres of a solid are from another one at t = 0, m."""
    x, radius = spheres(one.shape, one.scene.spacing)
    return min((float((apart - radius).min(initial=math.inf)) for apart, _ in surfaces(other, x)), default=math.inf)


def nearest(solid: Any) -> tuple[float, Any]:
    """How far the nearest other wall that a solid does not touch is from it at t = 0, in spacings, and that wall;
    infinity and None: there is none.
    """
    others = [wall for wall in solid.scene.walls if wall is not solid]
    gaps = [off(solid, wall) / solid.scene.spacing for wall in others]
    apart = [one for one in zip(gaps, others) if one[0] > TOUCHING]
    return min(apart, key=lambda one: one[0], default=(math.inf, None))


def touching(solid: Any) -> list[Any]:
    """The other walls that stay and that a solid touches or goes into."""
    others = [wall for wall in solid.scene.walls if wall is not solid and stays(wall)]
    least = TOUCHING * solid.scene.spacing
    return [wall for wall in others
            if off(solid, wall) <= least or (wall.section.solid and off(wall, solid) <= least)]  # fmt: skip


def stays(wall: Any) -> bool:
    """Whether a wall never moves, as a body does not of which all motions are held."""
    body = wall.section.body
    held = not body or len({*body.held}) == (3 if wall.scene.dimensions == 2 else 6)
    return not wall.moving and held and not (body and any((*body.velocity, *body.angular_velocity)))


def beside_a_film(solid: Any) -> bool:
    """Whether particles of a solid whose force is measured see those of the nearest wall across a film of fluid at
    t = 0, both with the pressure of that.
    """
    if not (solid.section.solid and solid.measure_force and solid.rule.extrapolated):
        return False
    least, other = nearest(solid)
    seen = least < solid.scene.support / solid.scene.spacing - 1.0 - TOUCHING and bool(other.rule.extrapolated)
    return seen and (stays(solid) or not touching(solid))


def solids(walls: list[Any]) -> list[int]:
    """The number of the solid that each wall is of, for `kernels.runs.across_a_film`: 0 of walls that do not press.
    Those that stay and touch are one: no fluid is between them, whose pressure they could have.
    """
    found = [wall.index + 1 if wall.presses else 0 for wall in walls]
    for wall in (wall for wall in walls if wall.presses and stays(wall)):
        one = [wall]
        for member in one:
            if member.section.solid:
                one += [other for other in touching(member) if other not in one]
        for member in one:
            found[member.index] = min(one, key=lambda other: other.index).index + 1
    return found


def pairs(walls: list[Any]) -> list[tuple[Any, Any]]:
    """Solids that may touch: every body and every wall, every two bodies once."""
    return [(a, b) if a.rigid else (b, a) for a, b in itertools.combinations(walls, 2) if a.rigid or b.rigid]
