"""Cold species that drift through the grid: its aliases heat them (the finite-grid instability)."""

import math
from collections.abc import Iterator

from hpcpic.core.case.derived import Derived, judged
from hpcpic.plasma.case.config import MOST_POINTS, PlasmaConfig, Species
from hpcpic.plasma.forecast.scales import MOST_WITHOUT_FIELD, plasma_frequency, spacing
from hpcpic.plasma.setup.loaders import loader_of

# A cold beam gains GAIN[shape] m (wp dx)^2/2 a particle at any u from 0.3 wp dx on, and then has the spread COLD; below
# 0.3 twice that and more, and nothing where it goes a whole number of cells in a step. 1D, 64 points, 64 particles per
# cell, wp dt = 0.2, quiet start with a wave of 1e-3, until wp t = 200, TSC until 600: docs/measured/plasma.md. Birdsall
# & Langdon, chapter 8, have the cause.
GAIN = {"NGP": 0.03, "CIC": 0.016, "TSC": 0.0045}
SPECTRAL = 2.0  # times as much with spectral gradients, at most
COLD = 0.05  # lambda_D/dx
SEEN = 50.0  # wp t in which a wave grows so much that it shows, with CIC
TOLD = 0.01  # of the energy


def cold_drift(config: PlasmaConfig) -> Iterator[Derived]:
    """The drift of each cold species against what the grid makes of it, along the axis where it is worst."""
    numerics, time = config.numerics, abs(config.simulation.time_step) * config.simulation.cycles
    if numerics.cloud_radius >= min(spacing(config)):  # leaves 1 % at 0.2 wp dx
        return
    more = SPECTRAL if numerics.gradient == "spectral" else 1.0
    for i, species in enumerate(config.species):
        found = slowest(config, species)
        if found == math.inf or plasma_frequency(config, species) * time < SEEN:
            continue
        least = least_drift(numerics.shape, more)
        points = [math.ceil(n * least / found * (1 + 1e-9)) if n > MOST_WITHOUT_FIELD else n for n in config.points]
        ways = [f"grid.points = {points}"] if max(points) <= MOST_POINTS else []
        if found >= least_drift("TSC", more):
            ways.insert(0, 'numerics.shape = "TSC"')
        growth, least_of = more * GAIN[numerics.shape] / found**2, "" if found > 0.3 else " or more"
        steady = (
            "" if not any(field_gain(config, species)) else " of steady drifts; 0.1 to 2 times that by field.electric"
        )
        yield judged(
            f"drift of cold {species.name}", "u/(wp dx)", found, limit=f">= {least:.3g}", ok=found >= least, legal=True,
            source=f"aliases raise its energy along the axis by {growth:.2g}{least_of}, measured{steady}",
            cure=", or ".join([*ways, "a spread of lambda_D = dx/2 or more"]), key=("species", i, "drift_velocity"),
        )  # fmt: skip


def least_drift(shape: str, more: float) -> float:
    """u/(wp dx) at which a beam gains TOLD of its energy."""
    return math.sqrt(more * GAIN[shape] / TOLD)


def field_gain(config: PlasmaConfig, species: Species) -> list[float]:
    """Speeds along each axis that the uniform electric field gives a species until the end, m/s; 0 in a magnetic one,
    where it has a drift of its own.
    """
    time = config.simulation.time_step * config.simulation.cycles
    ratio = 0.0 if any(config.field.magnetic) else species.charge / species.mass
    return [ratio * component * time for component in config.field.electric]


def slowest(config: PlasmaConfig, species: Species) -> float:
    """The smallest u/(wp dx) at the end of the cold parts of a species that move along an axis with a field, and of
    which there is a particle per cell; inf where none does.
    """
    ratios, cells, gained = [math.inf], math.prod(config.points), field_gain(config, species)
    for axis, (dx, n) in enumerate(zip(spacing(config), config.points)):
        for part in loader_of(species).populations(species, axis) if n > MOST_WITHOUT_FIELD else ():
            cell = plasma_frequency(config, species) * math.sqrt(part.share) * dx
            many = part.share * (species.particles or 0) >= cells
            if cell and many and (u := part.mean + gained[axis]) and part.spread < COLD * cell:
                ratios.append(abs(u) / cell)
    return min(ratios)
