"""How far macro-particles, which are few, bring temperatures together: they collide far more than real particles."""

import math
from collections.abc import Iterator

from hpcpic.core.case.derived import Derived, judged, rounded_up
from hpcpic.plasma.case.config import PlasmaConfig, Species
from hpcpic.plasma.forecast.scales import (
    MOST_WITHOUT_FIELD,
    field_axes,
    plasma_frequency,
    spacing,
    thermal_velocities,
)
from hpcpic.plasma.setup.loaders import loader_of
from hpcpic.plasma.setup.macro_particles import macro_charge, macro_mass

FAST = 2.0  # thermal velocities: what drifts faster meets others too shortly to collide at the rates below
ALIKE = 2.0  # charges over masses within this factor are one kind: others share their energy far more slowly
UNEQUAL = 1.25  # energies of macro-particles that differ by more have something to share
AXES = {2: 0.6, 3: 0.74}  # rate of a difference between axes over that between species, within 15 %, measured
SEEN = 0.1  # of a difference
HEAVY = 2.2  # rate with heavier particles of as much charge over that of one kind, times the ratio of their masses:
# within 35 %; of two to four times the charge within 35 % in 2D, up to 2.2 times as much in 3D
LEAST, MOST = 0.5, 1e3  # lambda_D/dx: below it no rate was measured and the grid heats, beyond it nothing collides


def collisions(config: PlasmaConfig) -> Iterator[Derived]:
    """How many e-folds a difference of temperature loses in the run, where species or axes of the lightest kind differ
    by more than a quarter. In 1D macro-particles do not collide. A magnetic field slows it and makes axes alike.
    """
    moving = [species for species in config.species if plasma_frequency(config, species)]
    if field_axes(config) < 2 or not moving:
        return
    fastest = max(abs(species.charge / species.mass) for species in moving)
    kind = [species for species in moving if abs(species.charge / species.mass) * ALIKE > fastest]
    kind = [species for species in kind if not drifts_fast(config, species)]
    for heavy in moving:
        if kind and heavy not in kind and not drifts_fast(config, heavy):
            yield from with_heavy(config, kind, heavy)
    heats = [[macro_mass(config, s) * square for square in found] for s in kind if (found := squares(config, s))]
    energies, means = [energy for heat in heats for energy in heat], [sum(heat) / len(heat) for heat in heats]
    if not energies or max(energies) < UNEQUAL * min(energies):
        return
    wp = math.hypot(*(plasma_frequency(config, species) for species in kind))
    time = wp * abs(config.simulation.time_step) * config.simulation.cycles
    lost = time * collision_rate(debye_cells(config, kind, wp), per_cell(config, kind), field_axes(config))
    lost *= AXES[field_axes(config)] if max(means) < UNEQUAL * min(means) else 1.0
    charges = [abs(macro_charge(config, species)) for species in kind]
    weights = max(charges) > UNEQUAL * min(charges)
    source = "measured: differences between energies of macro-particles fall by exp(-nu t)"
    if any(config.field.magnetic):
        source += "; with a magnetic field of up to wc = 2 wp at 0.4 to 1 of this rate"
    if weights:
        source += "; those of a larger weight come to a lower temperature"
    cure = ""
    if SEEN <= lost < math.inf:
        cure = f"{rounded_up(lost / SEEN):g} times the particles" + (", or all of one weight" if weights else "")
    yield judged(
        "collisions of macro-particles", "nu t", lost, limit=f"< {SEEN:g}", ok=lost < SEEN, legal=True, source=source,
        cure=cure, key=("species", config.species.index(kind[0]), "particles"),
    )  # fmt: skip


