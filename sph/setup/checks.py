"""What does not fit together in an SPH case: each fault with the key to change."""

import itertools
from collections.abc import Iterator

from hpcpic.core.case import accelerations
from hpcpic.core.case.config import Path
from hpcpic.core.case.gauge import STEP, TAKEN, TIME
from hpcpic.core.case.own_functions import formula_fault
from hpcpic.core.case.schema import Section
from hpcpic.core.case.words import unknown
from hpcpic.core.errors import ConfigError
from hpcpic.core.files.start import start_faults
from hpcpic.core.simd.own import shipped
from sph.case import geometry
from sph.case.bodies import Body, Hinge
from sph.case.columns import columns_of, scalar_units
from sph.case.config import AXES, FRONT, WALL_PRESSURE, Fluid, Gauge, SphConfig, Wall, name_of
from sph.case.shapes import Shape
from sph.physics import stability
from sph.physics.integrators import INTEGRATORS
from sph.physics.liquids import liquids_of
from sph.physics.smoothing import SMOOTHING
from sph.physics.viscosities import viscosity_of
from sph.physics.wall_rules import WALL_RULES
from sph.setup import opening_checks, periodic_walls
from sph.setup.defaults import domain_of
from sph.setup.flows import FLOWS, INITIAL_DENSITIES, density_of_flow
from sph.setup.speeds import speed_scale

MOST_ALONG = 2**21  # particles along an edge, whose places are kept
MOST_ACROSS = 2**21  # supports of the kernel across the domain: beyond, a place is not known as well as who is near
NO_CUP = (
    "No vessel that holds fluid can be a body: a tank moves as its wall.motion says, or is at rest in its own frame, "
    'whose forces are a fluid.acceleration (docs/start/python.md, "An acceleration")'
)
Fault = tuple[Path, str]


def faults(config: SphConfig) -> Iterator[Fault]:
    """The relations between settings; those inside shapes only where all vectors have their length."""
    found = [*kernels(config), *sizes(config), *names(config)]
    yield from found
    if not found:
        yield from relations(config)


def kernels(config: SphConfig) -> Iterator[Fault]:
    """Refuse a smoothing kernel that nobody has registered, and one of the user's own that cannot be compiled."""
    smoothing = SMOOTHING.get(config.numerics.kernel)
    if smoothing is None:
        yield ("numerics", "kernel"), unknown(config.numerics.kernel, SMOOTHING)
        return
    for formula in (smoothing.w, smoothing.f):
        if not shipped(formula) and (said := formula_fault(formula, ("r",), ("per_h",))):
            yield ("numerics", "kernel"), said


def sizes(config: SphConfig) -> Iterator[Fault]:
    """Refuse vectors of another number of components than dimensions, and axes that do not exist."""
    d = config.dimensions
    for path, vector in vectors(config):
        if len(vector) != d:
            yield path, f"needs {d} numbers in {d}D (got {len(vector)})"
    for i, axis in enumerate(config.domain.periodic):
        if axis not in AXES[:d]:
            yield ("domain", "periodic", i), f"must be one of {', '.join(AXES[:d])} (got {axis!r})"
    sides = [axis + sign for axis in AXES[:d] if axis not in config.domain.periodic for sign in "-+"]
    for i, side in enumerate(config.domain.outflow):
        if side not in sides:
            yield ("domain", "outflow", i), f"must be one of {', '.join(sides)} (got {side!r})"
    for group, i, section in shaped(config):
        yield from (((group, i, "shape", *path), text) for path, text in shape_faults(section.shape, d))
        box = section.shape.box
        if box and box.open:
            faces = [axis + sign for axis in AXES[:d] for sign in "-+"]
            wrong = [face for face in box.open if face not in faces]
            if group == "fluid" or wrong:
                text = "only a wall has faces to leave out" if group == "fluid" else f"not one of {', '.join(faces)}"
                yield (group, i, "shape", "box", "open"), text
    for i, flow in ((i, fluid.flow) for i, fluid in enumerate(config.fluid) if fluid.flow):
        if FLOWS[flow.type].needs_gradient and len(flow.gradient) != d * d:
            yield (
                ("fluid", i, "flow", "gradient"),
                (f"needs {d * d} numbers in {d}D, row by row (got {len(flow.gradient)})"),
            )
    for i, gauge in enumerate(config.gauge):
        yield from (((("gauge", i, *path), text)) for path, text in gauge_faults(gauge, d))
    yield from opening_checks.axes(config)


