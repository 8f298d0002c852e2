"""The numbers that decide whether contacts of grains are stable and stiff enough: their step and overlaps."""

import math
from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.case.config import Path, dotted
from hpcpic.core.case.derived import Derived, Verdict, judged, rounded_up
from hpcpic.core.physics.contact_law import deepest_overlap
from hpcpic.core.space.products import product
from lbmdem.case.config import ACCURATE, GrainSet, LbmDemConfig, contact_law, contact_step, grain_mass
from lbmdem.forecast.estimate import phases
from lbmdem.forecast.films import expected_substeps, films, pressed
from lbmdem.forecast.free_fall import impact_speed
from lbmdem.forecast.piles import denseness, heap, layers_at_rest, smallest_below, standing, weight_in_fluid
from lbmdem.forecast.rates import DEFAULT
from lbmdem.setup.overlap_survey import survey

DEAR_SUBSTEPS = 1000  # of the contacts in a step of the fluid, which take longer than all else
FEW_SUBSTEPS = 20  # with which films of touching discs have 0.2 % of their resistance, and a suspension its stress
MAX_SUBSTEPS = 100_000
CHAINS = 4.0  # times the mean overlap below a bed: its deepest, measured 2.5 (equal discs) to 3.8 (1 : 1.5)
PILE = 2.0  # layers of grains, from which on they lie on each other
UNEVEN = 1.25  # times the mean weight on a floor: from there on it is a pile's; in even beds columns of up to 1.16 are
DENSE = 0.45  # of the density of a bed that has settled: from it on layers that land stop each other
REBOUND = 10.0  # Stokes number rho_s v D/(9 mu) up to which a film brings a grain to rest
WAYS = 5  # along each axis, of a lattice of directions


def contacts(config: LbmDemConfig) -> Iterator[Derived]:
    """The time step of the contacts against its limit, and how far grains overlap under their weight."""
    limit = contact_step(config)
    if not math.isfinite(limit):
        return
    if config.fluid:
        yield substeps(config)
    share, good = config.time_step / config.substeps / limit, ACCURATE * limit
    yield judged(
        "step of the contacts", "dt/dt_max", share, ok=share <= 2.01 * ACCURATE, legal=share < 1.0, limit="<= 0.4, < 1",
        source="velocity Verlet with damped contacts on all sides (physics.contact_law)", stable_below=1.0,
        cure=f"substeps = {math.ceil(config.time_step / good)}" if config.fluid else f"time_step = {good:.3g}",
        key=("coupling", "substeps") if config.fluid else ("simulation", "time_step"),
    )  # fmt: skip
    if config.fluid and config.coupling.lubrication and not config.coupling.frozen:
        yield films(config)
    yield from overlaps(config)
    yield from narrow_gaps(config)


def narrow_gaps(config: LbmDemConfig) -> Iterator[Derived]:
    """The flow that central moments let through a gap of one node, over that of lubrication theory: it is as if the
    product of times of the two rates were (tau - 1/2)/2, and holds back what grains that strike squeeze out."""
    if not config.fluid or config.liquid.collision != "central" or config.coupling.frozen:
        return
    if config.grains_move:
        strikes = any(share for share, _ in overlaps_of_falls(config)) or any(overlaps_of_pairs(config))
        share = 4.0 * (config.tau - 0.5)
        yield judged(
            "flow through a gap of one node", "q/q_0", share, ok=share >= 0.5 or not strikes, legal=True,
            limit=">= 0.5 where grains strike", source="4 (tau - 1/2), measured; TRT 1.5",
            cure="a steel ball of ten nodes left a wall with 0.52 and 0.25 of its speed at tau = 0.51 and 0.5024, with "
            '0.69 and 0.79 by collision = "TRT" (experiments 0.76), which is right where it is stable',
            key=("fluid", "collision"),
        )  # fmt: skip


def substeps(config: LbmDemConfig) -> Derived:
    """The number of substeps of the contacts in a step of the fluid, what they take, and how to have fewer."""
    number = config.substeps
    verdict: Verdict = "ok" if number <= MAX_SUBSTEPS else "fail"
    note, key, step = "", ("contact", "normal_stiffness"), phases(config, 1, 1, DEFAULT, 1)
    spent, share = step["grains"], step["grains"] / sum(step.values())
    if number > DEAR_SUBSTEPS:
        softer = config.contact.normal_stiffness * (DEAR_SUBSTEPS / number) ** 2
        note = f"contact.normal_stiffness = {softer:.2g} takes {DEAR_SUBSTEPS}, and overlaps grow as its inverse"
        rest = max(overlap_at_rest(config, i)[0] for i in range(len(config.grains)))
        note += f", at rest to {rest * config.contact.normal_stiffness / softer:.2g}" if rest else ""
        note += f"; now they take about {spent:.2g} s of a step, {share:.0%} of it"
    elif (wanted := expected_substeps(config)) > number and share > 0.5:
        note = f"films of grains that touch take up to {wanted}, {share:.0%} of a step; with coupling.substeps = "
        note += f"{max(number, FEW_SUBSTEPS)} a sheared suspension of discs had the same stress to 0.4 %"
    limit, cure = f"<= {MAX_SUBSTEPS:g}", note if verdict == "fail" else ""
    return Derived("substeps of the contacts", "n_d", float(number), "", limit, verdict, note, cure, key, True)


