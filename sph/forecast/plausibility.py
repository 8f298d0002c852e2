"""What is legal in an SPH case and yet most likely not meant: as numbers with limits, for `check`."""

import math
from collections.abc import Iterator

import numpy as np

from hpcpic.core.case.config import Path
from hpcpic.core.case.derived import Derived, Verdict, judged, rounded_down
from sph.case import geometry
from sph.case.config import AXES, SphConfig
from sph.forecast.bodies import bodies
from sph.forecast.damping import damping
from sph.forecast.friction import friction, ringing
from sph.forecast.interfaces import interfaces
from sph.forecast.joints import joints, walled
from sph.forecast.left_out import suction, surface_tension
from sph.forecast.moving_walls import moving_walls
from sph.forecast.size import longest
from sph.forecast.slips import slips
from sph.forecast.speed_limits import speed_limits
from sph.physics import stability
from sph.physics.fluxes import FLUXES
from sph.physics.stray_limits import MAX_DENSITY_ERROR, most_strays
from sph.setup.flows import at_rest, load
from sph.setup.obstacles import NEAR
from sph.setup.openings import Source
from sph.setup.rigid.surfaces import TOUCHING, nearest, surfaces
from sph.setup.scene import Scene, Wall
from sph.setup.signed_distance import signed_distance
from sph.setup.speeds import fastest, speed_scale
from sph.setup.tanks import depth_in, depth_in_wall, open_sides

DENSE, DENSER = 0.02, 0.1  # rho / rho0 - 1 at rest, which are noticed and refused
MOST_STEPS = 1e9  # 11 days at a millisecond a step
STRONGEST = 100.0  # m/s2 of gravity; beyond, of a centrifuge, or in other units
LEAST_ACROSS = 5  # particles, of which the kernel reaches over most
PUSH = (1.3, 1.5, 2.0), (0.075, 0.015, 0.003)  # by h/dp: C_d that a pressure of rho v^2 adds to a cylinder's, of 2
MOST_PUSH = 0.2
LEAST_AMBIENT = 0.5  # rho v^2: three times the absolute pressure, 0.46 of the volume
SMOOTH = 2.0  # h/dp, below which particles that find an order take less room, and a closed gas has that much more
LEAST_PRESSURE = 2.0  # rho v^2 of an outlet behind a solid: of 0 and 1 a stream around a square fell apart
OPENING = 10  # spacings across an opening, below which its discharge is off by a tenth; by as much in 2D at 10
RAYS, LONGEST_RAY = 9, 1e6  # particles of a fluid under which a wall is looked for, so many half spacings deep


def sensible(config: SphConfig, scene: Scene) -> Iterator[Derived]:
    """All of it."""
    yield from dissipation(config)
    yield from steps(config)
    yield from directions(config)
    yield from speed_limits(config, scene)
    yield from surface_tension(config)
    yield from moving_walls(config, scene)
    yield from depths(config, scene)
    yield from gases(config, scene)
    yield from bodies_outside(config)
    yield from slips(config, scene)
    yield from joints(scene)
    yield from falling(scene)
    yield from suction(scene)
    yield from weightless(config)
    yield from unfelt(config)
    yield from bodies(scene)
    yield from friction(config, scene)
    yield from ringing(config, scene)
    yield from damping(config)
    yield from interfaces(config, scene)
    yield from films(scene)
    yield from slots(scene)
    yield from narrow_openings(scene)
    yield from openings(config, scene)
    if config.fluid:
        limits = f"{1 - MAX_DENSITY_ERROR:g} .. {1 + MAX_DENSITY_ERROR:g} rho0"
        words = f"beyond: exit 4; of fewer than half the neighbours and {limits}"
        source = "torn off: they get rho0"
        yield Derived("stray particles in a step", "n", most_strays(scene.n_fluid), "", words, "ok", source)


