"""What body forces, shaking and faces make of a fluid: how fast it gets, how it slips along walls, when it is steady
past grains that stay, and whether wakes can shed."""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from hpcpic.core.case.config import Path
from hpcpic.core.case.derived import Derived, judged
from lbmdem.case.boundaries import ends_between_planes
from lbmdem.case.config import AXES, LbmDemConfig
from lbmdem.forecast.free_fall import PEAK, speed_through, stays, terminal_speed
from lbmdem.forecast.piles import lies
from lbmdem.forecast.pressures import between
from lbmdem.forecast.relaxation import SPACING, finer, other_collision, slower
from lbmdem.physics.collision import COLLISIONS
from lbmdem.physics.velocity_sets import CS2

# Grid Reynolds number, by the largest speed that is told, up to which a flow through a packing holds, and one that
# diverges: 12 spheres of 8 and 16 nodes, porosity 0.4, TRT; BGK has half of it past a cylinder
THROUGH_GRAINS = {"TRT": (24.0, 49.0), "BGK": (12.0, 24.0)}
HALF_WAY = 3.0 / 16.0  # product of the relaxation times with which walls lie half-way
MOST_SLIP, SOME_NODES = 0.005, 16.0  # of the largest velocity; of a channel where the case has none
# Reynolds number from which on a wake sheds: of a cylinder (Provansal, Mathis & Boyer 1987), and one from which on that
# of a sphere is uneven (Johnson & Patel 1999)
CYLINDER, SPHERE = 47.0, 210.0
GROWTH = 0.11  # of the lift, in u/D: disc of 8 nodes, an eighth of its channel, Re = 100, from 1e-13 on, measured
SAME = 1e-6  # of a node


def driven(config: LbmDemConfig) -> Iterator[Derived]:
    """Speed that a body force, shaking and pressure faces give the fluid along axes without walls: that of their whole
    push, or if less that of the parabola between the nearest walls along it. Solids that stay hold the fluid back: then
    these, and what grains that it must pass let through, are upper limits. Not told of a body force on grains that all
    move in a box without walls along it, nor of pressure faces beside grains that move, which may bear the pressure.
    """
    size, nu = config.domain.size, config.liquid.kinematic_viscosity
    stay = any(stays(config, group) for group in config.grains)
    held = stay or bool(config.obstacle)
    speeds, largest, by = dict.fromkeys(AXES, 0.0), 0.0, PUSHED
    for along, push, a, free in pushes(config):
        walls = [length for axis, length in zip(AXES, size) if axis not in config.unwalled and axis != along]
        if along in config.unwalled and (walls or held or not config.grains or push is SHAKEN):
            limits = [free, *(a * height**2 / (8.0 * nu) for height in walls)]
            if stay and (not walls or along == AXES[config.dimensions - 1]):  # it cannot pass beside them
                limits.append(speed_through(config, a))
            speeds[along] += min(limits)
            largest, by = max((largest, by), (min(limits), push), key=lambda one: one[0])
    speed = math.hypot(*speeds.values())
    if not speed:
        return
    mach = speed * config.time_step / config.spacing / math.sqrt(CS2)
    name = f"largest speed that {by.name} can make" if held else f"speed that {by.name} makes"
    source = f"{by.source}, or a H2/(8 nu) between walls" + ("; drag of grains, Ergun 1952" if stay else "")
    yield Derived(name, "U", speed, "m/s", source=source)
    yield judged(
        "Mach number of the driven fluid" + (", at most" if held else ""), "Ma", mach, ok=mach <= 0.25,
        legal=held or mach < 0.5, forceable=True, limit="<= 0.25" if held else "<= 0.25, < 0.5 at all",
        source="Mansouri et al., section 3.2", key=by.key,
        cure=f"{by.cure}, or relaxation_time = {slower(config, 0.24 / mach)}",
    )  # fmt: skip
    if stay and config.liquid.collision in THROUGH_GRAINS:
        best, diverges = THROUGH_GRAINS[config.liquid.collision]
        value = speed * config.spacing / config.liquid.kinematic_viscosity
        yield judged(
            "grid Reynolds number of the driven fluid, at most", "U dx/nu", value, ok=value <= best, legal=True,
            limit=f"<= {best:g}", source=f"measured in a packing: {best:g} holds, {diverges:g} diverges",
            cure=f"{by.cure}, or {other_collision(config)}", key=SPACING,
        )  # fmt: skip


