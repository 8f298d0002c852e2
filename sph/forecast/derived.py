"""The numbers that decide whether an SPH case is stable and accurate, with their limits and sources."""

import itertools
import math
from collections.abc import Iterator

import numpy as np

from hpcpic.core.case.derived import Derived, Verdict, rounded_down
from sph.case import geometry
from sph.case.config import WALL_PRESSURE, SphConfig
from sph.forecast.moving_walls import swing_sound
from sph.forecast.plausibility import sensible
from sph.forecast.size import size
from sph.forecast.waves import waves
from sph.kernels.marks import CODES
from sph.physics import stability
from sph.physics.fluxes import FLUXES
from sph.physics.liquids import liquids_of
from sph.physics.smoothing import SMOOTHING
from sph.physics.viscosities import viscosity_of
from sph.physics.wall_rules import rule_of
from sph.setup.mirror_groups import most_images
from sph.setup.obstacles import DOMAIN, too_near
from sph.setup.scene import FluidSet, Scene, Wall
from sph.setup.signed_distance import signed_distance, thickness
from sph.setup.speeds import heights_of, motion_speed
from sph.setup.tanks import edge, ends

SMALL = 6  # spacings across a repulsive body, below which the force on it is off by more than a tenth
EDGE = 2  # spacings beside an edge that read low where a jet leaves it: the outer one nothing, the next two thirds
COARSE = 100  # u dp/nu, beyond which the scheme dissipates more than the viscosity, and layers at walls are thinner
CONTACT = 16  # spacings that a front goes into a wall until its pressure is right: until 4 half as large again or more
MOST_CLIPPED = 0.5  # of the places of a fluid: more is hardly meant
STIFF = 50  # c0 / vmax, below which a stress of the strain rate lets a wave of two spacings grow
RATIO, MOST_RATIO = 100, 1000  # of densities or viscosities of liquids, which are noticed and refused
STRETCH = 0.1  # of the spacing along an edge, which is noticed
CFL, STEP = ("simulation", "cfl"), ("simulation", "time_step")


def derived(config: SphConfig, ranks: int = 1) -> list[Derived]:
    """Every derived number of a completed case that runs on so many ranks; of one that is too large to be made, why."""
    sizes = list(size(config, ranks))
    if any(number.verdict == "fail" for number in sizes):
        return [*step(config), *compressibility(config), *resolution(config), *sizes]
    scene = Scene(config)
    return [
        *sizes,
        *step(config),
        *compressibility(config, swing_sound(scene)),
        *resolution(config),
        *waves(config, scene),
        *decoupling(config),
        *fast_walls(config),
        *unlike(config),
        *outer_edges(config),
        *small_bodies(config),
        *filling(config, scene),
        *extents(config, scene, ranks),
        *images(scene),
        *dry_gauges(config, scene),
        *sensible(config, scene),
    ]


def step(config: SphConfig) -> Iterator[Derived]:
    """The time step against the stability of integrator and flux, and the criteria it comes from."""
    simulation, dt, parts = config.simulation, stability.time_step(config), stability.step_parts(config)
    yield courant(config, dt)
    smallest = min(parts, key=lambda name: parts[name])
    yield Derived(f"time step at t = 0, {'fixed' if simulation.time_step else smallest}", "dt", dt, "s")
    if "viscous" in parts:
        yield from viscous_step(config, dt, parts["viscous"])
    if config.fluid and FLUXES[config.numerics.density_flux].upwind and any(config.gravity):
        runs = simulation.end_time / settling(config)
        verdict: Verdict = "ok" if runs < 20 else "warn"
        cure = "" if verdict == "ok" else 'density_flux = "delta" keeps still water still'
        source = "level falls 2 %, bottom pressure 17 % in 8 s (measured)"
        key = ("numerics", "density_flux")
        yield Derived("time under the Rusanov flux", "T sqrt(g/H)", runs, "", "< 20", verdict, source, cure, key)


