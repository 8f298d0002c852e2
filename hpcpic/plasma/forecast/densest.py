"""Where a plasma is densest at its start: there a step is unstable first, and a grid resolves least."""

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from hpcpic.plasma.case.config import PlasmaConfig
from hpcpic.plasma.forecast.cuts import sampled, spread_evenly
from hpcpic.plasma.forecast.scales import MOST_WITHOUT_FIELD, plasma_frequency, spacing, thermal_velocities
from hpcpic.plasma.setup.scene import Scene

SAMPLE = 1 << 18  # particles of a species, at most, by which its density is known
BY_CHANCE = 6.0  # standard deviations of a count that no bin of 1e9 exceeds in random places
DENSER = 1.2  # of the mean: a sum of squared plasma frequencies that is a place of its own


@lru_cache(maxsize=8)
def densest(config: PlasmaConfig) -> tuple[float, ...]:
    """Density of each species over its mean, where the squared plasma frequencies add up to most; 1 where that is no
    more than DENSER of the mean or than chance makes of few particles.

    The places are those of the start. Bins are of 2, 4, 8, ... cells on each axis (a slab of one cell feels half of its
    density), and of all that is taken whose excess over the mean is surest.
    """
    own = [plasma_frequency(config, species) ** 2 for species in config.species]
    even = tuple(1.0 for _ in own)
    uneven = [i for i, species in enumerate(config.species) if own[i] and not spread_evenly(species)]
    if not uneven:
        return even
    cells, shares = _occupied(config, uneven)
    found, surest = even, DENSER * sum(own)
    for level in range(1, max(config.points).bit_length() + 1):
        cells, inverse = _distinct(cells // 2, config.points)
        shares = np.array([np.bincount(inverse, share, len(cells)) for share in shares])
        whole = [n - (cell << level) for n, cell in zip(config.points, cells.T)]
        part = math.prod(np.minimum(1 << level, cut) / n for n, cut in zip(config.points, whole))
        squares = np.array([own[i] for i in uneven])[:, None]
        sizes = np.array([min(config.species[i].particles or 0, SAMPLE) for i in uneven])[:, None]
        here = np.sum(squares * shares, axis=0)
        noise = np.sqrt(np.sum(squares**2 * shares / sizes, axis=0))
        sure = (here - BY_CHANCE * noise) / part + sum(own) - squares.sum()
        most = int(np.argmax(sure))
        if sure[most] > surest:
            surest, ratios = sure[most], dict(zip(uneven, shares[:, most] / part[most]))
            found = tuple(float(ratios.get(i, 1.0)) for i in range(len(own)))
    return found


def _occupied(config: PlasmaConfig, uneven: list[int]) -> tuple[NDArray, NDArray]:
    """Cells [n, d] of a sample of some species, and the share [species, n] of each that lies in them."""
    scene, cells = Scene(config), list[NDArray]()
    for i in uneven:
        species = scene.species[i]
        x = species.positions(species.first + sampled(species.n, SAMPLE))
        cells.append((x / scene.spacing).astype(np.int64) % np.array(config.points))
    kinds = np.repeat(np.arange(len(uneven)), [len(cell) for cell in cells])
    return np.concatenate(cells), np.array([(kinds == k) / len(cell) for k, cell in enumerate(cells)])


def _distinct(cells: NDArray, points: tuple[int, ...]) -> tuple[NDArray, NDArray]:
    """The different rows of cells [n, d], and which of them each row is."""
    number = cells[:, 0]
    for axis in range(1, len(points)):
        number = number * points[axis] + cells[:, axis]
    _, first, inverse = np.unique(number, return_index=True, return_inverse=True)
    return cells[first], inverse


def at_densest(config: PlasmaConfig) -> str:
    """What names a number where the plasma is so much denser than its mean that it is judged there; else empty."""
    return ", where it is densest" if any(ratio != 1.0 for ratio in densest(config)) else ""


def dense_frequency(config: PlasmaConfig) -> float:
    """wp of all species together where the plasma is densest, rad/s."""
    ratios = zip(config.species, densest(config))
    return math.hypot(0.0, *(plasma_frequency(config, one) * math.sqrt(ratio) for one, ratio in ratios))


def mean_debyes(config: PlasmaConfig) -> tuple[float, ...]:
    """Debye length over the spacing of each axis with a field, were the heat shared by all charges as the grid comes to
    share it: colder species shield no more than others. Species without heat do not count; inf where none has.
    """
    charges, heats = [0.0] * config.dimensions, [0.0] * config.dimensions
    for species, denser in zip(config.species, densest(config)):
        per_charge = species.mass / abs(species.charge) if plasma_frequency(config, species) else 0.0
        charge = denser * plasma_frequency(config, species) ** 2 * per_charge  # density, over the permittivity
        for axis, thermal in enumerate(thermal_velocities(config, species)):
            charges[axis] += charge if thermal > 0 else 0.0
            heats[axis] += charge * per_charge * thermal * thermal
    axes = zip(heats, charges, spacing(config), config.points)
    return tuple(
        math.sqrt(heat) / charge / dx if charge else math.inf for heat, charge, dx, n in axes if n > MOST_WITHOUT_FIELD
    )
