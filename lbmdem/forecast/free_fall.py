"""What gravity and body forces bring about: how fast a lone grain falls, and what falls for ever."""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.case.derived import Derived, judged
from hpcpic.core.space.products import product
from lbmdem.case.boundaries import ends_between_planes
from lbmdem.case.config import AXES, GrainSet, LbmDemConfig
from lbmdem.forecast.node_shares import grains, volume
from lbmdem.forecast.piles import filled, lies, lower, settled_height, sinks, standing, weight_in_fluid, whole_weight
from lbmdem.forecast.relaxation import SPACING, key_of_tau, other_collision, slower
from lbmdem.physics.collision import COLLISIONS
from lbmdem.physics.lubrication import ROUGHNESS
from lbmdem.physics.velocity_sets import CS2
from lbmdem.setup.box_walls import below, cover, floor_height, plane_heights, sample_height

BALANCE = 1e-3  # of the forces on a box that are left over: what is still called a balance
FAR_BEYOND = 10.0  # times the limit of the grid Reynolds number: a bed falls slower than a grain alone, but not so much
MOST_TRIED = 10_000  # points above which a fall is tried
DRIFT = 0.25  # of the speed of a lone grain: beyond it a box that nothing holds is warned of, told is any
PEAK = 4.0  # times the estimate of a flow past grains: wakes shelter the next grain, pores differ; measured up to 3.5
ADDED = {2: 1.0, 3: 0.5}  # mass of a disc and of a sphere in a fluid, of what they displace
SWING = 0.03  # of the speed of a grain, by sound
LAYER = 1.13  # sqrt(Re) delta/D of the boundary layer where the flow divides (Schlichting & Gersten, ch. 5)


def drag_coefficient(reynolds: float) -> float:
    """The drag coefficient of a sphere: Schiller & Naumann 1933; 0.44 beyond Re = 1000."""
    return 24.0 / reynolds * (1.0 + 0.15 * reynolds**0.687) if reynolds < 1000.0 else 0.44


def terminal_speed(config: LbmDemConfig, i: int) -> float:
    """Speed (m/s) at which the largest grain of a set falls alone; the least of that without walls, of a disc
    Stokes's or that of a drag coefficient of 1, and that of creeping flow between walls along its fall."""
    group, nu = config.grains[i], config.liquid.kinematic_viscosity
    pull = math.hypot(*config.gravity) * abs(group.density / config.liquid.density - 1.0)
    size = group.largest_diameter
    return min(speed_alone(config, size, pull), pull * size**2 / (18.0 * nu) * between_walls(config, group))


def between_walls(config: LbmDemConfig, group: GrainSet) -> float:
    """Speed of the largest grain of a set that falls between walls, in a box that is closed below, over Stokes's of
    `speed_alone`; 1 without walls."""
    down, size = int(np.argmax(np.abs(config.gravity))), group.largest_diameter
    across = config.walled(down) if AXES[down] not in config.unwalled else ()
    if not across:
        return 1.0
    ends, tops = ends_between_planes(config.domain.size, config.obstacle)
    widths = [tops[k] - ends[k] for k in across]
    if config.dimensions == 3:
        return of_sphere_in_duct(size, widths)
    away = [2.0 * x[across[0]] - ends[across[0]] - tops[across[0]] for x in group.centres]  # from the middle, twice
    return of_disc_in_channel(size, widths[0], max(map(abs, away), default=0.0))


def of_sphere_in_duct(size: float, widths: Sequence[float]) -> float:
    """`between_walls` in the middle, the less of two: that of a slot (Faxen 1922) and that of the tube which slows a
    small sphere as a square duct does (Haberman & Sayre 1958), within 6 % of runs up to 0.85 of its width."""
    size = min(size, *widths)  # of a case that is refused it may be larger
    slot, tube = size / min(widths), 0.904 * size / math.sqrt(math.prod(widths)) if len(widths) == 2 else 0.0
    around = 1.0 - 2.105 * tube + 2.0865 * tube**3 - 1.7068 * tube**5 + 0.72603 * tube**6
    between = 1.0 - 1.004 * slot + 0.418 * slot**3 + 0.21 * slot**4 - 0.169 * slot**5
    return min(around / (1.0 - 0.75857 * tube**5), between)