def courant(config: SphConfig, dt: float) -> Derived:
    """The step dt in s against von Neumann's limit."""
    verdict: Verdict
    simulation, numerics = config.simulation, config.numerics
    key = STEP if simulation.time_step else CFL
    unit = config.h / stability.fastest_sound(config)
    limit = stability.courant_limit(config)
    what = f"{simulation.integrator}, {numerics.density_flux} flux"
    source = f"von Neumann: {what}, {numerics.kernel}, h/dp {numerics.smoothing:g}"
    asked = dt / unit if simulation.time_step else simulation.cfl or 0.0
    growth = stability.grows(config, dt / unit)
    verdict, cure, words = "ok", "", f"< {limit:.3g}"
    if asked > limit and not (simulation.time_step is None and growth <= stability.GROWTH / 10):
        legal = rounded_down(0.95 * limit)
        verdict = "fail"
        given = f"time_step = {legal * unit:.2g}" if simulation.time_step else f"cfl = {legal:g}"
        cure = f"{given} is the nearest legal one"
    if simulation.integrator == "euler" and growth > stability.GROWTH / 100:
        verdict = "fail"
        words = "no step is stable: some wave always grows"
        cure = 'density_flux = "rusanov", or integrator = "rk3-tvd" or "symplectic"'
        if limit > 0.1 and asked > limit:
            words, cure = f"< {limit:.3g}", f"cfl = {rounded_down(0.95 * limit):g} is the nearest legal one"
    return Derived("Courant number", "c0 dt/h", asked, "", words, verdict, source, cure, key, True, stable_below=limit)


def viscous_step(config: SphConfig, dt: float, longest: float) -> Iterator[Derived]:
    """The step dt in s against the longest that the viscosity allows."""
    most, nu = stability.viscous_limit(config), stability.kinematic_viscosity(config)
    share = dt / longest * most
    verdict: Verdict = "ok" if share <= most * 1.001 else "fail"
    cure = "" if verdict == "ok" else f"time_step = {rounded_down(longest):g} is the nearest legal one"
    source = "Morris et al. 1997"
    yield Derived("viscous step", "nu dt/h2", share, "", f"< {most:.3g}", verdict, source, cure, STEP, True)
    u, rules = config.eos.max_velocity or 0.0, [rule_of(wall.type) for wall in config.wall]
    n = u * config.numerics.spacing / nu
    sticks = not config.numerics.artificial_viscosity and any(not (rule.slips or rule.repulsive) for rule in rules)
    verdict = "warn" if sticks and n > COARSE else "ok"
    cure = "no dynamic_viscosity: free slip and artificial viscosity"
    cure += f"; or spacing = {config.numerics.spacing * COARSE / n:.1g}" if COARSE < n < 10 * COARSE else ""
    source = f"u = {u:.3g} m/s, eos.max_velocity; vortices decay 1.1 (20), 1.6 (100), 7 (1000) times as fast as by it"
    yield Derived("Reynolds number of a spacing", "u dp/nu", n, "", f"<= {COARSE} where walls stick, alpha 0", verdict,
                  source + ", measured",
                  cure if verdict == "warn" else "", ("fluid", 0, "dynamic_viscosity"))  # fmt: skip


def settling(config: SphConfig) -> float:
    """sqrt(H / g) of the fluid's height, s."""
    heights = [z for fluid in config.fluid for z in heights_of(config, fluid)]
    return math.sqrt((max(heights) - min(heights)) / math.hypot(*config.gravity))


def compressibility(config: SphConfig, least: float = 0.0) -> Iterator[Derived]:
    """The sound speed against the largest velocity and what else asks for at least so much of it, m/s; and the density
    change that follows.
    """
    verdict: Verdict
    eos, speed = config.eos, config.eos.max_velocity or config.sound_speed
    factor, usual = config.sound_speed / speed, max(10, math.ceil(least / speed))
    most = max(50.0, 1.5 * usual)
    key = ("eos", "sound_speed") if config.eos.sound_speed_factor == 10.0 else ("eos", "sound_speed_factor")
    diffuse = FLUXES[config.numerics.density_flux].upwind
    if factor < 3:
        verdict, cure = "fail", f"sound_speed = {10 * (eos.max_velocity or 0.1):.3g} (factor 10)"
    elif factor < 7:
        verdict, cure = "warn", "factor 10: the density changes by less than 1 %"
    elif factor > most:
        more = ": with the Rusanov flux dissipation grows with c0" if diffuse else ""
        verdict, cure = "warn", f"factor {usual} is {factor / usual:.0f} times as fast{more}"
    else:
        verdict, cure = "ok", ""
    source = "Monaghan 1994; density change measured in a dam break"
    yield Derived("sound speed", "c0", config.sound_speed, "m/s")
    words = f"7 .. {most:.3g}"
    yield Derived("sound speed factor", "c0/vmax", factor, "", words, verdict, source, cure, key, factor > 1)
    change = 1.0 / factor**2
    yield Derived("expected density change", "(vmax/c0)^2", change, "", "< 0.02", "ok" if change < 0.021 else "warn",
                  source, "" if change < 0.021 else "sound_speed_factor = 10", key)  # fmt: skip


