"""How many macro-particles of which charge and mass a species has: words of the case in numbers.

With density or plasma_frequency, charge and mass in the case are those of one real particle, of which a macro-particle
is many; without, they are the macro-particle's own.
"""

import math
from collections.abc import Iterator
from typing import Any

from hpcpic.core.case.schema import Fault
from hpcpic.plasma.case.config import PlasmaConfig, Species
from hpcpic.plasma.case.units import Units
from hpcpic.plasma.setup.loaders import present_word


def particle_faults(species: Species) -> Iterator[Fault]:
    """What does not fit together in the number, charge and mass of the particles: key within the species, sentence."""
    if (species.particles is None) == (species.particles_per_cell is None):
        yield ("particles",), "give either particles or particles_per_cell"
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
    if species.plasma_frequency and species.charge == 0:
        yield ("charge",), "must not be 0 where plasma_frequency is given"


def numbers(species: Species, cells: int, scale: Units) -> dict[str, Any]:
    """Settings of a completed species that take the place of words: count, charge, mass, thermal velocity, loader."""
    charge, mass = scale.particle(species.particle) if species.particle else (species.charge, species.mass)
    thermal = species.thermal_velocity
    if species.temperature is not None:
        thermal = scale.thermal_velocity(species.temperature, mass)
    per_cell = species.particles_per_cell
    return {
        "particles": species.particles if per_cell is None else round(per_cell * cells),
        "particles_per_cell": None,
        "particle": None,
        "charge": charge,
        "mass": mass,
        "temperature": None,
        "thermal_velocity": thermal,
        "init_method": present_word(species.init_method, thermal),
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
    """Mass of a macro-particle, kg: as given, or from the density, or from its charge and their ratio."""
    n = species.particles
    if n and species.density:
        return species.density * math.prod(config.simulation.space_length) / n * species.mass
    if n and species.plasma_frequency:
        return macro_charge(config, species) / (species.charge / species.mass)
    return species.mass
