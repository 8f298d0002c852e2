"""The dispersion relation of Maxwellian beams, 1 = susceptibility, and its roots. Units are whatever the caller uses.

Waves are exp(i k x - i omega t): a positive imaginary part of omega grows. Source: Landau (1946); Fried & Conte, The
Plasma Dispersion Function (1961).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

FAR = 300.0  # where the asymptotic series has the rounding of the function itself, 1e-11


class NoRoot(ArithmeticError):
    """Newton's method did not settle on a root."""


@dataclass(frozen=True, slots=True)
class Beam:
    """A Maxwellian (or, without spread, cold) species; drift along k, thermal velocity the standard deviation along k.

    velocity[d]: the whole drift along the axes of the grid, where it is not along k: aliases of a wave feel it.
    """

    plasma_frequency: float
    drift: float = 0.0
    thermal_velocity: float = 0.0
    velocity: tuple[float, ...] = ()


def total_frequency(beams: Sequence[Beam]) -> float:
    """The plasma frequency of all of them together."""
    return float(np.sqrt(sum(beam.plasma_frequency**2 for beam in beams)))


def plasma_dispersion_prime(zeta: complex) -> complex:
    """Z'(zeta) = -2 (1 + zeta Z), the derivative of the function of Fried and Conte, on both half planes."""
    from scipy.special import wofz

    if abs(zeta.real) > FAR and abs(zeta.imag) < 0.5 * abs(zeta.real):  # 1 + zeta Z cancels, by zeta^2
        inverse = 1.0 / (zeta * zeta)
        return inverse * (1.0 + inverse * (1.5 + 3.75 * inverse))
    return -2.0 * (1.0 + zeta * 1j * np.sqrt(np.pi) * wofz(zeta))


def susceptibility(omega: complex, k: float, beams: Sequence[Beam]) -> complex:
    """Sum over species of wp^2/(omega - k v)^2, or of wp^2 Z'/(2 k^2 vth^2) where there is thermal spread."""
    total = 0.0 + 0.0j
    for beam in beams:
        shifted = omega - k * beam.drift
        wp_sq = beam.plasma_frequency**2
        if beam.thermal_velocity == 0.0:
            total += wp_sq / shifted**2
        else:
            spread = k * beam.thermal_velocity
            zeta = shifted / (np.sqrt(2.0) * abs(spread))
            total += wp_sq * plasma_dispersion_prime(zeta) / (2.0 * spread**2)
    return total


def root_near(guess: complex, equation: Callable[[complex], complex], tolerance: float = 1e-14) -> complex:
    """Newton's method on an analytic equation(omega) = 0. Raises NoRoot when 60 steps do not settle."""
    omega = complex(guess)
    for _ in range(60):
        h = 1e-6 * (abs(omega) + 1e-3)
        with np.errstate(over="ignore", invalid="ignore"):  # Z' overflows far below the axis
            value = equation(omega)
            slope = (equation(omega + h) - equation(omega - h)) / (2.0 * h)
        if not np.isfinite(value) or not np.isfinite(slope) or slope == 0.0:
            break
        step = value / slope
        omega -= step
        if abs(step) <= tolerance * (abs(omega) + 1e-300):
            return omega
        if abs(step) <= 1e-11 * abs(omega) and abs(equation(omega)) >= abs(value):
            return omega  # round-off of the equation itself
    raise NoRoot(f"no root near {guess}")
