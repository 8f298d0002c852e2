"""Faces of the box, and what stands in it."""

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
        "uniform", 'type "velocity": of the velocity between walls, of which `velocity` is the mean'
    )


class PlaneShape(Section):
    point: Vector = setting(REQUIRED, "a point of the plane", "m")
    normal: Vector = setting(REQUIRED, "into the fluid")


class BoxShape(Section):
    low: Vector = setting(REQUIRED, "lower corner; repeats along the axes along which the case does", "m")
    high: Vector = setting(REQUIRED, "upper corner", "m")


class Shape(Section):
    plane: PlaneShape | None = None
    box: BoxShape | None = None


class Obstacle(Section):
    name: str = setting("", "name in the output; by default obstacle_1, ...")
    shape: Shape
    velocity: Vector = setting((), "of its surface, along which it slides", "m/s")
