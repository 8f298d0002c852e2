"""What does not fit together in a case: place and text of every fault that single keys do not show."""

import math
from collections.abc import Iterator

from hpcpic.core.case import accelerations
from hpcpic.core.case.config import Path
from hpcpic.core.case.gauge import gauge_faults
from hpcpic.core.case.own_functions import formula_fault
from hpcpic.core.case.words import unknown
from hpcpic.core.files.start import start_faults
from lbmdem.case.boundaries import Obstacle
from lbmdem.case.config import AXES, GrainSet, LbmDemConfig, whole, whole_spacing
from lbmdem.case.grain_arrays import OF_DISCS
from lbmdem.physics import wall_rules
from lbmdem.physics.wall_rules import RULES
from lbmdem.setup.overlap_survey import packing_ends


def faults(config: LbmDemConfig) -> Iterator[tuple[Path, str]]:
    """Place and text of each; none of a case that is sound."""
    d = config.dimensions
    yield from size_faults(config, d)
    rule, arguments = RULES.get(config.coupling.bounce_back), ("q", "gi_x", "gi_y", "gj_x", "push")
    if rule is None:
        yield ("coupling", "bounce_back"), unknown(config.coupling.bounce_back, RULES)
    elif rule.number == wall_rules.OWN:
        own = wall_rules.own
        if said := formula_fault(own, (), arguments) or formula_fault(own, arguments):
            yield ("coupling", "bounce_back"), said
    yield from vector_faults(config, d)
    yield from face_faults(config, d)
    fluid = config.fluid
    if fluid is None:
        yield from dry_faults(config)
    elif config.domain.spacing is None:
        yield ("domain", "spacing"), "is missing: the distance of the lattice nodes, m"
    if fluid is not None and config.simulation.time_step is not None:
        yield ("simulation", "time_step"), "is of a case without fluid; fluid.time_step is that of a lattice"
    if fluid is not None and fluid.start is not None:
        grid = config.points[::-1]
        found = start_faults(fluid.start, {"velocity": (*grid, d), "pressure": grid})
        yield from ((("fluid", "start", *path), text) for path, text in found)
        if fluid.initial is not None:
            yield ("fluid", "start"), "give either initial or start"
    yield from name_faults(config)
    yield from unused_faults(config)
    yield from packing_faults(config)
    yield from gauge_faults(config.gauge, config.fields, config.domain.size)
    for i, obstacle in enumerate(config.obstacle):
        for key, text in obstacle_faults(config, obstacle):
            yield ("obstacle", i, *key), text
    for i, grains in enumerate(config.grains):
        for key, text in grain_faults(grains, d):
            yield ("grains", i, *key), text


def size_faults(config: LbmDemConfig, d: int) -> Iterator[tuple[Path, str]]:
    size, dx = config.domain.size, config.domain.spacing
    if len(size) != d:
        yield ("domain", "size"), f"needs {d} numbers in {d}D (got {len(size)})"
    for axis, length in zip(AXES, size):
        if dx is None:
            break
        cells = length / dx
        if round(cells) < 1:
            yield ("domain", "size"), f"is less than one spacing along {axis} ({length:g} m of {dx:g} m)"
        elif not whole(cells):
            found = whole_spacing(size, dx)
            other = f", or domain.spacing = {found:.9g} along all axes" if found else ""
            text = f"is {cells:.6g} spacings along {axis}; {round(cells) * dx:.9g} m is a whole number{other}"
            yield ("domain", "size"), text
    lattice = config.simulation.lattice
    if lattice is not None and lattice[1] != str(d):
        yield ("simulation", "lattice"), f"{lattice} is not of {d} dimensions"
    for axis in config.domain.periodic:
        if axis not in AXES[:d]:
            yield ("domain", "periodic"), f"there is no {axis} in {d}D"


def face_faults(config: LbmDemConfig, d: int) -> Iterator[tuple[Path, str]]:
    around = {face.face[0] for face in config.boundary if face.type == "periodic"}.union(config.domain.periodic)
    seen: set[str] = set()
    for i, face in enumerate(config.boundary):
        axis = face.face[0]
        if axis not in AXES[:d]:
            yield ("boundary", i, "face"), f"there is no {axis} in {d}D"
        if axis in around and face.type != "periodic":
            yield ("boundary", i, "face"), f"the box is periodic along {axis}"
        if face.face in seen:
            yield ("boundary", i, "face"), f"{face.face} is given twice"
        seen.add(face.face)
        given = (face.pressure is not None) + (face.density is not None)
        if face.type == "pressure" and given != 1:
            yield ("boundary", i), "a pressure face needs either pressure or density"
        if face.type != "pressure" and (given or face.pressure_rate):
            yield ("boundary", i), f"a {face.type} face has no pressure of its own"
        if face.type == "periodic" and face.velocity:
            yield ("boundary", i, "velocity"), "a periodic face has none"
        if face.type != "velocity" and face.profile != "uniform":
            yield ("boundary", i, "profile"), f"a {face.type} face has none"
        if face.type == "velocity" and not face.velocity:
            yield ("boundary", i), "a velocity face needs velocity"
        if len(face.velocity) == d and axis in AXES[:d] and face.velocity[AXES.index(axis)]:
            if face.type == "wall":
                yield ("boundary", i, "velocity"), f"has a part along {axis}: a wall slides along itself"
            if face.type == "pressure":
                yield ("boundary", i, "velocity"), f"has a part along {axis}, which follows from the pressure"
    yield from edge_faults(config)


