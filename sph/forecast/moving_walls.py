"""Walls that move as they are told: beside sound, beside the fluid that they drag along, by steps and jumps of their
speed, and into others.
"""

import itertools
import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.case.derived import Derived, Verdict, judged, rounded_down
from sph.case import geometry
from sph.case.config import SphConfig
from sph.case.motions import Motion
from sph.physics import stability
from sph.setup.rigid.surfaces import TOUCHING, spheres, surfaces
from sph.setup.scene import Scene, Wall
from sph.setup.speeds import motion_speed, speed_jump, speed_scale
from sph.setup.tanks import slides

LONGEST_SWING = 0.5  # w L / c0 of walls that swing, where no surface gives way
LARGEST_JUMP = 0.5  # rho v^2: pressure of sound by a jump of the speed of a wall; that of the water where v^2 = 2 g H
LONGEST_WAY = 1.0  # spacings of a wall in a step, beyond which it jumps over fluid
LEAST_LAYER = 2.5  # spacings of the layer that a wall drags along, below which its drag is off by more than a tenth
DRAG = "drag over theory, plate 0.42 (0.25), 0.81 (0.5), 1.15 (1), 1.09 (2), cylinder 1.24 (0.9), 1.07 (2.8), measured"
APART, MOST_PLACES = 2.0, 1000  # spacings between places of a wall on its way that are looked at; so many at most
SAME = 1e-3  # of a spacing between two of them


def moving_walls(config: SphConfig, scene: Scene) -> Iterator[Derived]:
    """All of it."""
    for i, wall in enumerate(config.wall):
        if wall.motion:
            yield from swing(config, scene.walls[i])
            yield from dragged(scene.walls[i], wall.motion)
            yield from jumps(config, scene.walls[i], wall.motion)
    yield from meetings(scene)


def swing_sound(scene: Scene) -> float:
    """Least c0 in m/s with which walls that swing are slow beside sound; 0 where none is to be."""
    return max(map(sound_of, scene.walls), default=0.0)


def sound_of(wall: Wall) -> float:
    """Least c0 for one wall, m/s: 0 where it does not swing, slides along the fluid, or a surface gives way."""
    config, motion = wall.scene.config, wall.section.motion
    if not motion or not any(motion.amplitude) or any(config.gravity) or slides(wall, np.array(motion.amplitude)):
        return 0.0
    boxes = [geometry.bounds(fluid.shape) for fluid in config.fluid]
    extent = max((b - a for low, high in boxes for a, b in zip(low, high)), default=0.0)
    return 2 * math.pi / motion.period * extent / LONGEST_SWING


def swing(config: SphConfig, wall: Wall) -> Iterator[Derived]:
    """A wall that swings as fast as sound crosses the fluid."""
    if needed := sound_of(wall):
        source = "added mass of a cylinder in a closed box, 1.06 by theory: 1.07 (0.25), 1.16 (0.75), 0.2 (6)"
        yield judged(f"swing of {wall.name} beside sound", "w L/c0", LONGEST_SWING * needed / config.sound_speed,
                     limit=f"<= {LONGEST_SWING:g}", ok=needed <= config.sound_speed, legal=True, source=source,
                     cure=f"sound_speed = {1.01 * needed:.3g}", key=("eos", "sound_speed"))  # fmt: skip


def dragged(wall: Wall, motion: Motion) -> Iterator[Derived]:
    """A wall that swings and holds a viscous fluid: the layer of that which goes with it (Stokes' second problem)."""
    scene, rule = wall.scene, wall.rule
    if any(motion.amplitude) and scene.viscosity and not (rule.slips or rule.repulsive or rule.layer_images):
        depth = math.sqrt(scene.viscosity / scene.rho0 * motion.period / math.pi)
        yield judged(f"layer of fluid that {wall.name} drags along", "(2 nu/w)^(1/2)/dp", depth / scene.spacing,
                     limit=f">= {LEAST_LAYER:g}", ok=depth >= LEAST_LAYER * (1 - 1e-9) * scene.spacing, legal=True,
                     source=DRAG, cure=f"spacing = {rounded_down(depth / LEAST_LAYER):g}",
                     key=("numerics", "spacing"))  # fmt: skip