def slip(config: LbmDemConfig) -> Iterator[Derived]:
    """Velocity of the fluid at walls over the largest one of the narrowest channel that the case drives a flow through,
    where walls do not lie half-way; of another scene with solids that of a channel of 16 nodes, if it matters."""
    fluid, scheme = config.liquid, COLLISIONS[config.liquid.collision]
    product = scheme.product(config.tau, fluid.magic) if scheme.product else HALF_WAY
    walls = 2 * (config.dimensions - len(config.domain.periodic)) - sum(face.is_open for face in config.boundary)
    if not (walls or config.grains or config.obstacle) or abs(product / HALF_WAY - 1.0) < 1e-6:
        return
    lows, highs = ends_between_planes(config.domain.size, config.obstacle)
    through = {AXES.index(along) for along, push, _, _ in pushes(config) if push is not SHAKEN}
    through |= {AXES.index(face.face[0]) for face in config.boundary if face.type == "velocity"}
    widths = [highs[k] - lows[k] for along in through for k in config.walled(along) if AXES[along] in config.unwalled]
    nodes = min(widths, default=SOME_NODES * config.spacing) / config.spacing
    share = (16.0 * product - 3.0) / (3.0 * max(nodes, 1.0) ** 2)
    if not widths and abs(share) <= MOST_SLIP:
        return
    cure = "magic = 0.1875 puts them there" if scheme.magic else 'collision = "TRT" puts them there'
    yield judged(
        "slip of the walls", "u_w/U", share, ok=abs(share) <= MOST_SLIP, legal=True, limit=f"within {MOST_SLIP:.1%}",
        source=f"(16 L - 3)/(3 H2), L = {product:.3g}, H = {nodes:.3g} nodes; Ginzburg & d'Humieres 2003",
        cure=f"walls do not lie half-way between nodes: {cure} at any tau; it falls with the square of the spacing",
        key=("fluid", "magic" if scheme.magic else "collision"),
    )  # fmt: skip


def weight(config: LbmDemConfig) -> Iterator[Derived]:
    """Gravity along an axis that fluid may leave by, in a case without grains that it moves or packs: pressures are
    those beyond the fluid's own weight, so it does nothing, where one may expect a flow."""
    along = [k for k, axis in enumerate(AXES[: config.dimensions]) if axis in config.unwalled and config.gravity[k]]
    used = config.grains_move or any(group.packing for group in config.grains)
    if not along or used or any(config.liquid.body_force):
        return
    g = [config.gravity[k] if k in along else 0.0 for k in range(config.dimensions)]
    yield judged(
        "gravity on the fluid", "g", math.hypot(*g), unit="m/s2", ok=False, legal=True, limit="0",
        source="pressures are those beyond the fluid's own weight", key=("gravity",),
        cure=f"it drives nothing: body_force = {g} of the fluid drives a stream as gravity does one that falls",
    )  # fmt: skip


class Push(NamedTuple):
    """What drives a fluid: its name, the speed that it gives in words, the key, and what makes it less."""

    name: str
    source: str
    key: Path
    cure: str


PUSHED = Push("the body force", "a t", ("fluid", "body_force"), "a weaker force")
SHAKEN = Push("the shaking", "2 a/omega from rest", ("shaking", "acceleration"), "weaker shaking")
PRESSED = Push("the pressure difference", "dp t/(rho L)", ("boundary",), "a smaller difference")


def pushes(config: LbmDemConfig) -> Iterator[tuple[str, Push, float, float]]:
    """Axis, kind, acceleration (m/s2) and speed (m/s) of a fluid that nothing holds, of each push.

    A body force and the difference of two pressure faces act together. Shaking is a sine from rest: in the frame the
    fluid gets a/omega (1 - cos omega t), and grains that move get it too.
    """
    end = config.simulation.end_time
    faces = [one for one, face in enumerate(config.boundary) if face.type == "pressure"]
    for k, (along, own) in enumerate(zip(AXES, config.liquid.body_force)):
        pressed = 0.0 if config.grains_move and not config.coupling.frozen else between(config, k)
        if a := abs(own + pressed):
            push = PRESSED._replace(key=("boundary", faces[-1])) if abs(pressed) > abs(own) else PUSHED
            yield along, push, a, a * end
    if config.shaking:
        omega = 2.0 * math.pi * config.shaking.frequency
        share = 1.0 - math.cos(min(math.pi, omega * end))
        for along, a in zip(AXES, config.shaking.acceleration):
            if a:
                yield along, SHAKEN, abs(a), share * abs(a) / omega