def dissipation(config: SphConfig) -> Iterator[Derived]:
    """What keeps densities and velocities smooth, taken by default or not."""
    numerics, flux = config.numerics, config.numerics.density_flux
    usual = f'default: "delta", {FLUXES["delta"].coefficient:g}'
    yield Derived(f"density flux, {flux}", "delta", numerics.flux_coefficient or 0.0, "", usual, "ok",
                  "Marrone et al. 2011")  # fmt: skip
    usual = "default: 0.02, 0 with a viscosity"
    yield Derived("artificial viscosity", "alpha", numerics.artificial_viscosity or 0.0, "", usual, "ok",
                  "Marrone et al. 2011")  # fmt: skip
    if alpha := numerics.artificial_viscosity:
        share = 4 * (config.dimensions + 2)  # twice that where pairs that go apart are damped too
        nu = alpha * config.sound_speed * config.h / share
        length = max(map(longest, config.fluid), default=0.0)
        source = f"alpha c0 h/{share}; vortices decay 1.0 (alpha 0.4), 1.3 (0.05), 1.9 (0.02) times as fast, measured"
        if config.eos.max_velocity and length:
            source += f"; Re = vmax L/nu = {config.eos.max_velocity * length / nu:.3g} of the fluid's {length:.3g} m"
        yield Derived("kinematic viscosity of alpha", "nu", nu, "m2/s", source=source)


def steps(config: SphConfig) -> Iterator[Derived]:
    """How many there are."""
    n = config.simulation.end_time / stability.time_step(config)
    verdict: Verdict = "ok" if n <= MOST_STEPS else "fail"
    cure = "" if verdict == "ok" else "a shorter end_time, or check the units of spacing and sound speed"
    yield Derived("steps to the end", "T/dt", n, "", f"<= {MOST_STEPS:g}", verdict, "a millisecond each: 11 days", cure,
                  ("simulation", "end_time"), True)  # fmt: skip


def directions(config: SphConfig) -> Iterator[Derived]:
    """How strong gravity is, and where it points."""
    up, g = config.dimensions - 1, config.gravity
    key: Path = ("gravity",)
    if math.hypot(*g) > STRONGEST:
        cure = f"gravity = [{', '.join(f'{value / 100:g}' for value in g)}], if this is in cm/s2"
        yield Derived("gravity", "|g|", math.hypot(*g), "m/s2", f"<= {STRONGEST:g}", "warn",
                      "ten times that of the Earth", cure, key)  # fmt: skip
    if g[up] > 0:
        down = [*(f"{value:g}" for value in g[:up]), f"{-g[up]:g}"]
        yield Derived(f"gravity along {AXES[up]}", "", g[up], "m/s2", "<= 0", "fail", f"{AXES[up]} is up",
                      f"gravity = [{', '.join(down)}]", key, True)  # fmt: skip
    for k, (axis, value) in enumerate(zip(AXES, g)):
        if value and axis in config.domain.periodic:
            rest = ", ".join("0" if n == k else f"{v:g}" for n, v in enumerate(g))
            force = ", ".join(f"{v + value * (n == k):g}" for n, v in enumerate(config.body_force))
            cure = f"gravity = [{rest}] and body_force = [{force}], which pulls along {axis} as a slope does"
            yield Derived(f"gravity along the periodic {axis}", "", value, "m/s2", "0", "fail", "an endless fall", cure,
                          key, True)  # fmt: skip


def depths(config: SphConfig, scene: Scene) -> Iterator[Derived]:
    """Densities at rest under the surface, and particles across a fluid."""
    verdict: Verdict
    g = math.hypot(*config.gravity)
    for i, fluid in enumerate(config.fluid):
        if g and at_rest(fluid):
            heights = [-sum(a * b for a, b in zip(x, config.gravity)) / g for x in geometry.corners(fluid.shape)]
            surface = max(heights) if fluid.surface is None else fluid.surface
            depth = max(0.0, surface - min(heights)) / scene.liquids.lightness(fluid)
            places = np.array([*geometry.corners(fluid.shape), middle := geometry.middle(fluid.shape)])
            inside = places + 0.01 * (np.array(middle) - places)  # beyond the edge another fluid may stand higher
            depth += float(load(scene, fluid, inside).max()) / g  # of the reference liquid
            with np.errstate(over="ignore"):
                dense = float(scene.eos.excess_at_rest(np.array([depth]), g)[0]) / scene.rho0
            verdict = "ok" if dense <= DENSE else "warn" if dense <= DENSER else "fail"
            needed = math.sqrt(g * depth / DENSE) if depth < math.inf else math.inf
            cure = f"sound_speed = {needed:.3g}" if verdict != "ok" else ""
            key: Path = ("eos", "sound_speed")
            if cure and fluid.surface is not None and depth > 2 * (max(heights) - min(heights)):
                cure, key = f"surface = {max(heights):g} is its top", ("fluid", i, "surface")
            yield Derived(f"density of {fluid.name} at rest at its bottom", "rho/rho0 - 1", dense, "",
                          f"< {DENSE:g}; {DENSER:g} at most", verdict, f"{depth:.3g} m of water: g H/c0^2", cure, key,
                          dense < MAX_DENSITY_ERROR)  # fmt: skip
        if fluid.shape.box:
            dp = config.numerics.spacing
            edges = {axis: b - a for axis, a, b in zip(AXES, fluid.shape.box.low, fluid.shape.box.high)}
            across = {
                axis: geometry.count(edge, dp) for axis, edge in edges.items() if axis not in config.domain.periodic
            }
            if across and fluid.thin_layer == "refuse":
                axis = min(across, key=lambda name: across[name])
                verdict = "ok" if across[axis] >= LEAST_ACROSS else "warn"
                cure = "" if verdict == "ok" else f"spacing = {edges[axis] / LEAST_ACROSS:.3g}"
                name, source = f"particles across {fluid.name} along {axis}", "the kernel reaches beyond both sides"
                key = ("numerics", "spacing")
                yield Derived(name, "n", across[axis], "", f">= {LEAST_ACROSS}", verdict, source, cure, key)


