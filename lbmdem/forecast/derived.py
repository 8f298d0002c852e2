"""The numbers that decide whether an LBM-DEM case is stable and accurate, with their limits and sources."""

import math
from collections.abc import Iterator
from typing import Literal

import numpy as np

from hpcpic.core.case.config import Path
from hpcpic.core.case.derived import Derived, judged
from hpcpic.core.files.start import arrays
from lbmdem.case.config import AXES, Diameters, GrainSet, LbmDemConfig
from lbmdem.forecast.contacts import contacts, overlap_at_start
from lbmdem.forecast.driven import between_faces, carried, driven, slip, steady, wakes, weight
from lbmdem.forecast.free_fall import falling, landing, released, screen, stays, unheld
from lbmdem.forecast.node_shares import LOOSE, fluid_share
from lbmdem.forecast.plan import grain_count
from lbmdem.forecast.pressures import inflow, parabolas, pressures
from lbmdem.forecast.relaxation import SPACING, finer, grid_reynolds, key_of_tau, relaxation, slower
from lbmdem.forecast.shaken import layers
from lbmdem.forecast.throats import closed, pores, throats
from lbmdem.physics.velocity_sets import CS2, LATTICES
from lbmdem.physics.wall_rules import RULES, impedance
from lbmdem.setup.overlap_survey import SAMPLE, law_diameters, law_volume, packed_space, packing_area, packing_ends

MOST_PLACES, PADDING = 1 << 31, 32  # of nodes in a slab, and of a row or a line of nodes beside its own
DENSEST_VOID = {2: 0.093, 3: 0.26}  # void fraction of equal discs and spheres in their densest order
GROWN, SPREAD, WALLS = 0.357, 0.23, 0.12  # least porosity of spheres that grow: see `least_porosity`
UNORDERED, ENOUGH_SPREAD, ROWS, UNORDERED_ROWS = 0.147, 0.0033, 0.4, 0.15  # of discs: `least_porosity_of_discs`
ENOUGH_NODES = {2: 10.0, 3: 7.0}  # across a grain (Mansouri et al., section 4)
DENSE, MORE_NODES = 0.2, 10.0  # solid fraction of spheres that stay at given places, from which on they need more


def derived(config: LbmDemConfig, ranks: int = 1) -> list[Derived]:
    """Every derived number of a completed case that runs on so many ranks."""
    parts = (
        relaxation, lattice_units, speeds, driven, slip, weight, steady, pressures, between_faces, inflow, parabolas,
        wakes, ringing, sloshing, layers, obstacles, throats, closed, pores, carried,
    )  # fmt: skip
    fluid = [number for part in parts for number in part(config)] if config.fluid else []
    solids = [*grains(config), *unheld(config), *contacts(config), *slices(config)]
    solids += [*sliding(config), *gauges(config)]
    return [*fluid, *solids, *sizes(config, ranks), *whole_rules(config, ranks)]


def lattice_units(config: LbmDemConfig) -> Iterator[Derived]:
    """What one of length and velocity of the lattice is, and the case's own numbers in them."""
    dx, dt = config.spacing, config.time_step
    yield Derived("lattice length", "dx", dx, "m")
    yield Derived("lattice velocity", "dx/dt", dx / dt, "m/s")
    nu, force, speed = config.liquid.kinematic_viscosity, math.hypot(*config.liquid.body_force), known_speed(config)
    yield Derived(f"viscosity of {nu:g} m2/s", "nu dt/dx2", nu * dt / dx**2)
    if force:
        yield Derived(f"body force of {force:g} m/s2", "a dt2/dx", force * dt**2 / dx)
    if speed:
        yield Derived(f"largest velocity of {speed:g} m/s", "u dt/dx", speed * dt / dx)


