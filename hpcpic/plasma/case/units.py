"""The units of a case: constants of nature and known particles in them.

Source of the numbers: CODATA 2022; the elementary charge and the speed of light are exact.
"""

import math
from dataclasses import dataclass

PARTICLES = {  # charge in elementary charges, mass in electron masses
    "electron": (-1.0, 1.0),
    "positron": (1.0, 1.0),
    "proton": (1.0, 1836.152673426),
    "deuteron": (1.0, 3670.482967655),
    "alpha": (2.0, 7294.29954171),
}


@dataclass(frozen=True, slots=True)
class Units:
    """permittivity F/m, elementary charge C, electron mass kg; light: speed of light m/s, infinite where none is known.
    A temperature is in elementary charges times the unit of potential: eV in SI units.
    """

    permittivity: float
    charge: float
    mass: float
    light: float

    def particle(self, name: str) -> tuple[float, float]:
        """Charge and mass of a known particle."""
        charges, masses = PARTICLES[name]
        return charges * self.charge, masses * self.mass

    def thermal_velocity(self, temperature: float, mass: float) -> float:
        """Standard deviation of a velocity component, sqrt(k_B T/m)."""
        return math.sqrt(temperature * self.charge / mass)


SI = Units(8.8541878188e-12, 1.602176634e-19, 9.1093837139e-31, 299792458.0)
NORMALISED = Units(1.0, 1.0, 1.0, math.inf)
SYSTEMS = {"SI": SI, "normalised": NORMALISED}


def known_by_ratio(charge: float, mass: float) -> str | None:
    """The known particle that has this ratio of charge to mass in SI units, to 1 %."""
    for name, (charges, masses) in PARTICLES.items():
        ratio = charges / masses * (SI.charge / SI.mass)
        if abs(charge / mass / ratio - 1) < 0.01:
            return name
    return None