def gases(config: SphConfig, scene: Scene) -> Iterator[Derived]:
    """What holds gases together, how far they are compressed, and what they cost."""
    verdict: Verdict
    key: Path
    for i, fluid in enumerate(config.fluid):
        sides = open_sides(config, fluid) if fluid.gas or scene.untold else []
        verdict, cure = "warn" if sides else "ok", "walls or a period there"
        source, key = "gas has no surface: it flies away", ("fluid", i, "shape")
        if not fluid.gas:
            source = f"pressures in it are read {scene.untold:.3g} Pa too low: nothing presses on its surface"
            cure, key = "background_pressure = 0", ("eos", "background_pressure")
        if fluid.gas or sides:
            yield Derived(f"open sides of {fluid.name}", " ".join(sides), len(sides), "", "0", verdict, source,
                          cure if sides else "", key)  # fmt: skip
    if scene.liquids.gases:
        part = config.eos.ambient_pressure / (scene.rho0 * (config.eos.max_velocity or 0.0) ** 2)
        verdict = "ok" if part >= LEAST_AMBIENT else "warn"
        cure = "" if verdict == "ok" else "check its unit, Pa"
        source = "right within 3 % where air is pushed to half its volume, measured; beyond not tried"
        yield Derived("ambient pressure", "p_a/(rho v^2)", part, "", f">= {LEAST_AMBIENT:g}", verdict, source, cure,
                      ("eos", "ambient_pressure"))  # fmt: skip
        reach = config.numerics.smoothing
        verdict = "ok" if reach >= SMOOTH else "warn"
        cure = "" if verdict == "ok" else f"smoothing = {SMOOTH:g}"
        source = "disordered water under closed air, bottom pressure: -9 % (1.3), -6 % (1.6), -1 % (2), measured"
        yield Derived("smoothing length beside a gas", "h/dp", reach, "", f">= {SMOOTH:g}", verdict, source, cure,
                      ("numerics", "smoothing"))  # fmt: skip
        source = "its particles lie among stiff neighbours: a larger density of the gas makes steps longer"
        yield Derived("step over that without gases", "", 1 / scene.liquids.swiftest, "", "", "ok", source)


def bodies_outside(config: SphConfig) -> Iterator[Derived]:
    """Solid bodies at rest that no fluid can come to: most often in other units, or in another place."""
    tanks = [geometry.bounds(wall.shape) for wall in config.wall if not (wall.solid or wall.shape.plane)]
    boxes = [*tanks, *ways_of_fluid(config)]
    for i, wall in enumerate(config.wall):
        if not (boxes and wall.solid) or wall.motion or wall.shape.plane:
            continue
        low, high = geometry.bounds(wall.shape)
        away = min(geometry.apart(low, high, *box) for box in boxes)
        if away > stability.support_of(config):
            cure = "scale = 0.001 for a file in millimetres" if wall.shape.stl else "a place inside of a tank or fluid"
            path: Path = ("stl", "scale") if wall.shape.stl else ()
            yield Derived(f"distance of {wall.name} from all fluid and tanks", "", away, "m", "0", "warn",
                          "nothing comes to it", cure, ("wall", i, "shape", *path))  # fmt: skip


