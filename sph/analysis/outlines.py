"""Lines that show the walls of a scene at a time: in 2D all that are no rigid bodies, in 3D the tanks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sph.analysis import render
from sph.case import geometry

if TYPE_CHECKING:
    from sph.case.config import Wall as WallSection
    from sph.setup.scene import Wall

Line = NDArray[np.float64]
ROUND = 97  # points of a circle
ALONG = 33  # points of a straight line that may leave what is shown


def is_body(wall: WallSection) -> bool:
    return wall.body is not None


def in_plane(walls: Sequence[Wall], t: float, low: NDArray, high: NDArray) -> list[Line]:
    """The surfaces of the walls of a 2D scene at time t, lines[2, n]; planes as far as what is shown, low to high."""
    found: list[Line] = []
    for wall in walls:
        shape, moved = wall.section.shape, wall.motion(t)[0]
        if is_body(wall.section):
            continue
        if shape.box:
            (x0, y0), (x1, y1) = geometry.bounds(shape)
            faces = {"x-": ([x0, x0], [y0, y1]), "x+": ([x1, x1], [y0, y1])}
            faces |= {"y-": ([x0, x1], [y0, y0]), "y+": ([x0, x1], [y1, y1])}
            lines = [np.array(faces[face]) for face in sorted(wall.closed)]
        elif shape.sphere:
            angle = np.linspace(0.0, 2.0 * np.pi, ROUND)
            middle = np.array(shape.sphere.centre)[:, None]
            lines = [middle + shape.sphere.radius * np.stack([np.cos(angle), np.sin(angle)])]
        elif shape.cylinder:
            base, top = np.array(shape.cylinder.base), np.array(shape.cylinder.top)
            along = (top - base) / np.linalg.norm(top - base)
            side = shape.cylinder.radius * np.array([-along[1], along[0]])
            lines = [np.stack([base - side, base + side, top + side, top - side, base - side], axis=1)]
        elif shape.polygon:
            lines = [np.array([*shape.polygon.corners, shape.polygon.corners[0]]).T]
        elif shape.plane:
            normal = np.array(shape.plane.normal) / np.linalg.norm(shape.plane.normal)
            reach = np.linalg.norm(high - low) + np.linalg.norm((low + high) / 2 - shape.plane.point)
            along = reach * np.array([-normal[1], normal[0]])
            lines = [np.stack([shape.plane.point - along, shape.plane.point + along], axis=1)]
        else:
            lines = []
        found += [line + np.array(moved)[:, None] for line in lines]
    return found


def tank(walls: Sequence[Wall], t: float, low: NDArray, high: NDArray) -> list[Line]:
    """Lines[n, 3] of the hollow walls of a 3D scene at time t within what is shown, low to high; where there are none,
    the edges of that.
    """
    found = []
    for wall in walls:
        if not wall.section.solid and not is_body(wall.section):
            moved = np.array(wall.motion(t)[0])
            if wall.section.shape.box:
                a, b = (np.array(corner) + moved for corner in geometry.bounds(wall.section.shape))
                found += render.box_edges(np.clip(a, low, high), np.clip(b, low, high))
            else:
                found += [_within(line + moved, low, high) for line in _round(wall.section)]
    return [line for line in found if np.isfinite(line).any()] or render.box_edges(low, high)


def _within(line: Line, low: NDArray, high: NDArray) -> Line:
    """The line without its points that are outside of a box."""
    inside = np.all((line >= low) & (line <= high), axis=1)
    return np.where(inside[:, None], line, np.nan)


def _round(wall: WallSection) -> list[Line]:
    """Circles and straight lines on a sphere or a cylinder."""
    angle = np.linspace(0.0, 2.0 * np.pi, ROUND)[:, None]
    if wall.shape.sphere:
        axes = wall.shape.sphere.radius * np.eye(3)
        centre = np.array(wall.shape.sphere.centre)
        return [centre + np.cos(angle) * axes[k] + np.sin(angle) * axes[k - 1] for k in range(3)]
    if wall.shape.cylinder:
        base, top = np.array(wall.shape.cylinder.base), np.array(wall.shape.cylinder.top)
        *_, frame = np.linalg.svd((top - base)[None])
        one, two = wall.shape.cylinder.radius * frame[1:]
        rings = [end + np.cos(angle) * one + np.sin(angle) * two for end in (base, top)]
        share = np.linspace(0.0, 1.0, ALONG)[:, None]
        return [*rings, *(base + share * (top - base) + arm for arm in (one, two, -one, -two))]
    return []


def solid_boxes(walls: Sequence[Wall], t: float) -> list[tuple[NDArray, NDArray]]:
    """Corners at time t of the solid boxes among the walls that are no rigid bodies."""
    found = []
    for wall in walls:
        if wall.section.solid and wall.section.shape.box and not is_body(wall.section):
            moved = wall.motion(t)[0]
            low, high = (np.array(corner) + moved for corner in geometry.bounds(wall.section.shape))
            found.append((low, high))
    return found