def resolution(config: SphConfig) -> Iterator[Derived]:
    """Smoothing length over spacing, neighbours of a particle."""
    verdict: Verdict
    ratio, kernel, d = config.numerics.smoothing, config.numerics.kernel, config.dimensions
    reach = stability.support_of(config) / config.numerics.spacing
    neighbours = (math.pi * reach**2 if d == 2 else 4 / 3 * math.pi * reach**3) - 1
    key = ("numerics", "smoothing")
    verdict, cure, dense = "ok", "", SMOOTHING[kernel].dense
    if ratio < 0.7:
        verdict, cure = "fail", "smoothing = 1.5: particles hardly have neighbours"
    elif ratio < 1.0:
        verdict, cure = "warn", "smoothing = 1.5"
    elif ratio > dense:
        verdict = "warn"
        cure = "smoothing = 1.5" + (', or kernel = "wendland2", whose particles pair later' if dense < 2.5 else "")
    words = f"1 .. {dense:g}"
    source = "Dehnen & Aly 2012 (pairing)"
    yield Derived("smoothing length", "h/dp", ratio, "", words, verdict, source, cure, key, ratio >= 0.5)
    yield Derived("neighbours", "", neighbours)


def decoupling(config: SphConfig) -> Iterator[Derived]:
    """Gradients of gradients do not see waves of two spacings.

    The sums (MP 22) of v = (-1)^row are zero at every particle of a lattice, and mirrors go on with that wave: (MP 23)
    takes nothing from it. Only pressure keeps particles in rows, in which it does not grow.
    """
    mirrors = any(rule_of(wall.type).face_images for wall in config.wall)
    if viscosity_of(config.numerics.viscosity_form).stress and mirrors:
        factor = config.sound_speed / (config.eos.max_velocity or config.sound_speed)
        verdict: Verdict = "ok" if factor >= STIFF * (1 - 1e-9) else "fail"
        cure = "" if verdict == "ok" else f'sound_speed_factor = {STIFF}, or viscosity_form = "morris"'
        yield Derived("stiffness of rows beside mirrors", "c0/vmax", factor, "", f">= {STIFF}", verdict,
                      "Poiseuille, 10: off by 6 % after L^2/nu and growing, 50: by 3 %", cure,
                      ("eos", "sound_speed_factor"), True)  # fmt: skip


def unlike(config: SphConfig) -> Iterator[Derived]:
    """How much liquids differ: a light one is thrown about by what a heavy one hardly feels."""
    liquids = liquids_of(config)
    if liquids.densities:
        ratio, key = liquids.lightest, ("fluid", 0, "density")
        small = MOST_RATIO if liquids.gases else RATIO
        words = f"<= {small}" if liquids.gases else f"<= {RATIO}; {MOST_RATIO} at most"
        verdict: Verdict = "ok" if ratio <= small else "warn" if ratio <= MOST_RATIO * (1 + 1e-9) else "fail"
        cure = "" if verdict == "ok" else f"a ratio of {RATIO}: the step is shorter by its root too"
        source = "fastest particles of layers at rest, mean: 0.06 m/s (100), 0.16 m/s (1000), measured"
        yield Derived("density ratio of liquids", "rho1/rho2", ratio, "", words, verdict, source, cure, key, True)
    if liquids.viscosities:
        lowest = min(kind.viscosity for kind in liquids.kinds)
        ratio = liquids.viscosity / lowest if lowest else math.inf
        verdict = "ok" if ratio <= RATIO or not lowest else "warn"
        cure = "" if verdict == "ok" else f"a ratio of {RATIO}, or the thick liquid as a wall"
        source = "two layers, 20 spacings across: off by 0.6 % (4) and 1.1 % (100), measured"
        yield Derived("viscosity ratio of liquids", "mu1/mu2", ratio, "", f"<= {RATIO}", verdict, source, cure,
                      ("fluid", 0, "dynamic_viscosity"))  # fmt: skip


