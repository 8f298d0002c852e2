"""Errors of gravity waves on a liquid: few neighbours, and waves long beside the depth, make them too fast."""

from collections.abc import Iterator

import numpy as np

from hpcpic.core.case.derived import Derived, Verdict
from sph.case import geometry
from sph.case.config import AXES, SphConfig
from sph.setup.scene import Scene
from sph.setup.speeds import lost_in_a_period
from sph.setup.tanks import free_surface, open_sides

SHORT = (1.0, 1.15, 1.3, 1.4, 1.5, 1.6, 2.0), (-5.4, -2.2, -4.3, -4.0, -0.6, 0.0, -0.2)  # h/dp, % of the period
LONG = (1.3, 1.5, 1.6, 1.7, 2.0), (-6.0, -1.2, 0.0, -0.8, -0.8)  # the same, of 4 to 10 depths
LENGTHS = 2.0, 4.0  # depths, of the two
FEWEST = 1.3  # h/dp, below which hardly anything but that period is measured; papers have cases with it
SOLITARY = (1.3, 1.5, 1.6, 1.7, 2.0), (6.5, 4.8, 3.5, 1.3, 0.1)  # h/dp, % of the speed of a solitary wave
CORRECTED = 1.5, 0.2  # h / dp from which it is so with corrected gradients: not measured below
LEAST_ROOM = 5.0  # depths along which a solitary wave, which is some depths long, has a way to go


def waves(config: SphConfig, scene: Scene) -> Iterator[Derived]:
    """The errors of the period of the longest standing wave, and of the speed of a solitary wave."""
    ratio, key = config.numerics.smoothing, ("numerics", "smoothing")
    if not (scene.gravity.any() and config.numerics.kernel == "wendland2" and ratio <= SHORT[0][-1]):
        return
    room, length = lengths(scene)
    error, few = period_error(ratio, length), ratio < FEWEST * (1 - 1e-9)
    source = f"a standing wave of {length:.3g} depths, the longest here, measured" if length else "a standing wave"
    source += "; little else is with so few neighbours" if few else ""
    verdict: Verdict = "warn" if few else "ok"
    cure = f"smoothing = 1.5, the default: {period_error(1.5, length):g} %" if few else ""
    yield Derived("error of the period of waves", "", error, "%", f"h/dp >= {FEWEST}", verdict, source, cure, key)
    corrected = config.numerics.gradient_correction
    seen = CORRECTED[0] if corrected else SOLITARY[0][0]
    if ratio >= seen * (1 - 1e-9) and room >= LEAST_ROOM and lost_in_a_period(config) <= 1.0 and driven(scene):
        error = CORRECTED[1] if corrected else round(float(np.interp(ratio, *SOLITARY)), 1)
        source = "one of 0.3 of the depth after 13 depths, 20 layers, measured; h/dp 2 or gradient_correction cures it"
        yield Derived("error of the speed of a solitary wave", "", error, "%", source=source)


def period_error(ratio: float, length: float) -> float:
    """Error of the period of a standing wave so many depths long with so many h/dp, %."""
    return round(float(np.interp(length, LENGTHS, [np.interp(ratio, *SHORT), np.interp(ratio, *LONG)])), 1)


def lengths(scene: Scene) -> tuple[float, float]:
    """Depths of the liquid at rest for which its tank has room across gravity, and of the longest standing wave in it;
    0 without a liquid.
    """
    up = int(np.argmax(np.abs(scene.gravity)))
    liquids = [fluid for fluid in scene.fluids if fluid.n and not fluid.section.gas]
    if not liquids:
        return 0.0, 0.0
    low, high = scene.low.copy(), scene.high.copy()
    boxes = [np.array(geometry.bounds(fluid.section.shape)) for fluid in liquids]
    first, last = np.min([a for a, _ in boxes], axis=0), np.max([b for _, b in boxes], axis=0)
    for wall in scene.walls:
        a, b = wall.corners
        if not wall.section.solid and np.all(a < last) and np.all(b > first):
            low, high = np.maximum(low, a), np.minimum(high, b)
    across = [k for k in range(scene.dimensions) if k != up]
    room = (high - low)[across]
    volume = sum(fluid.n * fluid.mass / fluid.section.density for fluid in liquids)
    depth = volume / float(np.prod(room))
    whole = np.where(scene.periodic[across], 1.0, 2.0) * room
    return float(room.max()) / depth, float(whole.max()) / depth


def driven(scene: Scene) -> bool:
    """If a free surface does not stay level: a wall moves, fluid flows in, has a velocity or a force of its own, or
    spreads.
    """
    config, up = scene.config, AXES[int(np.argmax(np.abs(scene.gravity)))]
    liquids = [fluid for fluid in config.fluid if not fluid.gas]
    moved = any(any(fluid.velocity) or fluid.flow or fluid.start or fluid.acceleration for fluid in liquids)
    spread = any(side[0] != up for fluid in liquids for side in open_sides(config, fluid))
    pushed = bool(config.inlet) or any(config.body_force) or any(wall.motion for wall in config.wall)
    return (moved or spread or pushed) and (free_surface(config) or bool(scene.liquids.gases))