def falling(scene: Scene) -> Iterator[Derived]:
    """Fluids under which there is no wall: most often in another place than their tank."""
    g = math.hypot(*scene.config.gravity)
    sides = {AXES[k] + ("-" if value < 0 else "+") for k, value in enumerate(scene.config.gravity) if value}
    n = 2 * scene.diagonal / scene.spacing
    if not 0.0 < g < math.inf or not n < LONGEST_RAY or sides & {*scene.config.domain.outflow}:
        return
    way = 0.5 * scene.spacing * np.arange(n)[:, None] * scene.gravity / g
    for i, fluid in enumerate(scene.fluids):
        if fluid.n and not fluid.section.gas:
            ids = fluid.first + np.unique(np.linspace(0, fluid.n - 1, RAYS).astype(np.int64))
            held = any(np.any(depth_in_wall(wall, x + way) > 0.0) for x in fluid.points(ids) for wall in scene.walls)
            if not held:
                yield Derived(f"walls under {fluid.section.name}", "", 0, "", ">= 1", "warn", "it falls without end",
                              "a place in a tank, a wall under it, or domain.outflow", ("fluid", i))  # fmt: skip


def weightless(config: SphConfig) -> Iterator[Derived]:
    """Fluids in a tank that have a surface and are pressed down by what is no gravity, of which no pressure of rest is
    made: they ring.
    """
    if any(config.gravity):
        return
    real = [axis not in config.domain.periodic for axis in AXES[: config.dimensions]]
    pushed = any(force and there for force, there in zip(config.body_force, real))
    for fluid in config.fluid:
        if not (fluid.acceleration or pushed) or fluid.start or not at_rest(fluid):
            continue
        sides = open_sides(config, fluid)
        if 0 < len(sides) < 2 * sum(real):
            cure = "gravity, less which the acceleration gives" if fluid.acceleration else "gravity for body_force"
            yield Derived(f"gravity on {fluid.name}", "|g|", 0.0, "m/s2", "> 0 under a surface", "warn",
                          "the fluid starts without pressure, and rings", cure, ("gravity",))  # fmt: skip


def unfelt(config: SphConfig) -> Iterator[Derived]:
    """Bodies free to move in a fluid with an acceleration of the user's own, which they do not feel."""
    driven = [fluid.name for fluid in config.fluid if fluid.acceleration]
    ways = 3 if config.dimensions == 2 else 6
    for i, wall in enumerate(config.wall):
        if driven and wall.body and len(set(wall.body.held)) < ways:
            yield Derived(f"acceleration of {wall.name}", "", 0.0, "m/s2", f"that of {driven[0]}", "warn",
                          "gravity and the fluid move a body, which has no acceleration of its own",
                          "held motions, or gravity for it where it is uniform", ("wall", i, "body"))  # fmt: skip


def ways_of_fluid(config: SphConfig) -> Iterator[tuple[geometry.Point, geometry.Point]]:
    """Boxes that fluids and inlets come through in the run, as if nothing stopped them."""
    t, fastest = config.simulation.end_time, config.eos.max_velocity or 0.0
    starts = [(*geometry.bounds(fluid.shape), fluid.velocity) for fluid in config.fluid]
    for inlet in config.inlet:
        speed = fastest if inlet.axis[1] == "+" else -fastest
        along = tuple(speed * (axis == inlet.axis[0]) for axis in AXES[: config.dimensions])
        starts.append((inlet.low, inlet.high, along))
    for low, high, velocity in starts:
        way = [v * t + g * t * t / 2 for v, g in zip(velocity or (0.0,) * len(low), config.gravity)]
        yield tuple(a + min(0.0, s) for a, s in zip(low, way)), tuple(b + max(0.0, s) for b, s in zip(high, way))


def films(scene: Scene) -> Iterator[Derived]:
    """Solids whose force is measured and that lie so near others that the fluid between does not carry all of it, nor
    do they press on each other across it.
    """
    for wall in scene.walls:
        if wall.presses or not (wall.section.solid and wall.measure_force and wall.rule.layered):
            continue
        least, other = nearest(wall)
        if TOUCHING < least < 2.0 - TOUCHING:
            yield Derived(f"layers of fluid between {wall.name} and {other.name}", "n", least, "", ">= 2", "warn",
                          f"one layer carries 0.8 of the pressure, force_{wall.name} lacks the rest",
                          f"spacing = {least * scene.spacing / 2:.3g}, or they touch",
                          ("wall", wall.index, "shape"))  # fmt: skip


