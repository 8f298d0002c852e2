"""The numbers that decide whether an LBM-DEM case is stable and accurate, with their limits and sources."""

import math
from collections.abc import Iterator

import numpy as np

from hpcpic.core.case.config import Path
from hpcpic.core.case.derived import Derived, Verdict
from hpcpic.core.files.start import arrays
from lbmdem.case.config import (
    ACCURATE,
    AXES,
    GrainSet,
    LbmDemConfig,
    contact_step,
    grain_mass,
)
from lbmdem.forecast.estimate import DEFAULT, phases
from lbmdem.forecast.free_fall import falling, unheld
from lbmdem.forecast.node_shares import LOOSE
from lbmdem.forecast.plan import grain_count
from lbmdem.forecast.relaxation import SPACING, key_of_tau, relaxation, slower
from lbmdem.physics.collision import COLLISIONS
from lbmdem.physics.lubrication import MOST_SUBSTEPS, ROUGHNESS, STABLE, Film
from lbmdem.physics.velocity_sets import CS2, LATTICES
from lbmdem.physics.wall_rules import RULES, impedance
from lbmdem.setup.overlap_survey import law_volume, packed_space, survey

MOST_PLACES, PADDING = 1 << 31, 32  # of nodes in a slab, and of a row or a line of nodes beside its own
DENSEST_VOID = {2: 0.093, 3: 0.26}  # void fraction of equal discs and spheres in their densest order
RANDOM_VOID = {2: 0.16, 3: 0.36}  # the same of packings poured at random
DEAR_SUBSTEPS = 1000  # of the contacts in a step of the fluid, which take longer than all else
MAX_SUBSTEPS = 100_000
ENOUGH_NODES = {2: 10.0, 3: 7.0}  # across a grain (Mansouri et al., section 4)


def derived(config: LbmDemConfig, ranks: int = 1) -> list[Derived]:
    """Every derived number of a completed case that runs on so many ranks."""
    parts = (relaxation, lattice_units, speeds, pressures, inflow, sloshing)
    fluid = [number for part in parts for number in part(config)] if config.fluid else []
    solids = [*obstacles(config), *grains(config), *unheld(config), *contacts(config), *slices(config)]
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
    others = [math.hypot(*group.velocity) + turning_speed(group) for group in config.grains]
    others += [config.liquid.initial.speed] if config.liquid.initial else []
    starts = (config.fluid.start if config.fluid else None, *(group.start for group in config.grains))
    given = (arrays(start).get("velocity", np.zeros(1)) for start in starts if start)
    others += [math.sqrt(float((velocity**2).sum(axis=-1).max(initial=0.0))) for velocity in given]
    return max([*(math.hypot(*vector) for vector in vectors), *others], default=0.0)


def turning_speed(grains: GrainSet) -> float:
    """Speed of the surface of the largest grain of a set about its centre, m/s."""
    return 0.5 * grains.largest_diameter * math.hypot(*grains.angular_velocity)


def speeds(config: LbmDemConfig) -> Iterator[Derived]:
    """Mach number and grid Reynolds number of the velocities that are known beforehand."""
    u, dx, dt = known_speed(config), config.spacing, config.time_step
    mach = u * dt / dx / math.sqrt(CS2)
    if mach:
        verdict: Verdict = "ok" if mach <= 0.1 else "warn" if mach < 0.5 else "fail"
        cure = ""
        if verdict != "ok":
            error = f"compressibility error about {mach * mach:.1%}; " if mach < 0.5 else ""
            cure = f"{error}relaxation_time = {slower(config, 0.1 / mach)} gives Ma = 0.1"
        limit = "<= 0.1, < 0.5 at all" if verdict != "fail" else "< 0.5"
        source = "Mansouri et al., section 3.2"
        yield Derived("Mach number", "Ma", mach, "", limit, verdict, source, cure, key_of_tau(config), mach < 1.0)
    reynolds = u * dx / config.liquid.kinematic_viscosity
    if reynolds:
        most = COLLISIONS[config.liquid.collision].grid_reynolds
        verdict = "ok" if reynolds <= most / 2 else "warn" if reynolds <= most else "fail"
        cure = "" if verdict == "ok" else 'collision = "central" has no such limit; a finer spacing lowers it'
        limit = f"<= {most:g}" if math.isfinite(most) else "none"
        source = "doubly periodic shear layer, measured (tests/validation)"
        yield Derived("grid Reynolds number", "U dx/nu", reynolds, "", limit, verdict, source, cure, SPACING, True)


