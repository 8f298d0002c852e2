"""The plane walls that the grains of a scene meet."""

import itertools
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.products import product
from lbmdem.case.config import AXES, LbmDemConfig
from lbmdem.physics.plane_walls import PlaneWall
from lbmdem.setup.scene import Scene


def box_walls(scene: Scene) -> list[PlaneWall]:
    """The sides of the box that are not periodic, then the planes among the obstacles."""
    d, size = scene.dimensions, scene.config.domain.size
    walls = []
    for axis, name in enumerate(AXES[:d]):
        if scene.periodic[axis]:
            continue
        speeds: dict[str, tuple[float, ...]] = {
            face.face: face.velocity for face in scene.config.boundary if face.type == "wall"
        }
        floor = floor_height(scene.config) if axis == d - 1 else 0.0
        for side, place, way in (("-", floor, 1.0), ("+", size[axis], -1.0)):
            point, normal = np.zeros(d), np.zeros(d)
            point[axis], normal[axis] = place, way
            speed, screen = speeds.get(name + side, ()), side == "-" and floor > 0.0
            walls.append(PlaneWall(tuple(point), tuple(normal), speed, film=not screen))
    planes = [(obstacle.shape.plane, obstacle.velocity) for obstacle in scene.config.obstacle]
    return walls + [PlaneWall(plane.point, plane.normal, velocity) for plane, velocity in planes if plane is not None]


def floor_height(config: LbmDemConfig) -> float:
    """Where grains end below along the last axis (m): a screen under the lowest sample that moves, through which the
    fluid passes; 0 where planes among the obstacles keep all grains above it, or a grain of another set starts below.
    """
    low = sample_height(config)
    return 0.0 if cover(config) >= low * (1.0 - 1e-9) or below(config, low) is not None else low


def sample_height(config: LbmDemConfig) -> float:
    """The lowest end (m) of the packings that move, 0 without any."""
    return max(0.0, min((group.packing.low for group in config.grains if group.packing and group.moving), default=0.0))


def below(config: LbmDemConfig, height: float) -> int | None:
    """A set with a grain that starts below this height (m), one that moves if there is one: a screen would throw it
    out, and what stays there is what a sample is to fall on."""
    found = None
    for i, group in enumerate(config.grains):
        if group.packing is not None:
            lowest = group.packing.low
        else:
            own = group.own_diameters
            radius = 0.5 * (group.smallest_diameter if own is None else own)
            lowest = float((np.array(group.centres, np.float64).reshape(-1, config.dimensions)[:, -1] - radius).min())
        if lowest < height * (1.0 - 1e-9) and (found is None or group.moving):
            found = i
    return found


def cover(config: LbmDemConfig) -> float:
    """Height along the last axis (m) that planes among the obstacles let no grain get below, wherever it is."""
    return max([0.0, *(float(heights.min()) for heights in plane_heights(config))])


def plane_heights(config: LbmDemConfig) -> Iterator[NDArray[np.float64]]:
    """Heights (m) of each plane that faces up above the corners of the floor, those within the box somewhere."""
    corners = np.array(list(itertools.product(*((0.0, length) for length in config.domain.size[:-1]))))
    for plane in (obstacle.shape.plane for obstacle in config.obstacle):
        if plane is not None and plane.normal[-1] > 0.0:
            slope = np.array(plane.normal[:-1]) / plane.normal[-1]
            heights = plane.point[-1] - product(corners - np.array(plane.point[:-1]), slope)
            if heights.max() > 0.0:
                yield heights
