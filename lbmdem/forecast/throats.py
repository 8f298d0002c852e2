"""Gaps that are too narrow for the lattice: between discs that stay, and between these and walls; and pores that are
too narrow for the collision.

Measured are the flows that a body force drives through square arrays of discs, and past discs in the middle of a
channel, at offsets from the nodes (docs/measured/lbmdem.md). Spheres leave wider ways beside their narrowest gaps:
arrays of them are right by the nodes across a sphere, whatever their gaps, so no gap is told in 3D.

With TRT the permeability of a bed does not depend on tau. Central moments and BGK shift every wall by a part of a node,
which is most of a narrow pore.
"""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.case.derived import Derived, judged
from lbmdem.case.boundaries import ends_between_planes
from lbmdem.case.config import AXES, LbmDemConfig
from lbmdem.forecast.free_fall import stays
from lbmdem.forecast.piles import span, standing, weight_in_fluid
from lbmdem.forecast.relaxation import SPACING, finer
from lbmdem.setup.overlap_survey import plane_gap

BETWEEN_DISCS, BESIDE_WALLS = 5.0, 2.0  # nodes in a gap, from which on it is right within about 4 and 2 %
CLOSED = 1e-3  # nodes: what is nearer touches, and nothing flows between
# Permeability over that with TRT, by tau: 12 spheres of 8.2 nodes, porosity 0.4, in a periodic box, measured
PACKING = {
    "central": ((0.51, 0.21), (0.55, 0.47), (0.7, 0.79), (0.9, 1.01), (1.2, 1.27), (1.5, 1.49), (2.0, 1.8)),
    "BGK": ((0.52, 0.1), (0.55, 0.24), (0.7, 0.61), (0.9, 0.95), (1.0, 1.1), (1.2, 1.4)),
}
OF_PACKING = 3.66  # nodes: its hydraulic diameter
PILED = 3.0  # weights of a disc on the lowest of a pile, which encloses pores
MOST_OFF = 0.05  # of the flow, which may then be off by 0.12


def throats(config: LbmDemConfig) -> Iterator[Derived]:
    """The narrowest gaps beside discs that stay at positions that the case gives, in nodes, and beside discs that move
    and leave the fluid no other way."""
    if config.grains_move and not config.coupling.frozen:
        yield from beside_pistons(config)
    sets = [group for group in config.grains if not group.moving and len(group.centres)]
    if config.dimensions == 3 or not sets:
        return
    x = np.concatenate([np.array(group.centres, np.float64) for group in sets])
    own = [(len(group.centres), group.own_diameters, group.smallest_diameter) for group in sets]
    radius = 0.5 * np.concatenate([np.full(n, least) if sizes is None else sizes for n, sizes, least in own])
    for beside, gap, least, source in (
        ("discs that stay", between_discs(config, x, radius), BETWEEN_DISCS, "28 % at 2.5, 12 at 3, 7 at 4, 4 at 5"),
        ("a disc that stays and a wall", beside_walls(config, x, radius), BESIDE_WALLS, "20 % at 1, 2 at 2"),
    ):
        if math.isfinite(gap):
            yield narrow(config, f"narrowest gap between {beside}", gap, least, f"flow through it, off by {source}")


def narrow(config: LbmDemConfig, name: str, gap: float, least: float, source: str) -> Derived:
    """A gap (m) against so many nodes."""
    nodes = gap / config.spacing
    return judged(
        name, "h/dx", nodes, ok=nodes >= least * (1.0 - 1e-9), legal=True, limit=f">= {least:g}", source=source,
        cure=f"{finer(config, gap / least)} resolves it", key=SPACING,
    )  # fmt: skip


def beside_pistons(config: LbmDemConfig) -> Iterator[Derived]:
    """The gaps on both sides of a disc that moves in the middle between walls, where it fills more than half of them.
    Measured is how fast it sinks, with gaps of 0.15 and 0.35 of its radius."""
    ends, tops = ends_between_planes(config.domain.size, config.obstacle)
    source = "speed at which it sinks, too fast by 8 to 39 % at 1 and 1.5, 1 to 5 at 2"
    for group in config.grains:
        size = group.largest_diameter
        rooms = [tops[k] - ends[k] for k in range(2) if AXES[k] not in config.unwalled]
        gap = min([0.5 * (room - size) for room in rooms if room < 2.0 * size], default=math.inf)
        if group.moving and config.dimensions == 2 and CLOSED * config.spacing < gap < math.inf:
            name = f"gaps beside {group.name} in the middle between walls"
            yield narrow(config, name, gap, BESIDE_WALLS, source)