def pressures(config: LbmDemConfig) -> Iterator[Derived]:
    """Densities at the pressure faces: the lattice fluid is compressible."""
    dx, dt, rho = config.spacing, config.time_step, config.liquid.density
    unit = rho * (dx / dt) ** 2 * CS2  # pressure of a density change of one
    for i, face in enumerate(config.boundary):
        if face.type != "pressure":
            continue
        start = face.density / rho if face.density is not None else 1.0 + (face.pressure or 0.0) / unit
        end = start + face.pressure_rate * config.simulation.end_time / unit
        worst = max(start, end, key=lambda density: abs(density - 1.0))
        off = abs(worst - 1.0)
        verdict: Verdict = "ok" if off <= 0.02 else "warn" if off < 0.5 else "fail"
        cure = "" if verdict == "ok" else "a smaller relaxation_time makes the time step and this change smaller"
        key = ("boundary", i, "density" if face.density is not None else "pressure")
        limit, source = "within 1 +- 0.02, 0.5 at all", "weak compressibility"
        name = f"density at {face.face}"
        yield Derived(name, "rho/rho0", worst, "", limit, verdict, source, cure, key, worst > 0.0)


def inflow(config: LbmDemConfig) -> Iterator[Derived]:
    """Mean density at the end, of a fluid that velocity faces let in and nothing lets out."""
    given = [(i, face) for i, face in enumerate(config.boundary) if face.type == "velocity"]
    if not given or any(face.type == "pressure" for face in config.boundary):
        return
    axis = AXES.index(given[0][1].face[0])  # open faces are those of one axis
    into = sum(face.velocity[axis] if face.face[1] == "-" else -face.velocity[axis] for _, face in given)
    density = 1.0 + into * config.simulation.end_time / config.domain.size[axis]
    off = abs(density - 1.0)
    verdict: Verdict = "ok" if off <= 0.02 else "warn" if off < 0.5 else "fail"
    cure = "" if verdict == "ok" else f"what flows in has no way out: a pressure face across {AXES[axis]} is one"
    limit, source, key = "within 1 +- 0.02, 0.5 at all", "conservation of mass", ("boundary", given[-1][0], "velocity")
    yield Derived("mean density at the end", "rho/rho0", density, "", limit, verdict, source, cure, key, density > 0.0)


def sloshing(config: LbmDemConfig) -> Iterator[Derived]:
    """Frequency of shaking over that of the lowest sound between the walls that it moves: the lattice fluid gives way
    to them, by pi2/8 of its square of the way of the frame, where water would not.
    """
    if config.shaking is None:
        return
    opened = {face.face[0] for face in config.boundary if face.type != "wall"}.union(config.domain.periodic)
    moved = [axis for axis, part in zip(AXES, config.shaking.acceleration) if part and axis not in opened]
    length = max((config.domain.size[AXES.index(axis)] for axis in moved), default=0.0)
    ratio = 2.0 * length * config.shaking.frequency * config.time_step / config.spacing / math.sqrt(CS2)
    if not ratio:
        return
    verdict: Verdict = "ok" if ratio <= 0.2 else "warn" if ratio < 1.0 else "fail"
    cure = "" if verdict == "ok" else f"relaxation_time = {slower(config, 0.2 / ratio)} makes sound fast enough"
    source = "compressible fluid between walls; 0.2 is an error of 5 %"
    name, words = "shaking against sound", "<= 0.2, < 1"
    yield Derived(name, "2 f L/c", ratio, "", words, verdict, source, cure, key_of_tau(config), True)