def overlaps(config: LbmDemConfig) -> Iterator[Derived]:
    """The overlap at rest below all layers of grains, and the deeper one of a fall onto the wall below from positions
    that the case gives and of two grains that start towards each other."""
    gravity, d, law = math.hypot(*config.gravity), config.dimensions, contact_law(config)
    key, falls, pairs = ("contact", "normal_stiffness"), overlaps_of_falls(config), overlaps_of_pairs(config)
    for i, group in enumerate(config.grains):
        if not group.moving:
            continue
        size, stiffness = group.largest_diameter, config.contact.normal_stiffness
        if gravity and pressed(config):
            share, layers, source = overlap_at_rest(config, i)
            weight = abs(weight_in_fluid(config, group, size))
            enough = stiffness * share / 0.01  # 0 for what neither sinks nor rises
            cure = f"normal_stiffness = {rounded_up(enough):g} gives 1 % for {group.name}" if enough else ""
            yield overlap("overlap at rest", share, source, cure, key, forceable=share < 1.0)  # else it falls through
            if layers >= PILE:
                source = "chains of forces; a case that starts from its arrays is warned beyond 1 %"
                yield Derived("deepest overlap at rest", "delta/d", CHAINS * share, source=source)
            if law.friction and law.viscosity and not law.shear:
                high = max(layers_at_rest(config, group), heap(group.count, d))
                yield from creep(config, group, high, weight / size)
        share, how = max(falls[i], (pairs[i], "two grains that meet"))
        if share > 0.01:
            cure = f"normal_stiffness = {rounded_up(stiffness * (share / 0.01) ** 2):g} gives 1 % for {group.name}"
            free = bool(group.acceleration) and not gravity  # nobody knows its way
            cure += ", if its own acceleration lets it meet anything" if free else ""
            filmed = bool(config.fluid and config.coupling.lubrication)  # which brakes it too
            source = f"linear spring and dashpot, {how}"
            yield overlap("overlap at impact", share, source, cure, key, told_only=free or filmed)


@lru_cache(maxsize=8)  # many grains take a while
def foretold_overlap(config: LbmDemConfig) -> float:
    """The deepest overlap over a diameter that `check` tells of a case."""
    told = [*overlaps(config), *overlap_at_start(config)]
    return max([number.value for number in told if number.symbol == "delta/d"], default=0.0)


def overlaps_of_falls(config: LbmDemConfig) -> list[tuple[float, str]]:
    """The overlap of each set, over the diameter, with which its largest grain meets what is below, a wall or a grain
    that stays, and which speed that is of; 0 of grains that stay, and of those that a film brings to rest. Of dense
    layers that land each stops the next, and their dashpots take up little: the overlap is that without damping. Where
    smaller grains lie below it is over their diameter.
    """
    found = []
    for i, group in enumerate(config.grains):
        speed = float(rebounding(config, group, np.array(impact_speed(config, i)))) if group.moving else 0.0
        at_start = float(np.linalg.norm(group.at_start("velocity"), axis=1).max(initial=0.0))
        how = "free fall" if any(config.gravity) else "its speed at the start, against a wall or a grain that stays"
        if config.fluid:
            what = "speed at the start" if speed == at_start else "fall, up to its terminal speed"
            how = f"its {what}, {speed:.3g} m/s, at most"
        size, law = group.largest_diameter, contact_law(config)
        if speed and group.count > 1 and any(config.gravity) and not config.fluid and denseness(config, group) >= DENSE:
            law, how = law._replace(damping=0.0), f"{how}, of dense layers, undamped"
        depth = deepest_overlap(speed, grain_mass(group, size, config.dimensions), law)
        least = smallest_below(config, i)
        if math.sqrt(config.dimensions) * least < size:  # as many of which stop it together
            size, how = math.sqrt(config.dimensions) * least, f"{how}, onto smaller grains"
        found.append((depth / size, how))
    return found


def rebounding(config: LbmDemConfig, group: GrainSet, speed: NDArray[np.float64]) -> NDArray[np.float64]:
    """Speeds (m/s) at which the largest grain of a set meets another surface; 0 where the film between them brings it
    to rest: below a Stokes number of 10 (Gondret et al. 2002)."""
    if not (config.fluid and config.coupling.lubrication):
        return speed
    stokes = group.density * speed * group.largest_diameter / (9.0 * config.liquid.density)
    return np.where(stokes > REBOUND * config.liquid.kinematic_viscosity, speed, 0.0)