def jumps(config: SphConfig, wall: Wall, motion: Motion) -> Iterator[Derived]:
    """A wall so fast that it is behind fluid before it has met it, or whose speed jumps."""
    dt, key = stability.time_step(config), ("wall", wall.index, "motion")
    way = motion_speed(motion) * dt / config.numerics.spacing
    yield judged(f"way of {wall.name} in a step", "v dt/dp", way, limit=f"<= {LONGEST_WAY:g}", ok=way <= LONGEST_WAY,
                 source="it jumps over fluid", cure=f"{LONGEST_WAY * config.numerics.spacing / dt:.3g} m/s or less",
                 key=key, forceable=True)  # fmt: skip
    jump = speed_jump(wall, config.simulation.end_time)
    pressure = wall.scene.rho0 * config.sound_speed * jump
    most = LARGEST_JUMP * wall.scene.rho0 * (config.eos.max_velocity or speed_scale(config)) ** 2
    source = f"{jump:.3g} m/s at once, {jump / config.sound_speed:.2g} c0; none where it slides along fluid"
    yield judged(f"impact by jumps of the speed of {wall.name}", "rho c0 dv", pressure, unit="Pa",
                 limit=f"<= {most:.3g}", ok=pressure <= most, legal=True, source=source, key=key,
                 cure="a smooth path, with more points, also from and to rest")  # fmt: skip


def meetings(scene: Scene) -> Iterator[Derived]:
    """Walls of which one comes nearer to another than a layer of fluid, or goes through it. Those that touch at the
    start slide along each other.
    """
    dp, layer = scene.spacing, (1.0 - TOUCHING) * scene.spacing
    for one, other in itertools.permutations([wall for wall in scene.walls if not wall.rigid], 2):
        twice = other.section.solid and not other.shape.plane and other.index < one.index
        if twice or not one.section.solid or one.shape.plane or not (one.moving or other.moving):
            continue
        (x, radius), (ways, times) = outline(one, other), places(one, other)
        gaps = np.array([[float((apart - radius).min(initial=np.inf)) for apart, _ in surfaces(other, x + way)]
                         for way in ways])  # fmt: skip
        nearest = gaps[:, gaps[0] >= layer].min(axis=1, initial=np.inf)
        if nearest.min() >= layer:
            continue
        k = int(np.argmax(nearest < layer))
        until = float(np.interp(-dp, -nearest[k - 1 : k + 1], times[k - 1 : k + 1]))
        wet, mover = between(one, ways[k]), one if one.moving else other
        least, name = float(nearest.min()), f"least gap between {one.name} and {other.name} on the way of {mover.name}"
        verdict: Verdict = "fail" if wet and least < -TOUCHING * dp else "warn"
        source = "fluid is squeezed there" if wet else "they meet"
        yield Derived(name, "", least, "m", f">= {dp:g}, a layer of fluid", verdict, source,
                      f"an end of the way at t = {rounded_down(until) if until else 0:g} s",
                      ("wall", mover.index, "motion"), True)  # fmt: skip


def outline(one: Wall, other: Wall) -> tuple[NDArray[np.float64], NDArray[np.float64] | float]:
    """Centres[n, d] and radii of spheres of a solid, m, that touch another wall first: of a box beside flat faces its
    corners.
    """
    flat = one.shape.box and other.shape.box and not other.section.solid
    shape = one.section.shape  # not without ends, as that of a wall through a period
    return (np.array(geometry.corners(shape)), 0.0) if flat else spheres(shape, one.scene.spacing)


def places(one: Wall, other: Wall) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Displacements [n, d] of a wall beside another in the run, m, 0 at first, and when it comes there, [n] in s."""
    times, speed, end = [0.0], 0.0, 0.0
    for wall in (one, other):
        if motion := wall.section.motion:
            swings = any(motion.amplitude) and not any(motion.velocity) and not motion.path
            last = min(wall.scene.config.simulation.end_time, motion.start + motion.period if swings else np.inf)
            known = [last, motion.start, motion.stop, *(place.time for place in motion.path)]
            known += [motion.start + k / 4 * motion.period for k in (1, 3)]
            times += [t for t in known if t is not None and t <= last]
            speed, end = speed + motion_speed(motion), max(end, last)
    n = min(math.ceil(speed * end / (APART * one.scene.spacing)), MOST_PLACES)
    moments = np.unique([*times, *np.linspace(0.0, end, n + 1)])
    ways = np.array([one.motion(t)[0] - other.motion(t)[0] for t in moments.tolist()])
    first = np.sort(np.unique(np.rint(ways / (SAME * one.scene.spacing)), axis=0, return_index=True)[1])
    return ways[first], moments[first]


def between(wall: Wall, way: NDArray[np.float64]) -> bool:
    """If a fluid is at t = 0 where a solid comes to by going along [d] m."""
    (low, high), tiny = wall.corners, TOUCHING * wall.scene.spacing
    low, high = np.minimum(low, low + way) + tiny, np.maximum(high, high + way) - tiny
    boxes = (geometry.bounds(fluid.shape) for fluid in wall.scene.config.fluid)
    return any(np.all(low < b) and np.all(high > a) for a, b in boxes)
