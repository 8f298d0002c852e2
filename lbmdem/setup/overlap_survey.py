"""Where grains are at the start, from the case alone: how those at given positions lie to each other, and what space
packings fill.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.case.config import Path
from hpcpic.core.space.products import product
from lbmdem.case.boundaries import ends_between_planes
from lbmdem.case.config import Diameters, GrainSet, LbmDemConfig
from lbmdem.setup.box_walls import cover

LOOSE, LAYERS = 0.5, 3.0  # porosity from which grains fall, and least height of their space, largest diameters
POINTS = {2: 400, 3: 60}  # along a side, at which the space before slanted planes is counted
SAMPLE = 1 << 17  # grains whose diameters are looked at one by one before a run: their mean volume is within 1e-5


class Survey(NamedTuple):
    """How grains at given positions lie. nearest: least distance of two centres (m; of those that overlap); deepest:
    greatest overlap over the smaller diameter of pairs and walls with a grain that moves; outside: centres outside the
    box. close, deep, gone: keys of a grain with each.
    """

    nearest: float = np.inf
    deepest: float = 0.0
    outside: int = 0
    close: Path = ()
    deep: Path = ()
    gone: Path = ()


def starts(config: LbmDemConfig) -> tuple[float, float, int]:
    """The numbers of `survey`."""
    return survey(config)[:3]


def survey(config: LbmDemConfig) -> Survey:
    """How grains at given positions lie; those of a law of diameters count as its smallest."""
    sets = [grains for grains in config.grains if len(grains.centres)]
    if not sets:
        return Survey()
    counts = [len(grains.centres) for grains in sets]
    keys = position_keys(config)
    x = np.concatenate([np.array(grains.centres, float) for grains in sets])
    own = (grains.own_diameters for grains in sets)
    sizes = [np.full(n, g.smallest_diameter) if d is None else d for n, g, d in zip(counts, sets, own)]
    radius = 0.5 * np.concatenate(sizes)
    moving = np.repeat([grains.moving for grains in sets], counts)
    length = np.array(config.domain.size)
    periodic = np.array([axis in config.domain.periodic for axis in "xyz"[: len(length)]])
    outside = np.any(((x < 0.0) | (x > length)) & ~periodic, axis=1)
    gap = np.minimum(wall_gap(x, length, periodic), plane_gap(config, x))
    pressed = np.where(moving, (radius - gap) / (2.0 * radius), 0.0)
    nearest, deepest, close, deep = np.inf, float(pressed.max(initial=0.0)), 0, int(pressed.argmax())
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
        share = (radius[i] + radius[others] - distance) / (2.0 * np.minimum(radius[i], radius[others]))
        share[~(moving[others] | moving[i])] = 0.0
        if distance.min(initial=np.inf) < nearest:
            nearest, close = float(distance.min()), int(max(order[i], order[others[distance.argmin()]]))
        if share.max(initial=0.0) > deepest:
            deepest, deep = float(share.max()), int(max(order[i], order[others[share.argmax()]]))
    return Survey(nearest, deepest, int(outside.sum()), keys[close], keys[deep], keys[int(outside.argmax())])


def position_keys(config: LbmDemConfig) -> list[Path]:
    """Keys of the case that hold the position of each grain, in their order."""
    keys: list[Path] = []
    for i, grains in enumerate(config.grains):
        place: Path = ("grains", i, "position" if grains.position else "start")
        many = len(grains.position) > 1
        keys += [(*place, k) if many else place for k in range(len(grains.centres))]
    return keys


def wall_gap(x: NDArray, length: NDArray, periodic: NDArray) -> NDArray[np.float64]:
    """From centres [n, d] to the nearest side of the box, m [n]."""
    return np.where(periodic, np.inf, np.minimum(x, length - x)).min(axis=1)


def plane_gap(config: LbmDemConfig, x: NDArray) -> NDArray[np.float64]:
    """From centres [n, d] to the nearest plane in the box, m [n]."""
    gap = np.full(len(x), np.inf)
    for plane in (obstacle.shape.plane for obstacle in config.obstacle):
        if plane is not None:
            normal = np.array(plane.normal) / np.linalg.norm(plane.normal)
            gap = np.minimum(gap, product(x - np.array(plane.point), normal))
    return gap


def law_diameters(n: int, low: float, high: float, a: float, b: float, dimensions: int) -> NDArray[np.float64]:
    """Diameters [n] of `packing.beta_diameters` in order of size: the middles of n parts of equal number, so they
    follow the law as well as n grains can.
    """
    from scipy.special import betainc

    edges = np.linspace(0.0, 1.0, 1 + (1 << 14))
    middle = low + (high - low) * 0.5 * (edges[1:] + edges[:-1])
    number = np.cumsum(np.diff(betainc(a, b, edges)) / math.prod([middle] * dimensions))
    wanted = (np.arange(n) + 0.5) / n * number[-1]
    return low + (high - low) * np.interp(wanted, np.concatenate(([0.0], number)), edges)


def law_volume(law: Diameters, dimensions: int) -> float:
    """Volume of all grains of a law, m3 (m2 in 2D). Of very many, a sample stands for the others."""
    n = min(law.count, SAMPLE)
    diameters = law_diameters(n, law.min, law.max, law.a, law.b, dimensions)
    return solid_volume(0.5 * diameters, dimensions) * (law.count / n)


def solid_volume(radius: NDArray, dimensions: int) -> float:
    """Volume of all grains of these radii, m3 (m2 in 2D)."""
    return float(np.sum(math.pi * radius**2 if dimensions == 2 else 4.0 / 3.0 * math.pi * radius * radius * radius))


def packed_space(config: LbmDemConfig, grains: GrainSet, solid: float) -> float:
    """Upper end (m) of the space that a packing of grains of this volume fills, or from which it falls."""
    packing, law = grains.packing, grains.diameters
    assert packing is not None and law is not None
    ends, tops = packing_ends(config, grains)
    area = math.prod(top - end for end, top in zip(ends[:-1], tops))
    high = ends[-1] + solid / (1.0 - (packing.porosity or LOOSE)) / area
    if below := space_below(config, grains):
        heights, space = below
        wanted = solid / (1.0 - (packing.porosity or LOOSE))
        high = float(np.interp(wanted, space, heights)) + max(0.0, wanted - space[-1]) / area
    if packing.porosity is None:
        high = min(max(high, ends[-1] + LAYERS * law.max), packing.high or tops[-1], tops[-1])
    return high


def packing_area(config: LbmDemConfig, grains: GrainSet, high: float) -> float:
    """Section (m2, in 2D m) that the box and planes leave to a packing across the last axis, mean up to a height, m."""
    ends, tops = packing_ends(config, grains)
    if (below := space_below(config, grains)) and high > ends[-1]:
        return float(np.interp(high, *below)) / (min(high, tops[-1]) - ends[-1])
    return math.prod(top - end for end, top in zip(ends[:-1], tops))


def space_below(config: LbmDemConfig, grains: GrainSet) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Heights (m), and the volume (m3, in 2D m2) that slanted planes leave to a packing below each; None without them.
    It is counted at points, POINTS along each side and the height.
    """
    planes = [obstacle.shape.plane for obstacle in config.obstacle if obstacle.shape.plane is not None]
    slanted = [plane for plane in planes if sum(map(bool, plane.normal)) > 1]
    if not slanted:
        return None
    ends, tops = (np.array(one) for one in packing_ends(config, grains))
    d = len(ends)
    middles = (np.arange(POINTS[d]) + 0.5) / POINTS[d]
    lines = [low + (high - low) * middles for low, high in zip(ends[::-1], tops[::-1])]
    points = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, d)[:, ::-1]  # layer by layer
    before = [product(points - np.array(plane.point), np.array(plane.normal)) > 0.0 for plane in slanted]
    layers = np.all(before, axis=0).reshape(POINTS[d], -1).mean(axis=1)
    space = np.concatenate([[0.0], np.cumsum(layers)]) * float(np.prod(tops - ends)) / POINTS[d]
    return np.linspace(ends[-1], tops[-1], POINTS[d] + 1), space


def packing_ends(config: LbmDemConfig, grains: GrainSet) -> tuple[list[float], list[float]]:
    """Lower and upper ends (m) along each axis of what the box, planes across an axis and `low` leave to a packing; no
    lower than a slanted floor gets anywhere.
    """
    assert grains.packing is not None
    ends, tops = ends_between_planes(config.domain.size, config.obstacle)
    ends[-1] = max(ends[-1], grains.packing.low, cover(config))
    return ends, tops