def known_speed(config: LbmDemConfig) -> float:
    """The largest velocity that the case itself states, m/s; what develops later is watched while it runs."""
    vectors = [face.velocity for face in config.boundary] + [obstacle.velocity for obstacle in config.obstacle]
    parabolas = (face for face in config.boundary if face.profile == "parabolic")
    peaks = ((1.5 ** len(config.walled(AXES.index(face.face[0]))), face) for face in parabolas)
    vectors += [tuple(peak * u for u in face.velocity) for peak, face in peaks]
    others = [largest(group, "velocity") + turning_speed(group) for group in config.grains]
    others += [config.liquid.initial.speed] if config.liquid.initial else []
    if config.fluid and config.fluid.start:
        velocity = arrays(config.fluid.start).get("velocity", np.zeros(1))
        others.append(math.sqrt(float((velocity**2).sum(axis=-1).max(initial=0.0))))
    return max([*(math.hypot(*vector) for vector in vectors), *others], default=0.0)


def turning_speed(grains: GrainSet) -> float:
    """Speed of the surface of the largest grain of a set about its centre, m/s."""
    return 0.5 * grains.largest_diameter * largest(grains, "angular_velocity")


def largest(grains: GrainSet, name: Literal["velocity", "angular_velocity"]) -> float:
    """The largest length of a velocity of a set at the start, m/s or rad/s."""
    return float(np.linalg.norm(grains.at_start(name), axis=1).max(initial=0.0))


def speeds(config: LbmDemConfig) -> Iterator[Derived]:
    """Mach number and grid Reynolds number of the velocities that are known beforehand."""
    u, dx, dt = known_speed(config), config.spacing, config.time_step
    mach = u * dt / dx / math.sqrt(CS2)
    if mach:
        legal = mach < 0.5
        error = f"compressibility error about {mach * mach:.1%}; " if legal else ""
        yield judged(
            "Mach number", "Ma", mach, ok=mach <= 0.1, legal=legal,
            limit="<= 0.1, < 0.5 at all" if legal else "< 0.5", source="Mansouri et al., section 3.2",
            cure=f"{error}relaxation_time = {slower(config, 0.1 / mach)} gives Ma = 0.1",
            key=key_of_tau(config), forceable=mach < 1.0,
        )  # fmt: skip
    reynolds = u * dx / config.liquid.kinematic_viscosity
    if reynolds:
        yield grid_reynolds(config, reynolds)


def ringing(config: LbmDemConfig) -> Iterator[Derived]:
    """Period of the lowest sound along an axis with a face that lets fluid through, and throws back sound: a quarter of
    a wave between a pressure face and one of another kind, half a wave between two of one kind.
    """
    for axis, length in zip(AXES, config.domain.size):
        ends = [face for face in config.boundary if face.face[0] == axis]
        if any(face.is_open for face in ends) and axis not in config.domain.periodic:
            waves = 4 if [face.type for face in ends].count("pressure") == 1 else 2
            period = waves * length * config.time_step / config.spacing / math.sqrt(CS2)
            source = "faces throw it back: means over whole periods"
            yield Derived(f"period of sound along {axis}", f"{waves} L/c", period, "s", source=source)


def sloshing(config: LbmDemConfig) -> Iterator[Derived]:
    """Frequency of shaking over that of the lowest sound between the walls that it moves: the lattice fluid gives way
    to them, by pi2/8 of its square of the way of the frame, where water would not.
    """
    if config.shaking is None:
        return
    moved = [axis for axis, part in zip(AXES, config.shaking.acceleration) if part and axis not in config.unwalled]
    length = max((config.domain.size[AXES.index(axis)] for axis in moved), default=0.0)
    ratio = 2.0 * length * config.shaking.frequency * config.time_step / config.spacing / math.sqrt(CS2)
    if not ratio:
        return
    yield judged(
        "shaking against sound", "2 f L/c", ratio, ok=ratio <= 0.2, legal=ratio < 1.0, limit="<= 0.2, < 1",
        source="compressible fluid between walls; 0.2 is an error of 5 %",
        cure=f"relaxation_time = {slower(config, 0.2 / ratio)} makes sound fast enough",
        key=key_of_tau(config), forceable=True,
    )  # fmt: skip