def edge_faults(config: LbmDemConfig) -> Iterator[tuple[Path, str]]:
    """Faces that let fluid through and meet, or have their only node in common: what arrives there comes from beyond
    both; neither knows it."""
    opened = [(i, face.face) for i, face in enumerate(config.boundary) if face.is_open]
    for k, (i, name) in enumerate(opened):
        across = next((other for _, other in opened[:k] if other[0] != name[0]), None)
        if across:
            yield ("boundary", i, "face"), f"meets {across}: the fluid can pass through faces of one axis only"
        against = next((other for _, other in opened[:k] if other[0] == name[0] and other != name), None)
        if against and name[0] in AXES[: config.dimensions] and config.points[AXES.index(name[0])] == 1:
            yield ("boundary", i, "face"), f"has one node in common with {against}: open faces need two between them"


def dry_faults(config: LbmDemConfig) -> Iterator[tuple[Path, str]]:
    """What needs a fluid in a case that has none."""
    if not config.grains:
        yield ("fluid",), "is missing, and there are no grains either"
    elif not config.grains_move:
        yield ("grains",), "none moves, and there is no fluid"
    for i, face in enumerate(config.boundary):
        if face.is_open:
            yield ("boundary", i, "type"), f'"{face.type}" needs a fluid'


def vector_faults(config: LbmDemConfig, d: int) -> Iterator[tuple[Path, str]]:
    """Vectors with another number of components than the case has dimensions."""
    vectors: list[tuple[Path, tuple[float, ...]]] = [
        (("gravity",), config.gravity),
        (("fluid", "body_force"), config.liquid.body_force if config.fluid else ()),
    ]
    vectors += [(("boundary", i, "velocity"), face.velocity) for i, face in enumerate(config.boundary)]
    if config.shaking:
        vectors.append((("shaking", "acceleration"), config.shaking.acceleration))
    for i, obstacle in enumerate(config.obstacle):
        vectors.append((("obstacle", i, "velocity"), obstacle.velocity))
        for name, shape in (("plane", obstacle.shape.plane), ("box", obstacle.shape.box)):
            if shape is not None:
                vectors += [(("obstacle", i, "shape", name, key), value) for key, value in shape]
    for i, grains in enumerate(config.grains):
        vectors.append((("grains", i, "velocity"), grains.velocity))
        vectors += [(("grains", i, "position"), point) for point in grains.position]
        given, wanted = len(grains.angular_velocity), 1 if d == 2 else 3
        if given and given != wanted:
            yield ("grains", i, "angular_velocity"), f"needs {wanted} number(s) in {d}D (got {given})"
    for path, vector in vectors:
        if vector and len(vector) != d:
            yield path, f"needs {d} numbers in {d}D (got {len(vector)})"


def unused_faults(config: LbmDemConfig) -> Iterator[tuple[Path, str]]:
    """What is asked for and would do nothing."""
    if config.contact.tangential_stiffness is not None and config.contact.tangential != "history":
        yield ("contact", "tangential_stiffness"), 'is of the springs of tangential = "history"'
    if config.output.stress_slices and not config.grains_move:
        yield ("output", "stress_slices"), "needs grains that move: others press on nothing"
    for word in ("period", "every"):
        if getattr(config.output, word).fields and config.fluid is None:
            yield ("output", word, "fields"), "needs a fluid"


def name_faults(config: LbmDemConfig) -> Iterator[tuple[Path, str]]:
    """Names under which the output tells of grains and obstacles: two alike, or what a table or a tree cannot hold."""
    named = [(("grains", i, "name"), some.name or f"grains_{i + 1}") for i, some in enumerate(config.grains)]
    named += [(("obstacle", i, "name"), one.name or f"obstacle_{i + 1}") for i, one in enumerate(config.obstacle)]
    for k, (place, name) in enumerate(named):
        if name in [other for _, other in named[:k]]:
            yield place, f"{name!r} is taken by an earlier one"
        if set(name) & set('/,"\n'):
            yield place, f"must do without / , and quotation marks (got {name!r})"