def vectors(section: Section, path: Path = ()) -> Iterator[tuple[Path, tuple[float, ...]]]:
    """The vectors of a section and of all sections in it, each with its key; matrices and lists of times are none."""
    for name in type(section).model_fields.keys() - {"angular_velocity", "gradient", "pictures"}:
        value = getattr(section, name)
        if isinstance(value, Section):
            yield from vectors(value, (*path, name))
        elif isinstance(value, tuple) and value and isinstance(value[0], float):
            yield (*path, name), value
        elif isinstance(value, tuple):
            for k, part in enumerate(value):
                yield from vectors(part, (*path, name, k)) if isinstance(part, Section) else ()


def shaped(config: SphConfig) -> Iterator[tuple[str, int, Fluid | Wall]]:
    for i, fluid in enumerate(config.fluid):
        yield "fluid", i, fluid
    for i, wall in enumerate(config.wall):
        yield "wall", i, wall


def shape_faults(shape: Shape, d: int) -> Iterator[Fault]:
    kinds = ", ".join(type(shape).model_fields)
    if not shape.kind:
        yield (), f"needs exactly one of {kinds}"
    elif shape.box:
        low, high = shape.box.low, shape.box.high
        if len(low) == len(high) == d and any(a >= b for a, b in zip(low, high)):
            yield ("box", "high"), f"must be above low = {list(low)} on every axis (got {list(high)})"
    elif shape.cylinder and shape.cylinder.base == shape.cylinder.top:
        yield ("cylinder", "top"), "must differ from base"
    elif shape.polygon:
        yield from ((("polygon", "corners"), text) for text in polygon_faults(shape.polygon.corners, d))
    elif shape.plane and not any(shape.plane.normal):
        yield ("plane", "normal"), "must not be zero"
    elif shape.stl and d == 2:
        yield ("stl",), "surfaces from STL files are for 3D; in 2D a polygon gives any outline"
    elif shape.stl:
        try:
            geometry.bounds(shape)
        except ConfigError as error:
            yield ("stl", "file"), error.message


def polygon_faults(corners: tuple[tuple[float, ...], ...], d: int) -> Iterator[str]:
    """Why a polygon has no inside."""
    if d != 2:
        yield "polygons are for 2D; in 3D an STL file gives any surface"
    elif any(len(corner) != 2 for corner in corners):
        yield "a corner has two numbers"
    elif len(corners) < 3:
        yield f"three corners or more are needed (got {len(corners)})"
    elif len(set(corners)) < len(corners):
        twice = next(corner for k, corner in enumerate(corners) if corner in corners[:k])
        yield f"each corner is given once, the last is joined to the first (got {list(twice)} twice)"
    elif met := geometry.crossing(corners):
        one, other = (list(corners[k]) for k in met)
        yield f"sides must not meet but in corners, in turn (those from {one} and {other} do)"


