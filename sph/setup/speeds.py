"""Speeds that a case speaks of, m/s: of its fluids at t = 0, and of its walls."""

import itertools
import math

from sph.case import geometry
from sph.case.config import Fluid, Motion, SphConfig
from sph.setup import flows


def speed_scale(config: SphConfig) -> float:
    """sqrt(2 g H) of the fluid's height H along gravity, what moves at t = 0, and walls that swing, m/s: these push
    fluid, as others, such as a gate, need not.
    """
    g = math.hypot(*config.gravity)
    speeds = [geometry.length(fluid.velocity) + flows.speed(config, fluid) for fluid in config.fluid]
    speeds += [motion_speed(wall.motion) for wall in config.wall if wall.motion and any(wall.motion.amplitude)]
    speeds += [geometry.length(wall.body.velocity) for wall in config.wall if wall.body]
    if g:
        heights = [height for fluid in config.fluid for height in heights_of(config, fluid)]
        speeds.append(math.sqrt(2 * g * max(0.0, max(heights, default=0.0) - min(heights, default=0.0))))
    return max(speeds, default=0.0)


def heights_of(config: SphConfig, fluid: Fluid) -> list[float]:
    """Heights against gravity of the corners of a fluid, m."""
    g = math.hypot(*config.gravity)
    return [-sum(a * b for a, b in zip(corner, config.gravity)) / g for corner in geometry.corners(fluid.shape)]


def motion_speed(motion: Motion) -> float:
    """Largest speed of a wall, m/s."""
    steps = [
        math.dist(a.displacement, b.displacement) / (b.time - a.time)
        for a, b in itertools.pairwise(motion.path)
        if b.time > a.time
    ]
    swing = 2 * math.pi * geometry.length(motion.amplitude) / motion.period
    return max([geometry.length(motion.velocity), swing, *steps])
