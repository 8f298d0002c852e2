"""Slips of a unit or of a place: densities of no liquid, water over the rim of its tank, the pressure of rest in water
that rests on nothing, hinges far from their body, sensors of pressure in plates.
"""

import math
from collections.abc import Iterator

import numpy as np

from hpcpic.core.case.derived import Derived
from sph.case import geometry
from sph.case.config import AXES, WALL_PRESSURE, Fluid, SphConfig
from sph.setup.flows import at_rest, hydrostatic, up
from sph.setup.scene import FluidSet, Scene, Wall
from sph.setup.signed_distance import signed_distance
from sph.setup.tanks import depth_in_solid, depth_in_wall, frame

EARTH = 9.0, 10.5  # m/s2: gravity by which a case is known to be in SI units
LIQUIDS = 50.0, 25000.0  # kg/m3: hydrogen has 71, gold 19300
GASEOUS = 2.0  # exponents of the equation of state below are of gases
MOST_LOOKED, MOST_LOWEST = 100_000, 1_000  # particles of a fluid that are looked at, and looked under
FARTHEST = 2.0  # lengths of a body that its hinge is away from it


def slips(config: SphConfig, scene: Scene) -> Iterator[Derived]:
    """All of them."""
    yield from densities(config)
    yield from over_rims(config, scene)
    yield from in_the_air(scene)
    yield from hinges(config)
    yield from plates(config, scene)


def densities(config: SphConfig) -> Iterator[Derived]:
    """Liquids under the gravity of the Earth that are no liquids."""
    if not EARTH[0] < math.hypot(*config.gravity) < EARTH[1] or config.eos.gamma < GASEOUS:
        return
    for i, fluid in enumerate(config.fluid):
        if not fluid.gas and not LIQUIDS[0] <= fluid.density <= LIQUIDS[1]:
            yield Derived(f"density of {fluid.name}", "rho0", fluid.density, "kg/m3",
                          f"{LIQUIDS[0]:g} .. {LIQUIDS[1]:g}", "warn", "of a liquid; water has 1000, air 1.2",
                          "density = 1000 for water", ("fluid", i, "density"))  # fmt: skip


def over_rims(config: SphConfig, scene: Scene) -> Iterator[Derived]:
    """Liquids higher than the rim of the tank they are in, where nothing else holds them."""
    pulls = [k for k, g in enumerate(config.gravity) if g]
    if len(pulls) != 1:
        return
    up, dp = pulls[0], config.numerics.spacing
    sign = -math.copysign(1.0, config.gravity[up])
    for i, fluid in enumerate(config.fluid):
        low, high = geometry.bounds(fluid.shape)
        top, bottom = (high, low) if sign > 0 else (low, high)
        for wall in scene.walls:
            box = wall.section.shape.box
            if fluid.gas or wall.section.solid or not box or AXES[up] + ("+" if sign > 0 else "-") not in box.open:
                continue
            rim = (box.high if sign > 0 else box.low)[up]
            over = sign * (top[up] - rim)
            if over <= dp / 2 or sign * (rim - bottom[up]) <= dp:
                continue
            faces = [side for side in held_sides(scene, fluid, up, rim - sign * dp / 2, wall)
                     if side not in held_sides(scene, fluid, up, rim + sign * over / 2)]  # fmt: skip
            if faces:
                yield Derived(f"height of {fluid.name} over the rim of {wall.name}", " ".join(faces), over, "m", "<= 0",
                              "warn", "it runs over", f"a higher {wall.name}, or {fluid.name} up to {rim:g} m",
                              ("fluid", i, "shape"))  # fmt: skip


def held_sides(scene: Scene, fluid: Fluid, up: int, height: float, *walls: Wall) -> list[str]:
    """Sides of a fluid, as "x+", before which there is a wall, or one of these, at this height along the axis `up`."""
    found, (low, high) = [], map(np.array, geometry.bounds(fluid.shape))
    for k in (k for k in range(scene.dimensions) if k != up):
        for side, at in (("-", low[k] - scene.spacing / 2), ("+", high[k] + scene.spacing / 2)):
            place = (low + high) / 2
            place[k], place[up] = at, height
            if scene.periodic[k] or any(depth_in_wall(wall, place[None])[0] > 0.0 for wall in walls or scene.walls):
                found.append(AXES[k] + side)
    return found


