"""How grains at given positions lie to each other at the start, from the case alone."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from lbmdem.config import LbmDemConfig


def starts(config: "LbmDemConfig") -> tuple[float, float, int]:
    """Least distance of two centres (m), greatest overlap over the smaller diameter of pairs and walls with a grain
    that moves, and how many centres are outside the box. Grains of a law of diameters count as its smallest.
    """
    sets = [grains for grains in config.grains if grains.position]
    if not sets:
        return np.inf, 0.0, 0
    counts = [len(grains.position) for grains in sets]
    x = np.concatenate([np.array(grains.position, float) for grains in sets])
    sizes = [grains.diameter if grains.diameter is not None else grains.diameters.min for grains in sets]
    radius = 0.5 * np.repeat(np.array(sizes), counts)
    moving = np.repeat([grains.moving for grains in sets], counts)
    length = np.array(config.domain.size)
    periodic = np.array([axis in config.domain.periodic for axis in "xyz"[: len(length)]])
    outside = int(np.any(((x < 0.0) | (x > length)) & ~periodic, axis=1).sum())
    nearest, deepest = np.inf, wall_overlap(x[moving], radius[moving], length, periodic)
    for i in range(len(x) - 1):
        delta = x[i + 1 :] - x[i]
        delta -= np.where(periodic, length * np.rint(delta / length), 0.0)
        distance = np.sqrt((delta * delta).sum(axis=1))
        nearest = min(nearest, float(distance.min()))
        other = radius[i + 1 :]
        share = (radius[i] + other - distance) / (2.0 * np.minimum(radius[i], other))
        deepest = max(deepest, float(share[moving[i + 1 :] | moving[i]].max(initial=0.0)))
    return nearest, deepest, outside


def wall_overlap(x: NDArray, radius: NDArray, length: NDArray, periodic: NDArray) -> float:
    """Greatest overlap with a side of the box, over the diameter."""
    if not len(x) or periodic.all():
        return 0.0
    gap = np.minimum(x, length - x)[:, ~periodic]
    return max(0.0, float(((radius[:, None] - gap) / (2.0 * radius[:, None])).max()))
