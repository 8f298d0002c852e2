"""Particles of round walls, in layers along their sides: on a lattice they are a rough surface, along which pressure
pushes, and water that turned in a disc that slips lost a tenth of its energy in a fifth of a turn.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.elementary import cos, sin
from hpcpic.core.space.products import product
from sph.setup.particle_lattices import Found, along, even
from sph.setup.rigid.fit import outward

Reals = NDArray[np.float64]
GOLDEN = math.pi * (3.0 - math.sqrt(5.0))  # between neighbours on a spiral over a sphere


def is_round(wall: Any) -> bool:
    """True for a disc, a ball, or in 3D a cylinder, around fluid or solid."""
    return bool(wall.shape.sphere or (wall.shape.cylinder and wall.scene.dimensions == 3))


def ring(radius: float, spacing: float, first: float) -> Reals:
    """Unit vectors [n, 2] to points on a circle, about a spacing apart; they are their own mirror image, n being even,
    unless they are a few around the middle.
    """
    half = math.pi * radius / spacing
    n = 2 * round(half) if half > 4.0 else max(1, round(2.0 * half))
    angle = 2.0 * math.pi * (np.arange(n) + first) / n
    return np.stack([cos(angle), sin(angle)], axis=1)


def ball(radius: float, spacing: float) -> Reals:
    """Unit vectors [n, 3] to points on a sphere, one for the square of a spacing (spiral by the golden angle)."""
    n = max(1, round(4.0 * math.pi * (radius / spacing) ** 2))
    z = 1.0 - (2.0 * np.arange(n) + 1.0) / n
    flat, angle = np.sqrt(1.0 - z * z), GOLDEN * np.arange(n)
    return np.stack([flat * cos(angle), flat * sin(angle), z], axis=1)


class Rings:
    """The layers behind the side of a disc, ball or cylinder: around the fluid that it holds, or within a solid."""

    def __init__(self, wall: Any) -> None:
        depths = (np.arange(wall.layers) + 0.5) * wall.scene.spacing
        self.x, self.normal = (round_all_over if wall.shape.sphere else pipe)(wall, depths)

    def near(self, low: Reals, high: Reals) -> Found:
        index = np.flatnonzero(np.all((self.x >= low) & (self.x < high), axis=1))
        return index, *self.at(index)

    def at(self, index: NDArray[np.int64]) -> tuple[Reals, Reals]:
        return self.x[index], self.normal[index]


def round_all_over(wall: Any, depths: Reals) -> tuple[Reals, Reals]:
    """x[n, d] and normals of the particles of a disc or a ball, or of those around one."""
    d, dp, sphere = wall.scene.dimensions, wall.scene.spacing, wall.shape.sphere
    side = outward(wall)
    radii = sphere.radius - side * depths
    radii = radii[radii > 0.0]
    out = [ring(radius, dp, 0.5 * (k % 2)) if d == 2 else ball(radius, dp) for k, radius in enumerate(radii)]
    centre = np.array(sphere.centre)[:d]
    return np.concatenate([centre + radius * to for radius, to in zip(radii, out)]), side * np.concatenate(out)


def pipe(wall: Any, depths: Reals) -> tuple[Reals, Reals]:
    """x[n, 3] and normals of the particles of a cylinder, or of those around one; a periodic axis leaves no ends."""
    cylinder, dp, scene, side = wall.shape.cylinder, wall.scene.spacing, wall.scene, outward(wall)
    radius, base, way = cylinder.radius, np.array(cylinder.base), np.array(cylinder.top) - np.array(cylinder.base)
    length = float(np.sqrt(product(way, way)))
    axis, endless = way / length, bool(wall.through.any())
    across = along(axis)
    if endless:
        k = int(np.argmax(wall.through))
        base[k], length, axis = scene.low[k], float((scene.high - scene.low)[k]), np.abs(axis)
    heights, inner = even(0.0, length, dp), even(0.0, radius, dp)
    if side > 0.0:
        inner = radius - (np.arange(len(depths), math.ceil(radius / dp)) + 0.5) * dp
    elif not endless:
        heights = np.concatenate([-depths[::-1], heights, length + depths])
    x, normal = [], []
    for n, height in enumerate(heights):
        past, up = max(-height, height - length), math.copysign(1.0, height - 0.5 * length)  # of the nearer end
        full = not endless and past > (-len(depths) * dp if side > 0.0 else 0.0)
        radii = np.concatenate([inner if full else inner[:0], radius - side * depths])
        for k, r in enumerate(radii[radii > 0.0]):
            to = product(ring(r, dp, 0.5 * ((n + k) % 2)), across)
            x.append(base + height * axis + r * to)
            if side > 0.0:  # from the nearer of side and end
                out, on = (1.0, 0.0) if endless or radius - r <= -past else (0.0, 1.0)
            else:
                out, on = max(r - radius, 0.0), max(past, 0.0)
            back = out * to + on * up * axis
            normal.append(side * back / np.sqrt(np.sum(back * back, axis=1))[:, None])
    return np.concatenate(x), np.concatenate(normal)
