"""Friction of particles that are pressed together, beside what drags and moves solids in slow flow and bodies in deep
fluid.

Particles lie in an order, which fluid that goes around a solid breaks and makes anew. Rates of density see that order,
so it takes work against the pressure, as friction does: a stress of a share of the pressure, whatever the viscosity,
the spacing and the speed. Rates with corrected gradients see none of it.
"""

import math
from collections.abc import Iterator

import numpy as np

from hpcpic.core.case.derived import Derived, Verdict, judged
from sph.case import geometry
from sph.case.config import SphConfig
from sph.setup.flows import at_rest, heights
from sph.setup.rigid.packing import rests_disordered
from sph.setup.scene import Scene, Wall
from sph.setup.speeds import heights_of

SHARE = (1.3, 1.5, 1.6, 1.8, 2.0), (0.042, 0.014, 0.010, 0.0051, 0.0031)  # stress over pressure, by h/dp: a disc sinks
SHIFTED = (1.3, 1.5, 1.6, 2.0), (0.042, 0.0053, 0.0028, 0.0018)  # with `shifting`
SLIPS = 0.17  # of it, around a body that slips
SLOW = 100.0  # v R / nu, beyond which inertia moves the fluid
STRESS = 3.0  # mu v / R: of slow flow on a cylinder between others or beside walls, where walls drive it
PULLED = 2.5  # rho a R: where a body force does
MOST = 0.05
RINGING = (1.3, 1.5, 2.0), (0.41, 0.29, 0.12)  # by h/dp: p of still water, 100 dp deep, over rho c0 sqrt(g H) disorder
MOST_RINGING = 0.1  # of the pressure at the bottom


def ringing(config: SphConfig, scene: Scene) -> Iterator[Derived]:
    """Sound that liquids make under their own weight which start disordered and are not evened out: particles off their
    places are pressed to others. No limit where two meet, as a lattice is stiff there.
    """
    g = float(np.linalg.norm(scene.gravity))
    for i, fluid in enumerate(scene.fluids):
        section = fluid.section
        depth = heights(scene, section)[1] - heights(scene, section)[0] if g else 0.0
        if section.gas or not (depth and section.disorder and at_rest(section)) or rests_disordered(scene, fluid):
            continue
        rings = float(np.interp(config.numerics.smoothing, *RINGING)) * config.sound_speed / math.sqrt(g * depth)
        value, wanted = rings * section.disorder, scene.liquids.densities
        verdict: Verdict = "ok" if wanted or value <= MOST_RINGING else "warn"
        yield Derived(f"sound that the disorder of {section.name} makes", "p/(rho g H)", value, "",
                      "" if wanted else f"<= {MOST_RINGING:g}", verdict,
                      "still water rings with it for seconds, measured",
                      f"disorder = {MOST_RINGING / rings:.2g}" if verdict == "warn" else "",
                      ("fluid", i, "disorder"))  # fmt: skip


def friction(config: SphConfig, scene: Scene) -> Iterator[Derived]:
    """Its share in the weight less buoyancy of bodies, and in the viscous stress on solids in slow flow."""
    numerics, g = config.numerics, float(np.linalg.norm(scene.gravity))
    if numerics.gradient_correction or not config.fluid:
        return
    part = share(numerics.smoothing, bool(numerics.shifting))
    source = f"{part:.2g} of the pressure, where particles pass a solid, measured"
    least = SHIFTED[1][-1]
    cure = f"smoothing = 2.0 with shifting, {least / part:.2g} of it; or " if least < 0.5 * part else ""
    cure += "gradient_correction = true with shifting = true, which has none: drag 4 % too small"
    for wall in scene.walls:
        if not (wall.section.solid and wall.rule.layered):
            continue
        radius, stress = radius_of(wall), part * pressure_at(scene, wall)
        if wall.rigid and g:
            stress *= SLIPS if wall.rule.slips else 1.0
            density = wall.rigid.mass / geometry.volume(wall.shape)
            whole = abs(density - scene.rho0) * g * radius / scene.dimensions
            name, symbol = f"friction of pressed particles on {wall.name}", "of its weight less buoyancy"
        elif scene.viscosity and not wall.rule.slips:
            nu, pull = scene.viscosity / scene.rho0, float(np.linalg.norm(scene.acceleration))
            fastest = config.eos.max_velocity or 0.0
            if min(fastest, pull * radius**2 / (4 * nu) or math.inf) * radius > SLOW * nu:
                continue
            driven, pulled = STRESS * scene.viscosity * fastest / radius, PULLED * scene.rho0 * pull * radius
            whole = min(driven, pulled or math.inf)
            name, symbol = f"friction of pressed particles past {wall.name}", "of the viscous stress"
        else:
            continue
        value = stress / whole if whole else math.inf
        if stress and math.isfinite(value):
            yield judged(name, symbol, value, limit=f"<= {MOST:g}", ok=value <= MOST, legal=True, source=source,
                         cure=cure, key=("numerics", "gradient_correction"))  # fmt: skip


def share(smoothing: float, shifting: bool = False) -> float:
    """The stress over the pressure, by h/dp."""
    return float(np.interp(smoothing, *(SHIFTED if shifting else SHARE)))


def radius_of(wall: Wall) -> float:
    """Half the least extent of a solid, m."""
    low, high = map(np.array, geometry.bounds(wall.shape))
    return float(np.min((high - low)[~wall.through], initial=math.inf)) / 2


def pressure_at(scene: Scene, wall: Wall) -> float:
    """Pa at the middle of a solid; for a body that sinks or rises, halfway."""
    config, g = scene.config, float(np.linalg.norm(scene.gravity))
    if not g:
        return scene.eos.background
    levels = [height for fluid in config.fluid for height in heights_of(config, fluid)]
    own, bottom, top = heights_of(config, wall.section), min(levels), max(levels)
    middle = (min(own) + max(own)) / 2
    if wall.rigid:
        heavy = wall.rigid.mass > scene.rho0 * geometry.volume(wall.shape)
        middle = (middle + (bottom if heavy else top)) / 2
    return scene.rho0 * g * min(max(top - middle, 0.0), top - bottom) + scene.eos.background
