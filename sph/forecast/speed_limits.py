"""Speeds that the sound speed of a case is to be compared with, besides those that its default knows."""

import math
from collections.abc import Iterator

import numpy as np

from hpcpic.core.case.derived import Derived, judged, rounded_down
from sph.case import geometry
from sph.case.config import SphConfig
from sph.physics.stability import physical_viscosity
from sph.setup import flows
from sph.setup.rigid.rims import start_speed
from sph.setup.rigid.surfaces import off
from sph.setup.scene import Scene, Wall
from sph.setup.speeds import fastest, heights_of, motion_speed, pushing_speed, surfaces
from sph.setup.tanks import depth_in_wall

MOST_CELLS = 4e6  # of a spacing, in which a way down is looked for
FASTER = 1.02  # particles of a jet than its free fall: 1.012, measured over 1.2 m
LEAST_FACTOR = 7.0  # c0 over the largest speed of fluid, below which its density is off by 2 %
FEWEST = 6  # spacings across a gap that is sheared, below which its stress is more than a twentieth off
MOST_SQUEEZED = 0.01  # rho / rho0 - 1 by mu v over a gap, beyond which viscous pressures compress the fluid instead


def speed_limits(config: SphConfig, scene: Scene) -> Iterator[Derived]:
    """All of them."""
    yield from pushing_walls(config, scene)
    yield from squeezed(config, scene)
    yield from free_fall(config, scene)


def pushing_walls(config: SphConfig, scene: Scene) -> Iterator[Derived]:
    """Walls and bodies that take fluid with them: it becomes as fast as they are. A gate that leaves it does not."""
    for wall in scene.walls:
        speed = pushing_speed(wall, config.simulation.end_time) if wall.moving else 0.0
        if wall.rigid:
            speed = start_speed(wall.section)
        if speed:
            yield judged(f"sound speed over the speed of {wall.name}", "c0/v", config.sound_speed / speed,
                         limit=f">= {LEAST_FACTOR:g}", ok=config.sound_speed >= LEAST_FACTOR * speed, legal=True,
                         source="it takes fluid with it", key=("eos", "max_velocity"),
                         cure=f"max_velocity = {speed:.3g}, or sound_speed = {10 * speed:.3g}")  # fmt: skip


def squeezed(config: SphConfig, scene: Scene) -> Iterator[Derived]:
    """Solids that are driven through a viscous fluid beside another wall: spacings across the least gap, and the
    density that the pressure of viscosity makes of the fluid there. There is none of that between round solids about
    one centre of which one turns.
    """
    nu = physical_viscosity(config)
    for wall in (wall for wall in scene.walls if nu and wall.section.solid):
        motion = wall.section.motion
        speed = start_speed(wall.section) if wall.rigid else motion_speed(motion) if motion else 0.0
        gaps = [(off(wall, other), other) for other in scene.walls if other is not wall] if speed else []
        apart = [one for one in gaps if scene.spacing / 2 < one[0] < math.inf]
        for gap, other in sorted(apart, key=lambda one: one[0])[:1]:
            if not (wall.rule.slips or gap > 2 * FEWEST * scene.spacing):
                yield judged(f"spacings across the gap between {wall.name} and {other.name}", "L/dp",
                             gap / scene.spacing, limit=f">= {FEWEST}", ok=gap >= FEWEST * (1 - 1e-9) * scene.spacing,
                             legal=True, source="torques of Couette flow: -21 % (1), +8 % (2, 3), +7 % (4), +4 % (6)"
                             ", measured", cure=f"spacing = {rounded_down(gap / FEWEST):g}",
                             key=("numerics", "spacing"))  # fmt: skip
        pressed = [one for one in apart if not coaxial(wall, one[1])]
        for gap, other in sorted(pressed, key=lambda one: one[0])[:1]:
            dense = nu * speed / (gap * config.sound_speed**2)
            if dense >= MOST_SQUEEZED / 10:
                source = "Morris et al. 1997; load of an eccentric journal: -43 % (0.04), -6 % (0.01), measured"
                least = math.sqrt(nu * speed / gap / MOST_SQUEEZED)
                yield judged(f"density by viscosity between {wall.name} and {other.name}", "nu v/(L c0^2)", dense,
                             limit=f"<= {MOST_SQUEEZED:g}", ok=dense <= MOST_SQUEEZED * (1 + 1e-9), legal=True,
                             source=source, key=("eos", "sound_speed"),
                             cure=f"sound_speed = {1.01 * least:.3g}")  # fmt: skip


