"""Which rows the ranks have: cuts of equal cost, by where the grains are."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hpcpic.core.simd.registers import lanes
from hpcpic.core.space.domain import better_cuts, even_cuts
from lbmdem.case.config import GrainSet, LbmDemConfig
from lbmdem.forecast.node_shares import (
    LOOSE,
    covered,
    grains,
    lanes_of_all,
    links_follow_grains,
    links_of,
    porous,
    touched,
    volume,
)
from lbmdem.forecast.rates import DEFAULT, node_ns
from lbmdem.sizes import MAX_REPLICATED, STEPS_PER_PASS, STORAGE

MOST_ROWS = 1 << 14  # that are looked at before a run, for each row of a grain
SAMPLE = 1 << 12  # heights by which a packing is known before it is made
DEEP = 4 * STEPS_PER_PASS  # rows that a slab has for as many steps with links per pass over memory
CENTRES, BODIES, SOLID, TOUCHED, COVERED, LINKS = range(6)
LAYING_OUT = 2e8, 500.0, 1e4  # ns: of a layout, and of a node and a grain of a rank; twice or half costs little


class Grains(NamedTuple):
    """Heights of centres (m) and radii (nodes) of grains, and how many stand for each of these."""

    heights: NDArray[np.float64]
    radii: NDArray[np.float64]
    numbers: ArrayLike = 1.0


def expected(config: LbmDemConfig, group: GrainSet) -> Grains:
    """A set as it is at the start, as far as that is known beforehand: grains of a law of diameters have one volume."""
    d, dx, own = config.dimensions, config.spacing, group.own_diameters
    sizes = grains(config, group)
    solid = sum(n * volume(r, d) for r, n in sizes)
    heights, numbers = np.array(group.centres, np.float64).reshape(-1, d)[:, -1], 1.0
    if group.packing is not None:
        across = math.prod(config.points[:-1]) * (1 - (group.packing.porosity or LOOSE[d]))
        heights = group.packing.low + (np.arange(SAMPLE) + 0.5) / SAMPLE * (solid / across) * dx
        numbers = group.count / SAMPLE
    mean = (solid / group.count / volume(1.0, d)) ** (1 / d)
    return Grains(heights, np.full(len(heights), mean) if own is None else 0.5 * np.asarray(own) / dx, numbers)


def sums_by_row(config: LbmDemConfig, placed: Grains) -> NDArray[np.float64]:
    """What rows have of these grains [6, rows]: their centres; and, as if each were the same at all its heights, the
    grains themselves, nodes in them, vectors' boxes that touch them and that they cover, links.
    """
    d, rows = config.dimensions, config.points[-1]
    r = np.minimum(placed.radii, 0.5 * rows)  # of which a case that is refused may have larger ones
    at, numbers = placed.heights / config.spacing, np.broadcast_to(placed.numbers, r.shape)
    around = "xyz"[d - 1] in config.domain.periodic

    def inside(row: NDArray) -> NDArray[np.int64]:
        return (row % rows if around else np.clip(row, 0, rows - 1)).astype(np.int64)

    found = np.zeros((6, rows))
    found[CENTRES] = np.bincount(inside(np.floor(at)), numbers, rows)
    if config.fluid and len(r):
        width = lanes(STORAGE[config.liquid.storage])
        amounts = np.ones_like(r), volume(r, d), touched(r, width, d), covered(r, width, d), links_of(r, d)
        for k in range(math.ceil(2 * r.max()) + 1):
            row = np.floor(at - r) + k
            part = numbers * np.maximum(0.0, np.minimum(at + r, row + 1) - np.maximum(at - r, row)) / (2 * r)
            for kind, amount in enumerate(amounts, BODIES):
                found[kind] += np.bincount(inside(row), part * amount, rows)
    return found


def row_costs(config: LbmDemConfig, sums: NDArray[np.float64]) -> NDArray[np.float64]:
    """Time of a step by row, ns, with these `sums_by_row` of all grains, by DEFAULT rates, so the same on any machine.

    What every rank does, such as the motion of grains that all of them hold, is left out.
    """
    costs = fluid_costs(config, sums) if config.fluid else np.zeros(config.points[-1])
    if config.grains_move and sum(group.count for group in config.grains) > MAX_REPLICATED:
        costs += config.substeps * DEFAULT["grain_ns"] * sums[CENTRES]
    return costs


def fluid_costs(config: LbmDemConfig, sums: NDArray[np.float64]) -> NDArray[np.float64]:
    """Time of the nodes and of the links to grains. Obstacles are left out, as in `node_shares.shares`."""
    rates, d, nodes = DEFAULT, config.dimensions, math.prod(config.points[:-1])
    one, bare, more, beside = node_ns(config, rates)
    solid, touching, skipped = np.minimum(sums[SOLID : COVERED + 1] / nodes, [[0.9], [np.inf], [0.9]])
    if porous(config):
        return nodes * bare * (1 - solid) * (rates["sparse"] + more) + sums[LINKS] * rates["link_ns sparse"]
    wait = one - bare if config.grains_move else 0.0
    costs = lanes_of_all(config) / config.points[-1] * (bare * (1 + more) + wait) * (1 - skipped)
    if links_follow_grains(config):
        each = 1e3 * (rates[f"moving_grain_us {d}D"] + rates[f"moving_link_us {d}D"])
        return costs + sums[LINKS] * rates[f"link_ns moving {d}D"] + sums[BODIES] * each
    mixed = 1 - skipped - (1 - solid) * np.exp(-(touching - solid) / (1 - solid))
    costs += lanes_of_all(config) / config.points[-1] * beside * np.maximum(0.0, mixed)
    return costs + sums[LINKS] * rates["link_ns fixed"]


def laying_out(config: LbmDemConfig, ranks: int) -> float:
    """Time that a run takes to lay out its fluid and its grains anew, ns."""
    once, node, grain = LAYING_OUT
    nodes = math.prod(config.points) if config.fluid else 0
    return once + (node * nodes + grain * sum(group.count for group in config.grains)) / ranks


def first_cuts(config: LbmDemConfig, ranks: int, placed: Grains | None = None) -> tuple[int, ...]:
    """Cuts at the start: of equal cost where those of equal height are far from it, and rows are not too many to look
    at. placed: where grains are, if that is known.
    """
    rows = config.points[-1]
    even = even_cuts(rows, ranks)
    if not config.grains or not 1 < ranks <= rows <= MOST_ROWS:
        return even
    sets = [placed] if placed else [expected(config, group) for group in config.grains]
    costs = row_costs(config, np.sum([sums_by_row(config, one) for one in sets], axis=0))
    deep = config.fluid is not None and not config.grains_move
    return better_cuts(costs, even, minimum=min(DEEP, rows // ranks) if deep else 1) or even
