"""The pressures that a case makes, over rho c_s2: the lattice fluid gives way to them, as that times the change of its
density is its pressure.
"""

import itertools
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from hpcpic.core.case.config import Path
from hpcpic.core.case.derived import Derived, judged
from lbmdem.case.boundaries import Boundary, Obstacle, opening
from lbmdem.case.config import AXES, LbmDemConfig
from lbmdem.forecast.free_fall import drag_alone, ergun, stays
from lbmdem.forecast.piles import Bed, lies, span, whole_weight
from lbmdem.forecast.relaxation import key_of_tau, slower
from lbmdem.physics.velocity_sets import CS2
from lbmdem.setup.scene import Scene

MOST = 0.5  # of rho c_s2: there a flow that is let in doubles its density, and sound halves it between walls
# The share of it that is right, and what more does: where fluid comes in or leaves, and between walls
THROUGH = 0.02, "speeds and pressures are off by about as much"
SINKING = 0.1, "grains that sank diverged at 0.18"
STILL = 0.3, "the sound of the start diverged at 0.65"
NODES_SEEN = 1000
DENSEST = 0.95  # solid fraction of a bed of which a resistance is told


def pressures(config: LbmDemConfig) -> Iterator[Derived]:
    """The largest pressure above or below that of rest: what faces give, the drop of a flow that velocity faces let in,
    body forces and shaking along axes that walls close, and grains whose weight the fluid bears.

    A flow whose drop is r times rho c_s2 comes in with 1/(1 - r) times the density with which it leaves, whose speed
    grows by as much: its mass stays, and so does its kinematic viscosity.
    """
    unit = config.liquid.density * (config.spacing / config.time_step) ** 2 * CS2
    ends = [end for k in range(config.dimensions) for end in along(config, k) if end.pressure]
    if not ends:
        return
    largest = max(ends, key=lambda end: abs(end.pressure) / end.limit[0])
    (most, harm), off = largest.limit, abs(largest.pressure) / unit
    cure = f"{harm}; relaxation_time = {slower(config, 0.99 * math.sqrt(most / off))} makes sound fast enough"
    if largest.density:
        cure = "a density nearer to that of the fluid, or a pressure, which a smaller relaxation_time makes less of it"
    yield judged(
        "largest pressure", "p/(rho c_s2)", off, ok=off <= most, legal=off < MOST, limit=f"<= {most:g}, < {MOST:g} at "
        "all", source=f"weak compressibility; {largest.words}", key=largest.density or key_of_tau(config), cure=cure,
        forceable=largest.pressure > -unit,
    )  # fmt: skip


class End(NamedTuple):
    """The pressure at an end of an axis, Pa; its limit, what makes it, and the key of the density that a case gives in
    place of a pressure."""

    pressure: float
    limit: tuple[float, str]
    words: str
    density: Path = ()


def along(config: LbmDemConfig, k: int) -> Iterator[End]:
    """What happens at the ends of an axis."""
    faces = [next((f for f in config.boundary if f.face == AXES[k] + side), None) for side in "-+"]
    if AXES[k] in config.domain.periodic:
        return
    given = [at_face(config, face) for face in faces if face and face.type == "pressure"]
    parts = {} if len(given) == 2 else drops(config, k, faces)
    words = ", ".join(f"{name} {abs(part):.3g} Pa" for name, part in parts.items() if part)
    drop = sum(parts.values())
    carries = any(not stays(config, group) for group in config.grains)
    limit = SINKING if carries else STILL
    if any(face and face.is_open for face in faces):
        limit = THROUGH
    if not given:
        yield End(0.5 * drop, limit, f"half of {words}")
        return
    for pressure, face in zip(given, (face for face in faces if face and face.type == "pressure")):
        key = ("boundary", config.boundary.index(face), "density") if face.density is not None else ()
        yield End(pressure, limit, f"the pressure at {face.face}", key)
    if drop:
        yield End(given[0] + (drop if faces[1] and faces[1].type == "pressure" else -drop), limit, words)


def at_face(config: LbmDemConfig, face: Boundary) -> float:
    """The pressure at a face that is the furthest from that of rest, Pa."""
    unit = (config.spacing / config.time_step) ** 2 * CS2
    start = face.pressure or 0.0 if face.density is None else (face.density - config.liquid.density) * unit
    return max(start, start + face.pressure_rate * config.simulation.end_time, key=abs)