def in_the_air(scene: Scene) -> Iterator[Derived]:
    """Liquids that start with the pressure of rest and have nothing under their lowest particles: they fall, without
    pressure. A height of the surface that the case gives is meant.
    """
    for i, fluid in enumerate(scene.fluids):
        section = fluid.section
        if section.gas or section.surface is not None or not (fluid.n and at_rest(section) and scene.gravity.any()):
            continue
        x = fluid.points(fluid.first + spread(fluid.n, MOST_LOOKED))
        high = x @ up(scene)
        lowest = x[high <= high.min() + scene.spacing / 2]
        if not carried(scene, fluid, lowest[spread(len(lowest), MOST_LOWEST)]):
            most = float(scene.eos.pressure(hydrostatic(scene, section, x)).max())
            yield Derived(f"pressure of rest in {section.name}, under which there is nothing", "p", most, "Pa", "0",
                          "warn", "it falls freely", 'initial_pressure = "zero"',
                          ("fluid", i, "initial_pressure"))  # fmt: skip


def spread(n: int, most: int) -> np.ndarray:
    """All numbers below n, or about so many of them, in step with no lattice."""
    return np.arange(n) if n <= most else np.unique((np.arange(most) * (math.sqrt(5) - 1) / 2 % 1.0 * n).astype(int))


def carried(scene: Scene, fluid: FluidSet, x: np.ndarray) -> bool:
    """If a wall, a solid, another fluid, an inlet or an outlet is within a support under points[n, d] of a fluid."""
    deep = np.arange(scene.spacing / 2, scene.support, scene.spacing / 2)
    under = (x[:, None] - deep[:, None] * up(scene)).reshape(-1, scene.dimensions)
    openings = (*scene.config.inlet, *scene.config.outlet)
    return (
        any((depth_in_wall(wall, under) > 0.0).any() for wall in scene.walls)
        or any((signed_distance(o.section.shape, under) <= 0.0).any() for o in scene.fluids if o is not fluid)
        or any(np.all((under >= one.low) & (under <= one.high), axis=1).any() for one in openings)
    )


def hinges(config: SphConfig) -> Iterator[Derived]:
    """Hinges beyond the domain and far from the body that turns on them."""
    for i, wall in enumerate(config.wall):
        if wall.body and wall.body.hinge:
            point, (low, high) = wall.body.hinge.point, geometry.bounds(wall.shape)
            away, most = geometry.apart(point, point, low, high), FARTHEST * math.dist(low, high)
            if away > most and geometry.apart(point, point, *config.domain.corners):
                yield Derived(f"distance of the hinge of {wall.name} from it", "", away, "m", f"<= {most:.3g} m",
                              "warn", "it is beyond the domain too", "a point of the body, or beside it",
                              ("wall", i, "body", "hinge", "point"))  # fmt: skip


def plates(config: SphConfig, scene: Scene) -> Iterator[Derived]:
    """Sensors in solids so thin that the particles behind the area feel the fluid beyond the other face."""
    reach = 2 * scene.support - scene.spacing  # of the particles that count, and of theirs
    solids = [wall for wall in scene.walls if wall.section.solid and not wall.rule.images]
    for i, gauge in enumerate(config.gauge):
        if gauge.kind is not WALL_PRESSURE:
            continue
        along, sign = gauge.direction
        deep = np.linspace(0.0, reach, 65)[1:]
        x = np.array(gauge.at) + deep[:, None] * sign * frame(scene, gauge)[along]
        for wall in solids:
            out = depth_in_solid(wall, x) <= -1e-9 * scene.spacing
            if gauge.wall not in ("", wall.name) or out[0] or not out.any():
                continue
            first = int(np.argmax(out))
            if not any(depth_in_wall(other, x[first, None])[0] > 0.0 for other in scene.walls if other is not wall):
                yield Derived(f"thickness of {wall.name} behind {gauge.name}", "L/dp", deep[first] / scene.spacing, "",
                              f">= {reach / scene.spacing:.3g}", "warn", "it feels the fluid at the other face too",
                              f"a thicker {wall.name}, spacing = {deep[first - 1] * scene.spacing / reach:.2g}, or "
                              "measure_force, of both faces", ("gauge", i, "at"))  # fmt: skip