def gauge_faults(gauge: Gauge, d: int) -> Iterator[Fault]:
    kind = gauge.kind
    if kind is not FRONT and not gauge.at:
        yield (), f"at is missing, which a gauge of {gauge.what} needs"
    if kind.needs_axis and not gauge.axis:
        yield (), f"axis is missing, which a gauge of {gauge.what} needs"
    if gauge.size and not kind.area:
        yield ("size",), f"a gauge of {gauge.what} has no size; one of wall-pressure is the mean over an area of wall"
    if gauge.fluid and not kind.column:
        yield ("fluid",), f"a gauge of {gauge.what} has no fluid, only one of elevation"
    for name in ("radius", "wall"):
        if getattr(gauge, name) and kind is not WALL_PRESSURE:
            yield (name,), f"a gauge of {gauge.what} has no {name}, only one of wall-pressure"
    if gauge.size and gauge.radius:
        yield ("radius",), "size is given too: an area is a rectangle or a disc"
    if gauge.axis and not kind.along:
        yield ("axis",), f"a gauge of {gauge.what} has no axis"
    if any(length < 0 for length in gauge.size):
        yield ("size",), f"must not be below 0 (got {list(gauge.size)})"
    if gauge.axis and gauge.axis[0] not in AXES[:d]:
        yield ("axis",), f"there is no {gauge.axis[0]} in {d}D"


def names(config: SphConfig) -> Iterator[Fault]:
    """Refuse names that are taken, also by default, or that cannot name a file or a column of the series."""
    columns = set(scalar_units(config))
    taken: dict[tuple[bool, str], str] = {}  # snapshots tell fluids and walls apart by name, the series gauges
    for group in ("fluid", "wall", "gauge", "inlet", "outlet"):
        for i, section in enumerate(getattr(config, group)):
            name, path = name_of(group, i, section), (group, i, "name")
            if not name.replace("_", "").replace("-", "").isalnum():
                yield path, f"only letters, digits, _ and - (got {name!r})"
            earlier = taken.setdefault((group == "gauge", name), f"{group}[{i}]")
            if earlier != f"{group}[{i}]":
                yield path, f"{name!r}{'' if section.name else ', its name by default,'} is taken by {earlier}"
    for i, gauge in enumerate(config.gauge):
        own = columns_of(gauge, name_of("gauge", i, gauge), config.dimensions)
        walls = [name_of("wall", k, wall) for k, wall in enumerate(config.wall)]
        fluids = [name_of("fluid", k, fluid) for k, fluid in enumerate(config.fluid)]
        if gauge.fluid and gauge.fluid not in fluids:
            yield ("gauge", i, "fluid"), unknown(gauge.fluid, fluids)
        if gauge.wall and gauge.wall not in walls:
            yield ("gauge", i, "wall"), unknown(gauge.wall, walls)
        elif gauge.wall and config.wall[walls.index(gauge.wall)].body:
            yield ("gauge", i, "wall"), f"{gauge.wall} is a body, which may turn: its force is in the series"
        if {STEP, TIME} & set(own):
            yield ("gauge", i, "name"), TAKEN
        first = taken[True, name_of("gauge", i, gauge)] == f"gauge[{i}]"
        if first and (double := sorted(columns & set(own))):
            yield ("gauge", i, "name"), f"the series has a column {', '.join(double)} without it"
        columns |= set(own)