def between(config: LbmDemConfig, k: int) -> float:
    """The largest acceleration (m/s2) along an axis that two pressure faces give the fluid; 0 without them."""
    faces = [next((f for f in config.boundary if f.face == AXES[k] + side), None) for side in "-+"]
    given = [at_face(config, face) for face in faces if face and face.type == "pressure"]
    length = config.domain.size[k] - config.spacing  # the faces are the last nodes
    return (given[0] - given[-1]) / config.liquid.density / length if len(given) == 2 and length > 0.0 else 0.0


def drops(config: LbmDemConfig, k: int, faces: list[Boundary | None]) -> dict[str, float]:
    """How much higher the pressure at the low end of an axis is than at the high one, by cause, Pa."""
    size, rho, speed = config.domain.size, config.liquid.density, 0.0
    if all(face and face.is_open for face in faces):
        speed = max((face.velocity[k] for face in faces if face and face.type == "velocity"), key=abs, default=0.0)
    found = {"drop of the flow": math.copysign(resistance(config, k, speed), speed)}
    found["the body force"] = -rho * config.liquid.body_force[k] * size[k]
    down = config.gravity[k] / math.hypot(*config.gravity) if any(config.gravity) else 0.0
    for group in config.grains if down else ():
        if not stays(config, group):
            weight = -down * whole_weight(config, group) / (math.prod(size) / size[k])
            weight *= math.copysign(1.0, group.density - rho)
            if lies(config, group):  # and the fluid bears no more of it than the drop of a flow through it
                through = bed_drop(config, k, span(config, group, k), speed)
                weight = math.copysign(min(abs(weight), through), speed)
            found["the weight of grains"] = found.get("the weight of grains", 0.0) + weight
    shaken = rho * abs(config.shaking.acceleration[k]) * size[k] if config.shaking else 0.0
    found["the shaking"] = math.copysign(shaken, sum(found.values()))
    return found


def resistance(config: LbmDemConfig, k: int, speed: float) -> float:
    """Drop of the pressure, Pa, of a flow along an axis that a face lets in at this mean speed: that of a slot or duct,
    which planes and boxes narrow from place to place, and that of a bed of all other solids that stay."""
    if not speed:
        return 0.0
    narrowing = [obstacle for obstacle in config.obstacle if narrows(config, k, obstacle)]
    found = section_drop(config, k, speed, narrowing)
    held = [span(config, group, k) for group in config.grains if stays(config, group)]
    for box in (obstacle.shape.box for obstacle in config.obstacle if obstacle not in narrowing):
        if box is not None:
            low = [max(0.0, a) for a in box.low]
            edges = [min(b, length) - a for a, b, length in zip(low, box.high, config.domain.size)]
            if min(edges) > 0.0:
                solid = math.prod(edges)
                held.append(Bed(solid, sum(2.0 * solid / edge for edge in edges), low[k], low[k] + edges[k]))
    if held:
        solid, surface = (sum(one[j] for one in held) for j in range(2))
        whole = Bed(solid, surface, min(one.low for one in held), max(one.high for one in held))
        found += bed_drop(config, k, whole, speed)
    return found


def narrows(config: LbmDemConfig, k: int, obstacle: Obstacle) -> bool:
    """Whether an obstacle is a plane across an axis, or a box that makes sections across the axis k narrower."""
    box = obstacle.shape.box
    at = 0.0 if box is None else 0.5 * (box.low[k] + box.high[k])
    others = [other for other in config.obstacle if other is not obstacle]
    size = config.domain.size
    return opening(k, at, size, config.obstacle) != opening(k, at, size, others)


def section_drop(config: LbmDemConfig, k: int, speed: float, obstacles: list[Obstacle]) -> float:
    """The largest pressure above that of the outlet, Pa, in a channel of sections that differ: friction of the slot or
    the rectangular duct (Shah & London 1978), what speeds the fluid up where it narrows, with half of it lost, and what
    comes back where it widens (Borda & Carnot)."""
    size, rho = config.domain.size, config.liquid.density
    boxes = [obstacle.shape.box for obstacle in obstacles if obstacle.shape.box is not None]
    marks = {min(max(mark, 0.0), size[k]) for box in boxes for mark in (box.low[k], box.high[k])} | {0.0, size[k]}
    places = sorted(marks, reverse=speed > 0.0)  # from the outlet on
    sections = [(abs(b - a), opening(k, 0.5 * (a + b), size, obstacles)) for a, b in itertools.pairwise(places)]
    areas = [math.prod(tops[j] - ends[j] for j in range(len(size)) if j != k) for _, (ends, tops) in sections]
    if min(areas) <= 0.0:
        return 0.0  # nothing flows
    pressure = most = 0.0
    speeds = [abs(speed) * areas[-1] / area for area in areas]
    for (length, (ends, tops)), u, before in zip(sections, speeds, [*speeds[1:], speeds[-1]]):
        gaps = sorted(tops[j] - ends[j] for j in range(len(size)) if j != k and (
            j in config.walled(k) or (ends[j] > 0.0 and tops[j] < size[j])
        ))  # fmt: skip
        if gaps:
            a = gaps[0] / gaps[1] if len(gaps) == 2 else 0.0
            shape = 1 - 1.3553 * a + 1.9467 * a**2 - 1.7012 * a**3 + 0.9564 * a**4 - 0.2537 * a**5
            gradient = 12.0 * shape * (1.0 + a) ** 2 * u / gaps[0] ** 2
            pressure += rho * config.liquid.kinematic_viscosity * gradient * length
        most = max(most, pressure)
        pressure += 0.75 * rho * (u * u - before * before) if u > before else -rho * u * (before - u)
        most = max(most, pressure)
    return most


