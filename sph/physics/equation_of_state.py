"""The equation of state (MP 14) and what follows from it: sound speed, density at rest, work of compression. Gases
beside liquids are adiabatic, of molecules of two atoms, as air: p + p_a = p_a (rho / rho0)^1.4, where p is what liquids
have, 0 at rest. u = 1 + p / p_a is their absolute pressure over that of rest.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.simd.formulas import maximum, minimum
from hpcpic.core.space.elementary import expm1, log1p

MOST_GAMMA = 16  # that a polynomial is made for
ADIABATIC = 1.4  # ratio of the heat capacities of a gas
LEAST, MOST = 1 / 32, 32.0  # u beyond which its density stays
ITERATIONS = 5


def power(e: Any, n: float) -> Any:
    """((1 + e)^n - 1) / n without loss for small e, log(1 + e) for n = 0. Kernels have it as kernels.powers.power."""
    stretch = log1p(e)
    return expm1(n * stretch) / n if n else stretch


def coefficients(n: float) -> NDArray[np.float64]:
    """Coefficients of `power` as a polynomial in e, for whole n from 1 to MOST_GAMMA; else none."""
    whole = range(1, round(n) + 1) if n == round(n) and n <= MOST_GAMMA else ()
    return np.array([math.comb(round(n), k) / n for k in whole], np.float64)


def compression(u: Any) -> Any:
    """rho / rho0 = u^(5/7) of a gas, by Halley's iteration for y^7 = u^5 from Pade's fraction at 1: to rounding for u
    from 1/16 to 16, to 1e-8 at LEAST and MOST.
    """
    u = minimum(maximum(u, LEAST), MOST)
    square = u * u
    fifth = square * square * u
    y = (6.0 * u + 1.0) / (u + 6.0)
    for _ in range(ITERATIONS):
        cube = y * y * y
        seventh = cube * cube * y
        y = y * ((6.0 * seventh + 8.0 * fifth) / (8.0 * seventh + 6.0 * fifth))
    return y


def compression_work(u: Any, y: Any) -> Any:
    """Work on the volume of rest of a gas from there to y = rho / rho0, over p_a: the integral of (u - 1) / y^2 dy."""
    return (u / y - 1.0) / (ADIABATIC - 1.0) - (y - 1.0) / y


@dataclass(frozen=True)
class EquationOfState:
    """p = rho0 c0^2 / gamma ((rho / rho0)^gamma - 1) in Pa, and a background pressure; of `excess` = rho - rho0."""

    rho0: float
    c0: float
    gamma: float
    background: float = 0.0

    @property
    def stiffness(self) -> float:
        """k0 of (MP 14), Pa."""
        return self.rho0 * self.c0**2 / self.gamma

    def pressure(self, excess: NDArray | float) -> NDArray[np.float64]:
        """p in Pa without the background, from kg/m3."""
        return self.stiffness * expm1(self.gamma * log1p(np.asarray(excess) / self.rho0))

    def excess(self, pressure: NDArray | float) -> NDArray[np.float64]:
        """rho - rho0 in kg/m3 at which p without the background is this pressure in Pa."""
        return self.rho0 * expm1(log1p(np.asarray(pressure) / self.stiffness) / self.gamma)

    def sound_speed(self, excess: Any) -> Any:
        """(MP 15): c = c0 (rho / rho0)^((gamma - 1) / 2), m/s."""
        return self.c0 * (1.0 + excess / self.rho0) ** ((self.gamma - 1.0) / 2.0)

    def excess_at_rest(self, depth: NDArray, gravity: float) -> NDArray[np.float64]:
        """rho - rho0 at rest at a depth in m, exact."""
        return self.excess_at_head(gravity * np.maximum(depth, 0.0))

    def excess_at_head(self, head: NDArray) -> NDArray[np.float64]:
        """rho - rho0 of fluid at rest where the head, the integral of dp / rho, is so many m2/s2: (rho / rho0)^(gamma -
        1) = 1 + (gamma - 1) head / c0^2.
        """
        mach, n = head / self.c0**2, self.gamma - 1
        return self.rho0 * expm1(log1p(n * mach) / n if n else mach)

    def head(self, excess: NDArray) -> NDArray[np.float64]:
        """The head in m2/s2 at which rho - rho0 is `excess`."""
        return self.c0**2 * power(excess / self.rho0, self.gamma - 1)

    def energy(self, excess: NDArray) -> NDArray[np.float64]:
        """Work of compression from rho0, J/kg: the integral of (p + background) / rho^2."""
        change = excess / self.rho0
        volume = change / (1 + change)  # rho0 (1 / rho0 - 1 / rho)
        bent = power(change, self.gamma - 1)
        return (self.stiffness * (bent - volume) + self.background * volume) / self.rho0
