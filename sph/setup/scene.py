"""The initial state and the numbers of an SPH run, the same on every rank: pure functions of case and id.

Fluid particles have the ids 0 .. n_fluid - 1, those of wall w the ids (w + 1) 2^50 and on.
"""

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.errors import ConfigError
from hpcpic.core.files.start import arrays
from hpcpic.core.space.rng import uniforms
from hpcpic.core.space.shapes import unit
from sph.case import config as case
from sph.case import geometry
from sph.kernels.marks import WALL_BITS
from sph.physics.equation_of_state import EquationOfState
from sph.physics.liquids import liquids_of
from sph.physics.stability import support_of
from sph.physics.wall_rules import rule_of
from sph.setup import flows, periodic_walls, rest_distance, signed_distance
from sph.setup.obstacles import DOMAIN, obstacles
from sph.setup.openings import Sink, Source
from sph.setup.particle_lattices import (
    ENDLESS,
    LONGEST,
    PART,
    Face,
    Filled,
    Grid,
    Parts,
    Shell,
    box_sheets,
    dividing,
    even,
    flagged,
    grid_of,
    plane_sheet,
)
from sph.setup.rigid.fit import Fitted, beside, fits
from sph.setup.rigid.mass import rigid_of
from sph.setup.rigid.packing import oblique, packed, rests_disordered, share
from sph.setup.rigid.rings import Rings, is_round
from sph.setup.rigid.surfaces import beside_a_film

REST = 0.9  # of h: distance at which a repulsive layer holds the fluid (S(y) of (SC 9) is 0.25 there)
FAR = 1e300
AHEAD = 4.0  # supports around the fluid in which walls are made, once it is nearer than one to what is not made yet
DISORDER = 1  # stream of the random numbers