def grains(config: LbmDemConfig) -> Iterator[Derived]:
    """Size, resolution and density ratio of each set, and how grains overlap at the start."""
    d, dx = config.dimensions, config.spacing
    yield from fits(config)
    yield from overlap_at_start(config)
    yield from packings(config)
    yield from screen(config)
    yield from silo(config)
    for i, group in enumerate(config.grains if config.fluid else ()):
        smallest, enough = group.smallest_diameter, ENOUGH_NODES[d]
        nodes, source = smallest / dx, "Mansouri et al., section 4"
        if d == 3 and stays(config, group) and len(group.centres) and fluid_share(config) < 1.0 - DENSE:
            enough, source = (
                MORE_NODES,
                "drag by where centres lie between nodes, off by 20 % at 7 and 8, 12 at 9, 8 at 11",
            )
        key: Path = ("grains", i, "diameters" if group.diameters is not None else "diameter")
        least = 2.5 if group.moving else 2.0
        yield judged(
            "nodes across a grain", "D/dx", nodes, ok=nodes >= enough * (1 - 1e-9), legal=nodes >= least,
            limit=f">= {enough:g}, {least:g} at least", source=source,
            cure=f"{finer(config, smallest / enough)} resolves the grains of {group.name}",
            key=key, forceable=nodes >= 1,
        )  # fmt: skip
        if group.moving:
            yield from density_ratio(config, i, nodes)
            yield from falling(config, i)
    if config.fluid:
        yield from released(config)
    if config.fluid and not config.coupling.lubrication and config.grains_move:
        cure = "lubrication = true adds what the lattice does not resolve in them"
        key = ("coupling", "lubrication")
        yield Derived("narrowest gap", "h/dx", 0.0, "", ">= 1", "warn", "grains may come closer", cure, key)


def obstacles(config: LbmDemConfig) -> Iterator[Derived]:
    """Those that cover no node of the lattice: beyond the box, or smaller than it can see."""
    dx, d = config.spacing, config.dimensions
    for i, obstacle in enumerate(config.obstacle):
        if obstacle.shape.plane is not None:
            ends = np.stack(np.meshgrid(*[[0.5 * dx, (n - 0.5) * dx] for n in config.points]), axis=-1).reshape(-1, d)
            count = int(np.count_nonzero((ends - obstacle.shape.plane.point) @ obstacle.shape.plane.normal <= 0.0))
        elif (box := obstacle.shape.box) is not None:
            turns = [(-1, 0, 1) if axis in config.domain.periodic else (0,) for axis in AXES]
            count = math.prod(
                sum(nodes_between(a - k * length, b - k * length, n, dx) for k in images)
                for a, b, n, length, images in zip(box.low, box.high, config.points, config.domain.size, turns)
            )
        if not count:
            name = f"nodes in {obstacle.name}"
            cure = "it is not there for the fluid: outside the box, or between the nodes"
            yield Derived(name, "n", 0.0, "", ">= 1", "warn", "", cure, ("obstacle", i, "shape"))


def sliding(config: LbmDemConfig) -> Iterator[Derived]:
    """Velocity of grains that stay, and of boxes through faces that the fluid meets: that of their surface alone."""
    dx, cure = config.spacing, "its surface slides and it stays where it is: "
    for i, group in enumerate(config.grains):
        speed = largest(group, "velocity")
        if speed and (not group.moving or config.coupling.frozen):
            ways = "moving = true lets it go, velocity = [] holds it still, angular_velocity turns it"
            name, key = f"velocity of {group.name}, which stays", ("grains", i, "velocity")
            yield Derived(name, "v", speed, "m/s", "0", "warn", "", cure + ways, key)
    for i, obstacle in enumerate(config.obstacle if config.fluid else ()):
        box = obstacle.shape.box
        met = [  # the fluid meets a face with a node beyond it
            abs(u) for axis, u, a, b, length in zip(AXES, obstacle.velocity, box.low, box.high, config.domain.size)
            if (b - a < length - dx if axis in config.domain.periodic else a > 0.5 * dx or b < length - 0.5 * dx)
        ] if box else []  # fmt: skip
        if any(met):
            ways = "fluid passes through faces across it; along a belt from side to side of the domain none does"
            name, key = f"velocity through {obstacle.name}", ("obstacle", i, "velocity")
            yield Derived(name, "v", max(met), "m/s", "0", "warn", "", cure + ways, key)