def overlap_at_rest(config: LbmDemConfig, i: int) -> tuple[float, float, str]:
    """The mean overlap, over the diameter, below all layers of a set that lies on the floor, with the packings above
    it, or below the highest pile of grains that stand on each other at the start, or where one of its grains stands on
    smaller ones, over their diameter; the layers, and what they are. 0 of grains that stay."""
    group, size = config.grains[i], config.grains[i].largest_diameter
    weight = abs(weight_in_fluid(config, group, size))
    if not group.moving or not weight:
        return 0.0, 1.0, ""
    layers, piled = layers_at_rest(config, group), standing(config)[i] / weight
    source = "weight of one layer of grains"
    if piled > UNEVEN * layers:
        layers, source = piled, f"weight of {piled:.3g} grains that stand on each other at the start"
    elif layers > 1.0:
        source = f"weight of {layers:.3g} layers of grains, in the mean"
    share, least = layers * weight / config.contact.normal_stiffness / size, smallest_below(config, i)
    alone = weight / config.dimensions / config.contact.normal_stiffness / least
    if least < size and alone > share:
        return alone, 1.0, f"weight of a grain on {config.dimensions} smaller ones"
    return share, layers, source


def overlaps_of_pairs(config: LbmDemConfig) -> list[float]:
    """The deepest overlap of each set, over the smaller diameter, when its largest grain and the largest of any set
    meet head-on with the largest difference of their velocities at the start; 0 of grains that stay.
    """
    d, law, sets = config.dimensions, contact_law(config), config.grains
    rows = [outermost(group.at_start("velocity")) if group.moving else np.zeros((0, d)) for group in sets]
    of, v = np.repeat(np.arange(len(sets)), [len(own) for own in rows]), np.concatenate(rows)
    size = np.array([group.largest_diameter for group in sets])
    mass = np.array([grain_mass(group, group.largest_diameter, d) for group in sets])
    unit, shares = deepest_overlap(1.0, 1.0, law), []
    for k, own in enumerate(rows):
        speed = rebounding(config, sets[k], np.sqrt(((own[:, None] - v) ** 2).sum(axis=-1)))
        reduced = mass[k] * mass[of] / (mass[k] + mass[of])
        share = unit * speed * np.sqrt(reduced) / np.minimum(size[k], size[of])
        shares.append(float(share.max(initial=0.0)))
    return shares


def outermost(v: NDArray[np.float64]) -> NDArray[np.float64]:
    """The rows of v[n, d] that lie farthest along one of WAYS^d directions: their largest differences are those of all
    rows to 3 %."""
    if len(v) < 3:
        return v
    ways = np.array(list(np.ndindex((WAYS,) * v.shape[1]))) - WAYS // 2
    return v[sorted({int(np.argmax(product(v, way))) for way in ways})]


def creep(config: LbmDemConfig, group: GrainSet, layers: float, weight: float) -> Iterator[Derived]:
    """How far the contacts below so many layers slip until the end, at most: friction that is smoothed by a viscosity
    holds nothing at rest. weight: of a grain over its diameter, N/m."""
    law = contact_law(config)
    diameters = law.friction * layers * weight / law.viscosity * config.simulation.end_time
    if layers >= PILE:
        yield judged(
            f"creep of {group.name} in a pile", "mu N t/(beta d)", diameters, ok=diameters <= 1.0, legal=True,
            limit="<= 1", source="T = beta v below mu N", key=("contact", "tangential"),
            cure='a slope flows on like a thick liquid; tangential = "history" lets it come to rest',
        )  # fmt: skip


def overlap_at_start(config: LbmDemConfig) -> Iterator[Derived]:
    """The deepest overlap of grains at given positions, or why they cannot start."""
    nearest, deepest, outside, close, deep, gone = survey(config)
    if outside or nearest == 0.0:
        name = "grains outside the box" if outside else "least distance of centres"
        cure = "the centre must lie in it" if outside else "no force has a direction there: move one of the two"
        limit, key = "0" if outside else "> 0", gone if outside else close
        cure = f"{dotted(key)}: {cure}"
        yield Derived(name, "n" if outside else "r", float(outside), "", limit, "fail", "", cure, key)
    elif deepest > 0.0:
        flies = "flies apart from what it touches, a grain, side of the box or plane; move it, or let packing = {..} "
        flies += "find places without overlap"
        if deep[2] == "start" and deepest < 0.1:  # arrays are mostly what an earlier run ended with
            stiffer = rounded_up(config.contact.normal_stiffness * deepest / 0.01)
            flies = f"a heap that rests so has soft contacts: normal_stiffness = {stiffer:g} where it was made gives "
            flies += "1 %; grains that do not rest fly apart"
        yield overlap("overlap at the start", deepest, "linear contacts", f"{dotted(deep)}: {flies}", deep)


def overlap(
    name: str, value: float, source: str, cure: str, key: Path, forceable: bool = True, told_only: bool = False
) -> Derived:
    """An overlap over a diameter: 1 % is as linear contacts are meant, and 10 % no contact any more. told_only: it
    refuses no case."""
    return judged(
        name, "delta/d", value, ok=value <= 0.01, legal=told_only or value < 0.1,
        limit="<= 1 %" if told_only else "<= 1 %, < 10 %",
        source=source, cure=cure, key=key, forceable=forceable,
    )  # fmt: skip