class Wall:
    """One wall at rest. `faces` of mirror walls, `lattice` of those made of particles (None for mirrors).

    shape: without ends where it goes through a period.
    """

    def __init__(self, scene: "Scene", section: case.Wall, index: int) -> None:
        self.scene, self.section, self.index = scene, section, index
        self.shape = periodic_walls.endless(section.shape, scene.config.domain)
        self.name, self.rule, self.measure_force = section.name, rule_of(section.type), section.measure_force
        self.torque_about = np.array(section.torque_about)
        self.rigid = rigid_of(section.shape, section.body.density) if section.body else None
        self.closed = self._closed()
        self.layers = max(1, math.ceil(scene.support / scene.spacing - 0.5))
        self.faces: list[Face] = self.flat_faces() if self.rule.face_images else []
        self.lattice: Any = None if self.rule.face_images else self._lattice()

    @property
    def moving(self) -> bool:
        return self.section.motion is not None

    @cached_property
    def presses(self) -> bool:
        """Pairs of this and other solids act across a film of fluid (kernels.runs.across_a_film)."""
        return bool(self.rigid) or beside_a_film(self)

    def motion(self, t: float) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Displacement[d] in m, velocity[d] in m/s and acceleration[d] in m/s2 at time t; no jumps of the velocity."""
        d, motion = self.scene.dimensions, self.section.motion
        if motion is None:
            return np.zeros(d), np.zeros(d), np.zeros(d)
        stop = math.inf if motion.stop is None else motion.stop
        since, goes = min(max(t, motion.start), stop) - motion.start, motion.start <= t < stop
        w = 2 * math.pi / motion.period
        amplitude, velocity = np.array(motion.amplitude), np.array(motion.velocity)
        x = velocity * since + amplitude * math.sin(w * since)
        v = (velocity + amplitude * (w * math.cos(w * since))) * float(goes)
        a = amplitude * (-w * w * math.sin(w * since) * goes)
        if motion.path:
            times = np.array([0.0] + [place.time for place in motion.path])
            places = np.array([(0.0,) * d] + [place.displacement for place in motion.path])
            if motion.path[0].time == 0.0:
                times, places = times[1:], places[1:]
            x = x + np.array([np.interp(t, times, places[:, k]) for k in range(d)])
            now = int(np.searchsorted(times, t, side="right"))
            if 0 < now < len(times):
                v = v + (places[now] - places[now - 1]) / (times[now] - times[now - 1])
        return x, v, a

    def near(self, low: NDArray, high: NDArray) -> tuple[NDArray[np.int64], NDArray, NDArray]:
        """ids[n], x[n, d] at displacement 0, normals[n, d] into the fluid, of the particles in [low, high)."""
        index, x, normal = self.lattice.near(np.asarray(low, float), np.asarray(high, float))
        return index + ((self.index + 1) << WALL_BITS), x, normal

    def at(self, ids: NDArray) -> tuple[NDArray, NDArray]:
        """x[n, d] at displacement 0 and normals[n, d] of particles by id."""
        return self.lattice.at(np.asarray(ids, np.int64) & ((1 << WALL_BITS) - 1))

    @cached_property
    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The box that holds all particles of the wall at displacement 0."""
        low, high = self.corners
        beyond = ENDLESS * self.scene.diagonal if self.shape.plane else (self.layers + 1) * self.scene.spacing
        margin = np.where(self.through, 0.0, beyond)
        return low - margin, high + margin

    @cached_property
    def corners(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Corners of the box around the shape, or around the part of it in one period; of a plane, of the domain."""
        scene = self.scene
        if self.shape.plane:
            return scene.low, scene.high
        low, high = map(np.array, geometry.bounds(self.shape))
        return np.where(self.through, scene.low, low), np.where(self.through, scene.high, high)

    @cached_property
    def through(self) -> NDArray[np.bool_]:
        """Along which axes it goes through a period."""
        scene = self.scene
        axes = [k for k in np.flatnonzero(scene.periodic).tolist()
                if self.shape.plane or periodic_walls.through(self.shape, scene.config.domain, k)]  # fmt: skip
        return np.isin(np.arange(scene.dimensions), axes)

    def _closed(self) -> set[str]:
        """Faces of a box that are there: not those left out, nor any across a periodic axis."""
        d, box = self.scene.dimensions, self.shape.box
        faces = {axis + sign for axis in case.AXES[:d] for sign in "-+"}
        periodic = {axis for k, axis in enumerate(case.AXES[:d]) if self.scene.periodic[k]}
        return {face for face in faces if face[0] not in periodic} - set(box.open if box else ())

    def flat_faces(self) -> list[Face]:
        """Whether the shape is a plane or a box."""
        scene, shape, d = self.scene, self.shape, self.scene.dimensions
        if shape.plane:
            far = np.full(d, FAR)
            return [Face(np.array(shape.plane.point), unit(shape.plane.normal), -far, far)]
        low, high = self.corners
        faces = []
        for axis, name in enumerate(case.AXES[:d]):
            for sign, at in (("-", low[axis]), ("+", high[axis])):
                if name + sign in self.closed:
                    a, b, point, normal = low.copy(), high.copy(), (low + high) / 2, np.zeros(d)
                    a[axis] = b[axis] = point[axis] = at
                    normal[axis] = -1.0 if (sign == "+") != self.section.solid else 1.0
                    a[scene.periodic], b[scene.periodic] = -FAR, FAR
                    faces.append(Face(point, normal, a, b))
        return faces

    def _lattice(self) -> Any:
        scene, section, shape, dp = self.scene, self.section, self.shape, self.scene.spacing
        continuous, (low, high) = self.rule.layered, self.corners
        if shape.plane:
            depths = (np.arange(self.layers) + 0.5) * dp if continuous else self.recess[:1]
            return Parts([plane_sheet(scene, shape.plane, float(depth)) for depth in depths])
        if shape.box and continuous and not section.solid:
            return Shell(low, high, dp, self.layers, self.closed)
        if shape.box and not continuous:
            recess = self.recess if section.solid else -self.recess
            below, above = (np.array([k + s in self.closed for k in case.AXES[: scene.dimensions]]) for s in "-+")
            ends = np.full(scene.dimensions, self.rule.repulsive) & ~scene.periodic
            ends &= not section.solid  # at outer edges a face must not push what is before another
            return Parts(box_sheets(low + recess * below, high - recess * above, self.closed, dp, section.solid, ends))
        if fits(self) and not shape.box:
            return Rings(self) if is_round(self) else Fitted(shape, dp, self.layers, section.solid, self._grid(ends=1))
        return Filled(shape, dp, self.layers, section.solid, self._grid())

    @property
    def recess(self) -> NDArray[np.float64]:
        """How far layers lie behind faces [d]: the fluid then rests half a spacing before the face."""
        scene, shape = self.scene, self.shape
        depth = np.full(scene.dimensions, max(0.0, REST * scene.h - scene.spacing / 2))
        if not self.rule.repulsive:
            return np.zeros(scene.dimensions)
        if self.section.solid and shape.box:
            low, high = self.corners
            return np.minimum(depth, (high - low) / 2)
        return depth

    def _grid(self, ends: int = 0) -> Grid:
        """The lattice that holds the particles of what is round, or of a solid; `ends`: so many spacings farther."""
        dp, more = self.scene.spacing, np.arange(1, ends + 1) * self.scene.spacing
        if self.section.solid and self.shape.box:
            lines = [even(a, b, dp, LONGEST) for a, b in zip(*geometry.bounds(self.shape))]
        elif self.section.solid:
            lines = list(grid_of(self.shape, dp).coordinates)
        else:
            lines = [even(a, a + dp * math.ceil((b - a) / dp), dp) for a, b in zip(*self.bounds)]
        lines = [np.concatenate([line[0] - more[::-1], line, line[-1] + more]) for line in lines]
        for k in np.flatnonzero(self.through):
            lines[k] = even(self.scene.low[k], self.scene.high[k], dp)
        return Grid(tuple(lines))


@dataclass(slots=True)
class FluidSet:
    """The particles of one fluid: points of a grid without those `removed` (sorted flat indices), or those `given`."""

    section: case.Fluid
    grid: Grid
    first: int
    mass: float
    removed: NDArray[np.int64]
    step: float  # m between points where they are nearest: the spacing, but for a box that it does not divide
    clipped: dict[str, int] = field(default_factory=dict)  # by what -> how many
    given: NDArray[np.float64] | None = None  # x[n, d] of the array that the case names
    oblique: list[Wall] = field(default_factory=list)  # that cut its lattice
    filled: float = 1.0  # its volume beside them, over that of the cells of its particles

    @property
    def n(self) -> int:
        if self.given is not None:
            return len(self.given)
        return self.grid.n - len(self.removed)

    def points(self, ids: NDArray) -> NDArray[np.float64]:
        """x[n, d] of particles by id."""
        rank = np.asarray(ids, np.int64) - self.first
        if self.given is not None:
            return self.given[rank]
        flat = rank + np.searchsorted(self.removed - np.arange(len(self.removed)), rank, side="right")
        return self.grid.points(self.grid.unflat(flat))


class Scene:
    """A case made concrete. Vectors are in physical order, arrays [n, d].

    spacing dp, h, support in m; rho0 kg/m3, c0 m/s, viscosity Pa s of the reference liquid; low[d], high[d] of the
    domain, periodic[d]; gravity[d], body_force[d] and their sum `acceleration`; normals[n, d] of repulsive faces,
    behind a zero one; axes: storage axis k is physical axis axes[k]; untold: what readings and snapshots leave out of
    pressures, Pa: the background, beside gases.
    """

    def __init__(self, config: case.SphConfig) -> None:
        numerics = config.numerics
        self.config, self.liquids = config, liquids_of(config)
        self.dimensions = d = config.dimensions
        self.spacing, self.h, self.support = numerics.spacing, config.h, support_of(config)
        self.kernel = numerics.kernel
        self.rho0, self.viscosity = self.liquids.density, self.liquids.viscosity
        self.eos = EquationOfState(
            self.rho0, config.sound_speed, config.eos.gamma, config.eos.background_pressure or 0.0
        )
        self.c0 = config.sound_speed
        self.untold = self.eos.background if self.liquids.gases else 0.0
        self.low, self.high = np.array(config.domain.low, float), np.array(config.domain.high, float)
        self.periodic = np.array([axis in config.domain.periodic for axis in case.AXES[:d]])
        self.gravity, self.body_force = np.array(config.gravity), np.array(config.body_force)
        self.acceleration = self.gravity + self.body_force
        extent = self.high - self.low
        self.diagonal = float(np.sqrt(np.sum(extent**2)))
        longest = int(np.argmax(extent))
        self.axes = (longest, *(k for k in range(d) if k != longest))
        self.walls = [Wall(self, section, k) for k, section in enumerate(config.wall)]
        sheets = [wall.lattice.parts if wall.rule.repulsive else [] for wall in self.walls]
        self.normals = np.array([np.zeros(d), *(sheet.normal for parts in sheets for sheet in parts)])
        self._first_normal = 1 + np.cumsum([0, *map(len, sheets)])
        self.inlets = [Source(self, section) for section in config.inlet]
        self.outlets = [Sink(self, section) for section in config.outlet]
        self.fluids: list[FluidSet] = []
        for section in config.fluid:
            self.fluids.append(self._fill(section))
            require_fit(self, self.fluids[-1])
        self.n_fluid = sum(fluid.n for fluid in self.fluids)
        masses = [fluid.mass for fluid in self.fluids] + [inlet.mass for inlet in self.inlets]
        self.masses = np.array(masses)  # kg, by kind

    def vertical(self, gauge: case.Gauge) -> tuple[int, float]:
        """Axis and sign of up for a gauge of level: as given, else against gravity, else the last axis."""
        if gauge.axis:
            return gauge.direction
        g = self.gravity
        k = int(np.argmax(np.abs(g))) if g.any() else self.dimensions - 1
        return k, 1.0 if g[k] <= 0 else -1.0

    def kinds(self, ids: NDArray[np.int64]) -> NDArray[np.int64]:
        """By number, the fluid of a particle, or behind all fluids its inlet: inlets take turns with numbers."""
        firsts = [fluid.first for fluid in self.fluids]
        started = np.searchsorted(firsts, ids, side="right") - 1
        return np.where(ids < self.n_fluid, started, len(firsts) + (ids - self.n_fluid) % max(1, len(self.inlets)))

    def most_particles(self, t: float) -> float:
        """More than there are of the fluid at the time t in s."""
        boxes = sum(len(inlet.rows) * (inlet.columns + 1) for inlet in self.inlets)
        return self.n_fluid + boxes + sum(inlet.volume(t) * self.rho0 / inlet.mass for inlet in self.inlets)

    def has_wall_particles(self, ids: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Which of these numbers those of particles of walls can be."""
        wall, within = (ids >> WALL_BITS) - 1, ids & ((1 << WALL_BITS) - 1)
        sheets = np.diff(self._first_normal)[np.clip(wall, 0, len(self.walls) - 1)]
        return (wall >= 0) & (wall < len(self.walls)) & ((sheets == 0) | (within >> PART < sheets))

    def normal_of(self, ids: NDArray[np.int64]) -> NDArray[np.int64]:
        """Numbers in `normals` of wall particles: 0, of length 0, but for repulsive walls."""
        wall = (ids >> WALL_BITS) - 1
        repulsive = np.diff(self._first_normal)[wall] > 0
        return np.where(repulsive, self._first_normal[wall] + ((ids & ((1 << WALL_BITS) - 1)) >> PART), 0)

    def fluid(self, ids: NDArray) -> dict[str, NDArray[np.float64]]:
        """x[n, d] m, v[n, d] m/s, drho[n] = rho - rho0 kg/m3, m[n] kg of fluid particles at t = 0."""
        ids = np.asarray(ids, np.int64)
        d = self.dimensions
        found: dict[str, NDArray[np.float64]] = {"x": np.zeros((len(ids), d)), "v": np.zeros((len(ids), d))}
        found |= {"drho": np.zeros(len(ids)), "m": np.zeros(len(ids))}
        for fluid in self.fluids:
            own = (ids >= fluid.first) & (ids < fluid.first + fluid.n)
            x = self.places(fluid, ids[own])
            found["x"][own], found["v"][own] = x, self.initial_velocity(fluid, x, ids[own])
            found["drho"][own] = self.initial_density(fluid.section, x)
            if fluid.given is None:
                found["x"][own] = rest_distance.before_walls(self, fluid.section, x, found["drho"][own])
            found["m"][own] = fluid.mass
        return found

    def places(self, fluid: FluidSet, ids: NDArray) -> NDArray[np.float64]:
        """x[n, d] of particles of a fluid before repulsive walls move it."""
        x = self.from_lattice(fluid, ids)
        if len(ids) and (fluid.oblique or rests_disordered(self, fluid)):
            own, there = packed(self, fluid, x)
            index = np.minimum(np.searchsorted(own, ids), len(own) - 1)
            x = np.where((own[index] == ids)[:, None], there[index], x)
        return x

    def from_lattice(self, fluid: FluidSet, ids: NDArray) -> NDArray[np.float64]:
        """x[n, d] of particles of a fluid as its lattice has them, off solids."""
        x = self.disordered(fluid, fluid.points(ids), ids)
        return beside(self.walls, x, fluid.step) if fluid.given is None else x

    def initial_velocity(self, fluid: FluidSet, x: NDArray, ids: NDArray) -> NDArray[np.float64]:
        """v[n, d] in m/s: of the array that the case names, or of its flow."""
        start = fluid.section.start
        given = arrays(start).get("velocity") if start else None
        return flows.velocity(self, fluid.section, x) if given is None else given[ids - fluid.first]

    def disordered(self, fluid: FluidSet, x: NDArray, ids: NDArray) -> NDArray[np.float64]:
        """x[n, d] off the lattice: a perfect one is drawn out into lines before it gives way, all at once."""
        if not fluid.section.disorder:
            return x
        shifts = 2 * uniforms(self.config.simulation.random_seed, DISORDER, ids, self.dimensions) - 1
        return x + fluid.section.disorder * self.spacing * shifts

    def initial_density(self, section: case.Fluid, x: NDArray) -> NDArray[np.float64]:
        """rho - rho0 of points of a fluid at t = 0."""
        return flows.INITIAL_DENSITIES[section.initial_pressure](self, section, x)

    def rest_density(self, x: NDArray) -> NDArray[np.float64]:
        """rho - rho0 with which particles of walls at x[n, d] start: of the hydrostatic fluid within the support."""
        found = np.zeros(len(x))
        for fluid in reversed(self.fluids):
            if flows.at_rest(fluid.section) and fluid.n:
                low, high = map(np.array, geometry.bounds(fluid.section.shape))
                near = np.all((x > low - self.support) & (x < high + self.support), axis=1)
                found[near] = flows.hydrostatic(self, fluid.section, x[near])
        return found

    def _fill(self, section: case.Fluid) -> FluidSet:
        """The lattice of a fluid, less what lies outside its shape, in walls, in earlier fluids, or nowhere."""
        first = sum(fluid.n for fluid in self.fluids)
        given, none = arrays(section.start).get("position") if section.start else None, np.zeros(0, np.int64)
        if given is not None:
            nowhere, mass = Grid((np.zeros(0),) * self.dimensions), section.density * self.spacing**self.dimensions
            given = np.asarray(given, float)
            return FluidSet(section, nowhere, first, mass, none, self.spacing, given=given)
        shape, beyond, step = section.shape, 0, self.spacing
        grid, mass = grid_of(shape, step), section.density * step**self.dimensions
        askew = shape.cylinder and np.count_nonzero(np.subtract(shape.cylinder.top, shape.cylinder.base)) > 1
        if not (shape.sphere or askew):  # a floor and the sides of a tank lie half a spacing off it
            low, high = geometry.joined(shape, [fluid.shape for fluid in self.config.fluid], step / 2)
            grid, size = dividing(low, high, step), np.subtract(high, low)
            mass = section.density * math.prod(size.tolist()) / grid.n
            step = float(min(np.min(size / grid.shape), step))
        if shape.box:
            whole, grid = grid, grid.within(self.low, self.high)
            beyond = whole.n - grid.n
        taken: list[tuple[str, NDArray[np.int64]]] = []  # of them, by what
        fluid = FluidSet(section, grid, first, mass, none, step)
        if beyond:
            fluid.clipped[DOMAIN] = beyond
        out = none if shape.box else flagged(grid, None, lambda x: signed_distance.signed_distance(shape, x) > 0.0)
        for name, box, bad in obstacles(self, grid, step):
            found = np.setdiff1d(flagged(grid, box, bad), out, assume_unique=True)
            if len(found):
                fluid.clipped[name] = fluid.clipped.get(name, 0) + len(found)
                out = np.concatenate([out, found])
                taken.append((name, found))
        fluid.removed = np.sort(out)
        fluid.oblique = oblique(self, fluid)
        if fluid.oblique:
            cutting = {wall.name for wall in fluid.oblique}
            others = [found for name, found in taken if name not in cutting]
            fluid.filled = share(fluid, np.concatenate([*others, none]))
            fluid.mass *= fluid.filled
        return fluid


def require_fit(scene: Scene, fluid: FluidSet) -> None:
    """Raises ConfigError where arrays that a fluid starts from are not of its particles, or lie outside the domain."""
    start = fluid.section.start
    if fluid.given is not None and np.any((fluid.given < scene.low) | (fluid.given > scene.high)):
        raise ConfigError(f"{fluid.section.name}: start: position leaves the domain {scene.low} to {scene.high} m")
    n = len(arrays(start).get("velocity", range(fluid.n))) if start else fluid.n
    if n != fluid.n:
        told = f"velocity has {n} rows, and its shape holds {fluid.n} particles"
        raise ConfigError(f"{fluid.section.name}: start: {told}")
