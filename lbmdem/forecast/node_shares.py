"""How many nodes lie beside solids, before anything is placed: what the sweep of a lattice costs depends on it.

The sweep goes by vectors of nodes along x. Those without fluid cost nothing, those whose nodes and all their neighbours
are fluid the least, those beside solids more, but for grains that are linked at every step: what is beside and in them
is swept like fluid. Of grains that stand apart the shares follow from the volumes swept by boxes that touch a grain
(Steiner's formula) or are inside of it; of those that fill a sample, hard spheres leave a place free with the
probability (1 - s) exp(-e / (1 - s)), where s is their volume and e what a touching box adds to it (scaled particle
theory, to first order).
"""

import math
from collections.abc import Iterator
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.simd.registers import has_masks, lanes
from hpcpic.core.space.declared import Array
from lbmdem.case.config import Diameters, GrainSet, LbmDemConfig
from lbmdem.physics.velocity_sets import LATTICES
from lbmdem.physics.wall_rules import RULES
from lbmdem.sizes import CACHE, SPARSE_BELOW, STORAGE

Radii = TypeVar("Radii", float, NDArray[np.float64])  # in nodes
SIZES = 32  # of the law of diameters
LOOSE = {2: 0.2, 3: 0.4}  # void fraction of a packing that settles
LINKS = {2: 3.07, 3: 5.74}  # per node of a grain's perimeter or surface: half the sum of |e . n|, any direction n


class Shares(NamedTuple):
    """Shares of all vectors of nodes: those without fluid, and those beside solids or sides of the box."""

    skipped: float
    mixed: float


def sizes(law: Diameters, d: int) -> Iterator[tuple[float, float]]:
    """(diameter m, share of the grains): Voivret et al. 2007, the law is that of the volume of smaller grains."""
    places = [(k + 0.5) / SIZES for k in range(SIZES)]
    found = [law.min + (law.max - law.min) * x for x in places]
    logs = [(law.a - 1) * math.log(x) + (law.b - 1) * math.log1p(-x) - d * math.log(s) for x, s in zip(places, found)]
    weights = [math.exp(value - max(logs)) for value in logs]
    total = sum(weights)
    yield from ((size, weight / total) for size, weight in zip(found, weights))


def grains(config: LbmDemConfig, group: GrainSet) -> list[tuple[float, float]]:
    """(radius in nodes, number) of a set."""
    own = group.given("diameter")
    if own is not None:
        return [(0.5 * float(size) / config.spacing, 1.0) for size in own]
    law = sizes(group.law, config.dimensions) if group.diameter is None else [(group.diameter, 1.0)]
    return [(0.5 * size / config.spacing, share * group.count) for size, share in law]


def touched(r: Radii, width: int, d: int) -> Radii:
    """Nodes swept by the centre of a vector's box, its neighbours included, that touches a grain of this radius."""
    a, b = width + 1.0, 2.0
    if d == 2:
        return math.pi * r * r + 2 * r * (a + b) + a * b
    return 4 / 3 * math.pi * r**3 + math.pi * r * r * (a + 2 * b) + 2 * r * (2 * a * b + b * b) + a * b * b


def covered(r: Radii, width: int, d: int) -> Radii:
    """Nodes swept by the centre of a vector's box all of whose nodes are inside the grain."""
    s = width - 1.0
    r = np.maximum(r, 0.5 * s)  # no grain that is smaller has such a box
    if d == 2:
        return 2 * r * r * np.arccos(s / (2 * r)) - 0.5 * s * np.sqrt(4 * r * r - s * s)
    return 4 / 3 * math.pi * r**3 - math.pi * r * r * s + math.pi * s**3 / 12


def volume(r: Radii, d: int) -> Radii:
    return math.pi * r * r if d == 2 else 4 / 3 * math.pi * r**3


def links_of(r: Radii, d: int) -> Radii:
    """Links to a grain of this radius, on the mean."""
    return LINKS[d] * math.pi * (2 * r) ** (d - 1)


def shares(config: LbmDemConfig) -> Shares:
    """The shares of the lattice of a case with fluid; obstacles are left out."""
    d, width, nodes = config.dimensions, lanes(STORAGE[config.liquid.storage]), math.prod(config.points)
    skipped, plain, moving_links = 0.0, beside_sides(config, width), links_follow_grains(config)
    for group in config.grains:
        sizes = grains(config, group)
        solid, touching, inside = (sum(n * of(r) for r, n in sizes) / nodes for of in (
            lambda r: volume(r, d), lambda r: touched(r, width, d), lambda r: covered(r, width, d),
        ))  # fmt: skip
        filled = min(1.0, solid / (1 - (group.packing.porosity or LOOSE[d]))) if group.packing else 1.0
        solid, touching = min(0.9, solid / filled), touching / filled  # of the part of the box where the grains are
        none_touches = math.exp(-(touching - solid) / (1 - solid))
        plain *= 1.0 if moving_links else 1 - filled + filled * (1 - solid) * none_touches
        skipped += inside
    skipped = min(skipped, 0.9)
    plain *= 1 - skipped if moving_links else 1.0
    return Shares(skipped, max(0.0, 1 - plain - skipped))


def links_follow_grains(config: LbmDemConfig) -> bool:
    """True when all links to grains are done after the sweep (Fluid.leave_to_links)."""
    return config.grains_move and not config.coupling.frozen


def sparse(config: LbmDemConfig) -> bool:
    """True when this processor holds the fluid nodes alone (fluid.sparse)."""
    return has_masks() and porous(config)


def porous(config: LbmDemConfig) -> bool:
    """True when a processor with masks holds the fluid nodes alone."""
    stays, rules = not config.grains_move or config.coupling.frozen, config.coupling
    general = RULES[rules.bounce_back].reach < 2 and not rules.keeps_mass
    return stays and general and fluid_share(config) < SPARSE_BELOW


def node_bytes(config: LbmDemConfig) -> int:
    """Bytes of the populations of a node."""
    q = LATTICES[config.lattice].q
    return Array("node", (q,), STORAGE[config.liquid.storage]).bytes


def population_bytes(config: LbmDemConfig) -> int:
    return math.prod(config.points) * node_bytes(config)


def cached(config: LbmDemConfig) -> bool:
    return population_bytes(config) < CACHE


def lanes_of_all(config: LbmDemConfig) -> int:
    """Nodes that a lattice has room for in its vectors: rows along x are whole vectors."""
    width = lanes(STORAGE[config.liquid.storage])
    return -(-config.points[0] // width) * width * math.prod(config.points[1:])


def fluid_share(config: LbmDemConfig) -> float:
    """Share of the nodes that no grain covers."""
    solid = sum(n * volume(r, config.dimensions) for group in config.grains for r, n in grains(config, group))
    return max(0.1, 1 - solid / math.prod(config.points))


def beside_sides(config: LbmDemConfig, width: int) -> float:
    """The share of vectors that are whole and at no side of the box."""
    across = -(-config.points[0] // width)
    ends = int(config.points[0] % width > 0) if "x" in config.domain.periodic else min(2, across)
    share = 1 - ends / across
    for axis, n in zip("yz"[: config.dimensions - 1], config.points[1:]):
        share *= 1 - (0 if axis in config.domain.periodic else min(2, n)) / n
    return share