def gauges(config: LbmDemConfig) -> Iterator[Derived]:
    """Gauges at a point inside an obstacle, or inside a grain where it is at the start: there is no fluid to read."""
    for i, gauge in enumerate(config.gauge):
        at, inside = np.array(gauge.at), ""
        for group in config.grains if not any(gauge.size) else ():
            x, own = np.asarray(group.centres, float), group.own_diameters
            sizes = np.array(group.smallest_diameter) if own is None else own
            if len(x) and np.any(((x - at) ** 2).sum(axis=1) < 0.25 * sizes**2):
                inside = group.name
        for obstacle in config.obstacle if not any(gauge.size) else ():
            box = obstacle.shape.box
            if box is not None and np.all((at > box.low) & (at < box.high)):
                inside = obstacle.name
        if inside:
            cure, key = "move it into the fluid, or give it a size that reaches there", ("gauge", i, "at")
            name = f"{gauge.name or f'gauge_{i + 1}'} in {inside}"
            yield Derived(name, "n", 0.0, "", ">= 1 node of fluid", "warn", "", cure, key)


def nodes_between(a: float, b: float, n: int, dx: float) -> int:
    """How many of the n nodes along an axis, half a spacing inside its ends, lie in [a, b]."""
    return max(0, min(n - 1, math.floor(b / dx - 0.5)) - max(0, math.ceil(a / dx - 0.5)) + 1)


def fits(config: LbmDemConfig) -> Iterator[Derived]:
    """The largest grain against the box; across a periodic side one that moves, or grows in a packing, must not meet
    two images of another."""
    for group in config.grains:
        size, moves = group.largest_diameter, group.moving or group.packing is not None
        several = moves and grain_count(config) > 1
        needs = {axis: 2.0 if several and axis in config.domain.periodic else 1.0 for axis in AXES[: config.dimensions]}
        share, least = max((size * n / length, size * n) for length, n in zip(config.domain.size, needs.values()))
        yield judged(
            "grain in the box", "D/L", share, ok=share <= 1.0, limit="<= 1", key=("domain", "size"),
            source="two diameters of grains that move or are packed along a periodic side, one elsewhere",
            cure=f"a side of the box of at least {least:.6g} m has room for {group.name}",
        )  # fmt: skip


def packings(config: LbmDemConfig) -> Iterator[Derived]:
    """How high each reaches, and how dense it is, or where its grains begin to fall."""
    d = config.dimensions
    for i, group in enumerate(config.grains):
        if group.packing is None:
            continue
        law, wanted, (ends, tops) = group.law, group.packing.high, packing_ends(config, group)
        low, top, sides = ends[-1], tops[-1], [b - a for a, b in zip(ends[:-1], tops)]
        solid = law_volume(law, d)
        high = packed_space(config, group, solid)
        height = max(high - low, math.ulp(high))
        void = 1.0 - solid / (packing_area(config, group, high) * height)
        key: Path = ("grains", i, "packing") if group.packing.porosity is None else ("grains", i, "packing", "porosity")
        least, cure = DENSEST_VOID[d], "fewer grains, or more space for them"
        source = "densest of equal grains; that from which these begin to fall: settling leaves less"
        if group.packing.porosity is not None:
            least = least_porosity(config, law, (*sides, height))
            source = "grains that grow without friction until they touch"
            cure = f"porosity = {least + (0.01 if d == 3 else 0.02):.2f} or more has a place for all"
        yield judged(
            f"void fraction of {group.name}", "n", void, ok=void >= least, limit=f">= {least:.3g}", source=source,
            cure=cure, key=key, forceable=void > 0.0,
        )  # fmt: skip
        if group.packing.porosity is None:
            continue
        as_said = wanted is None or abs(high - wanted) <= 1e-3 * (high - low)
        above = "the top of the box" if top == config.domain.size[-1] else "where a plane is"
        limit = f"<= {top:g}, {above}" if as_said else f"{wanted:g}, as packing.high says"
        cure = "change its count or porosity" + ("" if as_said else ", or leave high out")
        full = solid / math.prod(sides)  # the height of its grains without a gap
        fitting = math.floor(1000.0 * (1.0 - full / (top - low))) / 1000.0 if top > low else 0.0
        if as_said and fitting >= least:
            cure = f"porosity = {fitting:g} has room for its {law.count} grains, or take fewer"
        ok = high <= top * (1.0 + 1e-12) and as_said
        yield judged(f"top of {group.name}", "z", high, unit="m", ok=ok, limit=limit, cure=cure, key=key)


