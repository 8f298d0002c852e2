"""Interfaces of two liquids that move, and what holds their waves and fronts back beside viscosity.

Two liquids slide past each other at an interface that swings or overturns. The friction of pressed particles
(`friction`) takes work there, in a layer of some spacings: waves decay, or grow too slowly, by its part of the pressure
over the weight that drives them, and by spacings over wavelength. A perfect lattice is stiff. Where a heavy liquid
stands beside a light one it runs out under it, and its front is slowed down likewise, and by the artificial viscosity.
"""

import itertools
import math
from collections.abc import Iterator

import numpy as np

from hpcpic.core.case.derived import Derived, judged
from sph.case import geometry
from sph.case.config import Fluid, SphConfig
from sph.forecast.friction import share
from sph.setup.flows import StandingWave, flow_of, heights, hydrostatic
from sph.setup.scene import Scene

SWINGS, GROWS = 45.0, 20.0  # spacings of that layer, measured: by damping over frequency, by the loss of growth
SMOOTHEST = 2.0, 1.5  # h/dp, beyond which nothing is gained, of both
MOST = 0.06  # of the rate
FRONT, VISCOUS = 0.75, 25.0  # of the speed of a front: times that share; over Re, by the artificial viscosity; measured
DISORDER = 0.1  # with which a wave of 40 spacings has -3 % of its frequency, for +12 % (measured)


def interfaces(config: SphConfig, scene: Scene) -> Iterator[Derived]:
    """Rows of each interface, across gravity, of two liquids of different density."""
    pulls = [k for k, g in enumerate(config.gravity) if g]
    liquids = [(i, fluid) for i, fluid in enumerate(config.fluid) if not fluid.gas]
    for (_, heavy), (_, light) in itertools.permutations(liquids, 2) if len(pulls) == 1 else ():
        if heavy.density > light.density and (height := side_by_side(scene, heavy, light)):
            yield slowed(scene, heavy, light, height)
    for (i, lower), (j, upper) in itertools.permutations(liquids, 2) if len(pulls) == 1 else ():
        gap, length = heights(scene, upper)[0] - heights(scene, lower)[1], longest(scene, lower, upper)
        slopes = gap < -scene.spacing / 2  # by so much, or one is carved out of the other
        if lower.density == upper.density or gap > scene.spacing / 2 or length <= 0.0 or not over(scene, lower, upper):
            continue
        if not config.numerics.gradient_correction:
            yield held_back(scene, lower, upper, length)
        if upper.density > lower.density or swings(lower) or swings(upper) or slopes:
            yield from (stiff(fluid, k) for k, fluid in ((i, lower), (j, upper)) if not fluid.disorder)


def over(scene: Scene, lower: Fluid, upper: Fluid) -> bool:
    """If bottom and top of one liquid lie higher than those of the other, its bottom nearer to that one's top."""
    (low, high), (first, last) = heights(scene, lower), heights(scene, upper)
    return low < first and high < last and high - first < 0.5 * min(high - low, last - first)


def held_back(scene: Scene, lower: Fluid, upper: Fluid, length: float) -> Derived:
    """What friction takes of the rate of a wave of this length in m: damping over frequency, or of the growth."""
    numerics, g, falls = scene.config.numerics, float(np.linalg.norm(scene.gravity)), upper.density > lower.density
    best, layer = SMOOTHEST[falls], (GROWS if falls else SWINGS) * scene.spacing
    part, least = share(min(numerics.smoothing, best)), share(best)
    p = pressed(scene, upper)
    value = part * p * 2.0 * math.pi / (abs(upper.density - lower.density) * g * length) * layer / length
    cure = f"smoothing = {best}, {least / part:.2g} of it, or " if least < part else ""
    cure += f"spacing = {scene.spacing * MOST / value:.2g}" if value else ""
    cure += ', with viscosity_form = "none"' if numerics.artificial_viscosity else ""
    source = f"a wave of {length:.3g} m, {length / scene.spacing:.3g} spacings; {part:.2g} of {p:.4g} Pa, measured"
    return judged(f"friction of pressed particles where {lower.name} and {upper.name} meet", "of the rate", value,
                  limit=f"<= {MOST:g}", ok=value <= MOST, legal=True, source=source, cure=cure,
                  key=("numerics", "smoothing"))  # fmt: skip