def of_disc_in_channel(size: float, width: float, aside: float) -> float:
    """`between_walls` in a channel. In the middle the drag is 9 sqrt(2) pi mu U h^-2.5 (lubrication, of what it drives
    up beside it) times 1 + h + 0.52 h^2, with h the gap over the radius: within 5 % of Faxen 1946 from h = 1 on, 2 % of
    runs at 0.15. Off the middle two gaps (1 +- e) h let through as much as their mean power 2.5, at the walls 2^1.5
    times as much, which fades until h = 2: within 15 % of runs at h = 0.3 to 2 and e up to 0.9; the fastest disc."""
    h = max(ROUGHNESS, width / size - 1.0)
    e = min(1.0, aside / (h * size))
    wider = 1.0 + (0.5 * ((1.0 - e) ** 2.5 + (1.0 + e) ** 2.5) - 1.0) * max(0.0, 1.0 - 0.5 * h)
    return min(1.0, wider * h**2.5 / (math.sqrt(8.0) * (1.0 + h + 0.52 * h * h))) if h < 5.0 else 1.0


def speed_alone(config: LbmDemConfig, size: float, pull: float) -> float:
    """Speed (m/s) past a lone grain of this diameter at which its drag is `pull` (m/s2) times the mass of fluid that it
    displaces."""
    nu = config.liquid.kinematic_viscosity
    slow = pull * size**2 / (18.0 * nu)
    if config.dimensions == 2 or not pull:
        return min(math.sqrt(math.pi / 2.0 * size * pull), slow)
    v = slow
    for _ in range(100):  # halves the error of log v, or better
        v = math.sqrt(4.0 / 3.0 * size * pull / drag_coefficient(v * size / nu))
    return v


def drag_alone(config: LbmDemConfig, size: float, u: float) -> float:
    """Drag of a lone grain of this diameter in a fluid of speed u, over the mass that it displaces, m/s2: the inverse
    of `speed_alone`."""
    nu = config.liquid.kinematic_viscosity
    if config.dimensions == 2 or not u:
        return max(2.0 / math.pi * u * u / size, 18.0 * nu * u / size**2)
    return 0.75 * drag_coefficient(u * size / nu) * u * u / size


def stays(config: LbmDemConfig, group: GrainSet) -> bool:
    """Whether the grains of a set hold the fluid back, as they cannot give way to it."""
    return config.coupling.frozen or not group.moving


def speed_through(config: LbmDemConfig, a: float) -> float:
    """The largest speed (m/s) that a body force a (m/s2) gives a fluid that has no way around grains that stay: PEAK
    times that past a lone one that bears its share of the force, or twice Ergun's mean in the pores (1952), as in a
    tube, if that is less. A disc counts as the sphere of its surface over its volume.
    """
    d = config.dimensions
    held = [group for group in config.grains if stays(config, group)]
    room = math.prod(config.domain.size)
    c = sum(n * volume(r * config.spacing, d) for group in held for r, n in grains(config, group)) / room
    size = max(group.largest_diameter for group in held)
    alone = speed_alone(config, size, a / c)
    if c >= 1.0:
        return PEAK * alone
    slow, fast = ergun(config, c, size * (1.5 if d == 2 else 1.0))
    mean = 2.0 * a / (slow + math.sqrt(slow**2 + 4.0 * fast * a))
    return PEAK * min(alone, 2.0 * mean / (1.0 - c))


def ergun(config: LbmDemConfig, c: float, sphere: float) -> tuple[float, float]:
    """What a bed of solid fraction c < 1 takes of a fluid's momentum, m/s2, by its mean speed and by the square of it:
    Ergun 1952. sphere: diameter of the sphere that has as much surface for its volume as its grains, m."""
    pores = (1.0 - c) ** 3
    return 150.0 * config.liquid.kinematic_viscosity * (c / sphere) ** 2 / pores, 1.75 * c / sphere / pores