def between_faces(config: LbmDemConfig) -> Iterator[Derived]:
    """By how much more than over the length of the box a pressure falls between two faces: these are the last nodes.
    Grains bear most of the pressure, and permeabilities take their height.
    """
    kinds: dict[str, str] = {face.face: face.type for face in config.boundary}
    for axis, length in zip(AXES, config.domain.size):
        if kinds.get(f"{axis}-") == kinds.get(f"{axis}+") == "pressure" and not config.grains:
            share = config.spacing / max(length - config.spacing, 1e-300)
            yield judged(
                f"gradient along {axis}, over dp/L", "dx/(L-dx)", share, ok=share <= 0.0501, legal=True, limit="<= 5 %",
                source="pressure faces are the last nodes, dx/2 inside the box", key=SPACING,
                cure=f"the pressure falls over L - dx; {finer(config, length / 21.0)} is fine enough",
            )  # fmt: skip


def steady(config: LbmDemConfig) -> Iterator[Derived]:
    """The end of a run in times in which a body force brings a fluid past grains that stay to its speed, u/a. Before
    three of them its flow is too low by more than 5 %, past few grains 8. Measured are 0.3 (dense) to 1.2 (dilute)
    times what is told.
    """
    nu, end = config.liquid.kinematic_viscosity, config.simulation.end_time
    if not config.grains or (config.grains_move and not config.coupling.frozen):
        return
    for k, a in enumerate(map(abs, config.liquid.body_force)):
        if a and AXES[k] in config.unwalled:
            walls = [config.domain.size[j] for j in config.walled(k)]
            time = min([speed_through(config, a) / PEAK / a, *(height**2 / (8.0 * nu) for height in walls)])
            yield judged(
                "end over the time to a steady flow", "t a/u", end / time, ok=end >= 3.0 * time, legal=True,
                limit=">= 3", source="drag of grains, Ergun 1952; about 5 % are left", key=("simulation", "end_time"),
                cure=f"the flow along {AXES[k]} is still rising: end_time = {3.0 * time:.3g}",
            )  # fmt: skip


def carried(config: LbmDemConfig) -> Iterator[Derived]:
    """How far a stream and gravity take grains at given positions towards a face that lets fluid through, over the way
    to it: they meet it as a wall. Not told of beds, which hold each other."""
    for face in config.boundary:
        if not face.is_open:
            continue
        k, side = AXES.index(face.face[0]), 1.0 if face.face[1] == "+" else -1.0
        pull = math.hypot(*config.gravity)
        for i, group in enumerate(config.grains):
            if stays(config, group) or not len(group.centres) or lies(config, group):
                continue
            sinks = math.copysign(1.0, group.density - config.liquid.density)
            fall = sinks * terminal_speed(config, i) * config.gravity[k] / pull if pull else 0.0
            along = np.asarray(group.centres)[:, k]
            room = float((config.domain.size[k] - along if side > 0.0 else along).min()) - 0.5 * group.smallest_diameter
            far = side * (stream(config, k) + fall) * config.simulation.end_time / max(room, 1e-300)
            if far > 0.0:
                yield judged(
                    f"way of {group.name} towards {face.face}", "u t/d", far, ok=far <= 1.0, legal=True, limit="<= 1",
                    source="the fastest of the stream; a lone grain", key=("grains", i),
                    cure=f"grains meet {face.face} as a wall, stop there and block it: a shorter end_time, or a box "
                    f"that repeats along {AXES[k]}, where fluid.body_force drives it",
                )  # fmt: skip


def stream(config: LbmDemConfig, k: int) -> float:
    """The velocity (m/s) along an axis, where it is fastest, that faces give the fluid."""
    given = [face for face in config.boundary if face.type == "velocity" and AXES.index(face.face[0]) == k]
    across = config.walled(k)
    if given:
        peaks = (face.velocity[k] * (1.5 ** len(across) if face.profile == "parabolic" else 1.0) for face in given)
        return max(peaks, key=abs)
    a, nu = between(config, k) + config.liquid.body_force[k], config.liquid.kinematic_viscosity
    parabolas = (abs(a) * config.domain.size[j] ** 2 / (8.0 * nu) for j in across)
    return math.copysign(min([abs(a) * config.simulation.end_time, *parabolas]), a)