def slots(scene: Scene) -> Iterator[Derived]:
    """Boxes that stay, so near others that stay that no particle fits between them."""
    dp = scene.spacing
    stay = [w for w in scene.walls if not (w.moving or w.rigid) and (w.shape.box or w.shape.plane)]
    for wall in stay:
        if not (wall.section.solid and wall.shape.box):
            continue
        film = wall.measure_force and wall.rule.layered and not wall.presses
        for other in stay:
            solid = other.section.solid and other.shape.box
            if other is wall or (solid and other.index < wall.index):
                continue
            if solid:
                least = geometry.apart(*geometry.bounds(wall.shape), *geometry.bounds(other.shape))
            else:  # flat faces, to which a corner is nearest
                faces = surfaces(other, np.array(geometry.corners(wall.shape)))
                least = min((float(off.min()) for off, _ in faces), default=math.inf)
            if not TOUCHING < least / dp < 1.0 - TOUCHING:
                continue
            if not (film and nearest(wall)[1] is other):  # of which `films` tells
                yield Derived(f"slot between {wall.name} and {other.name}", "L/dp", least / dp, "", ">= 1", "warn",
                              "0.5: nothing passes at first, then half of what should, measured",
                              f"spacing = {least / LEAST_ACROSS:.3g}, or they touch",
                              ("wall", wall.index, "shape"))  # fmt: skip


def narrow_openings(scene: Scene) -> Iterator[Derived]:
    """Openings through which fluid runs between boxes that stay and what else stays, with few particles across."""
    dp, stay = scene.spacing, [w for w in scene.walls if w.shape.box and not (w.moving or w.rigid)]
    for wall in (wall for wall in stay if wall.section.solid and scene.config.fluid):
        for other in stay:
            if other is wall or (other.section.solid and other.index < wall.index):
                continue
            found = [high[k] - low[k] for k, low, high in rooms(wall, other) if runs_through(scene, k, low, high)]
            least = min((width for width in found if width >= (1.0 - TOUCHING) * dp), default=math.inf)
            if least < OPENING * (1 - 1e-9) * dp:
                yield Derived(f"spacings across the opening between {wall.name} and {other.name}", "L/dp", least / dp,
                              "", f">= {OPENING}", "warn", "discharge: hole in 3D -11 % (4), slot +12 % (10), measured",
                              f"spacing = {rounded_down(least / OPENING):g}", ("numerics", "spacing"))  # fmt: skip


