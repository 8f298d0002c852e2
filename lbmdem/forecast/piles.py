"""What lies on the lowest grains of a bed, a pile or a column, from the case alone."""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lbmdem.case.config import AXES, GrainSet, LbmDemConfig, grain_mass
from lbmdem.forecast.node_shares import LOOSE, grains, volume
from lbmdem.setup.overlap_survey import packed_space, packing_area, packing_ends

REPOSE = 0.4  # slope of a heap
APART = 1.5  # sums of two radii between heights of centres, beyond which the upper grain does not stand on the lower
MOST_TRIED = 1000  # of the lowest grains of a set, and MOST_PAIRS of them with those above
MOST_PAIRS = 20_000_000


class Bed(NamedTuple):
    """Solids that stay: their volume (m3, in 2D m2), surface, and ends along an axis, m."""

    solid: float
    surface: float
    low: float
    high: float


def weight_in_fluid(config: LbmDemConfig, group: GrainSet, size: float) -> float:
    """Weight of a grain of this diameter less its buoyancy, N (N/m in 2D); negative of one that rises."""
    lighter = 1.0 - (config.liquid.density if config.fluid else 0.0) / group.density
    return grain_mass(group, size, config.dimensions) * math.hypot(*config.gravity) * lighter


def whole_weight(config: LbmDemConfig, group: GrainSet) -> float:
    """Weight of all grains of a set less their buoyancy, without its sign, N (N/m in 2D)."""
    return sum(n * abs(weight_in_fluid(config, group, 2.0 * r * config.spacing)) for r, n in grains(config, group))


def heap(count: float, d: int) -> float:
    """How many diameters high so many grains lie where nothing but the slope of repose holds them: a wedge, a cone."""
    filled = 1.0 - LOOSE[d]
    wedge, cone = math.pi / 4.0 * REPOSE / filled, 0.5 * REPOSE**2 / filled
    return math.sqrt(wedge * count) if d == 2 else math.cbrt(cone * count)


def layers_at_rest(config: LbmDemConfig, group: GrainSet) -> float:
    """How many diameters high the grains of a set lie on the floor, loosely packed, but at least one: on that of the
    box, or what planes leave of it to a packing. Packings above it count as so many more layers of it."""
    d, down = config.dimensions, int(np.argmax(np.abs(config.gravity)))
    size, height = group.largest_diameter, config.domain.size[down]
    solid = config.spacing**d * sum(n * volume(r, d) for r, n in grains(config, group))
    floor = math.prod(config.domain.size) / height
    if group.packing is not None and down == d - 1:
        floor = packing_area(config, group, packed_space(config, group, solid))
    own = max(1.0, min(group.count, height / size, solid / (floor * (1.0 - LOOSE[d]) * size)))
    sets = [other for other in config.grains if other.moving and other.packing and lower(config, group, other)]
    unit = weight_in_fluid(config, group, 1.0)
    bears = [whole_weight(config, other) for other in sets if unit * weight_in_fluid(config, other, 1.0) > 0.0]
    return own * (1.0 + sum(bears) / whole_weight(config, group)) if bears else own


def lower(config: LbmDemConfig, group: GrainSet, other: GrainSet) -> bool:
    """Whether the lowest grain of a set starts below that of another along gravity."""
    down = int(np.argmax(np.abs(config.gravity)))
    one, two = span(config, group, down), span(config, other, down)
    return one.low < two.low if config.gravity[down] < 0.0 else one.high > two.high


def smallest_below(config: LbmDemConfig, i: int) -> float:
    """Diameter (m) of the smallest grain of the sets that start below a set, or without gravity of any other; infinite
    without one."""
    group, others = config.grains[i], [other for k, other in enumerate(config.grains) if k != i]
    met = [other for other in others if not any(config.gravity) or lower(config, other, group)]
    return min((other.smallest_diameter for other in met), default=math.inf)


@lru_cache(maxsize=8)  # many grains take a while
def standing(config: LbmDemConfig) -> list[float]:
    """The largest weight (N, in 2D N/m) on the floor below a grain of each set, its own and that of those which stand
    above it at the start, of each what lies in its shadow; 0 of sets without positions, and of those that stay."""
    d, down, length = config.dimensions, int(np.argmax(np.abs(config.gravity))), np.array(config.domain.size)
    found, across = [0.0] * len(config.grains), [k for k in range(d) if k != down]
    sets = [i for i, group in enumerate(config.grains) if group.moving and len(group.centres)]
    if not sets:
        return found
    rows = [sized(config, config.grains[i]) for i in sets]
    x, radius, weight = (np.concatenate([row[k] for row in rows]) for k in range(3))
    of = np.repeat(sets, [len(row[1]) for row in rows])
    height = -math.copysign(1.0, config.gravity[down]) * np.sign(weight) * x[:, down]
    around = np.array([AXES[k] in config.domain.periodic for k in across])
    most = min(MOST_TRIED, math.ceil(MOST_PAIRS / len(x)))
    for i in sets:
        own = np.flatnonzero(of == i)
        for g in own[np.argsort(height[own], kind="stable")[:most]]:
            away = x[:, across] - x[g, across]
            away -= np.where(around, length[across] * np.rint(away / length[across]), 0.0)
            distance = np.sqrt((away * away).sum(axis=1))
            above = (height >= height[g]) & (weight * weight[g] > 0.0) & (distance < radius + radius[g])
            pile = np.flatnonzero(above)[np.argsort(height[above], kind="stable")]
            gaps = np.diff(height[pile]) > APART * (radius[pile][1:] + radius[pile][:-1])
            pile = pile[: int(np.argmax(gaps)) + 1] if gaps.any() else pile
            share = in_shadow(distance[pile], radius[pile], float(radius[g]), d)
            found[i] = max(found[i], float(np.sum(share * np.abs(weight[pile]))))
    return found