def least_porosity(config: LbmDemConfig, law: Diameters, lengths: tuple[float, ...]) -> float:
    """Below it no packing of grains has been found whose overlaps are less than 1 % of a diameter.

    Measured with 200 spheres of largest over smallest diameter 1, 2 and 3, in periodic boxes, between plates and in
    closed boxes (docs/measured/lbmdem.md): sizes that differ fill gaps, and rigid sides, where grains stand in layers,
    leave some. Ten times slower growth is no denser.
    """
    dimensions = config.dimensions
    d = law_diameters(min(law.count, SAMPLE), law.min, law.max, law.a, law.b, dimensions)
    sides = sum(1.0 / length for axis, length in zip(AXES, lengths) if axis not in config.domain.periodic)
    mean = float(d.mean())
    spread, walls = float(d.var()) / mean**2, mean * sides
    return GROWN - SPREAD * spread + WALLS * walls if dimensions == 3 else least_porosity_of_discs(spread, walls)


def least_porosity_of_discs(spread: float, walls: float) -> float:
    """That of discs of this relative variance of the diameters; walls: mean diameter times the sum of 1/length over
    the axes with rigid sides.

    Equal discs order themselves as they grow, the closer to their densest order the fewer they are, and rigid sides
    break the order; from a ratio of sizes of 1.2 on they do not. A line below what was measured: 60, 200 and 800 discs
    of ratios from 1 to 3.
    """
    ordered = DENSEST_VOID[2]
    mixed = ordered + (UNORDERED - ordered) * min(1.0, spread / ENOUGH_SPREAD)
    return max(ordered + ROWS * walls, mixed + UNORDERED_ROWS * walls)


def silo(config: LbmDemConfig) -> Iterator[Derived]:
    """The share of a packing's weight that its floor carries once the grains have slid down rigid sides: Janssen 1895
    with K = 1 - sin(phi), tan(phi) the friction. At the start they have not: a fill lands, rebounds and locks.
    """
    friction = config.contact.friction
    if not friction or not any(config.gravity):
        return
    ratio = 1.0 - math.sin(math.atan(friction))
    for i, group in enumerate(config.grains):
        if group.packing is None or not group.moving:
            continue
        if group.packing.low > landing(config, group) + group.largest_diameter:  # it falls, and lies on no floor
            continue
        law, d = group.law, config.dimensions
        ends, tops = packing_ends(config, group)
        sides = [top - end for end, top in zip(ends[:-1], tops)]
        rigid = [width for axis, width in zip(AXES, sides) if axis not in config.domain.periodic]
        void = min(group.packing.porosity or LOOSE[d], LOOSE[d])  # what is looser settles
        height = law_volume(law, d) / (1.0 - void) / math.prod(sides)
        slides = height * friction * ratio * sum(2.0 / width for width in rigid)
        if not slides:
            continue
        share = -math.expm1(-slides) / slides
        yield judged(
            f"weight of {group.name} on its floor", "Janssen", share, ok=share >= 0.9, legal=True, limit=">= 0.9",
            source="Janssen 1895, K = 1 - sin phi", key=("grains", i, "packing"),
            cure="sides with friction carry a part of the weight in a silo once its grains slide down; before, more or "
            "less rests on the floor",
        )  # fmt: skip