def relations(config: SphConfig) -> Iterator[Fault]:
    domain, d = config.domain, config.dimensions
    if domain.low and domain.high and any(a >= b for a, b in zip(domain.low, domain.high)):
        yield ("domain", "high"), f"must be above low = {list(domain.low)} on every axis (got {list(domain.high)})"
    if domain.periodic and not (domain.low and domain.high):
        yield ("domain",), "low and high are missing, which a periodic domain needs"
    whole = domain_of(config)
    n = max(b - a for a, b in zip(*whole.corners)) / stability.support_of(config)
    if n > MOST_ACROSS:
        yield ("domain",), f"{n:.3g} supports of the kernel across, more than {MOST_ACROSS}: a smaller one"
    for group, i, section in shaped(config):
        if not section.shape.plane:
            low, high = geometry.bounds(section.shape)
            n = max(b - a for a, b in zip(low, high)) / config.numerics.spacing
            if n > MOST_ALONG:
                text = f"{n:.3g} particles along an edge, more than {MOST_ALONG}: a larger numerics.spacing"
                yield (group, i, "shape"), text
    for i, fluid in enumerate(config.fluid):
        yield from ((("fluid", i, *path), text) for path, text in fluid_faults(config, fluid, d))
    for i, wall in enumerate(config.wall):
        found = itertools.chain(wall_faults(wall, d), periodic_walls.faults(config, wall))
        yield from ((("wall", i, *path), text) for path, text in found)
    yield from opening_checks.faults(config)
    yield from liquid_faults(config)
    moving = config.eos.sound_speed or config.eos.max_velocity or not config.fluid
    if not moving and not speed_scale(config):
        yield ("eos",), "max_velocity or sound_speed is missing: nothing tells a speed, as gravity or what moves does"
    viscous = any(fluid.dynamic_viscosity for fluid in config.fluid)
    if viscosity_of(config.numerics.viscosity_form).physical and not viscous:
        yield ("numerics", "viscosity_form"), 'needs a fluid with viscosity > 0, or "none"'
    for i, wall in enumerate(config.wall):
        form = config.numerics.viscosity_form or "none"
        if wall.type and not WALL_RULES[wall.type].knows(viscosity_of(form)):
            text = f'"{wall.type}" does not know viscosity_form = "{form}": "morris", or leave the type out'
            yield ("wall", i, "type"), text
    integrator = config.simulation.integrator
    if config.numerics.shifting and not INTEGRATORS[integrator].split:
        text = f'"{integrator}" finds rates of density before shifts are known: simulation.integrator = "symplectic"'
        yield ("numerics", "shifting"), text


def liquid_faults(config: SphConfig) -> Iterator[Fault]:
    """What does not know of several liquids."""
    liquids = liquids_of(config)
    for i, fluid in enumerate(config.fluid):
        if fluid.gas and all(other.gas for other in config.fluid):
            text = "a gas alone is a fluid: false, with eos.gamma = 1.4 and its own eos.sound_speed"
            yield ("fluid", i, "gas"), text
        elif fluid.gas and fluid.density >= min(other.density for other in config.fluid if not other.gas):
            yield ("fluid", i, "gas"), f"a gas is lighter than liquids (got density = {fluid.density:g}): false"
    if not liquids.several:
        return
    if liquids.gases and config.numerics.continuity == "masses":
        yield ("numerics", "continuity"), '"masses" does not know gases: "volumes"'
    these = "liquids of several " + ("densities" if liquids.densities else "viscosities")
    for i, wall in enumerate(config.wall):
        rule = WALL_RULES[wall.type] if wall.type else None
        if rule and not (rule.images or rule.extrapolated):
            yield ("wall", i, "type"), f'"{wall.type}" does not know {these}: "extrapolated-free-slip", or leave it out'
    for group in ("inlet", "outlet"):
        for i, _ in enumerate(getattr(config, group)):
            yield (group, i), f"an {group} does not know {these}"
    form = config.numerics.viscosity_form
    if viscosity_of(form).stress:
        text = f'"{form}" does not know {these}: "full-stress", "morris" or "cleary"'
        yield ("numerics", "viscosity_form"), text
    if config.numerics.shifting and liquids.densities:
        yield ("numerics", "shifting"), f"would mix {these} at their interface: false"
    for i, fluid in enumerate(config.fluid):
        if INITIAL_DENSITIES[fluid.initial_pressure] is density_of_flow and liquids.densities:
            yield ("fluid", i, "initial_pressure"), f'"flow" does not know {these}: "hydrostatic" or "zero"'


