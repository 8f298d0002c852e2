"""How grains at given positions lie to each other at the start, from the case alone."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.products import product

if TYPE_CHECKING:
    from lbmdem.config import LbmDemConfig


def starts(config: "LbmDemConfig") -> tuple[float, float, int]:
    """Least distance of two centres (m; of those that overlap), greatest overlap over the smaller diameter of pairs
    and walls with a grain that moves, and how many centres are outside the box. Grains of a law of diameters count as
    its smallest.
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
    gap = np.minimum(wall_gap(x, length, periodic), plane_gap(config, x))
    nearest, deepest = np.inf, float(((radius - gap) / (2.0 * radius))[moving].max(initial=0.0))
    x = np.where(periodic, x - length * np.floor(x / length), x)
    order, reach = np.argsort(x[:, -1], kind="stable"), 2.0 * float(radius.max())
    x, radius, moving = x[order], radius[order], moving[order]
    ends = np.searchsorted(x[:, -1], x[:, -1] + reach, side="right")
    begins = np.searchsorted(x[:, -1], x[:, -1] + length[-1] - reach) if periodic[-1] else np.full(len(x), len(x))
    for i in range(len(x) - 1):
        others = np.r_[i + 1 : ends[i], max(begins[i], ends[i]) : len(x)]  # beside it, and across a periodic side
        delta = x[others] - x[i]
        delta -= np.where(periodic, length * np.rint(delta / length), 0.0)
        distance = np.sqrt((delta * delta).sum(axis=1))
        nearest = min(nearest, float(distance.min(initial=np.inf)))
        share = (radius[i] + radius[others] - distance) / (2.0 * np.minimum(radius[i], radius[others]))
        deepest = max(deepest, float(share[moving[others] | moving[i]].max(initial=0.0)))
    return nearest, deepest, outside


def wall_gap(x: NDArray, length: NDArray, periodic: NDArray) -> NDArray[np.float64]:
    """From centres [n, d] to the nearest side of the box, m [n]."""
    return np.where(periodic, np.inf, np.minimum(x, length - x)).min(axis=1)


def plane_gap(config: "LbmDemConfig", x: NDArray) -> NDArray[np.float64]:
    """From centres [n, d] to the nearest plane in the box, m [n]."""
    gap = np.full(len(x), np.inf)
    for plane in (obstacle.shape.plane for obstacle in config.obstacle):
        if plane is not None:
            normal = np.array(plane.normal) / np.linalg.norm(plane.normal)
            gap = np.minimum(gap, product(x - np.array(plane.point), normal))
    return gap