def density_ratio(config: LbmDemConfig, i: int, nodes: float) -> Iterator[Derived]:
    """Explicit coupling explodes where a grain is lighter than half the impedance of its links: measured at 1.0 to 1.2
    times that density with discs of 10 nodes and spheres of 7. Implicit coupling gives a grain that is lighter than the
    impedance the inertia that it lacks.
    """
    d, lattice = config.dimensions, LATTICES[config.lattice]
    ratio = config.grains[i].density / config.liquid.density
    volume = math.pi / 4 * nodes**2 if d == 2 else math.pi / 6 * nodes**3
    heavy = float(impedance(lattice, config.coupling.bounce_back, 0.5 * nodes)[0] / volume)
    limit, key, source = 1.2 * 0.5 * heavy, ("grains", i, "density"), "impedance of the links, zeta/V"
    if config.coupling.inertia == "explicit":
        yield judged(
            "density ratio", "rho_s/rho_f", ratio, ok=ratio > 1.5 * limit, legal=ratio > limit,
            limit=f"> {limit:.2g} with explicit coupling", source=source, key=key, forceable=True,
            cure='coupling.inertia = "implicit" is stable at any ratio',
        )  # fmt: skip
        return
    cure = f"it gains speed as if it were {heavy / ratio:.2g} times as heavy, which keeps it stable; "
    yield judged(
        "density ratio", "rho_s/rho_f", ratio, ok=ratio >= heavy, legal=True, limit=f">= {heavy:.2g}", source=source,
        cure=cure + "steady speeds are right; a finer spacing needs less", key=key,
    )  # fmt: skip


def slices(config: LbmDemConfig) -> Iterator[Derived]:
    """Control slices against the nodes, or grains, that they are to hold."""
    count = config.output.stress_slices
    if count:
        height, dx = config.domain.size[-1] / count, config.spacing
        least = dx if config.fluid else 0.1 * dx  # the largest diameter
        yield judged(
            "height of a control slice", "h", height, unit="m", ok=height >= least * (1 - 1e-9),
            limit=f">= {least:g}", key=("output", "stress_slices"),
            cure=f"stress_slices = {math.floor(config.domain.size[-1] / least * (1 + 1e-9))}",
        )  # fmt: skip


def whole_rules(config: LbmDemConfig, ranks: int) -> Iterator[Derived]:
    """What works on one rank only."""
    if config.fluid and (config.grains or config.obstacle) and RULES[config.coupling.bounce_back].reach > 1:
        cure, key = 'it reads two nodes beyond a slab; "cli" and "interpolated" read one', ("coupling", "bounce_back")
        name = "ranks of the quadratic rule"
        yield judged(name, "R", float(ranks), ok=ranks == 1, limit="1", cure=cure, key=key)


def sizes(config: LbmDemConfig, ranks: int) -> Iterator[Derived]:
    """Nodes, and how many ranks they are for: places of nodes in a slab have 31 bits."""
    points = config.points
    rows, others = points[-1], math.prod(n + PADDING for n in points[:-1])
    n, most = math.prod(points), MOST_PLACES // others - 1  # a row more is held than there are
    yield judged(
        "nodes", "n", float(n), ok=not config.fluid or rows <= most * ranks, source="32-bit places",
        limit=f"{most * others:.2g} per rank" if config.fluid else "", key=SPACING if config.fluid else (),
        cure=f"{math.ceil(rows / most)} ranks hold them" if most > 0 else "a row alone has too many",
    )  # fmt: skip
    yield judged(
        "rows of nodes per rank", "", rows / ranks, ok=ranks <= rows, legal=True, limit=">= 1",
        source="one row per rank", cure=f"{rows} ranks have a row each, the others are idle",
    )  # fmt: skip