def fluid_faults(config: SphConfig, fluid: Fluid, d: int) -> Iterator[Fault]:
    if fluid.shape.plane:
        yield ("shape", "plane"), "a half-space holds no finite number of particles"
    if fluid.shape.box and fluid.thin_layer == "refuse":
        edges = [b - a for a, b in zip(fluid.shape.box.low, fluid.shape.box.high)]
        dp = config.numerics.spacing
        if min(edges) < 0.99 * dp:
            yield (
                ("shape", "box"),
                f"{min(edges):g} m thick, thinner than the spacing {dp:g} m: a smaller numerics.spacing, or "
                'thin_layer = "one layer" for one layer of reduced mass',
            )
    yield from accelerations.faults(fluid.acceleration)
    if fluid.start:
        shapes = {"position": (None, d), "velocity": (None, d)}
        yield from ((("start", *path), text) for path, text in start_faults(fluid.start, shapes))
    flow = fluid.flow
    if flow and FLOWS[flow.type].needs_gravity and not any(config.gravity):
        yield ("flow", "type"), f"a {flow.type} needs gravity"
    if INITIAL_DENSITIES[fluid.initial_pressure] is density_of_flow and flow is None:
        yield ("initial_pressure",), '"flow" needs a flow'


def wall_faults(wall: Wall, d: int) -> Iterator[Fault]:
    kind = wall.shape.kind
    if wall.body:
        yield from ((("body", *path), text) for path, text in body_faults(wall, wall.body, d))
    if wall.type and WALL_RULES[wall.type].flat and kind not in ("box", "plane"):
        yield ("type",), f'"{wall.type}" needs flat faces, shape box or plane; "extrapolated-free-slip" is for a {kind}'
    if wall.motion:
        if any(b.time <= a.time for a, b in itertools.pairwise(wall.motion.path)):
            yield ("motion", "path"), "times must grow"
        if wall.motion.stop is not None and wall.motion.stop <= wall.motion.start:
            yield ("motion", "stop"), f"must be after start = {wall.motion.start:g}"


def body_faults(wall: Wall, body: Body, d: int) -> Iterator[Fault]:
    if not wall.solid:
        yield (), f"only a solid can be a body: solid = true, which fills all of its shape. {NO_CUP}"
    elif wall.shape.box and wall.shape.box.open:
        yield (), f"it is filled, open faces make no cup of it: leave shape.box.open out. {NO_CUP}"
    if wall.motion:
        yield (), "the wall has a motion: it moves as that says, or as a body by the forces on it"
    if wall.shape.plane:
        yield (), "a half-space has no mass that a body could have"
    if wall.type and not WALL_RULES[wall.type].extrapolated:
        yield (), f'a body needs the type "extrapolated-free-slip" or "extrapolated-no-slip" (got "{wall.type}")'
    turns = 1 if d == 2 else 3
    if body.angular_velocity and len(body.angular_velocity) != turns:
        yield ("angular_velocity",), f"needs {turns} in {d}D (got {len(body.angular_velocity)} numbers)"
    known = [*AXES[:d], *(f"r{axis}" for axis in AXES[-turns:])]
    for i, motion in enumerate(body.held):
        if motion not in known:
            yield ("held", i), f"must be one of {', '.join(known)} (got {motion!r})"
    for i, line in enumerate(body.mooring):
        if line.length is None and line.at == line.anchor:
            yield ("mooring", i, "length"), "is missing: the anchor is where the line is fastened to the body"
    if body.hinge:
        yield from hinge_faults(body, body.hinge, d)


def hinge_faults(body: Body, hinge: Hinge, d: int) -> Iterator[Fault]:
    if d == 2 and hinge.axis:
        yield ("hinge", "axis"), "in 2D a hinge turns in the plane: leave the axis out"
    elif d == 3 and not any(hinge.axis):
        yield ("hinge", "axis"), "must not be zero" if hinge.axis else "is missing, which a hinge in 3D needs"
    elif len(hinge.axis) == len(body.angular_velocity) == 3:
        planes = zip(itertools.combinations(hinge.axis, 2), itertools.combinations(body.angular_velocity, 2))
        if any(a * w != b * v for (a, b), (v, w) in planes):
            yield ("angular_velocity",), f"must be along the axis of the hinge, {list(hinge.axis)}"
    if body.held:
        yield ("held",), "a body on a hinge makes no other motion than to turn on it: leave held out"
    if any(body.velocity):
        yield ("velocity",), "a body on a hinge only turns: give its angular_velocity"
