"""Accelerations of the user's own, which cases name: functions of place x and velocity v, of three components each, and
of the time t, in SI units, that numba compiles.

    from hpcpic.core.case.accelerations import register

    def trap(x, v, t):
        return -4.0 * x[0] - 0.1 * v[0], 0.0, 0.0

    register("trap", trap)

in a file that `--use` names, or in a script. Components that a scene does not have are 0, and not read.
"""

from collections.abc import Callable, Iterator

from hpcpic.core.case.config import Path
from hpcpic.core.simd.own import note, same

Components = tuple[float, float, float]
Acceleration = Callable[[Components, Components, float], Components]

ACCELERATIONS: dict[str, Acceleration] = {}
MEANING = "name of a further acceleration, a function of place, velocity and time in a file that --use names"


def register(name: str, acceleration: Acceleration) -> None:
    """Make an acceleration known by its name. ValueError where one of another name in its module has it: the same
    function may be defined again, as in a notebook.
    """
    if not same(ACCELERATIONS.get(name, acceleration), acceleration):
        raise ValueError(f"there is another acceleration {name!r}")
    note(acceleration)
    ACCELERATIONS[name] = acceleration


def faults(name: str) -> Iterator[tuple[Path, str]]:
    """An acceleration that nobody has registered."""
    if name and name not in ACCELERATIONS:
        known = f"; there are {', '.join(ACCELERATIONS)}" if ACCELERATIONS else ": --use FILE.py registers one"
        yield ("acceleration",), f"nobody has registered {name!r}{known}"