def grains(config: LbmDemConfig) -> Iterator[Derived]:
    """Size, resolution and density ratio of each set, and how grains overlap at the start."""
    d, dx = config.dimensions, config.spacing
    yield from fits(config)
    yield from overlap_at_start(config)
    yield from packings(config)
    yield from silo(config)
    for i, group in enumerate(config.grains):
        smallest = group.smallest_diameter
        if config.fluid is None:
            continue
        nodes, enough = smallest / dx, ENOUGH_NODES[d]
        key: Path = ("grains", i, "diameters" if group.diameters is not None else "diameter")
        least = 2.5 if group.moving else 2.0
        verdict: Verdict = "ok" if nodes >= enough * (1 - 1e-9) else "warn" if nodes >= least else "fail"
        fine = f"domain.spacing = {smallest / enough:.3g} resolves the grains of {group.name}"
        cure = "" if verdict == "ok" else fine
        limit, source = f">= {enough:g}, {least:g} at least", "Mansouri et al., section 4"
        yield Derived("nodes across a grain", "D/dx", nodes, "", limit, verdict, source, cure, key, nodes >= 1)
        if group.moving:
            yield from density_ratio(config, i, nodes)
            yield from falling(config, i)
    if config.fluid and not config.coupling.lubrication and any(group.moving for group in config.grains):
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
            name = f"nodes in {obstacle.name or f'obstacle_{i + 1}'}"
            cure = "it is not there for the fluid: outside the box, or between the nodes"
            yield Derived(name, "n", 0.0, "", ">= 1", "warn", "", cure, ("obstacle", i, "shape"))


def nodes_between(a: float, b: float, n: int, dx: float) -> int:
    """How many of the n nodes along an axis, half a spacing inside its ends, lie in [a, b]."""
    return max(0, min(n - 1, math.floor(b / dx - 0.5)) - max(0, math.ceil(a / dx - 0.5)) + 1)


def fits(config: LbmDemConfig) -> Iterator[Derived]:
    """The largest grain against the box; across a periodic side one that moves must not meet two images of another."""
    for group in config.grains:
        size, several = group.largest_diameter, group.moving and grain_count(config) > 1
        needs = {axis: 2.0 if several and axis in config.domain.periodic else 1.0 for axis in AXES[: config.dimensions]}
        share, least = max((size * n / length, size * n) for length, n in zip(config.domain.size, needs.values()))
        verdict: Verdict = "ok" if share <= 1.0 else "fail"
        cure = "" if verdict == "ok" else f"a side of the box of at least {least:.6g} m has room for {group.name}"
        source = "two diameters of grains that move along a periodic side, one elsewhere"
        yield Derived("grain in the box", "D/L", share, "", "<= 1", verdict, source, cure, ("domain", "size"))


def overlap_at_start(config: LbmDemConfig) -> Iterator[Derived]:
    """The deepest overlap of grains at given positions, or why they cannot start."""
    nearest, deepest, outside, close, deep, gone = survey(config)
    if outside or nearest == 0.0:
        name = "grains outside the box" if outside else "least distance of centres"
        cure = "their centres must lie in it" if outside else "no force has a direction there: move one of them"
        limit, key = "0" if outside else "> 0", gone if outside else close
        yield Derived(name, "n" if outside else "r", float(outside), "", limit, "fail", "", cure, key)
    elif deepest > 0.0:
        verdict: Verdict = "ok" if deepest <= 0.01 else "warn" if deepest < 0.1 else "fail"
        cure = "" if verdict == "ok" else "they fly apart; move them, or let packing = {..} find places without overlap"
        limit, source = "<= 1 %, < 10 %", "linear contacts"
        yield Derived("overlap at the start", "delta/d", deepest, "", limit, verdict, source, cure, deep, True)


