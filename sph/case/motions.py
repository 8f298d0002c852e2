"""What a case says of walls that move as they are told."""

from hpcpic.core.case.schema import REQUIRED, Section, Vector, setting


class Place(Section):
    time: float = setting(REQUIRED, "time", "s", ge=0)
    displacement: Vector = setting(REQUIRED, "from the initial place", "m")


TURNING = (
    "walls do not turn. A solid that does, as a paddle, is a body that no force slows down: body = { density = 1000.0; "
    'angular_velocity = [3.0]; held = ["x", "y", "rz"]; }. One that swings as it is told, as a flap that makes waves, '
    "is a stack of walls, each with the amplitude of its height. Of a tank that turns compute in its frame, with the "
    'forces of that frame as fluid.acceleration (docs/start/python.md, "An acceleration")'
)


class Motion(Section):
    instead = dict.fromkeys(("angular_velocity", "rotation", "omega", "angle", "axis", "centre"), TURNING)

    velocity: Vector = setting(
        (), "constant velocity; the wall goes away with it, so that a lid or a belt is as long as its way", "m/s"
    )
    amplitude: Vector = setting((), "of a displacement a sin(2 pi t / period)", "m")
    period: float = setting(1.0, "of the oscillation", "s", gt=0)
    start: float = setting(0.0, "rests before", "s", ge=0)
    stop: float | None = setting(None, "rests after", "s", ge=0)
    path: tuple[Place, ...] = setting((), "places in time, with straight lines between them")
