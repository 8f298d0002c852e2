"""Plane walls that grains meet; the law of a contact [1] is in `hpcpic.core.physics.contact_law`."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lbmdem.sizes import ROW


@dataclass(frozen=True, slots=True)
class PlaneWall:
    """A plane with a normal into the grains' side; its point moves: point + velocity t + amplitude sin(2 pi f t).

    film: of fluid between it and grains. One through which the fluid passes, like a screen, squeezes none.
    """

    point: Sequence[float]
    normal: Sequence[float]
    velocity: Sequence[float] = ()
    amplitude: Sequence[float] = ()
    frequency: float = 0.0
    film: bool = True

    @property
    def moves(self) -> bool:
        return any(self.velocity) or (any(self.amplitude) and self.frequency != 0.0)

    def rows(self, times: NDArray) -> NDArray[np.float64]:
        """Values [n, ROW] for the kernels at times (s): point, 1 where it has no film, velocity, 0, normal, 0 ..."""
        rows, omega = np.zeros((len(times), ROW)), 2.0 * math.pi * self.frequency
        d = len(self.point)
        velocity, amplitude = (np.array(v or np.zeros(d), float) for v in (self.velocity, self.amplitude))
        phases = (omega * times).tolist() if any(self.amplitude) else [0.0]
        # each time alone, so that its bits do not depend on the others
        sines, cosines = (np.array([[f(phase)] for phase in phases]) for f in (math.sin, math.cos))
        rows[:, :d] = np.asarray(self.point) + velocity * times[:, None] + amplitude * sines
        rows[:, 3] = not self.film
        rows[:, 4 : 4 + d] = velocity + amplitude * omega * cosines
        rows[:, 8 : 8 + d] = np.asarray(self.normal, float) / math.hypot(*self.normal)
        return rows


def wall_rows(walls: Sequence[PlaneWall], times: NDArray) -> NDArray[np.float64]:
    """Rows [n, walls + 1, ROW] of all walls at times (s), and one that touches nothing behind them."""
    rows = np.full((len(times), len(walls) + 1, ROW), np.nan)
    for k, wall in enumerate(walls):
        rows[:, k] = wall.rows(times)
    return rows
