"""What a case says of the places where fluid flows in and out."""

from typing import Annotated, Any, Literal, get_args

from pydantic import BeforeValidator

from hpcpic.core.case.schema import REQUIRED, Section, Vector, setting

Direction = Literal["x+", "x-", "y+", "y-", "z+", "z-"]


def along_an_axis(value: Any) -> Any:
    """Refuse flow at an angle, and say how it can be had."""
    if value not in get_args(Direction):
        known = ", ".join(get_args(Direction))
        raise ValueError(f"must be one of {known}: for an opening at an angle turn the scene, and gravity with it")
    return value


class Opening(Section):
    name: str = setting("", "by default inlet_1, outlet_1, ...")
    low: Vector = setting(REQUIRED, "lower corner of the box in which the flow is prescribed", "m")
    high: Vector = setting(REQUIRED, "upper corner; along `axis` at least as far as the kernel reaches", "m")
    axis: Annotated[Direction, BeforeValidator(along_an_axis)] = setting(
        REQUIRED, "the way in which fluid flows through the box"
    )


class Moment(Section):
    time: float = setting(REQUIRED, "time", "s", ge=0)
    velocity: float | None = setting(None, "in place of that of the inlet", "m/s", ge=0)
    discharge: float | None = setting(None, "in place of that of the inlet", "m3/s (2D: m2/s)", ge=0)
    level: float | None = setting(None, "in place of that of the inlet", "m")


class Inlet(Opening):
    velocity: float | None = setting(None, "mean velocity of what flows in", "m/s", ge=0)
    discharge: float | None = setting(
        None, "volume per time, through as much of the box as lies below the surface of the fluid before it",
        "m3/s (2D: m2/s)", ge=0,
    )  # fmt: skip
    profile: Literal["uniform", "parabolic"] = setting("uniform", "of the velocity across the box")
    level: float | None = setting(
        None,
        "height of the surface: nothing flows in above, the pressure is that of rest below; by default fluid comes "
        "through the whole box with the pressure of the fluid before it",
        "m",
    )
    table: tuple[Moment, ...] = setting((), "velocity or discharge and level in time, with straight lines between them")

    def over_time(self, name: str) -> list[tuple[float, float]]:
        """Times in s and values of velocity, discharge or level; none where it is not given."""
        listed = [(moment.time, getattr(moment, name)) for moment in self.table if getattr(moment, name) is not None]
        return listed or [(0.0, value) for value in [getattr(self, name)] if value is not None]


class Outlet(Opening):
    level: float | None = setting(None, "under gravity: height of the surface, below which it is still", "m")
    pressure: float = setting(0.0, "without gravity: pressure", "Pa", ge=0)
    waves: bool = setting(False, "long waves leave: the level follows the flow as in a wave that goes out")
    velocity: float = setting(0.0, "waves: mean velocity of the current on which they run", "m/s", ge=0)
