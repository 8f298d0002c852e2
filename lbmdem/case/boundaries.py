"""Faces of the box, what stands in it, and what that leaves of box and faces."""

import itertools
from collections.abc import Sequence
from typing import Literal

from hpcpic.core.case.schema import REQUIRED, Section, Vector, setting

FaceName = Literal["x-", "x+", "y-", "y+", "z-", "z+"]


class Boundary(Section):
    face: FaceName = setting(REQUIRED, "side of the box")
    type: Literal["wall", "pressure", "velocity", "periodic"] = setting(
        REQUIRED,
        "what it does to the fluid (grains meet any face as a wall); periodic: the box repeats along this axis, as in "
        "domain.periodic",
    )
    pressure: float | None = setting(None, 'type "pressure": above that of the density of rest', "Pa")
    density: float | None = setting(None, 'type "pressure": the density itself', "kg/m3", gt=0)
    pressure_rate: float = setting(0.0, 'type "pressure": change in time', "Pa/s")
    velocity: Vector = setting(
        (), 'of the wall, or of the fluid through a "velocity" face, with which all fluid starts along its axis', "m/s"
    )
    profile: Literal["uniform", "parabolic"] = setting(
        "uniform",
        'type "velocity": of the velocity, of which `velocity` is the mean, between walls or the planes and boxes that '
        "narrow the face",
    )

    @property
    def is_open(self) -> bool:
        """Whether fluid passes through the face."""
        return self.type in ("pressure", "velocity")


class PlaneShape(Section):
    point: Vector = setting(REQUIRED, "a point of the plane", "m")
    normal: Vector = setting(REQUIRED, "into the fluid")


class BoxShape(Section):
    low: Vector = setting(REQUIRED, "lower corner; repeats along the axes along which the case does", "m")
    high: Vector = setting(REQUIRED, "upper corner", "m")


class Shape(Section):
    instead = dict.fromkeys(
        ("cylinder", "sphere", "disc", "circle", "polygon", "stl"),
        "there are plane and box; what is round is a grain with moving = false, what is bent a row of such grains",
    )
    plane: PlaneShape | None = None
    box: BoxShape | None = None


class Obstacle(Section):
    instead = dict.fromkeys(
        ("angular_velocity", "rotation", "motion"),
        "it slides along itself (velocity); what turns is a grain with moving = false and an angular_velocity, and the "
        "wall of a drum of radius R that turns with w is a ring of such grains of radius r with -w R/r",
    )
    name: str = setting("", "name in the output; by default obstacle_1, ...")
    shape: Shape
    velocity: Vector = setting((), "of its surface, along which it slides", "m/s")


Ends = tuple[list[float], list[float]]


def ends_between_planes(size: Sequence[float], obstacles: Sequence[Obstacle]) -> Ends:
    """Lower and upper ends (m) along each axis of what planes across it leave of a box of this size (m)."""
    ends, tops = [0.0] * len(size), list(size)
    for plane in (obstacle.shape.plane for obstacle in obstacles):
        across = [k for k, part in enumerate(plane.normal) if part] if plane is not None else []
        if plane is not None and len(across) == 1:
            k = across[0]
            if plane.normal[k] > 0.0:
                ends[k] = max(ends[k], plane.point[k])
            else:
                tops[k] = min(tops[k], plane.point[k])
    return ends, tops


def opening(axis: int, at: float, size: Sequence[float], obstacles: Sequence[Obstacle]) -> Ends:
    """Those of the part of a face across an axis that planes leave, and boxes which stand in its nodes, `at` (m) along
    the axis, against a whole side of it."""
    ends, tops = ends_between_planes(size, obstacles)
    given = [obstacle.shape.box for obstacle in obstacles]
    boxes = [box for box in given if box is not None and box.low[axis] <= at <= box.high[axis]]
    before: Ends = ([], [])
    while before != (ends, tops):  # a box may stand against another
        before = ([*ends], [*tops])
        for box, j in itertools.product(boxes, set(range(len(size))) - {axis}):
            others = set(range(len(size))) - {axis, j}
            if all(box.low[m] <= ends[m] and box.high[m] >= tops[m] for m in others):
                if box.low[j] <= ends[j] < box.high[j]:
                    ends[j] = box.high[j]
                if box.low[j] < tops[j] <= box.high[j]:
                    tops[j] = box.low[j]
    return ends, tops
