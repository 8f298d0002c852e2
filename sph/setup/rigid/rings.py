"""Particles of round tanks, in layers along their sides: on a lattice they are a rough surface, along which pressure
pushes, and water that turned in a disc that slips lost a tenth of its energy in a fifth of a turn.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.elementary import cos, sin
from hpcpic.core.space.products import product
from sph.setup.particle_lattices import Found, along, even

Reals = NDArray[np.float64]
GOLDEN = math.pi * (3.0 - math.sqrt(5.0))  # between neighbours on a spiral over a sphere


def is_round(wall: Any) -> bool:
    """Whether a wall is a round tank: a disc, a ball, or in 3D a cylinder, that holds fluid."""
    shape = wall.shape
    return not wall.section.solid and bool(shape.sphere or (shape.cylinder and wall.scene.dimensions == 3))


def ring(radius: float, spacing: float, first: float) -> Reals:
    """Unit vectors [n, 2] to points on a circle, about a spacing apart."""
    n = max(1, round(2.0 * math.pi * radius / spacing))
    angle = 2.0 * math.pi * (np.arange(n) + first) / n
    return np.stack([cos(angle), sin(angle)], axis=1)


def ball(radius: float, spacing: float) -> Reals:
    """Unit vectors [n, 3] to points on a sphere, one for the square of a spacing (spiral by the golden angle)."""
    n = max(1, round(4.0 * math.pi * (radius / spacing) ** 2))
    z = 1.0 - (2.0 * np.arange(n) + 1.0) / n
    flat, angle = np.sqrt(1.0 - z * z), GOLDEN * np.arange(n)
    return np.stack([flat * cos(angle), flat * sin(angle), z], axis=1)


class Rings:
    """The layers behind the side of a disc, ball or cylinder that holds fluid."""

    def __init__(self, wall: Any) -> None:
        depths = (np.arange(wall.layers) + 0.5) * wall.scene.spacing
        self.x, self.normal = (round_all_over if wall.shape.sphere else pipe)(wall, depths)

    def near(self, low: Reals, high: Reals) -> Found:
        index = np.flatnonzero(np.all((self.x >= low) & (self.x < high), axis=1))
        return index, *self.at(index)

    def at(self, index: NDArray[np.int64]) -> tuple[Reals, Reals]:
        return self.x[index], self.normal[index]


def round_all_over(wall: Any, depths: Reals) -> tuple[Reals, Reals]:
    """x[n, d] and normals of the particles around a disc or a ball."""
    d, dp, sphere = wall.scene.dimensions, wall.scene.spacing, wall.shape.sphere
    radii = sphere.radius + depths
    out = [ring(radius, dp, 0.5 * k) if d == 2 else ball(radius, dp) for k, radius in enumerate(radii)]
    centre = np.array(sphere.centre)[:d]
    return np.concatenate([centre + radius * to for radius, to in zip(radii, out)]), -np.concatenate(out)


def pipe(wall: Any, depths: Reals) -> tuple[Reals, Reals]:
    """x[n, 3] and normals of the particles around a cylinder; along a periodic axis it has no ends."""
    cylinder, dp, scene = wall.shape.cylinder, wall.scene.spacing, wall.scene
    base, way = np.array(cylinder.base), np.array(cylinder.top) - np.array(cylinder.base)
    length = float(np.sqrt(product(way, way)))
    axis = way / length
    across, ends = along(axis), np.concatenate([-depths[::-1], length + depths])
    if wall.through.any():
        k = int(np.argmax(wall.through))
        base[k], length, ends, axis = scene.low[k], float((scene.high - scene.low)[k]), ends[:0], np.abs(axis)
    x, normal = [], []
    for n, height in enumerate(np.sort(np.concatenate([even(0.0, length, dp), ends]))):
        beyond = max(-height, height - length, 0.0)
        inner = even(0.0, cylinder.radius, dp) if beyond else ends[:0]
        for k, radius in enumerate(np.concatenate([inner, cylinder.radius + depths])):
            to = product(ring(radius, dp, 0.5 * ((n + k) % 2)), across)
            x.append(base + height * axis + radius * to)
            back = max(radius - cylinder.radius, 0.0) * to + (beyond if height > 0.0 else -beyond) * axis
            normal.append(-back / np.sqrt(np.sum(back * back, axis=1))[:, None])
    return np.concatenate(x), np.concatenate(normal)
