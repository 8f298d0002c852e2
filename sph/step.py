"""The SPH simulation: the state of a run, and one step in time."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.case import accelerations
from hpcpic.core.comm.world import World
from hpcpic.core.errors import Diverged
from hpcpic.core.files.arrays import Column, FieldArray, ParticleArray, Shard
from hpcpic.core.files.sealed import Reader
from hpcpic.core.simd.generate import specialise
from hpcpic.core.space.domain import Domain
from hpcpic.core.tasks.graph import Pool
from hpcpic.core.timers import Timers
from sph.case import columns
from sph.case.config import SphConfig
from sph.diagnostics import scalars, snapshot
from sph.diagnostics.checkpoint import Checkpoint
from sph.diagnostics.checksums import Checksums
from sph.diagnostics.gauges import Gauges
from sph.diagnostics.guards import Runaway
from sph.diagnostics.sensors import Sensors
from sph.kernels.driven import driven_kernel
from sph.particles.arrays import arrays_of
from sph.particles.evolution import Evolution
from sph.particles.extremes import extremes, fluid_box
from sph.particles.ghosts import Ghosts
from sph.particles.images import images_of
from sph.particles.neighbours import Cells
from sph.particles.openings import Exchange, Openings
from sph.particles.pair_sums import PairSums
from sph.particles.rigid.bodies import Bodies
from sph.particles.skin import Skin
from sph.particles.slabs import CellGrid, Slabs
from sph.particles.storage import Storage
from sph.particles.strays import Strays
from sph.particles.tasks import Tasks, arena_of, parts_of
from sph.particles.wall_forces import Forces, WallForces
from sph.particles.walls import Walls
from sph.physics.integrators import INTEGRATORS
from sph.physics.timestep import Clock, TimeStep
from sph.setup.pair_numbers import pair_spec_of
from sph.setup.scene import Scene


class Sph:
    """The state x^n, v^n, rho^n of a run, and the step to n + 1. Inside, axes are in storage order and x is relative
    to the lower corner of the domain.
    """

    work_unit = particle_name = "particle"

    def __init__(self, config: SphConfig, world: World, pool: Pool, timers: Timers) -> None:
        self.scene = scene = Scene(config)
        self.world, self.timers, self.clock = world, timers, Clock()
        self.n_steps, self.end_time = config.n_steps, config.end_time
        self.scalar_units = columns.series_units(config)
        kinds = {"series": "series", "particle": "particles", "checkpoint": "checkpoint"}
        self.time_periods = {kind: getattr(config.output.period, name) or 0.0 for kind, name in kinds.items()}
        self.periods = {kind: getattr(config.output.every, name) or 0 for kind, name in kinds.items()}
        self.integrator = INTEGRATORS[config.simulation.integrator]
        self.skin = Skin(scene, self.integrator.staged)
        self.choose = TimeStep(config, scene.eos, self.skin.step_limit)
        self.walls = Walls(scene)
        self.grid = CellGrid(scene, self.skin.largest_radius)
        self.slabs = Slabs(scene, self.grid, world)
        with world.first_on_node():  # it compiles
            self._prepare(scene, pool)
        self.forces = WallForces(self.walls, self.ghosts, self.sums, self.slabs)
        if any(wall.rigid for wall in scene.walls):
            with world.first_on_node():  # it compiles
                self.evolution.bodies = Bodies(self.clock, self.forces, self.tasks, self.motion)
        self.bodies = self.evolution.bodies
        self.sensors = Sensors(self.walls, self.ghosts, self.sums, self.slabs)
        self.gauges = Gauges(self.storage, self.sensors)
        self.exchange = Exchange(scene, world, self.clock, self.storage)
        if scene.inlets or scene.outlets:
            self.evolution.openings = Openings(scene, self.clock, self.storage, self.slabs, self.exchange)
        self.openings = self.evolution.openings
        small: dict[str, NDArray] = {"impulses on walls": self.forces.impulses}
        small |= {"counts of what inlets made": self.exchange.made, "counts of what has left": self.exchange.gone}
        if self.bodies:
            small |= {"states of bodies": self.bodies.state, "impulses of contacts": self.bodies.ledger}
        if self.openings:
            small |= {"mean velocities at openings": self.openings.mean, "ways of inlets": self.openings.way}
            small["water columns at outlets"] = self.openings.columns
        self.checksums = Checksums(scene.dimensions, self.tasks.arena, small)
        self.runaway = Runaway(self.clock, self.storage, self.forces, self.totals, self.checksums, self.exchange)
        self.strays = Strays(scene, world, self.clock, self.storage)
        parts = self.clock, self.storage, self.forces, self.gauges, self.strays, self.skin, self.bodies
        self.checkpoint = Checkpoint(*parts, self.exchange, self.openings)
        self.storage.append_fluid()  # this rank's share by number
        if self.openings:
            self.openings.begin()
        self.walls.grow(fluid_box(scene, world, self.storage), self.storage, self.slabs)
        for inlet in scene.inlets:  # where fluid will be
            self.walls.grow((inlet.low, inlet.high), self.storage, self.slabs)
        self._settle()

    def _prepare(self, scene: Scene, pool: Pool) -> None:
        """Declare the arrays, without particles yet, and compile the kernels of the scene."""
        maps, mirrors = images_of(self.walls, self.skin.largest_radius)
        others, films = bool(scene.walls) or len(maps.planes) > 1, any(wall.presses for wall in scene.walls)
        self.spec = pair_spec_of(scene.config, others, films)
        declared = arrays_of(self.spec, self.integrator.staged)
        parts = parts_of(scene.n_fluid // self.world.size, pool.threads)
        self.tasks = Tasks(pool, arena_of(scene, declared, parts, mirrors=mirrors))
        self.motion = specialise("sph.kernels", ["motion"], DIM=scene.dimensions, REAL=repr(self.spec.real))
        self.storage = Storage(scene, self.world, self.tasks.arena)
        self.ghosts = Ghosts(self.storage, maps)
        self.cells = Cells(self.tasks, self.grid, scene.dimensions)
        self.sums = PairSums(scene, self.spec, self.tasks, self.ghosts)
        self.evolution = Evolution(self.clock, self.tasks, self.motion, self.sums, self.walls, self.timers)
        self._drive(scene)
        self.totals = scalars.Totals(scene, self.world, self.tasks)

    def _drive(self, scene: Scene) -> None:
        """Accelerations of the user's own that fluids name."""
        axes, named = tuple(scene.axes), [fluid for fluid in scene.fluids if fluid.section.acceleration]
        if named:
            self.evolution.driven.append(self.motion.clear_own)
            self.tasks.arena.set(moment=np.zeros(1), corner=np.ascontiguousarray(scene.low[list(axes)]))
        for fluid in named:
            own = accelerations.compiled(fluid.section.acceleration)
            self.evolution.driven.append(driven_kernel(own, axes, fluid.first, fluid.first + fluid.n))

    def step(self) -> None:
        """x^n, v^n, rho^n -> n + 1."""
        self.integrator.step(self.evolution, self.choose_step)
        box = self.extremes.box
        with self.timers.section("update"):
            if self.bodies:
                self.bodies.settle()
            self.evolution.wrap()
            self.strays.settle()
            self.exchange.leave(box)
        self.clock.time += self.clock.time_step
        self.clock.step += 1
        if self.openings:
            with self.timers.section("update"):
                self.openings.follow()
        with self.timers.section("migrate"):
            self.walls.grow(box, self.storage, self.slabs)
            self.migrate()
        self.skin.reach = self.skin.next_reach
        self.sort()
        period = self.scene.config.numerics.balance_period
        if period and self.clock.step % period == 0:
            self.balance()

    def advance(self, most: int) -> None:
        """Do one step, of `most` that may be done at once."""
        self.step()

    def migrate(self) -> None:
        """Send particles that left the slab to their new ranks. Collective."""
        if self.world.size > 1:
            layer, slabs = self.cells.layer_of(self.storage), self.slabs
            leaving = np.flatnonzero((layer >= 0) & ((layer < slabs.low) | (layer >= slabs.high)))
            self.ghosts.forget()
            self.storage.migrate(self.clock.step, leaving, slabs.owner[layer[leaving]])

    def balance(self) -> None:
        """Cut slabs of equal cost, if the present ones are far from it. Collective."""
        if self.world.size > 1 and self.slabs.balance(self.cells.costs()):
            self.migrate()
            self.sort()

    def _settle(self) -> None:
        """Slabs of equal cost for particles on any rank, and who is near whom. Collective."""
        if self.world.size > 1:
            self.slabs.balance(self.cells.counts(self.storage))  # who is near whom is known afterwards
        self.migrate()
        self.sort()
        self.balance()

    def sort(self) -> None:
        """Find ghosts, cells and neighbours for the positions as they are. Collective."""
        ghosts = self.ghosts
        if self.bodies:
            self.bodies.follow()
        with self.timers.section("ghosts"):
            if self.walls.moving and any(ghosts.maps.wall):
                ghosts.maps, mirrors = images_of(self.walls, self.skin.largest_radius)
                self.tasks.arena.set(mirrors=mirrors)
            if not ghosts.none_anywhere:
                ghosts.choose(self.clock.step, self.cells.layer_of(self.storage), self.slabs)
        with self.timers.section("sort"):
            ghosts.sorted(self.cells.sort(self.storage, self.slabs))
            self.cells.find(self.skin.radius)
        self.checksums.keep()

    def choose_step(self) -> None:
        """dt from the largest speed, acceleration and density error of all particles. Collective."""
        with self.timers.section("dt"):
            self.extremes = now = extremes(self.scene, self.world, self.tasks, self.motion.largest)
            if not now.finite:
                self.runaway.end_without_number()
            self.evolution.speed = now.speed
            self.clock.time_step = dt = self.choose(now.speed, now.acceleration, now.density_error)
            self.strays.find(now.density_error)
            self.runaway.look(now)
            self.forces.add_impulses(dt, self.bodies.found if self.bodies else None)
            self.sensors.add(dt)
        if self.skin.farthest and not self.skin.suffices(dt, now.speed, now.acceleration):
            self.sort()  # which has lost the sums
            self.evolution.forget_rates()
            self.evolution.evaluate(start=True)
        if self.bodies:
            with self.timers.section("update"):
                self.bodies.meet()

    # ---- what others see

    @property
    def iteration(self) -> int:
        """Steps done."""
        return self.clock.step

    @property
    def time(self) -> float:
        """t^n, s."""
        return self.clock.time

    @property
    def time_step(self) -> float:
        """Length of the last step, s."""
        return self.clock.time_step

    @property
    def work_items(self) -> int:
        """Particles of all ranks, without those that have left since the last look at the mass."""
        return self.scene.n_fluid + self.exchange.come

    @property
    def local_items(self) -> int:
        """Particles of this rank."""
        return self.storage.n

    @property
    def domain(self) -> Domain:
        """The domain in storage axes, and its cuts between ranks."""
        return self.slabs.domain

    def current_forces(self) -> None:
        """Find a of the present state, if it is not known: the next step will not evaluate it again. Collective."""
        if self.integrator.split:
            self.evolution.evaluate_forces()
        else:
            self.evolution.evaluate(start=True)

    def wall_forces(self) -> Forces:
        """Force [d] and torque [3] of the fluid on each measured wall, now. Collective."""
        self.current_forces()
        return self.forces.now()

    def scalars(self) -> Mapping[str, float]:
        """Energies, mass, momentum, extremes, forces, gauges. Collective."""
        with self.timers.section("scalars"):
            if self.forces.measured or self.sensors.gauges:
                self.current_forces()
            found = self.runaway.fluid_scalars() | scalars.wall_scalars(self.scene, self.forces)
            found |= {"dt": self.clock.time_step, "strays": float(self.strays.count)}
            found |= self.bodies.scalars() if self.bodies else {}
            found |= self.gauges.values(self.clock.time)
            return {name: found[name] for name in self.scalar_units if name in found}

    def sampled(self) -> None:
        """Let means over time of gauges begin anew, as the series has the scalars of this time. Collective."""
        if self.sensors.gauges:
            self.current_forces()
        self.gauges.sampled(self.clock.time)

    def fields(self) -> Mapping[str, FieldArray]:
        """Nothing: there is no mesh."""
        return {}

    def particles(self) -> Mapping[str, ParticleArray]:
        """Fluids and walls by name."""
        if not self.spec.moments:
            return snapshot.particles(self.storage)
        self.evolution.forget_rates()
        return snapshot.particles(self.storage, self.sums)

    def state(self) -> Mapping[str, Shard]:
        """Fluid and walls in order of their ids, bit for bit. Collective."""
        return self.checkpoint.state()

    def columns(self, reader: Reader) -> Mapping[str, Column]:
        """What the arrays of a checkpoint of this scene are."""
        return self.checkpoint.columns(reader)

    def restore(self, reader: Reader) -> None:
        """Take the state of a checkpoint, written by any number of ranks, for the present one. Collective."""
        self.ghosts.forget()
        self.checkpoint.restore(reader)
        self.resume()

    def resume(self) -> None:
        """Go on from particles that have just been appended on any rank. Collective."""
        if not np.isfinite(self.storage.x[:, : self.storage.end]).all():
            raise Diverged("a position is not a finite number")
        self.skin.check()
        self.evolution.forget_rates()
        if self.evolution.driven:
            self.tasks.arena["moment"][0] = self.clock.time
        self._settle()

    def guard(self) -> str | None:
        """Why this rank's state is no solution, or None. Collective where no series has looked at the energy lately."""
        return self.runaway.trouble()

    def worst(self) -> list[str]:
        """Lines on the worst particles of this rank."""
        return snapshot.worst(self.storage)

    def close(self) -> None:
        """Free what MPI holds (all ranks together)."""
        self.storage.free()