def packings(config: LbmDemConfig) -> Iterator[Derived]:
    """How high each reaches, and how dense it is, or where its grains begin to fall."""
    d, top = config.dimensions, config.domain.size[-1]
    for i, group in enumerate(config.grains):
        if group.packing is None:
            continue
        law, low, wanted = group.law, group.packing.low, group.packing.high
        solid = law_volume(law, d)
        high = packed_space(config, group, solid)
        height = max(high - low, math.ulp(high))
        void = 1.0 - solid / (math.prod(config.domain.size[:-1]) * height)
        verdict: Verdict = "ok" if void >= DENSEST_VOID[d] else "fail"
        cure = "" if verdict == "ok" else "fewer grains, or more space for them"
        limit = f">= {DENSEST_VOID[d]:g}"
        source = f"densest of equal grains; random packings end at about {RANDOM_VOID[d]:g}"
        key: Path = ("grains", i, "packing") if group.packing.porosity is None else ("grains", i, "packing", "porosity")
        yield Derived(f"void fraction of {group.name}", "n", void, "", limit, verdict, source, cure, key, void > 0.0)
        if group.packing.porosity is None:
            continue
        as_said = wanted is None or abs(high - wanted) <= 1e-3 * (high - low)
        verdict = "ok" if high <= top * (1.0 + 1e-12) and as_said else "fail"
        limit = f"<= {top:g}, the top of the box" if as_said else f"{wanted:g}, as packing.high says"
        cure = "" if verdict == "ok" else "change its count or porosity" + ("" if as_said else ", or leave high out")
        yield Derived(f"top of {group.name}", "z", high, "m", limit, verdict, "", cure, key)


def silo(config: LbmDemConfig) -> Iterator[Derived]:
    """The share of a packing's weight that its floor carries once the grains have slid down rigid sides: Janssen 1895
    with K = 1 - sin(phi), tan(phi) the friction. At the start they have not: a fill lands, rebounds and locks.
    """
    rigid = [size for axis, size in zip(AXES, config.domain.size[:-1]) if axis not in config.domain.periodic]
    friction = config.contact.friction
    if not rigid or not friction or not any(config.gravity):
        return
    ratio = 1.0 - math.sin(math.atan(friction))
    for i, group in enumerate(config.grains):
        if group.packing is None or not group.moving:
            continue
        law, d = group.law, config.dimensions
        height = law_volume(law, d) / (1.0 - (group.packing.porosity or LOOSE[d])) / math.prod(config.domain.size[:-1])
        slides = height * friction * ratio * sum(2.0 / size for size in rigid)
        share = -math.expm1(-slides) / slides if slides else 1.0
        verdict: Verdict = "ok" if share >= 0.9 else "warn"
        cure = "it starts without friction at its sides, which may lock against a rebound: no silo until it slides"
        cure = "" if verdict == "ok" else cure
        name, key = f"weight of {group.name} on its floor", ("grains", i, "packing")
        yield Derived(name, "Janssen", share, "", ">= 0.9", verdict, "Janssen 1895, K = 1 - sin phi", cure, key)


def density_ratio(config: LbmDemConfig, i: int, nodes: float) -> Iterator[Derived]:
    """Explicit coupling explodes where a grain is lighter than half the impedance of its links: measured at 1.0 to 1.2
    times that density with discs of 10 nodes and spheres of 7."""
    d, lattice = config.dimensions, LATTICES[config.lattice]
    ratio = config.grains[i].density / config.liquid.density
    volume = math.pi / 4 * nodes**2 if d == 2 else math.pi / 6 * nodes**3
    limit = float(1.2 * 0.5 * impedance(lattice, config.coupling.bounce_back, 0.5 * nodes)[0] / volume)
    explicit = config.coupling.inertia == "explicit"
    verdict: Verdict = "ok" if not explicit or ratio > 1.5 * limit else "warn" if ratio > limit else "fail"
    cure = "" if verdict == "ok" else 'coupling.inertia = "implicit" is stable at any ratio'
    words = f"> {limit:.2g} with explicit coupling" if explicit else "none with implicit coupling"
    source = "impedance of the links, zeta/(2 V)"
    key = ("grains", i, "density")
    yield Derived("density ratio", "rho_s/rho_f", ratio, "", words, verdict, source, cure, key, True)