def fast_walls(config: SphConfig) -> Iterator[Derived]:
    """Walls with a density of their own: what goes past the fluid fast is a lattice that rattles it."""
    for i, wall in enumerate(config.wall):
        if wall.motion and rule_of(wall.type).layered:
            mach = motion_speed(wall.motion) / config.sound_speed
            verdict: Verdict = "ok" if mach < 1 / 3 else "fail"
            cure = "" if verdict == "ok" else 'type = "repulsive" lets the fluid go, at any speed of the wall'
            yield Derived(f"speed of {wall.name}", "v/c0", mach, "", "< 1/3", verdict, "measured with a gate", cure,
                          ("wall", i, "motion"), True)  # fmt: skip


def outer_edges(config: SphConfig) -> Iterator[Derived]:
    """Point symmetry knows faces only: beside the outer edges of a solid images are missing."""
    for i, wall in enumerate(config.wall):
        if wall.solid and rule_of(wall.type).layer_images and wall.shape.box:
            cure = 'type = "mirror-no-slip" or "pressure-continuity": here single particles are thrown off the edges'
            yield Derived(f"images beside the edges of {wall.name}", "", 0.0, "", "> 0", "warn",
                          "a body in still water, measured", cure, ("wall", i, "type"))  # fmt: skip


def small_bodies(config: SphConfig) -> Iterator[Derived]:
    """Repulsive walls act at a distance, from layers behind their faces: a small body has no room for these."""
    for i, wall in enumerate(config.wall):
        if wall.solid and rule_of(wall.type).repulsive and wall.measure_force and wall.shape.box:
            edges = [b - a for a, b in zip(wall.shape.box.low, wall.shape.box.high)]
            size = min(edges) / config.numerics.spacing
            verdict: Verdict = "ok" if size >= SMALL * (1 - 1e-9) else "warn"
            cure = "" if verdict == "ok" else 'a smaller spacing, or "pressure-continuity": it is lifted too little'
            source = "a body of 4 spacings: by 18 to 30 %, of 6 to 16: by 9 %, measured"
            yield Derived(f"size of {wall.name}", "L/dp", size, "", f">= {SMALL}", verdict, source, cure,
                          ("wall", i, "shape"))  # fmt: skip


def filling(config: SphConfig, scene: Scene) -> Iterator[Derived]:
    """Particles, what of the fluids was clipped, thin and stretched layers."""
    verdict: Verdict
    yield Derived("fluid particles", "n", scene.n_fluid)
    for i, fluid in enumerate(scene.fluids):
        section, key = fluid.section, ("fluid", i, "shape")
        places = fluid.n + sum(fluid.clipped.values())
        inlets = {inlet.name for inlet in scene.inlets}  # they begin with fluid
        nothing = fluid.n == 0 and not inlets & {*fluid.clipped}
        for name, gone in fluid.clipped.items():
            tanks = [wall for wall in scene.walls if wall.name == name and not wall.section.solid]
            outside = name == DOMAIN or any(reaches_into(wall, fluid) for wall in tanks)
            share = gone / places
            whole = any(fills(wall, fluid) for wall in tanks)
            outside, mostly = outside and not whole, share > MOST_CLIPPED and not whole
            verdict = "fail" if nothing else "warn" if outside or mostly else "ok"
            cure = "nothing is left of it" if nothing else "part of the shape holds no fluid" if outside else ""
            cure = cure or (f"{name} fills its shape with what is solid" if mostly else "")
            if cure and any(wall.shape.plane for wall in tanks):
                cure += f"; the normal of {name} points into the fluid"
            elif cure and tanks:
                cure += f"; {name} holds fluid inside, as a tank does: solid = true is a body in the fluid"
            words = f"of {places} ({share:.1%})"
            title = f"{section.name} clipped by {name}"
            yield Derived(title, "particles", gone, "", words, verdict, "filling", cure, key, fluid.n > 0)
        if fluid.oblique:
            source = f"volume beside {', '.join(wall.name for wall in fluid.oblique)}; packed evenly before the run"
            title = f"mass of {section.name} beside walls that cut its lattice"
            yield Derived(title, "m/m_cells - 1", fluid.filled - 1, "", "", "ok", source)
        if fluid.given is not None:
            continue
        if section.shape.box:
            yield from layers(config, fluid.section, i)
        else:
            exact = section.density * geometry.volume(section.shape)
            error = fluid.mass / fluid.filled * (fluid.n + sum(fluid.clipped.values())) / exact - 1 if exact else 0.0
            verdict = "ok" if abs(error) < 0.05 else "warn"
            cure = "" if verdict == "ok" else "a smaller spacing follows the shape better"
            yield Derived(f"mass of {section.name}", "m/m_exact - 1", error, "", "< 5 %", verdict, "filling", cure, key)


