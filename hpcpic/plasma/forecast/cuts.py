"""Which rows the ranks have: cuts of equal cost, by where the particles are."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hpcpic.core.space.domain import MAX_IMBALANCE, better_cuts, even_cuts
from hpcpic.plasma.case.config import PlasmaConfig, Species
from hpcpic.plasma.forecast.rates import DEFAULT, kernel_ns
from hpcpic.plasma.forecast.scales import particle_count
from hpcpic.plasma.setup.loaders import EVEN, loader_of
from hpcpic.plasma.setup.scene import Scene

MOST_ROWS = 1 << 22  # that are looked at before a run
SAMPLE = 1 << 20  # particles of a species, at most, by which its density is known at the start
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
LAYING_OUT = 5e7, 150.0  # ns: of a layout, and of a particle of a rank; twice or half as much costs little


def row_costs(config: PlasmaConfig, particles: ArrayLike) -> NDArray[np.float64]:
    """Time of a step by row, ns, with so many particles [rows], by DEFAULT rates, so the same on any machine.

    Half of the field's time is of columns, which all ranks share evenly, and with LU all of it is every rank's.
    """
    d, lu = config.dimensions, config.simulation.solver == "LU"
    node = DEFAULT[f"cell_ns {d}D"] + (0.0 if lu else 0.5 * DEFAULT[f"field_ns {d}D"])
    return kernel_ns(config, DEFAULT) * np.asarray(particles) + node * math.prod(config.points[:-1])


def laying_out(config: PlasmaConfig, ranks: int) -> float:
    """Time that a run takes to lay out its particles and fields anew, ns."""
    once, each = LAYING_OUT
    return once + each * particle_count(config) / ranks


def first_cuts(config: PlasmaConfig, ranks: int) -> tuple[int, ...]:
    """Cuts at the start: of equal cost where those of equal height are far from it, and rows are not too many to look
    at.
    """
    even = even_cuts(config.points[-1], ranks)
    if ranks == 1 or config.points[-1] > MOST_ROWS or all(map(spread_evenly, config.species)):
        return even
    scene, rows = Scene(config), np.zeros(config.points[-1])
    for species in scene.species:
        numbers = sampled(species.n, SAMPLE)
        at = species.positions(species.first + numbers)[:, -1] / scene.spacing[-1]
        rows += np.bincount(at.astype(np.int64) % len(rows), minlength=len(rows)) * (species.n / max(len(numbers), 1))
    return better_cuts(row_costs(config, rows), even, minimum=1) or even


def sampled(n: int, most: int) -> NDArray[np.int64]:
    """All of n numbers, or one of each of `most` equal parts, by the golden ratio: equal steps would meet the same
    place of each beam of strata, which come in batches.
    """
    part = np.arange(min(n, most))
    return np.minimum((part + part * GOLDEN % 1.0) * (n / max(len(part), 1)), n - 1).astype(np.int64)


def spread_evenly(species: Species) -> bool:
    """True if all slabs of one height have as many particles of a species at the start, to MAX_IMBALANCE."""
    wave = species.perturbation
    return type(loader_of(species)).positions in EVEN and (not wave or abs(wave.amplitude) < MAX_IMBALANCE - 1)