def wakes(config: LbmDemConfig) -> Iterator[Derived]:
    """The Reynolds number of solids that stay in a stream which a face lets in, where all of the scene is even about
    the middle of an axis across it. The lattice keeps that but for rounding."""
    inlets = {AXES.index(face.face[0]) for face in config.boundary if face.type == "velocity"}
    across = [(k, j) for k in inlets for j in range(config.dimensions) if j != k and even(config, j)]
    for k, j in across:
        nu, length = config.liquid.kinematic_viscosity, config.domain.size
        boxes = [obstacle.shape.box for obstacle in config.obstacle if obstacle.shape.box is not None]
        bars = [box for box in boxes if box.low[j] > 0.0 and box.high[j] < length[j]]  # away from both sides
        for m in set(range(config.dimensions)) - {k, j}:
            bars = [box for box in bars if box.low[m] <= 0.0 and box.high[m] >= length[m]]
        free = max((box.high[j] - box.low[j] for box in bars), default=0.0)
        grain = max((group.largest_diameter for group in config.grains), default=0.0)
        of_grains = CYLINDER if config.dimensions == 2 else SPHERE
        size, onset = max((free, CYLINDER), (grain, of_grains), key=lambda one: one[0] / one[1])
        reynolds = abs(stream(config, k)) * size / nu
        if reynolds:
            yield judged(
                f"Reynolds number of solids that are even along {AXES[j]}", "u D/nu", reynolds, ok=reynolds <= onset,
                legal=True, limit=f"<= {onset:g}", key=("boundary",),
                source="beyond it wakes shed; Provansal et al. 1987, of spheres Johnson & Patel 1999",
                cure="it keeps even, with too little drag and no lift, until rounding has grown for some "
                f"{math.log(1e13) / GROWTH:.0f} D/u: a tenth of a node off the middle a wake sheds within 40 D/u",
            )  # fmt: skip


def even(config: LbmDemConfig, j: int) -> bool:
    """Whether nothing of a case that has only solids which stay tells one half along an axis from the other."""
    started = config.fluid is not None and config.fluid.start is not None
    turned = any(group.at_start(what).any() for group in config.grains for what in ("velocity", "angular_velocity"))
    placed = all(len(group.centres) and not group.moving for group in config.grains)
    pushes = [*config.liquid.body_force[j : j + 1], *(config.shaking.acceleration[j : j + 1] if config.shaking else ())]
    if started or turned or not placed or any(pushes):
        return False
    sliding = [face for face in config.boundary if face.type == "wall" and any(face.velocity)]
    below, above = ([face.velocity for face in sliding if face.face == AXES[j] + end] for end in "-+")
    return below == above and Counter(solids(config, j, False)) == Counter(solids(config, j, True))


def solids(config: LbmDemConfig, j: int, mirrored: bool) -> Iterator[tuple[object, ...]]:
    """What tells each solid from others, as it is or mirrored about the middle of an axis, to SAME nodes."""
    unit, length = SAME * config.spacing, config.domain.size[j]

    def turn(x: Sequence[float], about: float) -> list[float]:
        return [about - part if mirrored and k == j else part for k, part in enumerate(x)]

    for obstacle in config.obstacle:
        box, plane, speed = obstacle.shape.box, obstacle.shape.plane, turn(obstacle.velocity, 0.0)
        if box is not None:
            ends = zip(turn(box.low, length), turn(box.high, length))
            yield ("box", *(round(part / unit) for both in ends for part in sorted(both)), *speed)
        elif plane is not None:
            normal = [part / math.hypot(*plane.normal) for part in turn(plane.normal, 0.0)]
            away = sum(a * b for a, b in zip(normal, turn(plane.point, length)))
            yield ("plane", *(round(part / SAME) for part in normal), round(away / unit), *speed)
    for group in config.grains:
        sizes = group.own_diameters
        for k, x in enumerate(group.centres):
            own = group.largest_diameter if sizes is None else float(sizes[k])
            yield ("grain", round(own / unit), *(round(part / unit) for part in turn(x, length)))
