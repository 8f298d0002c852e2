"""Speeds that a case speaks of, m/s: of its fluids at t = 0, and of its walls."""

import itertools
import math
from typing import Any

from sph.case import geometry
from sph.case.config import AXES, Fluid, Motion, SphConfig, Wall
from sph.case.openings import Inlet
from sph.setup import flows
from sph.setup.tanks import slides

PEAKS = {"uniform": 1.0, "parabolic": 1.5}  # largest velocity of a profile over the mean one


def speed_scale(config: SphConfig) -> float:
    """sqrt(2 g H) of the height H along gravity of liquids and of bodies above them, what moves at t = 0, what flows
    in, and walls that swing, m/s: these push fluid, as others, such as a gate, need not.
    """
    g = math.hypot(*config.gravity)
    speeds = [geometry.length(fluid.velocity) + flows.speed(config, fluid) for fluid in config.fluid]
    speeds += [motion_speed(wall.motion) for wall in config.wall if wall.motion and any(wall.motion.amplitude)]
    speeds += [geometry.length(wall.body.velocity) for wall in config.wall if wall.body]
    speeds += [fastest(config, inlet) for inlet in config.inlet]
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


def fastest(config: SphConfig, inlet: Inlet) -> float:
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