def contacts(config: LbmDemConfig) -> Iterator[Derived]:
    """The time step of the contacts against its limit, and how far grains overlap under their weight."""
    limit = contact_step(config)
    if not math.isfinite(limit):
        return
    source = "velocity Verlet with damped contacts on all sides (lbmdem.contacts)"
    key: Path = ("coupling", "substeps") if config.fluid else ("simulation", "time_step")
    if config.fluid:
        yield substeps(config)
    share = config.time_step / config.substeps / limit
    verdict: Verdict = "ok" if share <= 2.01 * ACCURATE else "warn" if share < 1.0 else "fail"
    good = ACCURATE * limit
    cure = f"substeps = {math.ceil(config.time_step / good)}" if config.fluid else f"time_step = {good:.3g}"
    cure = "" if verdict == "ok" else cure
    words = "<= 0.4, < 1"
    yield Derived(
        "step of the contacts", "dt/dt_max", share, "", words, verdict, source, cure, key, stable_below=1.0
    )
    if config.fluid and config.coupling.lubrication and not config.coupling.frozen:
        yield films(config)
    yield from overlaps(config)


def films(config: LbmDemConfig) -> Derived:
    """The gap at a plane wall, over the radius, below which the film of the smallest grain is limited: steps of the
    contacts take care of stiffer ones up to MOST_SUBSTEPS, or not where their number is given."""
    d, dx, fluid = config.dimensions, config.spacing, config.liquid
    film = Film.of_lattice(fluid.kinematic_viscosity * fluid.density, dx, d)
    group = min((group for group in config.grains if group.moving), key=lambda group: group.smallest_diameter)
    radius, mass = 0.5 * group.smallest_diameter, grain_mass(group, group.smallest_diameter, d)
    if config.coupling.inertia == "implicit":
        lattice, rule = LATTICES[config.lattice], config.coupling.bounce_back
        mass = max(mass, float(impedance(lattice, rule, radius / dx)[0]) * fluid.density * dx**d)
    n = config.coupling.substeps or max(config.substeps, MOST_SUBSTEPS)
    gap = film.gap_of(STABLE * n * mass / config.time_step, radius) / radius
    least, limit = gap if gap > ROUGHNESS else 0.0, 0.01
    verdict: Verdict = "ok" if least <= limit else "warn"
    cure = ""
    if verdict != "ok":
        wanted = math.ceil(film.resistance(limit * radius, radius) * config.time_step / (STABLE * mass))
        cure = f"coupling.substeps = {wanted} holds to {limit:g}; a smaller relaxation_time needs fewer"
    source, key = "stability of lubrication forces", ("coupling", "substeps")
    return Derived("gap of limited films", "h/R", least, "", f"<= {limit:g}", verdict, source, cure, key)


def substeps(config: LbmDemConfig) -> Derived:
    """The number of substeps of the contacts in a step of the fluid, what they take, and how to have fewer."""
    number = config.substeps
    verdict: Verdict = "ok" if number <= MAX_SUBSTEPS else "fail"
    told, key = "", ("contact", "normal_stiffness")
    if number > DEAR_SUBSTEPS:
        spent = phases(config, 1, 1, DEFAULT, 1)["grains"]
        softer = config.contact.normal_stiffness * (DEAR_SUBSTEPS / number) ** 2
        told = f"contact.normal_stiffness = {softer:.2g} takes {DEAR_SUBSTEPS}, and overlaps grow as its inverse; "
        told += f"now they take about {spent:.2g} s of a step"
    limit, cure = f"<= {MAX_SUBSTEPS:g}", told if verdict == "fail" else ""
    return Derived("substeps of the contacts", "n_d", float(number), "", limit, verdict, told, cure, key, True)