def reaches_into(wall: Wall, fluid: FluidSet) -> bool:
    """Whether places of a fluid lie in a wall, not only too near to it."""
    x = fluid.grid.points(fluid.grid.unflat(fluid.removed))
    x = x[signed_distance(fluid.section.shape, x) <= 0.0]
    ends = np.array([(c[0], c[-1]) for c in fluid.grid.coordinates])
    return bool(too_near(wall, ends, 0.0, x).any())


def fills(wall: Wall, fluid: FluidSet) -> bool:
    """Whether a box of fluid holds all of a tank that is none, but for what is above it: the tank gives its shape."""
    box, g, slack = fluid.section.shape.box, wall.scene.gravity, wall.scene.spacing / 2
    if not box or wall.shape.box or wall.shape.plane:
        return False
    beyond = np.array(box.low) > wall.corners[0] + slack, np.array(box.high) < wall.corners[1] - slack
    return not (np.any(beyond[0] & (g <= 0.0)) or np.any(beyond[1] & (g >= 0.0)))


def dividing(edges: list[float], dp: float) -> float:
    """The largest spacing below dp, of three digits, that hardly has to stretch along any edge."""
    shortest = min(edges)
    for n in itertools.count(math.ceil(shortest / dp)):
        step = float(f"{shortest / n:.3g}")
        if all(abs(edge / geometry.count(edge, step) / step - 1) < STRETCH for edge in edges):
            return step
    raise AssertionError  # a spacing small enough divides everything


def layers(config: SphConfig, section, i: int) -> Iterator[Derived]:
    """How well the spacing divides a box."""
    dp, key = config.numerics.spacing, ("fluid", i, "shape", "box")
    edges = [b - a for a, b in zip(section.shape.box.low, section.shape.box.high)]
    counts = [geometry.count(edge, dp) for edge in edges]
    worst = max((edge / n / dp - 1 for edge, n in zip(edges, counts)), key=abs)
    verdict: Verdict = "ok" if abs(worst) < STRETCH else "warn"
    cure = ""
    if min(edges) < 0.99 * dp:
        verdict, cure = ("warn" if min(edges) > 0.5 * dp else "fail"), f"one layer of {min(edges) / dp:.0%} of the mass"
        cure += f"; two layers need spacing = {rounded_down(min(edges) / 2):g}"
    elif verdict == "warn":
        cure = f"spacing = {dividing(edges, dp):g} divides the box"
    name = f"stretch of the spacing in {section.name}"
    yield Derived(name, "", 100 * worst, "%", "< 10 %", verdict, "filling", cure, key)


def extents(config: SphConfig, scene: Scene, ranks: int) -> Iterator[Derived]:
    """Periodic lengths against the kernel, walls against the spacing, layers of cells against ranks."""
    verdict: Verdict
    for k, axis in enumerate("xyz"[: config.dimensions]):
        length = scene.high[k] - scene.low[k]
        if scene.periodic[k]:
            ok = length > 3 * scene.support
            cure = "" if ok else f"{3 * scene.support:g} m or more"
            source, verdict = "a particle meets no image of itself twice", "ok" if ok else "fail"
            key = ("domain", "high")
            title = f"period along {axis}"
            yield Derived(title, "L/support", length / scene.support, "", "> 3", verdict, source, cure, key)
    for i, wall in enumerate(config.wall):
        if wall.solid and not wall.shape.plane:
            thin = thickness(wall.shape) / scene.spacing
            verdict = "ok" if thin >= 0.99 else "fail"
            cure = "" if verdict == "ok" else f"make it {scene.spacing:g} m thick, or a smaller spacing"
            yield Derived(f"thickness of {wall.name}", "L/dp", thin, "", ">= 1", verdict, "one layer", cure,
                          ("wall", i, "shape"), True)  # fmt: skip
    cells = (scene.high[scene.axes[0]] - scene.low[scene.axes[0]]) / scene.support
    yield Derived("layers of cells per rank", "", cells / ranks, "", ">= 1", "ok" if cells >= ranks else "warn",
                  "slabs end at one layer", "" if cells >= ranks else "some ranks stay empty")  # fmt: skip