def with_heavy(config: PlasmaConfig, kind: list[Species], heavy: Species) -> Iterator[Derived]:
    """How many e-folds the difference of temperature between the lightest kind and heavier particles loses."""
    light = [macro_mass(config, species) * square for species in kind for square in squares(config, species)]
    heat = [macro_mass(config, heavy) * square for square in squares(config, heavy)]
    if not light:
        return
    ours, other = sum(light) / len(light), sum(heat) / len(heat) if heat else 0.0
    if max(ours, other) < UNEQUAL * min(ours, other):
        return
    wp = math.hypot(*(plasma_frequency(config, species) for species in kind))
    debye = debye_cells(config, kind, wp) * math.sqrt(0.5 + 0.5 * other / ours)
    rate = collision_rate(debye, 2 * per_cell(config, kind), field_axes(config)) * heavier(config, kind, heavy)
    lost = rate * wp * abs(config.simulation.time_step) * config.simulation.cycles
    source = f"measured: their temperature and that of {kind[0].name} come together by exp(-nu t)"
    if any(config.field.magnetic):
        source += "; with a magnetic field of up to wc = 2 wp at 0.2 to 1 of this rate"
    weights = weight(config, heavy), weight(config, kind[0])
    if max(weights) > UNEQUAL * min(weights):
        source += "; those of a larger weight come to a lower temperature"
    cure = f"{rounded_up(lost / SEEN):g} times the particles" if SEEN <= lost < math.inf else ""
    yield judged(
        f"collisions with {heavy.name}", "nu_h t", lost, limit=f"< {SEEN:g}", ok=lost < SEEN, legal=True,
        source=source, cure=cure, key=("species", config.species.index(heavy), "particles"),
    )  # fmt: skip


def heavier(config: PlasmaConfig, kind: list[Species], heavy: Species) -> float:
    """The rate with heavy particles over that of as many of the lightest kind among themselves: as one over their mass,
    as the square of their charge, and as the number of both, as what one gains the others lose.
    """
    count = per_cell(config, kind) * math.prod(config.points)
    charge = sum(species.particles * abs(macro_charge(config, species)) for species in kind) / count
    both = 0.5 * (1.0 + heavy.particles / count)
    mass = macro_mass(config, heavy) / macro_mass(config, kind[0])
    return HEAVY / mass * both * (macro_charge(config, heavy) / charge) ** 2


def weight(config: PlasmaConfig, species: Species) -> float:
    """Real particles in one of the simulation."""
    return abs(macro_charge(config, species) / species.charge)


def collision_rate(debye: float, per_cell: float, axes: int) -> float:
    """Rate of a difference of temperature, over wp: debye in cells, per_cell particles of one charge.

    Two species of one mass, CIC, lambda_D from 0.5 to 4 dx (docs/measured/plasma.md): as one over the particles in a
    Debye length and the size of their clouds together (Hockney, J. Comput. Phys. 8, 19, 1971); in 3D with Landau's
    logarithm, which ends where clouds overlap.
    """
    debye = min(max(debye, LEAST), MOST)
    if axes == 2:
        return 0.059 / (per_cell * (debye * debye + 0.41))
    return 0.0047 * math.log(1.0 + 4.0 * debye * debye) / (per_cell * debye**3)


def squares(config: PlasmaConfig, species: Species) -> list[float]:
    """Squared velocity spreads of a species that has heat, along axes with a field; in a magnetic field their mean."""
    axes = [axis for axis, n in enumerate(config.points) if n > MOST_WITHOUT_FIELD]
    parts = [part for axis in axes for part in loader_of(species).populations(species, axis)]
    found = [part.spread**2 for part in parts if part.spread]
    return [sum(found) / len(found)] if found and any(config.field.magnetic) else found


def drifts_fast(config: PlasmaConfig, species: Species) -> bool:
    """Whether a part of a species drifts faster than all velocity spreads of the case."""
    axes = range(config.dimensions)
    parts = [part for axis in axes for part in loader_of(species).populations(species, axis)]
    widest = max(max(thermal_velocities(config, other)) for other in config.species)
    return max(abs(part.mean) for part in parts) > FAST * widest


def debye_cells(config: PlasmaConfig, kind: list[Species], wp: float) -> float:
    """Debye length of the mean heat of a kind, in cells."""
    heat = sum(
        plasma_frequency(config, species) ** 2 * sum(found) / len(found)
        for species in kind
        if (found := squares(config, species))
    )
    dx = [one for one, n in zip(spacing(config), config.points) if n > MOST_WITHOUT_FIELD]
    return math.sqrt(heat) / wp / wp / math.prod(dx) ** (1 / len(dx))


def per_cell(config: PlasmaConfig, kind: list[Species]) -> float:
    """Particles per cell of one charge that make the noise of a kind: (sum N |q|)^2 / sum N q^2."""
    charges = [(species.particles, abs(macro_charge(config, species))) for species in kind]
    total = sum(n * q for n, q in charges)
    return total * total / sum(n * q * q for n, q in charges) / math.prod(config.points)
