"""Frequencies, lengths and charges that follow from a plasma case without a limit: what forecasts are made of."""

import math

from hpcpic.core.case.derived import rounded_down
from hpcpic.plasma.case.config import PlasmaConfig, Species, volume
from hpcpic.plasma.setup.loaders import loader_of

UNITS = 'are charge, mass and lengths in the case\'s units (units = "SI" or "normalised")?'
MOST_WITHOUT_FIELD = 2  # points along an axis: a difference over two cells (5.13) is then none


def plasma_frequency(config: PlasmaConfig, species: Species) -> float:
    """wp of one species at its mean density, rad/s: its own where the case gives it, else sqrt(n q^2 / (eps0 m))."""
    if not species.particles:
        return 0.0
    if species.plasma_frequency:
        return species.plasma_frequency
    density = species.density or species.particles / volume(config)
    ratio = species.charge / species.mass
    return math.sqrt(density * species.charge * ratio / config.constants.vacuum_permittivity)


def driven(config: PlasmaConfig) -> bool:
    """Whether an acceleration of the user's own moves particles: the plasma may be so thin that it does not."""
    return any(species.acceleration for species in config.species)


def particle_count(config: PlasmaConfig) -> int:
    """Macro-particles of all species."""
    return sum(species.particles for species in config.species)


def total_plasma_frequency(config: PlasmaConfig) -> float:
    """wp of all species together at the mean density of the box, rad/s."""
    return math.hypot(0.0, *(plasma_frequency(config, species) for species in config.species))


def thermal_velocities(config: PlasmaConfig, species: Species) -> tuple[float, ...]:
    """Standard deviation of the velocity per grid axis, m/s, that beams and waves have no part in."""
    populations = loader_of(species).populations
    return tuple(max(part.spread for part in populations(species, axis)) for axis in range(config.dimensions))


def spacing(config: PlasmaConfig) -> tuple[float, ...]:
    return tuple(length / n for length, n in zip(config.simulation.space_length, config.points))


def field_axes(config: PlasmaConfig) -> int:
    """Axes with a field along them."""
    return sum(n > MOST_WITHOUT_FIELD for n in config.points)


def charge_density(config: PlasmaConfig, species: Species) -> float:
    """Mean charge density of one species; where wp is given, wp^2 eps0 / (q/m)."""
    if species.plasma_frequency and species.particles:
        wp = species.plasma_frequency
        return wp * wp * config.constants.vacuum_permittivity * species.mass / species.charge
    return (species.density or species.particles / volume(config)) * species.charge if species.particles else 0.0


def step_for(config: PlasmaConfig, wanted: float, value: float) -> float:
    """A time step that makes `wanted` of a value that grows with it; the present one where there is none."""
    dt = config.simulation.time_step
    step = abs(dt) * wanted / value if value else 0.0
    return math.copysign(rounded_down(step), dt) if 0 < step < math.inf else dt