def coaxial(wall: Wall, other: Wall) -> bool:
    """Whether a disc or ball turns on the spot in, or around, another one."""
    one, two, body = wall.shape.sphere, other.shape.sphere, wall.section.body
    return bool(
        one and two and body and not any(body.velocity) and math.dist(one.centre, two.centre) < 1e-6 * one.radius
    )


def free_fall(config: SphConfig, scene: Scene) -> Iterator[Derived]:
    """How fast fluid becomes that falls to the lowest place it can come to, where c0 may be too small for it: its
    default knows the height of the fluid alone.
    """
    g = math.hypot(*config.gravity)
    if not 0.0 < g < math.inf or not (config.fluid or config.inlet):
        return
    top, most = highest(config, g), config.sound_speed / LEAST_FACTOR
    up, cells = -scene.gravity / g, np.prod((scene.high - scene.low) / scene.spacing)
    floor = float(np.minimum(scene.low * up, scene.high * up).sum())
    if FASTER * math.sqrt(2 * g * max(0.0, top - floor)) <= most or cells > MOST_CELLS:
        return
    speed = FASTER * math.sqrt(2 * g * (top - lowest(scene, up, top)))
    yield judged("sound speed over the speed of a free fall", "c0/v", config.sound_speed / max(speed, 1e-300),
                 limit=f">= {LEAST_FACTOR:g}", ok=speed <= most, legal=True, key=("eos", "max_velocity"),
                 source="down to where fluid comes; splashes of a dam break reach 1.5 sqrt(2 g H)",
                 cure=f"max_velocity = {speed:.3g}")  # fmt: skip


def highest(config: SphConfig, g: float) -> float:
    """Height against gravity of liquids and inlets, and what their speed takes them higher, m."""
    liquids = [fluid for fluid in config.fluid if not fluid.gas]
    heads = [(max(heights_of(config, fluid)), geometry.length(fluid.velocity) + flows.speed(config, fluid))
             for fluid in liquids]  # fmt: skip
    heads += [(max(surfaces(config, inlet)), fastest(inlet)) for inlet in config.inlet]
    return max(height + speed**2 / (2 * g) for height, speed in heads)


def lowest(scene: Scene, up: np.ndarray, top: float) -> float:
    """Height of the lowest place in the domain to which there is a way from liquids and inlets below the height `top`,
    m. Solids that move do not stop them.
    """
    from scipy.ndimage import label

    dp, config = scene.spacing, scene.config
    lines = [np.arange(a + dp / 2, max(b, a + dp), dp) for a, b in zip(scene.low, scene.high)]
    x = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, scene.dimensions)
    free = x @ up <= top
    for wall in scene.walls:
        if not (wall.section.solid and (wall.moving or wall.rigid)):
            free &= depth_in_wall(wall, x) <= 0.0
    boxes = [geometry.bounds(fluid.shape) for fluid in config.fluid if not fluid.gas]
    boxes += [(inlet.low, inlet.high) for inlet in config.inlet]
    wet = np.any([np.all((x >= low) & (x <= high), axis=1) for low, high in boxes], axis=0)
    part = label(free.reshape([len(line) for line in lines]))[0].ravel()
    reached = x[free & np.isin(part, np.unique(part[wet & free]))]
    return float(np.min(reached @ up, initial=top)) - dp / 2
