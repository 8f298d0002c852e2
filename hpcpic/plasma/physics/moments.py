"""What is summed over particles: integrands of the velocity, written once, compiled for numbers and for vectors."""

import inspect
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hpcpic.core.case.own_functions import formula_fault
from hpcpic.core.simd.own import shipped

FIRST_SPEED, SECOND_SPEED = (0.3, -0.7, 1.1), (-0.9, 0.2, 0.5)  # any two


@dataclass(frozen=True, slots=True)
class Moment:
    """A sum over the particles of a species.

    integrand(vx, vy, vz, square) gives one value, or three where the moment is a vector. Components of the velocity are
    in cells per step, square = |v|^2 in (side of a cell along x per step)^2. It is arithmetic of its arguments alone,
    numbers or vectors of them: its source is compiled with the kernels. It must not exceed S^(power // 2) s^power,
    where s is above every component and S = square for v = (1, 1, 1): so |v|^2 v has the power 3.

    For fields of species (see species_fields) all components are in cells along x per step, so that any integrand of
    that power has a meaning; for the series it must be made of |v|^2, and of one component of v where it is a vector.
    """

    integrand: Callable[[Any, Any, Any, Any], Any]
    power: int
    vector: bool = False

    def size(self, components: int) -> int:
        """Values of the moment of velocities with so many components."""
        return components if self.vector else 1

    @property
    def isotropic(self) -> bool:
        """Whether the integrand is made of |v|^2 alone, times one component each where it is a vector, as the series
        wants it; looked at for two velocities.
        """
        speeds = np.array([FIRST_SPEED, SECOND_SPEED])
        try:
            values = [np.atleast_1d(self.integrand(v[0], v[1], v[2], 2.0)) for v in speeds]
            shares = np.stack(values) / (speeds if self.vector else 1.0)
        except Exception:  # `fault` tells it, with its place
            return True
        return bool(np.ptp(shares) <= 1e-12 * np.abs(shares).max())

    def fault(self, vectors: bool) -> str:
        """What is wrong with an integrand of the user's own, in one sentence with its place; "" of a sound one.

        vectors: it is compiled for vectors too, and not for numbers alone.
        """
        names, results = ("vx", "vy", "vz", "square"), 3 if self.vector else 1
        if shipped(self.integrand):
            return ""
        of_numbers = formula_fault(self.integrand, (), names, results)
        return of_numbers or (formula_fault(self.integrand, names, (), results) if vectors else "")


def speed_squared(vx, vy, vz, square):
    """|v|^2."""
    return square


def velocity(vx, vy, vz, square):
    """v."""
    return vx, vy, vz


SPEED_SQUARED = Moment(speed_squared, power=2)
VELOCITY = Moment(velocity, power=1, vector=True)


def values_of(moments: Sequence[Moment], components: int) -> int:
    """How many values the integrands of all moments give, of velocities with so many components."""
    return sum(moment.size(components) for moment in moments)


def integrands_source(moments: Sequence[Moment], components: int) -> str:
    """Text of `integrands`, which gives all values of the moments one after the other, for kernels.moments."""
    text, values = "", []
    for k, moment in enumerate(moments):
        text += f"\n\n@inlined\n{textwrap.dedent(inspect.getsource(moment.integrand))}"
        values += [f"m{k}[{c}]" for c in range(components)] if moment.vector else [f"m{k}"]
    found = (f"    m{k} = {moment.integrand.__name__}(vx, vy, vz, square)\n" for k, moment in enumerate(moments))
    given = "".join(f"{value}, " for value in values)
    return f"{text}\n\n@inlined\ndef integrands(vx, vy, vz, square):\n{''.join(found)}    return ({given})\n"