def overlaps(config: LbmDemConfig) -> Iterator[Derived]:
    """The overlap at rest below a column of grains as high as the box, or as all of them."""
    gravity, d = math.hypot(*config.gravity), config.dimensions
    density = config.liquid.density if config.fluid else 0.0
    for group in config.grains:
        if not group.moving or not gravity:
            continue
        size = group.largest_diameter
        count = group.count
        layers = min(count, config.domain.size[-1] / size)
        weight = grain_mass(group, size, d) * gravity * abs(1.0 - density / group.density)
        overlap = layers * weight / config.contact.normal_stiffness / size
        verdict: Verdict = "ok" if overlap <= 0.01 else "warn" if overlap < 0.1 else "fail"
        stiff = layers * weight / (0.01 * size)
        cure = "" if verdict == "ok" else f"normal_stiffness = {stiff:.2g} gives 1 % for {group.name}"
        key = ("contact", "normal_stiffness")
        limit, source = "<= 1 %, < 10 %", "weight of the column above"
        yield Derived("overlap at rest", "delta/d", overlap, "", limit, verdict, source, cure, key)


def slices(config: LbmDemConfig) -> Iterator[Derived]:
    """Control slices against the nodes, or grains, that they are to hold."""
    count = config.output.stress_slices
    if count:
        height, dx = config.domain.size[-1] / count, config.spacing
        least = dx if config.fluid else 0.1 * dx  # the largest diameter
        verdict: Verdict = "ok" if height >= least * (1 - 1e-9) else "fail"
        cure = "" if verdict == "ok" else f"stress_slices = {math.floor(config.domain.size[-1] / least * (1 + 1e-9))}"
        limit, key = f">= {least:g}", ("output", "stress_slices")
        yield Derived("height of a control slice", "h", height, "m", limit, verdict, "", cure, key)


def whole_rules(config: LbmDemConfig, ranks: int) -> Iterator[Derived]:
    """What works on one rank only."""
    if config.fluid and (config.grains or config.obstacle) and RULES[config.coupling.bounce_back].reach > 1:
        verdict: Verdict = "ok" if ranks == 1 else "fail"
        cure = "" if verdict == "ok" else 'it reads two nodes beyond a slab; "cli" and "interpolated" read one'
        key = ("coupling", "bounce_back")
        yield Derived("ranks of the quadratic rule", "R", float(ranks), "", "1", verdict, "", cure, key)


def sizes(config: LbmDemConfig, ranks: int) -> Iterator[Derived]:
    """Nodes, and how many ranks they are for: places of nodes in a slab have 31 bits."""
    points = config.points
    rows, others = points[-1], math.prod(n + PADDING for n in points[:-1])
    n, most = math.prod(points), MOST_PLACES // others - 1  # a row more is held than there are
    verdict: Verdict = "fail" if config.fluid and rows > most * ranks else "ok"
    cure = f"{math.ceil(rows / most)} ranks hold them" if most > 0 else "a row alone has too many"
    limit = f"{most * others:.2g} per rank" if config.fluid else ""
    key = SPACING if config.fluid else ()
    yield Derived("nodes", "n", float(n), "", limit, verdict, "32-bit places", cure if verdict == "fail" else "", key)
    verdict = "ok" if ranks <= rows else "warn"
    cure = "" if verdict == "ok" else f"{rows} ranks have a row each, the others are idle"
    yield Derived("rows of nodes per rank", "", rows / ranks, "", ">= 1", verdict, "one row per rank", cure)