def sized(config: LbmDemConfig, group: GrainSet) -> tuple[NDArray, NDArray, NDArray]:
    """Centres [n, d] (m), radii [n] (m) and weights [n] of a set; a law of diameters counts by its mean ones."""
    x, own = np.array(group.centres, np.float64), group.own_diameters
    if own is None:
        solid = sum(n * volume(r * config.spacing, config.dimensions) for r, n in grains(config, group))
        mean = (solid / group.count / volume(0.5, config.dimensions)) ** (1.0 / config.dimensions)
        own = np.full(len(x), mean)
    unit = weight_in_fluid(config, group, 1.0)
    return x, 0.5 * own, unit * own**config.dimensions


def in_shadow(distance: NDArray, radius: NDArray, r: float, d: int) -> NDArray[np.float64]:
    """The share of grains of these radii that lies above one of radius r, whose axis is so far from theirs: that of two
    equal intervals or circles that overlap, of the smaller where they differ, and of the larger one its part."""
    least = np.minimum(radius, r)
    s = np.clip((distance - np.abs(radius - r)) / (2.0 * least), 0.0, 1.0)
    lens = 1.0 - s if d == 2 else (np.arccos(s) - s * np.sqrt(1.0 - s * s)) * 2.0 / math.pi
    return lens * (least / radius) ** (d - 1)


def span(config: LbmDemConfig, group: GrainSet, k: int) -> Bed:
    """A set of grains as a bed."""
    d, dx = config.dimensions, config.spacing
    each = [(r * dx, n * volume(r * dx, d)) for r, n in grains(config, group)]
    solid, surface = sum(part for _, part in each), sum(d * part / r for r, part in each)
    low, high = 0.0, config.domain.size[k]
    if group.packing is not None and k == d - 1:
        low, high = packing_ends(config, group)[0][k], packed_space(config, group, solid)
    elif len(group.centres):
        x, r = np.asarray(group.centres)[:, k], 0.5 * group.largest_diameter
        low, high = max(low, float(x.min()) - r), min(high, float(x.max()) + r)
    return Bed(solid, surface, low, high)


def denseness(config: LbmDemConfig, group: GrainSet) -> float:
    """Solid fraction of a set at the start, between its lowest and its highest grain, over that of one that settles."""
    loose = LOOSE[config.dimensions]
    if group.packing is not None:
        return (1.0 - (group.packing.porosity or loose)) / (1.0 - loose)
    down = int(np.argmax(np.abs(config.gravity)))
    bed = span(config, group, down)
    room = math.prod(config.domain.size) / config.domain.size[down] * max(bed.high - bed.low, 1e-300)
    return bed.solid / room / (1.0 - loose)


def lies(config: LbmDemConfig, group: GrainSet) -> bool:
    """Whether grains are at rest on each other at the start, as settled or placed as dense."""
    return (group.packing is not None or group.count > 1) and denseness(config, group) >= 1.0


def filled(config: LbmDemConfig, group: GrainSet, axis: int, height: NDArray) -> NDArray[np.float64]:
    """How high (m) [n] the grains of a set at given positions that are lower than each of its grains lie on the floor
    across an axis once they have settled on all of it; height[n]: of their centres, m."""
    d, order = config.dimensions, np.argsort(height, kind="stable")
    floor = math.prod(config.domain.size) / config.domain.size[axis]
    volumes = math.pi * sized(config, group)[1][order] ** d * (1.0 if d == 2 else 4.0 / 3.0)
    found = np.empty(len(height))
    found[order] = np.cumsum(volumes) - volumes
    return found / floor / (1.0 - LOOSE[d])


def settled_height(config: LbmDemConfig, group: GrainSet, axis: int) -> float:
    """How high (m) a set lies on the whole floor across an axis, loosely packed."""
    d, floor = config.dimensions, math.prod(config.domain.size) / config.domain.size[axis]
    return span(config, group, axis).solid / floor / (1.0 - LOOSE[d])


def sinks(config: LbmDemConfig, group: GrainSet) -> float:
    """How far (m) the top of a packing falls as the loose grains below it settle; 0 where they are at rest."""
    bed = span(config, group, config.dimensions - 1)
    return (bed.high - bed.low) * max(0.0, 1.0 - denseness(config, group))