def packing_faults(config: LbmDemConfig) -> Iterator[tuple[Path, str]]:
    """Packings that have no space in the box, or that are made in the space of another one."""
    spaces: list[tuple[float, float]] = []
    planes = [plane for plane in (obstacle.shape.plane for obstacle in config.obstacle) if plane is not None]
    vectors = [config.domain.size, *(vector for plane in planes for vector in (plane.point, plane.normal))]
    sound = all(len(vector) == config.dimensions for vector in vectors)
    for i, packing in enumerate(grains.packing for grains in config.grains):
        if packing is None:
            continue
        low, high = packing.low, packing.low if packing.high is None else packing.high
        if not 0.0 <= low < config.domain.size[-1]:
            yield ("grains", i, "packing", "low"), "must lie in the box"
        elif sound:
            ends, tops = packing_ends(config, config.grains[i])
            if any(end >= top for end, top in zip(ends, tops)):
                yield ("grains", i, "packing"), "has no space between the planes among the obstacles"
        if packing.high is not None and not high > low:
            yield ("grains", i, "packing", "high"), f"must be above low ({low:g} m)"
        if any(low <= other[1] and other[0] <= high for other in spaces):
            yield ("grains", i, "packing"), "fills the space of an earlier one: put it above that, or make them one set"
        spaces.append((low, high))


def obstacle_faults(config: LbmDemConfig, obstacle: Obstacle) -> Iterator[tuple[Path, str]]:
    """What does not fit together in one obstacle."""
    plane, box, d = obstacle.shape.plane, obstacle.shape.box, config.dimensions
    if (plane is None) == (box is None):
        yield ("shape",), "needs one of plane = {..} and box = {..}"
    elif box is not None:
        if any(low >= high for low, high in zip(box.low, box.high)):
            yield ("shape", "box"), "has no inside: low must be below high along every axis"
        if config.grains_move:
            text = "is nothing that moving grains could touch; a plane is, or a row of grains with moving = false"
            yield ("shape", "box"), text
    elif plane is not None and not any(plane.normal):
        yield ("shape", "plane", "normal"), "is no direction"
    elif plane is not None and len(plane.normal) == d:
        for axis, part in zip(AXES, plane.normal):
            if part and axis in config.domain.periodic:
                yield ("shape", "plane", "normal"), f"has a part along {axis}, along which the box is periodic"
        through = sum(u * n for u, n in zip(obstacle.velocity, plane.normal))
        if abs(through) > 1e-9 * math.hypot(*obstacle.velocity) * math.hypot(*plane.normal):
            yield ("velocity",), "has a part along the normal: a plane slides along itself"


def grain_faults(grains: GrainSet, d: int) -> Iterator[tuple[Path, str]]:
    """What does not fit together in one set of grains."""
    if grains.shape not in (None, "disc" if d == 2 else "sphere"):
        yield ("shape",), f"{grains.shape} in {d}D; {'disc' if d == 2 else 'sphere'} is the shape there"
    yield from accelerations.faults(grains.acceleration)
    if grains.acceleration and not grains.moving:
        yield ("acceleration",), "moves nothing: grains with moving = false stay where they are"
    turning = 1 if d == 2 else 3
    shapes = {"position": (None, d), "diameter": (None,), "velocity": (None, d), "angular_velocity": (None, turning)}
    if grains.start is not None:
        wrong = list(start_faults(grains.start, shapes, held=OF_DISCS if d == 2 else {}))
        yield from ((("start", *path), text) for path, text in wrong)
        if wrong:
            return
    diameter = grains.given("diameter")
    if diameter is not None and not (diameter > 0.0).all():
        yield ("start",), "diameter must be above 0"
    if (grains.diameter is not None) + (diameter is not None) + (grains.diameters is not None) != 1:
        yield (), "needs either diameter or diameters = {..}, or an array diameter in start"
    if bool(grains.position) + (grains.given("position") is not None) + (grains.packing is not None) != 1:
        yield (), "needs either position or packing = {..}, or an array position in start"
    if grains.packing is not None and grains.diameters is None:
        how = "diameters = { min = ..; max = ..; count = ..; } in place of diameter, with min = max where all are equal"
        yield ("packing",), f"needs {how}"
    n = len(grains.centres)
    if not n and grains.packing is None and grains.start is not None:
        yield ("start",), "there are no grains in it"
    if n and grains.diameters is not None and grains.diameters.count != n:
        yield ("diameters", "count"), f"is not the number of positions ({n})"
    for name in shapes:
        given = grains.given(name)
        count = n or (grains.diameters.count if grains.diameters else 0)
        if given is not None and len(given) != count:
            yield ("start",), f"{name} has {len(given)} rows for {count} grains"
    if grains.diameters is not None and grains.diameters.min > grains.diameters.max:
        yield ("diameters", "min"), f"is above max ({grains.diameters.max:g} m; got {grains.diameters.min:g})"
