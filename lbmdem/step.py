"""One step of fluid and grains (Mansouri et al. 2011, section 4)."""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.world import World
from hpcpic.core.errors import ConfigError
from hpcpic.core.space.domain import Domain, even_cuts
from hpcpic.core.tasks.graph import Pool
from hpcpic.core.timers import Timers
from lbmdem.case.config import AXES, LbmDemConfig, contact_law
from lbmdem.coupling.contact_pressure import Patches
from lbmdem.coupling.immersed import Immersed
from lbmdem.diagnostics import snapshot
from lbmdem.diagnostics.scalars import Diagnostics
from lbmdem.fluid.faces import Face
from lbmdem.fluid.fluid import Fluid
from lbmdem.forecast.estimate import output_periods
from lbmdem.grains.dem import Dem
from lbmdem.kernels.layout import FLUID
from lbmdem.physics.contact_law import Wall
from lbmdem.physics.impedance import impedance
from lbmdem.physics.lubrication import MOST_SUBSTEPS, STABLE, Film
from lbmdem.physics.velocity_sets import LATTICES
from lbmdem.setup.obstacles import obstacle_walls
from lbmdem.setup.overlap_survey import starts
from lbmdem.setup.placement import place_grains
from lbmdem.setup.scene import Scene, volumes

HOLD = 8  # steps for which the pressure of a creeping flow stays the same
TOGETHER = 256  # steps of grains alone in one call: short enough to hear signals
FASTEST = 0.4  # velocity in lattice units beyond which no collision is a fluid any more
DENSEST = 2.0  # density of the lattice fluid, likewise, and 1 / 2
DEEPEST = 0.1  # overlap over diameter at which grains are no grains any more, unless they start so
MOST_DRIFT = 0.01  # of the mean density of a fluid that cannot leave
MOST_JUMP = 1e-9  # of the same between two looks where it stays to rounding: 1e-17 a step


