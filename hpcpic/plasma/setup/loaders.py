"""How a species is loaded: its words in numbers, what a macro-particle has, what is random, mean and spread.

With density or plasma_frequency, charge and mass in the case are those of one real particle, of which a macro-particle
is many; without, they are the macro-particle's own.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hpcpic.core.case.config import Path
    from hpcpic.plasma.case.config import PlasmaConfig, Species
    from hpcpic.plasma.case.units import Units

RANDOM = ("random", "opposite beams", "uniform velocities")  # their positions are random
SCALABLE = (*RANDOM, "quiet")  # more particles are the same scene
PLACED = ("position delta", "harmonic two electrons")  # one by one


def loader(word: str, thermal_velocity: float) -> str:
    """The present word for an init_method. "random position" has its own velocities where no spread is given."""
    if word == "default":
        return "opposite beams"
    if word == "random position":
        return "random" if thermal_velocity else "uniform velocities"
    return word


def particle_faults(species: Species) -> Iterator[tuple[Path, str]]:
    """What does not fit together in how many particles of which kind there are."""
    if (species.particles is None) == (species.particles_per_cell is None):
        yield ("particles",), "give either particles or particles_per_cell"
    if species.particles_per_cell and species.init_method in PLACED:
        yield ("particles_per_cell",), f"give particles where init_method is {species.init_method!r}"
    missing = [name for name in ("charge", "mass") if getattr(species, name) is None]
    if species.particle and len(missing) < 2:
        yield ("particle",), "give either particle, or charge and mass"
    for name in missing if not species.particle else ():
        yield (name,), "missing: give charge and mass, or particle"
    if species.density and species.plasma_frequency:
        yield ("density",), "give either density or plasma_frequency"
    for name in ("particle", "temperature"):
        if getattr(species, name) is not None and not (species.density or species.plasma_frequency):
            yield (name,), "needs density or plasma_frequency: without, charge and mass are a macro-particle's"
    if species.temperature is not None and species.thermal_velocity:
        yield ("temperature",), "give either temperature or thermal_velocity"
    if species.init_method == "uniform velocities" and (species.thermal_velocity or species.temperature):
        yield ("init_method",), '"uniform velocities" have a spread of their own: no thermal_velocity, or "random"'
    if species.plasma_frequency and species.charge == 0:
        yield ("charge",), "must not be 0 where plasma_frequency is given"


def numbers(species: Species, cells: int, scale: Units) -> dict[str, Any]:
    """What a completed species has in the place of words: count, charge, mass, thermal velocity."""
    charge, mass = scale.particle(species.particle) if species.particle else (species.charge, species.mass)
    hot = species.temperature is not None
    thermal = scale.thermal_velocity(species.temperature, mass) if hot else species.thermal_velocity
    counted = species.particles is not None
    return {
        "particles": species.particles if counted else round(species.particles_per_cell * cells),
        "particles_per_cell": None,
        "particle": None,
        "charge": charge,
        "mass": mass,
        "temperature": None,
        "thermal_velocity": thermal,
        "init_method": loader(species.init_method, thermal),
    }


def macro_charge(config: PlasmaConfig, species: Species) -> float:
    """Charge of a macro-particle, C: as given, or from the density, or from wp^2 = (N / V) q (q/m) / eps0."""
    n, wp, volume = species.particles, species.plasma_frequency, math.prod(config.simulation.space_length)
    if n and species.density:
        return species.density * volume / n * species.charge
    if n and wp:
        charge_to_mass = species.charge / species.mass
        return wp * wp * config.constants.vacuum_permittivity * volume / (n * charge_to_mass)
    return species.charge


def macro_mass(config: PlasmaConfig, species: Species) -> float:
    """Mass of a macro-particle, kg, likewise."""
    n = species.particles
    if n and species.density:
        return species.density * math.prod(config.simulation.space_length) / n * species.mass
    if n and species.plasma_frequency:
        return macro_charge(config, species) / (species.charge / species.mass)
    return species.mass


def draws_random(species: Species) -> bool:
    """Whether the initial state of a species changes with random_seed."""
    drawn = species.init_method in RANDOM or (species.thermal_velocity and species.init_method != "quiet")
    return bool(species.particles and drawn)


def velocity_moments(config: PlasmaConfig, species: Species, axis: int) -> tuple[float, float]:
    """Mean and standard deviation, m/s, of a velocity component as loaded."""
    n, v, method = species.particles or 0, species.drift_velocity[axis], species.init_method
    mean, variance = v, species.thermal_velocity**2
    if method == "opposite beams" and n:
        mean = -v * (n % 2) / n
        variance += v * v - mean * mean
    elif method == "uniform velocities":
        mean, variance = 0.0, v * v / 3
    elif method == "harmonic two electrons":
        mean, variance = 0.0, variance + (v * v if axis == 0 else 0.0)
    wave = species.perturbation
    if wave and axis < len(wave.mode):
        k = [mode / length for mode, length in zip(wave.mode, config.simulation.space_length)]
        variance += 0.5 * (wave.velocity_amplitude * k[axis] / math.hypot(*k)) ** 2  # sin(k.x) has the variance 1/2
    return mean, math.sqrt(variance)
