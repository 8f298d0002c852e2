"""The contacts [1] of Mansouri et al. 2011: walls, and the largest stable step of grains; the law of one contact is in
`hpcpic.core.physics.contact_law`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.physics.contact_law import ContactLaw

ROW = 16  # values of a grain (x y z radius, v and inverse mass, omega and inverse inertia, orientation) or a plane
LANES = 8  # contacts whose forces are found at a time


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


def stable_step(law: ContactLaw, radius: NDArray, mass: NDArray, inertia: NDArray, contacts: float = 0.0) -> float:
    """Largest stable step (s) of grains that move: a bound for the lightest of them among its equals.

    contacts: how many act along one direction; by default the most that equal discs (3) or spheres (4.5) can have:
    contacts are 60 degrees apart, and one at an angle a counts cos^2 a. Neighbours in antiphase act as half the mass.
    Tangential springs and dashpots, twice as many along a direction or about an axis, are added.
    """
    if len(mass) == 0:
        return math.inf
    k = int(np.argmin(mass))
    planar = inertia[k] > 0.45 * mass[k] * radius[k] ** 2
    contacts = contacts or (3.0 if planar else 4.5)
    normal = 2.0 / mass[k]  # 1/kg: 1 / reduced mass of two of them, along the normal
    tangential = 2.0 * (normal + 2.0 * radius[k] ** 2 / inertia[k])  # 1/kg: along the contact, both turn; twice as many
    # 1/s2: stiffness of all springs over the reduced mass
    spring = contacts * (law.stiffness * normal + law.shear * tangential)
    # 1/s: viscosity of all dashpots over the reduced mass
    dashpot = contacts * (2.0 * law.damping * math.sqrt(law.stiffness * normal) + law.viscosity * tangential)
    return 2.0 / (dashpot + math.sqrt(dashpot**2 + spring))