def bed_drop(config: LbmDemConfig, k: int, bed: Bed, speed: float) -> float:
    """Drop of the pressure of a flow along an axis through a bed, Pa: Ergun's (1952), or the drag of its grains as if
    each were alone, if that is more."""
    u, size, rho = abs(speed), config.domain.size, config.liquid.density
    length = max(bed.high - bed.low, 1e-300)
    c = min(DENSEST, bed.solid / (math.prod(size) / size[k] * length))
    slow, fast = ergun(config, c, 6.0 * bed.solid / bed.surface)
    alone = c * drag_alone(config, 2.0 * config.dimensions * bed.solid / bed.surface, u)
    return rho * length * max(alone, slow * u + fast * u * u)


def inflow(config: LbmDemConfig) -> Iterator[Derived]:
    """Mean density at the end, of a fluid that velocity faces let in and nothing lets out."""
    given = [(i, face) for i, face in enumerate(config.boundary) if face.type == "velocity"]
    if not given or any(face.type == "pressure" for face in config.boundary):
        return
    axis = AXES.index(given[0][1].face[0])  # open faces are those of one axis
    into = sum(face.velocity[axis] if face.face[1] == "-" else -face.velocity[axis] for _, face in given)
    mean = 1.0 + into * config.simulation.end_time / config.domain.size[axis]
    off = abs(mean - 1.0)
    yield judged(
        "mean density at the end", "rho/rho0", mean, ok=off <= 0.02, legal=off < 0.5, limit="within 1 +- 0.02, 0.5 at "
        "all", source="conservation of mass", key=("boundary", given[-1][0], "velocity"), forceable=mean > 0.0,
        cure=f"what flows in has no way out: a pressure face across {AXES[axis]} is one",
    )  # fmt: skip


def parabolas(config: LbmDemConfig) -> Iterator[Derived]:
    """Share of the nodes through which a parabola is to come in that obstacles cover; at most NODES_SEEN along an axis
    are seen."""
    d, dx = config.dimensions, config.spacing
    for i, face in enumerate(config.boundary):
        k = AXES.index(face.face[0])
        if face.profile == "uniform" or not face.velocity[k] or not config.obstacle or not config.walled(k):
            continue
        axes = [(np.unique(np.linspace(0, n - 1, min(n, NODES_SEEN)).round()) + 0.5) * dx for n in config.points]
        axes[k] = axes[k][:1] if face.face[1] == "-" else axes[k][-1:]
        x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        covered = np.zeros(x.shape[:-1], bool)
        for plane, box in ((obstacle.shape.plane, obstacle.shape.box) for obstacle in config.obstacle):
            if plane is not None:
                covered |= ((x - plane.point) * plane.normal).sum(axis=-1) <= 0.0
            elif box is not None:
                covered |= np.all((x >= box.low) & (x <= box.high), axis=-1)
        across = [axis.reshape([-1 if m == j else 1 for m in range(d)]) for j, axis in enumerate(axes)]
        inside = np.broadcast_to(Scene(config).inflow(face.face, tuple(across))[..., k] != 0.0, covered.shape)
        share = float(covered[inside].mean()) if inside.any() else 1.0
        yield judged(
            f"covered part of the parabola at {face.face}", "n/n", share, ok=share == 0.0, legal=share < 1.0,
            limit="0, < 1", source="nodes in obstacles", key=("boundary", i, "profile"), forceable=True,
            cure="planes across an axis and boxes along a whole side narrow it, other obstacles stand in its way: put "
            'them further inside, or say profile = "uniform"',
        )  # fmt: skip
