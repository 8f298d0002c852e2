"""Accelerations of the user's own, which cases name: functions of place x and velocity v, of three components each, and
of the time t, in SI units, that numba compiles. They return three numbers.

    from hpcpic.core.case.accelerations import register

    def trap(x, v, t):
        return -4.0 * x[0] - 0.1 * v[0], 0.0, 0.0

    register("trap", trap)

in a file that `--use` names, or in a script. Components that a scene does not have are 0, and not read.
"""

import functools
from collections.abc import Callable, Iterator
from typing import Any

from hpcpic.core.case.config import Path
from hpcpic.core.case.own_functions import fault, plain
from hpcpic.core.simd import frozen
from hpcpic.core.simd.own import enter

Components = tuple[float, float, float]
Acceleration = Callable[[Components, Components, float], Components]

ACCELERATIONS: dict[str, Acceleration] = {}
MEANING = "name of a further acceleration, a function of place, velocity and time in a file that --use names"


def register(name: str, acceleration: Acceleration) -> None:
    """Make an acceleration known by its name. ValueError where one of another name in its module has it: the same
    function may be defined again, as in a notebook.
    """
    enter(ACCELERATIONS, "acceleration", name, plain(acceleration), lambda one: one)
    frozen.keep(f"acceleration {name!r}", acceleration)


def compiled(name: str) -> Acceleration:
    """An acceleration as kernels call it: of numbers of any precision, for three of float64."""
    return _compiled(ACCELERATIONS[name])


@functools.cache
def _compiled(acceleration: Acceleration) -> Acceleration:
    import numpy as np

    from hpcpic.core.simd import compile

    of, real = compile.njit(cache=False)(acceleration), np.float64

    def components(x: Components, v: Components, t: float) -> Components:
        place, velocity = (real(x[0]), real(x[1]), real(x[2])), (real(v[0]), real(v[1]), real(v[2]))
        a, b, c = of(place, velocity, t)
        return real(a), real(b), real(c)

    return components


@functools.cache
def _fault(acceleration: Acceleration) -> str:
    from numba import types

    def three_numbers(result: Any) -> bool:
        parts, real = getattr(result, "types", ()), (types.Integer, types.Float)
        return len(parts) == 3 and all(isinstance(types.unliteral(part), real) for part in parts)

    three = types.UniTuple(types.float64, 3)
    arguments = {"x": three, "v": three, "t": types.float64}
    return fault(acceleration, arguments, three_numbers, "three numbers, a_x, a_y, a_z")


def faults(name: str) -> Iterator[tuple[Path, str]]:
    """An acceleration that nobody has registered, or that cannot be compiled."""
    if name and name not in ACCELERATIONS:
        how = ": `register` does, in a script or in a file that --use names"
        known = f"; there are {', '.join(ACCELERATIONS)}" if ACCELERATIONS else how
        yield ("acceleration",), f"nobody has registered {name!r}{known}"
    elif name and (said := _fault(ACCELERATIONS[name])):
        yield ("acceleration",), said