def rooms(wall: Wall, other: Wall) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Boxes between a solid box and another, or a closed face of a tank, that face each other: axis, corners."""
    (a, b), (c, d), solid = wall.corners, other.corners, other.section.solid
    first, last = np.maximum(a, c), np.minimum(b, d)
    for k in range(len(a)):
        if np.any(np.delete(first >= last, k)):
            continue
        for sign, start, end in (("-", d[k] if solid else c[k], a[k]), ("+", b[k], c[k] if solid else d[k])):
            if start < end and (solid or AXES[k] + sign in other.closed):
                low, high = first.copy(), last.copy()
                low[k], high[k] = start, end
                yield k, low, high


def runs_through(scene: Scene, k: int, low: np.ndarray, high: np.ndarray) -> bool:
    """If nothing is in the middle of a box between walls, nor beyond two opposite sides of it, and walls close the
    others: an opening, and no passage beside an obstacle.
    """
    dp, middle, runs, closed = scene.spacing, (low + high) / 2, 0, 0
    for m in (m for m in range(scene.dimensions) if m != k):
        ends = []
        for end in (low[m] - dp / 2, high[m] + dp / 2):
            x = np.tile(middle, (int(abs(end - middle[m]) / (dp / 2)) + 2, 1))
            x[:, m] = np.linspace(middle[m], end, len(x))
            out = not scene.low[m] < end < scene.high[m]
            ends.append("wall" if walled(scene, x, 0.0).any() else "out" if out else "")
        runs += ends == ["", ""]
        closed += ends == ["wall", "wall"] or bool(scene.periodic[m] and "" not in ends)
    return runs == 1 and closed == scene.dimensions - 2


def openings(config: SphConfig, scene: Scene) -> Iterator[Derived]:
    """How fast and how much flows in, and whether walls stand in its way."""
    verdict: Verdict
    for i, inlet in enumerate(scene.inlets):
        mach, key = fastest(config.inlet[i]) / config.sound_speed, ("inlet", i)
        verdict = "ok" if mach <= 1 / 7 else "warn" if mach <= 1 / 3 else "fail"
        cure = "" if verdict == "ok" else f"sound_speed = {10 * mach * config.sound_speed:.3g}"
        yield Derived(f"velocity of {inlet.name}", "v/c0", mach, "", "<= 1/7", verdict, "Monaghan 1994", cure,
                      ("eos", "sound_speed"), True)  # fmt: skip
        for wall in scene.walls:
            rows = int(np.count_nonzero(_in_wall(scene, wall, inlet)))
            if rows:
                yield Derived(f"rows of {inlet.name} in {wall.name}", "n", rows, "", "0", "fail", "fluid in walls",
                              f"a box on the fluid's side of {wall.name}; or {wall.name} open there, and solids around "
                              "the box", (*key, "low"))  # fmt: skip
        n = inlet.volume(config.simulation.end_time) * scene.rho0 / inlet.mass
        yield Derived(f"particles through {inlet.name}", "n", round(n))
    if scene.inlets and not (config.outlet or config.domain.outflow):
        full = (inlet for inlet in scene.inlets if not inlet.section.over_time("level"))  # of others some rows are dry
        came = sum(inlet.volume(config.simulation.end_time) for inlet in full)
        room = float(np.prod(scene.high - scene.low)) - scene.n_fluid * scene.spacing**config.dimensions
        yield judged("fluid that comes in and stays", "V", came, unit=f"m{config.dimensions}", limit=f"<= {room:.3g}",
                     ok=came <= room, source="room in the domain", key=("inlet",),
                     cure="an outlet, domain.outflow, or a shorter run")  # fmt: skip
    for i, outlet in enumerate(config.outlet):
        dense = float(scene.eos.excess(outlet.pressure)) / scene.rho0
        verdict = "ok" if dense <= DENSE else "warn" if dense <= DENSER else "fail"
        if outlet.pressure:
            needed = math.sqrt(outlet.pressure / scene.rho0 / DENSE)
            yield Derived(f"density at the pressure of {outlet.name}", "rho/rho0 - 1", dense, "",
                          f"< {DENSE:g}; {DENSER:g} at most", verdict, "equation of state",
                          f"sound_speed = {needed:.3g}" if verdict != "ok" else "", ("eos", "sound_speed"),
                          dense < MAX_DENSITY_ERROR)  # fmt: skip
        dynamic = scene.rho0 * speed_scale(config) ** 2
        if outlet.level is None and dynamic and any(wall.solid for wall in config.wall):
            part = outlet.pressure / dynamic
            verdict = "ok" if part >= LEAST_PRESSURE * (1 - 1e-9) else "warn"
            cure = "" if verdict == "ok" else f"pressure = {LEAST_PRESSURE * dynamic:.3g}"
            yield Derived(f"pressure of {outlet.name}", "p/(rho v^2)", part, "", f">= {LEAST_PRESSURE:g}", verdict,
                          "cavities behind solids, which push fluid out", cure, ("outlet", i, "pressure"))  # fmt: skip
            push = part * float(np.interp(config.numerics.smoothing, *PUSH))
            verdict = "ok" if push <= MOST_PUSH else "warn"
            cure = "" if verdict == "ok" else "smoothing = 2.0"
            yield Derived(f"drag by pressure of {outlet.name}", "C_d", push, "", f"<= {MOST_PUSH:g}", verdict,
                          "fluid lies closer before solids than behind", cure, ("numerics", "smoothing"))  # fmt: skip


def _in_wall(scene: Scene, wall: Wall, inlet: Source) -> np.ndarray:
    """Which rows of an inlet come through a wall."""
    margin, found = NEAR * scene.spacing, np.zeros(len(inlet.rows), bool)
    for column in range(inlet.columns):
        x = inlet.rows.copy()
        x[:, inlet.axis] += inlet.sign * (column + 0.5) * inlet.step
        outside = wall.section.solid or wall.shape.plane
        found |= (signed_distance(wall.shape, x) < margin) if outside else (depth_in(wall, x) > -margin)
    return found