class LbmDem:
    """Populations and grains at `iteration`; `time` in s. A case without fluid has no populations."""

    particle_name = "grain"

    def __init__(self, config: LbmDemConfig, world: World, pool: Pool, timers: Timers) -> None:
        self.scene = scene = Scene(config)
        self.world, self.pool, self.timers = world, pool, timers
        self.n_steps, self.periods = config.n_steps, output_periods(config)
        points, periodic = scene.points[::-1], scene.periodic[::-1]
        cuts = even_cuts(points[0], world.size)
        self.domain = Domain(tuple(config.domain.size[::-1]), points, periodic, cuts, offset=0.5)
        self.iteration = 0
        self.table = place_grains(config, world, pool, self.domain)
        self.work_items = math.prod(scene.points) if config.fluid else len(self.table)
        self.work_unit = "node" if config.fluid else "particle"
        self.grains_move = bool((~self.table.fixed).any())
        self.fluid = self._fluid() if config.fluid else None
        self.immersed = self._immersed() if self.fluid and (len(self.table) or config.obstacle) else None
        self.solid_moves = bool(self.grains_move and self.immersed and not config.coupling.frozen)
        self.dem = self._dem() if self.grains_move else None
        seen_at_rest = self.dem and self.immersed and config.coupling.frozen
        self.patches = Patches(self.fluid, world, self.table.radius) if seen_at_rest else None
        self.start_solid()
        self._check_fluid()
        self.deepest_allowed = max(DEEPEST, 1.1 * starts(config)[1])
        shaken = scene.config.shaking is not None
        ramped = config.fluid is not None and any(face.rate for face in scene.faces.values())
        self.driven = shaken or ramped  # by something that changes in time
        self.creeps = ramped and not shaken and creeping(config)
        self.diagnostics = Diagnostics(self)
        self.scalar_units = self.diagnostics.units

    def _fluid(self) -> Fluid:
        scene, config, fluid = self.scene, self.scene.config, self.scene.config.fluid
        forced = any(fluid.body_force) or scene.config.shaking is not None
        made = Fluid(
            self.world, self.pool, self.domain, LATTICES[scene.lattice],
            tau=scene.tau,
            collision=fluid.collision,
            magic=fluid.magic,
            force=scene.body_force(0.5) if forced else None,
            storage=fluid.storage,
            blocks=scene.config.simulation.blocks,
            faces={name: Face(face.kind, face.density, face.velocity) for name, face in scene.faces.items()},
        )  # fmt: skip
        rules = config.coupling
        made.stays = not self.grains_move or rules.frozen
        made.stays &= rules.bounce_back != "quadratic" and rules.refill != "conserving"
        axes = self.coordinates()
        made.set_equilibrium(scene.initial_density(axes, self.sample()), scene.initial_velocity(axes))
        return made

    def sample(self) -> tuple[float, float]:
        """Lower and upper end of the fixed grains along the last axis, m; the box's where there are none."""
        x, r = self.table.x[:, -1], self.table.radius
        if not len(r):
            return 0.0, self.scene.config.domain.size[-1]
        return float((x - r).min()), float((x + r).max())

    def coordinates(self) -> tuple[NDArray, ...]:
        """x, y(, z) of this rank's nodes in m, which broadcast to the slab in storage order."""
        d, dx = self.scene.dimensions, self.scene.config.spacing
        low, high = self.domain.row_range(self.world.rank)
        ranges = [np.arange(low, high), *(np.arange(n) for n in self.domain.points[1:])]
        along = [((r + 0.5) * dx).reshape([-1 if k == axis else 1 for k in range(d)]) for axis, r in enumerate(ranges)]
        return tuple(along[::-1])

    def _immersed(self) -> Immersed:
        """The solids of the fluid: obstacles, and grains, of which those that stay are linked once."""
        coupling, table, units = self.scene.config.coupling, self.table, self.scene.units
        stay = table.fixed if not coupling.frozen else np.ones(len(table), np.bool_)
        ids = np.flatnonzero(stay)
        return Immersed(
            self.fluid, self.world, self.pool,
            rule=coupling.bounce_back,
            refill=coupling.refill,
            fixed=(ids, self.nodes(table.x[ids]), table.radius[ids] / units.dx,
                   table.v[ids] / units.velocity, table.omega[ids] * units.dt),
            walls=obstacle_walls(self.scene),
        )  # fmt: skip

    def nodes(self, x: NDArray) -> NDArray[np.float64]:
        """Places [n, d] in m as coordinates in which node i is at i."""
        return x / self.scene.units.dx - 0.5

    def _dem(self) -> Dem:
        config, scene, table = self.scene.config, self.scene, self.table
        self.law = law = contact_law(config)
        columns = {name: getattr(table, name) for name in ("x", "v", "omega", "radius", "mass", "inertia", "fixed")}
        film = None
        if self.solid_moves and config.coupling.lubrication:
            viscosity = config.fluid.kinematic_viscosity * config.fluid.density
            film = Film.of_lattice(viscosity, config.spacing, scene.dimensions)
        dem = Dem(
            self.world, self.pool, self.domain, columns, law, box_walls(scene), reach=2.0 * config.spacing, film=film
        )
        self.substeps = config.substeps  # but for what films want, see move_grains
        self.films = film is not None
        self.least_film = self.worst_film = 1.0  # least share of its formula that a film got, last step and all
        self._constant = scene.constant_force(table.mass, volumes(table.radius, scene.dimensions))
        if self.solid_moves and config.coupling.inertia == "implicit":
            self._add_impedance(dem)
        return dem

    def _add_impedance(self, dem: Dem) -> None:
        """Inertia for grains that are lighter than the impedance of their links, as much as that: half of it is where
        the force of these would begin to swing. All others keep their own, and momentum closes."""
        units, rule = self.scene.units, self.scene.config.coupling.bounce_back
        own = {name: getattr(dem.grains, name)[: dem.grains.n] for name in ("radius", "mass", "inertia")}
        mass, inertia = impedance(LATTICES[self.scene.lattice], rule, own["radius"] / units.dx)
        added = mass * units.mass - own["mass"], inertia * units.mass * units.dx**2 - own["inertia"]
        dem.set_added(*(np.maximum(0.0, part) for part in added))

    def step(self) -> None:
        """From time step n to n + 1."""
        if self.fluid:
            with self.timers.section("fluid"):
                if self.driven:
                    self.drive()
                self.fluid.step()  # collide [4], bounce back [6] and momentum exchange [7], stream, faces (Zou & He)
        if self.dem:
            with self.timers.section("grains"):
                self.move_grains()  # n_d steps of the contacts [1], [2]
            with self.timers.section("solid"):
                self.mark_solid()  # nodes that grains have covered and left (3.3)
        self.iteration += 1

    def drive(self) -> None:
        """Body force and pressures of this step."""
        if self.scene.config.shaking:
            self.fluid.set_force(self.scene.body_force(self.iteration + 0.5))
        if self.creeps and self.iteration % HOLD:
            return
        for name, face in self.scene.faces.items():
            if face.rate:
                density = face.density + face.rate * self.ramped(self.iteration + 1)
                if self.creeps:
                    before = face.density + face.rate * self.ramped(self.iteration)
                    self.fluid.f *= (density - 1.0) / (before - 1.0)
                self.fluid.set_face(name, density=density)

    def ramped(self, step: int) -> int:
        """Steps of change that the pressures at a time step have behind them."""
        return (step - 1) // HOLD * HOLD + 1 if self.creeps and step else step

    def move_grains(self, steps: int = 1) -> None:
        """n_d substeps per step under the forces of the fluid, which stay the same meanwhile."""
        dem, units, frame = self.dem, self.scene.units, self.scene.shaken(self.time)
        own = dem.grains.ids[: dem.grains.n]
        force = self._constant[own] - self.table.mass[own, None] * frame
        torque = np.zeros((len(own), self.table.omega.shape[1]))
        if self.immersed:
            pushed, turned = self.immersed.forces(own)
            if self.patches:
                pushed = pushed + self.patches.forces()[own]
            force += pushed * units.force
            torque += turned * units.torque
        n, dt = self._substeps_of_films() if self.films else self.substeps, self.time_step
        dem.advance(dt / n, steps * n, force, torque, time=self.time, usual=dt / self.substeps)

    def _substeps_of_films(self) -> int:
        """n_d of this step, in which no film is limited unless that takes more than MOST_SUBSTEPS. Collective."""
        wanted = self.time_step * self.dem.fastest_film(self.time_step) / STABLE
        n = self.substeps
        if not self.scene.config.coupling.substeps:
            n = max(n, math.ceil(min(wanted, MOST_SUBSTEPS)))
        self.least_film = min(1.0, n / wanted) if wanted else 1.0
        self.worst_film = min(self.worst_film, self.least_film)
        return n

    def advance(self, most: int) -> None:
        """Some steps, `most` at most: what the fluid does in one pass over memory when nothing moves in it, or what
        grains without a fluid do in one call.
        """
        if self.driven or (self.fluid and self.dem):
            self.step()
        elif self.fluid:
            with self.timers.section("fluid"):
                n = self.fluid.leap(most)
            self.iteration += n
        else:
            with self.timers.section("grains"):
                n = min(most, TOGETHER)
                self.move_grains(n)
            self.iteration += n

    def start_solid(self) -> None:
        """The fluid sees the grains for the first time, or where a checkpoint has them."""
        if self.solid_moves:
            self.immersed.start(*self._moving_grains())

    def _check_fluid(self) -> None:
        """ConfigError where solids fill the box. Collective."""
        if self.fluid and not self.world.any(bool((self.fluid.solid.inner == FLUID).any())):
            raise ConfigError("no node of the lattice is in the fluid: grains and obstacles fill the whole box")

    def mark_solid(self) -> None:
        """The fluid sees the grains where they are now."""
        if self.solid_moves:
            self.immersed.move(*self._moving_grains())

    def _moving_grains(self) -> tuple[NDArray, ...]:
        """Numbers, places, radii, velocities and angular velocities of own grains and ghosts, in lattice units."""
        grains, units = self.dem.grains, self.scene.units
        moving = ~grains.fixed
        return (
            grains.ids[moving],
            self.nodes(grains.x[moving]),
            grains.radius[moving] / units.dx,
            grains.v[moving] / units.velocity,
            grains.omega[moving] * units.dt,
        )

    @property
    def time_step(self) -> float:
        return self.scene.time_step

    @property
    def time(self) -> float:
        return self.iteration * self.time_step

    def scalars(self) -> dict[str, float]:
        """See lbmdem.diagnostics. Collective."""
        with self.timers.section("scalars"):
            return self.diagnostics.scalars()

    def arrays(self, what: str) -> Mapping[str, object]:
        """ "field": velocity, pressure, solid; "particle": grains by set. Collective."""
        return snapshot.fields(self) if what == "field" else snapshot.grains(self)

    def state(self) -> Mapping[str, object]:
        """Populations by rows, grains by number, bit for bit. Collective."""
        return snapshot.state(self)

    def columns(self, reader) -> Mapping[str, object]:
        """What the arrays of a checkpoint of this scene are."""
        return snapshot.columns(self, reader, DENSEST)

    def restore(self, reader) -> None:
        """Take the state of a checkpoint, written by any number of ranks. Collective."""
        snapshot.restore(self, reader)
        for name, face in self.scene.faces.items() if self.driven and self.fluid else ():
            if face.rate:
                self.fluid.set_face(name, density=face.density + face.rate * self.ramped(self.iteration))

    def guard(self) -> str | None:
        """Why this rank's state is no solution, or None."""
        if self.diagnostics.fastest > FASTEST:
            return f"the fluid moves by {self.diagnostics.fastest:.3g} nodes in a step (limit {FASTEST})"
        if self.fluid:
            share = float(self.fluid.lattice.w[0])  # populations at rest follow the density
            low, high = (1.0 / DENSEST - 1.0) * 2.0 * share, (DENSEST - 1.0) * share
            least, most = self.fluid.rest_bounds()
            if not low <= least <= most <= high:
                return f"the density left {1 / DENSEST} .. {DENSEST} times that of rest"
        if self.dem and not np.isfinite(self.dem.grains.x).all():
            return "a grain is nowhere"
        if self.dem and not all(np.isfinite(self.dem.grains.columns[name]).all() for name in ("heat", "work")):
            return "the energy of a grain is no number"
        deepest, drift = self.diagnostics.deepest, self.diagnostics.drift
        if deepest > self.deepest_allowed:
            return f"grains overlap by {deepest:.1%} of a diameter (limit {self.deepest_allowed:.0%})"
        if abs(drift) > MOST_DRIFT:
            return f"the mean density of the fluid has changed by {drift:.2%} (limit {MOST_DRIFT:.0%})"
        if not abs(self.diagnostics.jump) <= MOST_JUMP:
            return f"the mean density of the fluid jumped by {self.diagnostics.jump:.1e}, which nothing in it can do"
        return None

    def worst(self) -> list[str]:
        """Lines on the worst grains and nodes of this rank. Collective."""
        return snapshot.worst(self)

    def close(self) -> None:
        """Free what MPI holds (all ranks together)."""
        if self.immersed:
            self.immersed.free()
        if self.fluid:
            self.fluid.free()


