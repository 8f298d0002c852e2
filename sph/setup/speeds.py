"""Speeds that a case speaks of, m/s: of its fluids at t = 0, and of its walls."""

import itertools
import math
from typing import Any

import numpy as np

from hpcpic.core.space.shapes import unit
from sph.case import geometry
from sph.case.config import AXES, Fluid, SphConfig, Wall
from sph.case.motions import Motion
from sph.case.openings import Inlet
from sph.physics.stability import physical_viscosity
from sph.setup import flows
from sph.setup.rigid.rims import start_speed
from sph.setup.tanks import slides

PEAKS = {"uniform": 1.0, "parabolic": 1.5}  # largest velocity of a profile over the mean one


def speed_scale(config: SphConfig) -> float:
    """sqrt(2 g H) of the height H along gravity of liquids and of bodies above them, what moves or turns at t = 0, what
    flows in, and walls that swing, m/s: these push fluid, as others, such as a gate, need not. Without gravity all
    walls that move: nothing else may move fluid there.
    """
    g = math.hypot(*config.gravity)
    speeds = [geometry.length(fluid.velocity) + flows.speed(config, fluid) for fluid in config.fluid]
    speeds += [motion_speed(wall.motion) for wall in config.wall
               if wall.motion and (any(wall.motion.amplitude) or not g)]  # fmt: skip
    speeds += [start_speed(wall) for wall in config.wall if wall.body]
    speeds += [fastest(inlet) for inlet in config.inlet]
    if g:
        heights = [height for fluid in config.fluid if not fluid.gas for height in heights_of(config, fluid)]
        heights += [min(heights_of(config, wall)) for wall in config.wall if wall.body and not wall.body.hinge]
        heights += [height for inlet in config.inlet for height in surfaces(config, inlet)]
        speeds.append(math.sqrt(2 * g * max(0.0, max(heights, default=0.0) - min(heights, default=0.0))))
    return max(speeds, default=0.0)


def heights_of(config: SphConfig, fluid: Fluid | Wall) -> list[float]:
    """Heights against gravity of the corners of a fluid or a solid, m."""
    g = math.hypot(*config.gravity)
    return [-sum(a * b for a, b in zip(corner, config.gravity)) / g for corner in geometry.corners(fluid.shape)]


def lost_in_a_period(config: SphConfig) -> float:
    """2 nu k^2 T of a wave on the fluid, as long as it is deep: viscosity takes it to exp(- that) within its period
    (Lamb, Hydrodynamics, 348). 0 without a fluid.
    """
    heights = [height for fluid in config.fluid for height in heights_of(config, fluid)]
    if not heights:
        return 0.0
    k = 2 * math.pi / (max(heights) - min(heights))
    period = 2 * math.pi / math.sqrt(math.hypot(*config.gravity) * k)
    return 2 * physical_viscosity(config) * k * k * period


def fastest(inlet: Inlet) -> float:
    """Largest velocity of what flows in through an inlet at any time, m/s; of a discharge, through the whole box."""
    across = [b - a for axis, a, b in zip(AXES, inlet.low, inlet.high) if axis != inlet.axis[0]]
    speeds = [speed for _, speed in inlet.over_time("velocity")]
    speeds += [discharge / math.prod(across) for _, discharge in inlet.over_time("discharge")]
    return PEAKS[inlet.profile] * max(speeds, default=0.0)


def surfaces(config: SphConfig, inlet: Inlet) -> list[float]:
    """Heights against gravity of the lowest and highest corner of an inlet, m, or of its levels in place of that."""
    heights = [-sum(a * b for a, b in zip(corner, config.gravity)) / math.hypot(*config.gravity)
               for corner in itertools.product(*zip(inlet.low, inlet.high))]  # fmt: skip
    return [min(heights), *([level for _, level in inlet.over_time("level")] or [max(heights)])]


def motion_speed(motion: Motion) -> float:
    """Largest speed of a wall, m/s."""
    steps = [
        math.dist(a.displacement, b.displacement) / (b.time - a.time)
        for a, b in itertools.pairwise(motion.path)
        if b.time > a.time
    ]
    swing = 2 * math.pi * geometry.length(motion.amplitude) / motion.period
    return max([geometry.length(motion.velocity), swing, *steps])


def speed_jump(wall: Any, end: float) -> float:
    """Largest change of the velocity of a wall until a time in s, m/s, but for those in which it only slides along the
    fluid. Before t = 0 it rests, or goes with a fluid that starts with its velocity.
    """
    motion, changes = wall.section.motion, []
    times = {0.0, motion.start, motion.stop, *(place.time for place in motion.path)} - {None}
    for t in (t for t in times if t <= end):
        after, before = (wall.motion(at)[1] for at in (t, math.nextafter(t, -math.inf)))
        fluids = [fluid.velocity for fluid in wall.scene.config.fluid] if t == 0.0 and any(after) else []
        ways = [after - start for start in (before, *fluids)]
        if not any(slides(wall, way) for way in ways):
            changes.append(min(geometry.length(way) for way in ways))
    return max(changes, default=0.0)


def pushing_speed(wall: Any, end: float) -> float:
    """Largest speed until a time in s, m/s, with which a wall pushes fluid, carries it or drags it along: not that of a
    gate that leaves the fluid or slides along it.
    """
    motion, quarters = wall.section.motion, range(5 if any(wall.section.motion.amplitude) else 0)
    times = [0.0, end, motion.start, motion.stop, *(place.time for place in motion.path)]
    times += [motion.start + k * motion.period / 4 for k in quarters]
    moves = [wall.motion(t)[:2] for t in times if t is not None and t <= end]
    ways, speeds = (np.array(rows) for rows in zip(*moves))
    config = wall.scene.config
    if wall.shape.plane:
        ahead = np.clip(speeds @ unit(wall.shape.plane.normal), 0.0, None)[:, None]
    else:
        axes = range(config.dimensions)
        up, down = (np.array([pushes(wall, ways, k, upwards) for k in axes]) for upwards in (True, False))
        ahead = speeds * np.where(speeds > 0.0, up, down)
    viscous = any(fluid.dynamic_viscosity for fluid in config.fluid)
    drags = viscous and not (wall.section.solid or wall.rule.slips or wall.rule.repulsive)  # a solid slides out of it
    return float(np.max(np.linalg.norm(speeds if drags else ahead, axis=1)))


def pushes(wall: Any, ways: np.ndarray, k: int, up: bool) -> bool:
    """True if a wall that makes these ways[n, d] in m pushes fluid by going up or down along axis k: a hollow by what
    closes it behind, a solid if there is fluid at t = 0 before it.
    """
    if not wall.section.solid:
        return not wall.shape.box or AXES[k] + "-+"[not up] in wall.closed
    low, high = wall.corners[0] + ways.min(axis=0), wall.corners[1] + ways.max(axis=0)
    if up:
        low[k] = wall.corners[1][k]
    else:
        high[k] = wall.corners[0][k]
    tiny = 1e-6 * wall.scene.spacing
    boxes = (geometry.bounds(fluid.shape) for fluid in wall.scene.config.fluid)
    return any(np.all(low + tiny < b) and np.all(high - tiny > a) for a, b in boxes)
