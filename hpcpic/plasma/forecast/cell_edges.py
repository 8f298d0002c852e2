"""Waves that NGP does not see: a particle has its charge on the nearest node, wherever in that cell it is."""

import math
from collections.abc import Iterator

from hpcpic.core.case.derived import Derived, judged, rounded_up
from hpcpic.plasma.case.config import PlasmaConfig, Species
from hpcpic.plasma.forecast.scales import plasma_frequency, spacing
from hpcpic.plasma.physics.quiet_start import lattice
from hpcpic.plasma.setup.loaders import Quiet, loader_of


def cell_edges(config: PlasmaConfig) -> Iterator[Derived]:
    """How far the wave of each cold quiet species moves its particles, over the way to the nearest edge of a cell: with
    less no charge moves, and what is at rest stays so. A velocity takes them there in time.
    """
    if config.numerics.shape != "NGP":
        return
    for i, species in enumerate(config.species):
        wave = species.perturbation
        if not wave or not wave.amplitude or wave.velocity_amplitude or not plasma_frequency(config, species):
            continue
        ways = list(ways_to_edge(config, species))
        k = [2 * math.pi * n / length for n, length in zip(wave.mode, config.simulation.space_length)]
        moved = [abs(wave.amplitude * n) / math.hypot(*k) ** 2 / dx for n, dx in zip(k, spacing(config))]
        crossed = max((cells / way if way else math.inf for cells, way in zip(moved, ways) if cells), default=math.inf)
        if crossed == math.inf:
            continue
        larger = rounded_up(abs(wave.amplitude) / crossed)
        cures = [f"species[{i}].perturbation.amplitude = {larger:g}"] if larger < 1 else []
        yield judged(
            f"wave of {species.name} across cell edges", "a/(k d)", crossed, limit=">= 1", ok=crossed >= 1, legal=True,
            source="NGP sees no wave that moves no particle to another node",
            cure=", or ".join([*cures, 'numerics.shape = "CIC"']), key=("species", i, "perturbation", "amplitude"),
        )  # fmt: skip


def ways_to_edge(config: PlasmaConfig, species: Species) -> Iterator[float]:
    """Cells from the places (j + 1/2)/n of a lattice to the nearest edge between nodes, along each axis; nothing of
    what is no lattice. Places and edges are (2 j + 1) points and (2 i + 1) n in units of 1/(2 n): where both numbers
    have the same power of 2 some meet, else the nearest are their common divisor apart.
    """
    quiet = type(loader_of(species)).positions is Quiet.positions and not species.thermal_velocity
    total, points = species.particles or 0, config.points
    sides = (total,) if len(points) == 1 else lattice(total, points)
    for n, m in zip((sides or ()) if quiet else (), points):
        common = math.gcd(n, m)
        yield 0.0 if (n // common) % 2 and (m // common) % 2 else common / (2 * n)