def impact_speed(config: LbmDemConfig, i: int) -> float:
    """Speed (m/s) at which a grain of a set meets what is below: that of its start and of its fall, in a fluid the
    larger of its start's and its terminal one at most. A grain falls to the wall or a plane, less what those of its set
    below it fill of the floor once they have settled, but at least as far as the lowest, and less what sets that start
    lower fill. A packing falls to what lies below, and without fluid, which would brake it, its top on as it settles.
    Who falls longer than the run meets nothing in it. Without fluid a shaken frame throws what falls, or what its
    weight does not hold.
    """
    group, pull = config.grains[i], math.hypot(*config.gravity)
    below = [k for k, g in enumerate(config.gravity) if abs(g) > 0.5 * pull and AXES[k] not in config.domain.periodic]
    speeds = np.linalg.norm(group.at_start("velocity"), axis=1)
    if not below:
        met = speeds + max(thrown(config, k) for k in range(config.dimensions))
        walls = len(config.domain.periodic) < config.dimensions or config.obstacle
        return float(met.max(initial=0.0)) if walls or any(not one.moving for one in config.grains) else 0.0
    axis, last = below[0], config.dimensions - 1
    down = config.gravity[axis] < 0.0
    if group.packing is not None:
        fall = group.packing.low - landing(config, group) + (0.0 if config.fluid else sinks(config, group))
        heights = np.array([fall if down and axis == last else 0.0])
    else:
        x, radius = np.asarray(group.centres), 0.5 * group.smallest_diameter
        heights = (x[:, axis] if down else config.domain.size[axis] - x[:, axis]) - radius
        heights = np.minimum(heights, above_planes(config, x, radius))
        below_it = math.inf if lies(config, group) else filled(config, group, axis, x[:, axis] if down else -x[:, axis])
        under = [other for other in config.grains if lower(config, other, group)]
        heights = np.maximum(heights - below_it, heights.min()) - sum(settled_height(config, o, axis) for o in under)
    end = config.simulation.end_time
    met = (heights > 0.0) & (heights <= speeds * end + 0.5 * pull * end**2)
    falls = np.sqrt(2.0 * pull * np.where(met, heights, 0.0))
    if config.fluid:  # which brakes what is faster than its terminal speed
        return float(np.maximum(speeds, np.minimum(falls, terminal_speed(config, i))).max(initial=0.0))
    pushed, shaking = thrown(config, axis), config.shaking
    lifts = shaking is not None and abs(shaking.acceleration[axis]) > abs(config.gravity[axis])
    return float((np.hypot(speeds, falls) + np.where(lifts | (falls > 0.0), pushed, 0.0)).max(initial=0.0))


def thrown(config: LbmDemConfig, k: int) -> float:
    """The largest speed (m/s) along an axis, in a shaken frame without fluid, of a grain that was at rest in it and is
    free since; 0 along one along which nothing holds it, where all go with it."""
    if config.shaking is None or config.fluid or AXES[k] in config.domain.periodic:
        return 0.0
    omega = 2.0 * math.pi * config.shaking.frequency
    share = 1.0 - math.cos(min(math.pi, omega * config.simulation.end_time))
    return share * abs(config.shaking.acceleration[k]) / omega


def above_planes(config: LbmDemConfig, x: NDArray, radius: float) -> NDArray[np.float64]:
    """How far grains at x[n, d] can fall along gravity before they touch a plane of the case, m [n]."""
    height, down = np.full(len(x), np.inf), np.array(config.gravity) / math.hypot(*config.gravity)
    for plane in (obstacle.shape.plane for obstacle in config.obstacle):
        if plane is None:
            continue
        normal = np.array(plane.normal) / math.hypot(*plane.normal)
        distance, towards = product(x - np.array(plane.point), normal), -float(down @ normal)
        if towards > 0.0:
            own = np.maximum(0.0, distance - radius) / towards
            height = np.where(distance > 0.0, np.minimum(height, own), height)
    return height


def landing(config: LbmDemConfig, group: GrainSet) -> float:
    """Lowest height (m) to which the smallest grain of a packing can fall: onto fixed grains that leave it no gap, or
    through one onto the floor. It is tried above points a tenth of a radius apart, or MOST_TRIED points in all."""
    assert group.packing is not None
    r, sides = 0.5 * group.smallest_diameter, config.domain.size[:-1]
    most = round(MOST_TRIED ** (1.0 / len(sides)))
    counts = [min(most, math.ceil(10.0 * length / r)) for length in sides]
    rigid = [0.0 if axis in config.domain.periodic else min(r, 0.5 * length) for axis, length in zip(AXES, sides)]
    lines = [np.linspace(edge, length - edge, n) for n, length, edge in zip(counts, sides, rigid)]
    points = np.stack(np.meshgrid(*lines), axis=-1)
    height = np.full(points.shape[:-1], max(floor_height(config), cover(config)))
    for other in config.grains:
        sizes = None if other.moving else other.own_diameters
        if sizes is None:
            continue
        for x, size in zip(np.asarray(other.centres), sizes):
            away = points - x[:-1]
            for k, length in enumerate(sides):
                if AXES[k] in config.domain.periodic:
                    away[..., k] -= length * np.rint(away[..., k] / length)
            rise = (r + 0.5 * size) ** 2 - (away**2).sum(axis=-1)
            lies = x[-1] - r + np.sqrt(np.maximum(rise, 0.0))
            met = (rise > 0.0) & (x[-1] < group.packing.low + r)
            height = np.where(met, np.maximum(height, lies), height)
    return float(height.min())