def pressed(scene: Scene, fluid: Fluid) -> float:
    """Pa at the bottom of a fluid at rest."""
    g = float(np.linalg.norm(scene.gravity))
    point = np.array(geometry.middle(fluid.shape))
    point += scene.gravity / g * (point @ -scene.gravity / g - heights(scene, fluid)[0])
    return float(scene.eos.pressure(hydrostatic(scene, fluid, point[None]))[0]) + scene.eos.background


def side_by_side(scene: Scene, heavy: Fluid, light: Fluid) -> float:
    """Height in m along which two liquids stand beside each other; 0 where they do not touch so."""
    (low, high), (first, last) = (map(np.array, geometry.bounds(fluid.shape)) for fluid in (heavy, light))
    room = np.minimum(high, last) - np.maximum(low, first)
    flat = scene.gravity == 0.0
    touch = flat & (np.abs(room) <= scene.spacing / 2)
    if touch.sum() != 1 or np.any(room[~touch] <= scene.spacing / 2):
        return 0.0
    return float(room[~flat][0])


def slowed(scene: Scene, heavy: Fluid, light: Fluid, height: float) -> Derived:
    """What is lost of the speed of the front of a liquid that runs out under a lighter one (Benjamin 1968)."""
    numerics, g = scene.config.numerics, float(np.linalg.norm(scene.gravity))
    weight = (heavy.density - light.density) * g * height
    speed = math.sqrt(2.0 * weight / (heavy.density + light.density))
    part = 0.0 if numerics.gradient_correction else share(numerics.smoothing)
    alpha = (numerics.artificial_viscosity or 0.0) * scene.c0 * scene.h / (4 * (scene.dimensions + 2))
    rubbed, viscous = FRONT * part * pressed(scene, heavy) / weight, VISCOUS * alpha / (speed * height)
    cures = [f"smoothing = {SMOOTHEST[0]}"] if share(SMOOTHEST[0]) < part else []
    cures += ['viscosity_form = "none"'] if viscous > MOST / 4 else []
    loss = rubbed + viscous
    source = f"friction of pressed particles {rubbed:.2g}, artificial viscosity {viscous:.2g}, measured"
    return judged(f"speed that the front of {heavy.name} under {light.name} lacks", "of its speed", loss,
                  limit=f"<= {MOST:g}", ok=loss <= MOST, legal=True, source=source, cure=" with ".join(cures),
                  key=("numerics", "smoothing"))  # fmt: skip


def stiff(fluid: Fluid, index: int) -> Derived:
    """A perfect lattice at an interface that moves."""
    source = "a perfect lattice is stiff: a wave of 40 spacings swings 12 % too fast, measured"
    return Derived(f"disorder of {fluid.name}, where an interface moves", "of dp", 0.0, "", f">= {DISORDER:g}", "warn",
                   source, f"disorder = {DISORDER:g}", ("fluid", index, "disorder"))  # fmt: skip


def swings(fluid: Fluid) -> bool:
    """If it starts as a standing wave."""
    flow = flow_of(fluid, StandingWave)
    return bool(flow and flow.amplitude)


def longest(scene: Scene, lower: Fluid, upper: Fluid) -> float:
    """Length in m of the wave that the case starts, else of the longest that an interface has room for; 0 where the two
    do not lie on each other.
    """
    found = []
    (low, high), (first, last) = geometry.bounds(lower.shape), geometry.bounds(upper.shape)
    for k in np.flatnonzero(scene.gravity == 0.0).tolist():
        room = min(high[k], last[k]) - max(low[k], first[k])
        if room <= 0.0:
            return 0.0
        found.append(room if scene.periodic[k] else 2.0 * room)
    flow = flow_of(lower, StandingWave) or flow_of(upper, StandingWave)
    return flow.wavelength if flow and flow.wavelength else max(found, default=0.0)