def images(scene: Scene) -> Iterator[Derived]:
    """Walls that mirror, whose corners mirror the images in each other."""
    if (n := most_images(scene)) > CODES:
        cure = 'planes instead of boxes that mirror, or "pressure-continuity"'
        yield Derived("images of a particle", "", n, "", f"<= {CODES}", "fail", "one in each corner", cure, ("wall",))


def dry_gauges(config: SphConfig, scene: Scene) -> Iterator[Derived]:
    """Gauges where no fluid comes."""
    for i, gauge in enumerate(config.gauge):
        over = scene.vertical(gauge)[0] if gauge.kind.column else None  # all along this axis it reads
        ends = enumerate(zip(gauge.at, scene.low, scene.high))
        beyond = [max(a - x, x - b, 0.0) for k, (x, a, b) in ends if k != over and not scene.periodic[k]]
        if max(beyond, default=0.0) > 0.0:
            title, cure = f"{gauge.name} beyond the domain", "a place in the domain: here is nothing to show"
            yield Derived(title, "", max(beyond), "m", "0", "warn", "domain", cure, ("gauge", i, "at"))
        if gauge.kind is WALL_PRESSURE:
            yield from _sensor(config, scene, i)


def _sensor(config: SphConfig, scene: Scene, i: int) -> Iterator[Derived]:
    """The i-th gauge, an area of wall: behind it there is wall, it is a spacing wide, and how long it takes until the
    pressure of a front that strikes it is right.
    """
    gauge, dp = config.gauge[i], scene.spacing
    half = np.array(gauge.extents(dp)) / 2 if not gauge.radius else np.full(config.dimensions, gauge.radius)
    k, sign = gauge.direction
    low, high = (np.array(gauge.at) + side * np.maximum(half, dp) for side in (-1.0, 1.0))
    low[k], high[k] = sorted((gauge.at[k] - sign * dp / 4, gauge.at[k] + sign * scene.support))
    walls = [wall for wall in scene.walls if gauge.wall in ("", wall.name)]
    behind = {wall.name: len(wall.near(low, high)[0]) for wall in walls if not wall.rule.images}
    made = sum(behind.values())
    if not made and not any(wall.rule.images for wall in walls):
        cure = 'a place in the surface of a wall, and the axis along which fluid pushes it there, as "x+"'
        yield Derived(f"wall behind {gauge.name}", "particles", 0, "", "> 0", "fail", "an area of wall", cure,
                      ("gauge", i, "at"), True)  # fmt: skip
    for wall in walls:
        if (wall.moving or wall.rigid) and not gauge.wall and behind.get(wall.name):
            title, cure = f"{gauge.name} stays, {wall.name} moves", f'wall = "{wall.name}", with which it moves'
            yield Derived(title, "particles", behind[wall.name], "", "0", "warn", "an area of wall", cure,
                          ("gauge", i, "wall"))  # fmt: skip
    beyond = float(np.max(half[:, None] - np.abs(ends(scene, gauge))))
    if beyond > 1e-9 * dp:
        title, cure = f"{gauge.name} behind another wall", "a smaller area, or another place: nothing presses there"
        yield Derived(title, "", beyond, "m", "0", "warn", "an area of wall", cure, ("gauge", i, "at"))
    near = min((edge(wall, gauge) for wall in walls if behind.get(wall.name)), default=np.inf)
    if near < EDGE * dp:
        title, cure = f"edge beside {gauge.name}", "a place farther from it: a jet that leaves there pulls at the edge"
        yield Derived(title, "L/dp", round(near / dp, 6), "", f">= {EDGE}", "warn", "a jet on a plate, measured", cure,
                      ("gauge", i, "at"))  # fmt: skip
    narrow = 2 * gauge.radius if gauge.radius else min(extent for extent in gauge.extents(dp) if extent)
    verdict: Verdict = "ok" if narrow >= dp * (1 - 1e-9) else "warn"
    cure = "" if verdict == "ok" else "a smaller spacing: it reads what the wall bears over a spacing"
    yield Derived(f"width of {gauge.name}", "L/dp", narrow / dp, "", ">= 1", verdict, "forces on particles", cure,
                  ("gauge", i, "radius" if gauge.radius else "size"))  # fmt: skip
    assert config.eos.max_velocity is not None  # completed
    yield Derived(f"first contact on {gauge.name}", f"{CONTACT} dp/v", CONTACT * dp / config.eos.max_velocity, "s",
                  "until then particles strike one by one", source="a wedge that meets a wall, measured")  # fmt: skip