def released(config: LbmDemConfig) -> Iterator[Derived]:
    """By how much the speed of grains that begin to fall swings with the lowest sound between the walls below and
    above: their weight F pulls at the fluid (mass M) at once, whose speed is then F/(M w), w = pi c_s/L, over theirs.
    Those that take a time t to begin have 1/sqrt(1 + (w t)2) of it.
    """
    if not any(config.gravity) or config.coupling.frozen:
        return
    k = int(np.argmax(np.abs(config.gravity)))
    weights = [abs(weight_in_fluid(config, g, g.largest_diameter)) if g.moving else 0.0 for g in config.grains]
    free = [i for i, own in enumerate(weights) if own and standing(config)[i] and standing(config)[i] < 1.5 * own]
    if AXES[k] in config.unwalled or not free:
        return
    falls = [(i, terminal_speed(config, i)) for i in free]
    force = sum(whole_weight(config, config.grains[i]) for i in free)
    sound = config.spacing / config.time_step * math.sqrt(CS2)
    room = math.prod(config.domain.size) * config.liquid.density
    omega = math.pi * sound / config.domain.size[k]
    share = max(force / room / omega / math.hypot(v, omega * v * start_time(config, i)) for i, v in falls)
    yield judged(
        "swing of the speed of released grains", "F/(M w v)", share, ok=share <= SWING, legal=True,
        limit=f"<= {SWING:.0%}", source="lowest sound of the box, measured with a disc: 0.35 to 0.95 of it",
        cure=f"relaxation_time = {slower(config, 0.9 * SWING / share)} makes sound fast enough; means over the period "
        f"{2.0 * config.domain.size[k] / sound:.3g} s are right", key=key_of_tau(config),
    )  # fmt: skip


def start_time(config: LbmDemConfig, i: int) -> float:
    """Time (s) in which the largest grain of a set would get its terminal speed, with the fluid that it takes along."""
    group, added = config.grains[i], ADDED[config.dimensions] * config.liquid.density
    pull = math.hypot(*config.gravity) * abs(group.density - config.liquid.density)
    return terminal_speed(config, i) * (group.density + added) / pull


def screen(config: LbmDemConfig) -> Iterator[Derived]:
    """The screen that the lower end of a packing is, or why there is none where the case may count on it; it keeps
    grains from slanted planes that get lower, as those of a hopper."""
    low, d = sample_height(config), config.dimensions
    if not low or cover(config) >= low * (1.0 - 1e-9) or AXES[d - 1] in config.domain.periodic:
        return
    i, lows = below(config, low), [g.packing.low if g.packing and g.moving else math.inf for g in config.grains]
    name = "" if i is None else config.grains[i].name
    cure = f"all grains fall to the floor, as {name} starts below {low:g} m: put it above, or a row of grains with "
    cure += "moving = false there"
    slanted = any(np.ptp(heights) > 0.0 for heights in plane_heights(config))
    if not name:
        cure = f"grains stop at it, and planes meet none below {low:g} m: packing.low = 0 fills what they leave"
    yield judged(
        "screen for grains that move", "z", floor_height(config), unit="m", legal=True, cure=cure,
        ok=not slanted if i is None else not config.grains[i].moving,
        limit=f"{low:g}, as packing.low says" + (", without slanted planes below" if slanted else ""),
        source=f"none: {name} starts below it" if name else "the lowest packing.low of grains that move",
        key=("grains", lows.index(min(lows)), "packing", "low"),
    )  # fmt: skip