def box_walls(scene: Scene) -> list[Wall]:
    """What grains meet: the sides of the box that are not periodic, and planes in it."""
    d, size = scene.dimensions, scene.config.domain.size
    walls = []
    for axis, name in enumerate(AXES[:d]):
        if scene.periodic[axis]:
            continue
        speeds = {face.face: face.velocity for face in scene.config.boundary if face.type == "wall"}
        floor = floor_of(scene.config) if axis == d - 1 else 0.0
        for side, place, way in (("-", floor, 1.0), ("+", size[axis], -1.0)):
            point, normal = np.zeros(d), np.zeros(d)
            point[axis], normal[axis] = place, way
            walls.append(Wall(tuple(point), tuple(normal), speeds.get(name + side, ())))
    planes = [(obstacle.shape.plane, obstacle.velocity) for obstacle in scene.config.obstacle]
    return walls + [Wall(plane.point, plane.normal, velocity) for plane, velocity in planes if plane is not None]


def floor_of(config: LbmDemConfig) -> float:
    """Where grains end below along the last axis, m: a screen under a sample, through which the fluid passes."""
    samples = [grains.packing.low for grains in config.grains if grains.packing and grains.moving]
    return max(0.0, min(samples)) if samples and len(samples) == len(config.grains) else 0.0


def creeping(config: LbmDemConfig) -> bool:
    """Is a flow through grains that it sees at rest proportional to the one pressure that changes?

    Then its populations are scaled with that pressure: a compressible fluid would take the time L^2 mu / (k rho c^2)
    to adjust its pressure in a sample of length L, far longer than water does.
    """
    open_faces = [face for face in config.boundary if face.type != "wall"]
    ramped = [face for face in open_faces if face.pressure_rate and face.pressure]
    still = all(face.type == "pressure" and (face.pressure == 0.0 or face in ramped) for face in open_faces)
    moved = any(any(face.velocity) for face in config.boundary) or any(any(some.velocity) for some in config.obstacle)
    calm = not moved and not any(config.fluid.body_force) and config.fluid.initial is None
    return config.coupling.frozen and len(ramped) == 1 and still and calm