def between_discs(config: LbmDemConfig, x: NDArray[np.float64], radius: NDArray[np.float64]) -> float:
    """The narrowest gap (m) between discs at x[n, 2], also across periodic sides; infinite where all are wide."""
    from scipy.spatial import cKDTree

    length = np.array(config.domain.size)
    periodic = np.array([axis in config.domain.periodic for axis in AXES[:2]])
    place = np.where(periodic, x % length, x)
    place[periodic & (place >= length)] = 0.0  # of a remainder that was rounded up
    tree = cKDTree(place, boxsize=np.where(periodic, length, 0.0))  # 0: no period
    pairs = tree.query_pairs(2.0 * (float(radius.max()) + BETWEEN_DISCS * config.spacing), output_type="ndarray")
    apart = place[pairs[:, 0]] - place[pairs[:, 1]]
    apart -= np.where(periodic, length * np.rint(apart / length), 0.0)
    gaps = np.hypot(apart[:, 0], apart[:, 1]) - radius[pairs].sum(axis=1)
    own = [side - 2.0 * radius for side in length[periodic]]  # to its own image
    return narrowest(np.concatenate([gaps, *own]), config.spacing)


def beside_walls(config: LbmDemConfig, x: NDArray[np.float64], radius: NDArray[np.float64]) -> float:
    """The narrowest gap (m) between discs at x[n, 2] and walls of the box, or planes; infinite without."""
    opened = {face.face for face in config.boundary if face.is_open}
    away = [plane_gap(config, x)]
    for axis, along, length in zip(AXES, x.T, config.domain.size):
        if axis not in config.domain.periodic:
            away += [far for side, far in (("-", along), ("+", length - along)) if axis + side not in opened]
    return narrowest(np.min(away, axis=0) - radius, config.spacing)


def narrowest(gaps: NDArray[np.float64], spacing: float) -> float:
    """The least of gaps (m) that are open; infinite without any."""
    return float(gaps.min(initial=math.inf, where=gaps > CLOSED * spacing))


def closed(config: LbmDemConfig) -> Iterator[Derived]:
    """Beds and piles of discs that move in a fluid: where they touch, no fluid gets from pore to pore."""
    if config.dimensions == 3 or not any(config.gravity):
        return
    for group, below in zip(config.grains, standing(config)):
        own = abs(weight_in_fluid(config, group, group.largest_diameter))
        if not stays(config, group) and own and (group.packing is not None or below > PILED * own):
            yield Derived(
                f"pores between discs of {group.name} that touch", "k", 0.0, "m2",
                source="closed in 2D: it drains, dilates and flows as contacts open; spheres leave ways",
            )  # fmt: skip


def pores(config: LbmDemConfig) -> Iterator[Derived]:
    """The flow between grains that stay over that of TRT: as in the packing that was measured, to the power of its
    hydraulic diameter over that of the case. Its logarithm is 0.4 to 2.3 times that of arrays of discs and spheres
    with gaps of 2 to 8 nodes.
    """
    found = PACKING.get(config.liquid.collision)
    held = [group for group in config.grains if stays(config, group)]
    if found is None or not held:
        return
    tau, share = np.array(found).T
    through = math.exp(float(np.interp(config.tau, tau, np.log(share))) * OF_PACKING / pore(config))
    yield judged(
        "flow between grains that stay, over TRT's", "k/k_TRT", through, ok=abs(through - 1.0) <= MOST_OFF, legal=True,
        limit=f"within 1 +- {MOST_OFF:g}", source=f"{config.liquid.collision}, measured in packings and arrays",
        cure=f"walls lie elsewhere, by tau = {config.tau:.4g}: with collision = \"TRT\" they do not",
        key=("fluid", "collision"),
    )  # fmt: skip


def pore(config: LbmDemConfig) -> float:
    """Nodes in the hydraulic diameter, four times the volume over the surface, between grains that stay: in the sample
    of a packing, otherwise in the whole box."""
    last, room = config.dimensions - 1, math.prod(config.domain.size)
    solid = surface = 0.0
    narrowest = math.inf
    for group in config.grains:
        if stays(config, group):
            bed = span(config, group, last)
            solid, surface = solid + bed.solid, surface + bed.surface
            if group.packing is not None:
                sample = room * (bed.high - bed.low) / config.domain.size[last]
                narrowest = min(narrowest, 4.0 * (sample - bed.solid) / bed.surface)
    narrowest = min(narrowest, 4.0 * (room - solid) / surface)
    return max(narrowest / config.spacing, 0.5)