def falling(config: LbmDemConfig, i: int) -> Iterator[Derived]:
    """Speed, Mach and Reynolds numbers of a grain that falls or rises alone, which a bed seldom reaches."""
    v, fluid, dx = terminal_speed(config, i), config.liquid, config.spacing
    if not v:
        return
    source = "Schiller & Naumann 1933" if config.dimensions == 3 else "Stokes; drag coefficient 1 of a disc"
    name, size = config.grains[i].name, config.grains[i].largest_diameter
    source += "; between walls" if between_walls(config, config.grains[i]) < 1.0 else ""
    reynolds = v * size / fluid.kinematic_viscosity
    yield Derived(f"speed of {name}, alone", "v", v, "m/s", source=source)
    yield Derived(f"Reynolds number of {name}, alone", "v D/nu", reynolds)
    mach = v * config.time_step / dx / math.sqrt(CS2)
    legal = mach < 0.5
    yield judged(
        "Mach number of a lone grain", "Ma", mach, ok=mach <= 0.25, legal=legal,
        limit="<= 0.25, < 0.5 at all" if legal else "< 0.5", source=source, key=key_of_tau(config), forceable=True,
        cure=f"relaxation_time = {slower(config, 0.24 / mach)} makes the time step short enough for {v:.3g} m/s",
    )  # fmt: skip
    grid, most = v * dx / fluid.kinematic_viscosity, COLLISIONS[fluid.collision].grid_reynolds
    yield judged(
        "grid Reynolds number of a lone grain", "v dx/nu", grid, ok=grid <= most, legal=grid <= FAR_BEYOND * most,
        limit=f"<= {most:g}, {FAR_BEYOND * most:g} at all" if math.isfinite(most) else "none",
        source=f"{source}; shear layer, measured", cure=other_collision(config), key=SPACING, forceable=True,
    )  # fmt: skip
    if reynolds > 1.0:
        layer = LAYER * size / math.sqrt(reynolds)
        yield judged(
            "boundary layer of a lone grain", "delta/dx", layer / dx, ok=layer >= 0.5 * dx, legal=True, limit=">= 0.5",
            source="Schlichting & Gersten, ch. 5", cure=f"at Re = {reynolds:.3g} it needs spacing = {layer:.2g}",
            key=SPACING,
        )  # fmt: skip


def unheld(config: LbmDemConfig) -> Iterator[Derived]:
    """The speed that a whole box has at the end, when forces pull along an axis along which it repeats and it has no
    wall, obstacle or fixed grain to pull against. Without fluid walls hold by friction alone. A body force pulls at
    the whole box: at the fluid, and at grains by what they displace (Scene.constant_force). The speed that one reads of
    a grain which settles has it too.
    """
    fluid, walls = config.fluid, len(config.domain.periodic) < config.dimensions
    held = walls if fluid else walls and config.contact.friction > 0.0
    if held or config.obstacle or config.coupling.frozen or any(not group.moving for group in config.grains):
        return
    weights, mass = [0.0] * config.dimensions, 0.0
    room = math.prod(config.domain.size)  # that the fluid has
    for group in config.grains:
        solid = sum(n * volume(r * config.spacing, config.dimensions) for r, n in grains(config, group))
        lighter = group.density - (fluid.density if fluid else 0.0)
        weights = [weight + lighter * solid * g for weight, g in zip(weights, config.gravity)]
        mass, room = mass + group.density * solid, room - solid
    wet = fluid.density * max(room, 0.0) if fluid else 0.0
    full = fluid.density * math.prod(config.domain.size) if fluid else 0.0  # kg, of a box that holds fluid alone
    falls = [terminal_speed(config, i) for i in range(len(config.grains))] if fluid else []
    for k, (axis, weight) in enumerate(zip(AXES, weights)):
        driven = full * fluid.body_force[k] if fluid else 0.0
        pulls, left = abs(weight) + abs(driven), abs(weight + driven)
        if axis not in config.domain.periodic or not pulls:
            continue
        end = left / (mass + wet) * config.simulation.end_time
        far = 0.5 * end * config.simulation.end_time > config.domain.size[k]
        share = end / max(falls) if weight and any(falls) else 0.0
        fast = share > DRIFT
        cure = "the box carries it along" if fast and not far else "its speed grows without a bound"
        cure += ": a wall or a fixed grain holds it"
        if weight and full:
            cure += f", or a fluid.body_force of {-weight / full:.6g} m/s2 along {axis} balances the weight"
        beside = f" and {DRIFT:.0%} of the speed of a lone grain" if share else ""
        source = "momentum of the whole box" + (f"; {share:.2g} of the speed of a lone grain" if share else "")
        yield judged(
            f"speed at the end along {axis}", "a t", end, unit="m/s", legal=True,
            ok=left <= BALANCE * pulls or not (far or fast), source=source, cure=cure,
            limit=f"balanced to {BALANCE:.1%}, or within a box's length{beside}",
            key=("gravity",) if weight else ("fluid", "body_force"),
        )  # fmt: skip
