"""The SPH simulation: particles sorted into cells, pair sums, one step in time."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.world import World
from hpcpic.core.errors import Diverged
from hpcpic.core.files.arrays import Column, FieldArray, ParticleArray, Shard
from hpcpic.core.files.sealed import Reader
from hpcpic.core.space.domain import Domain, balanced_cuts, block_ranges
from hpcpic.core.tasks.arena import Arena
from hpcpic.core.tasks.graph import Pool
from hpcpic.core.timers import Timers
from sph.case import columns
from sph.case.config import SphConfig
from sph.diagnostics import checkpoint, scalars, snapshot
from sph.diagnostics.gauges import Gauges
from sph.diagnostics.guards import Runaway
from sph.kernels.groups import Mirrors
from sph.kernels.marks import FLOWS, FLUID, REAL
from sph.kernels.specialise import specialise
from sph.particles.arrays import arrays_of
from sph.particles.images import Maps, mirrors, periodic_maps, single_mirrors
from sph.particles.neighbours import Cells, Grid
from sph.particles.pair_sums import PairSums
from sph.particles.particles import Bodies, Slabs
from sph.particles.strays import Outflow, Strays
from sph.particles.tasks import Tasks
from sph.particles.walls import Walls, grow_walls, wall_forces
from sph.physics.integrators import INTEGRATORS, STAGED, symplectic
from sph.physics.pair_spec import law_of
from sph.physics.timestep import TimeStep
from sph.setup.scene import Scene

PART = 24_000  # particles of a part of a task, whose odd layers find in the cache what its even ones have left there
PARTS_PER_THREAD = 4, 16  # at least and at most
FASTEST = 0.15  # of c0: particles of integrators with stages may move so far in a step of Courant number cfl
SPARE, LEAST = 1.15, 2e-3  # neighbours are known for this much more than the way of the last step, and for so many h
MARGIN = 1e-9  # of the support, for rounding


class Sph:
    """The state x^n, v^n, rho^n of a run, and the step to n + 1. Inside, axes are in storage order and x is relative
    to the lower corner of the domain.
    """

    work_unit = particle_name = "particle"

    def __init__(self, config: SphConfig, world: World, pool: Pool, timers: Timers) -> None:
        self.scene = scene = Scene(config)
        self.world, self.timers = world, timers
        self.n_steps, self.end_time = None, scene.end_time
        period, every = config.output.period, config.output.every
        self.scalar_units = columns.scalar_units(config) | columns.gauge_units(config)
        self.gauges = Gauges(self)
        kinds = {"series": "series", "particle": "particles", "checkpoint": "checkpoint"}
        self.time_periods = {kind: getattr(period, name) or 0.0 for kind, name in kinds.items()}
        self.periods = {kind: getattr(every, name) or 0 for kind, name in kinds.items()}
        self.iteration, self.time, self.time_step = 0, 0.0, 0.0
        self._slabs: Slabs | None = None
        self.evaluations, self._forces_at = 0, -1
        self.axes = list(scene.axes)
        self.walls, self.impulses = Walls(scene, world), np.zeros((len(scene.walls), 4))
        self._domain()
        parts = int(np.clip(scene.n_fluid // (PART * world.size * pool.threads), *PARTS_PER_THREAD))
        with world.first_on_node():  # it compiles
            self._prepare(pool, parts * pool.threads)
        self.runaway, self.strays, self.outflow = Runaway(self), Strays(self), Outflow(self)
        self._distribute()
        self.sort()

    def _domain(self) -> None:
        """Storage axes, the grid of cells, and how far particles may move between sorts."""
        scene, config = self.scene, self.scene.config
        self.origin = scene.low[self.axes]
        self.lengths = (scene.high - scene.low)[self.axes]
        self.periodic = scene.periodic[self.axes]
        staged = config.simulation.integrator in STAGED
        self.farthest_reach = FASTEST * config.simulation.cfl * scene.h if staged else 0.0
        self.reach = self.next_reach = min(LEAST * scene.h, self.farthest_reach)  # how far particles move between sorts
        self.radius = scene.support * (1 + MARGIN) + 2 * self.farthest_reach
        self.grid = Grid(self.lengths, self.radius)
        cuts = balanced_cuts(np.ones(self.grid.layers), self.world.size)
        points = (self.grid.layers, *np.ceil(self.lengths[1:] / self.radius).astype(int).tolist())
        self.domain = Domain(tuple(self.lengths), points, tuple(map(bool, self.periodic)), cuts)

    def _prepare(self, pool: Pool, parts: int) -> None:
        """Bodies, cells and sums of nothing yet."""
        scene, d = self.scene, self.scene.dimensions
        maps, mirrors = self._maps()
        staged = scene.config.simulation.integrator in STAGED
        self.law = law_of(scene, bool(scene.walls) or len(maps.planes) > 1)
        self.motion = specialise("motion", DIM=d, REAL=self.law.real)
        sizes = {"slots": 1024, "layers": 0, "rows": 0, "cells": 0, "parts": parts, "ends": parts + 1}
        self.tasks = Tasks(pool, Arena(arrays_of(self.law, staged), **sizes))
        self.bodies = Bodies(self.world, self.tasks.arena, self.motion, d, maps)
        self.cells = Cells(self.tasks, self.grid, d)
        self.sums = PairSums(scene, self.law, self.tasks, self.cells, self.bodies)
        self.integrate = INTEGRATORS[scene.config.simulation.integrator]
        self.choose = TimeStep(scene, self.farthest_reach if staged else np.inf)
        self.numbers = self.tasks.arena["numbers"]
        self.tasks.arena.set(
            mirrors=mirrors,
            external=np.ascontiguousarray(scene.acceleration[self.axes]),
            period=np.where(self.periodic, self.lengths, 0.0),
            wall_shift=np.zeros((len(scene.walls), d)),
            wall_speed=np.zeros((len(scene.walls), d)),
        )
        self.totals = scalars.Totals(self)

    def _maps(self) -> tuple[Maps, Mirrors]:
        """Images of the particles in periodic sides and mirrors, as the walls are now."""
        maps = periodic_maps(self.lengths, self.periodic, self.radius)
        groups = mirrors(self.scene, self.walls, self.axes, self.radius)
        for group in groups:
            maps.combine(group)
        self.faces = sum(len(group.planes) - 1 for group in groups)
        return maps, single_mirrors(groups)

    def _distribute(self) -> None:
        """Every rank makes its share of the particles by number, then they go home."""
        low, high = block_ranges(self.scene.n_fluid, self.world.size)[self.world.rank]
        ids = np.arange(low, high)
        fluid = self.scene.fluid(ids)
        self.bodies.append(
            (fluid["x"][:, self.axes] - self.origin).T, fluid["v"][:, self.axes].T, fluid["drho"], fluid["m"],
            ids, FLUID | REAL | FLOWS,
        )  # fmt: skip
        self.work_items = self.scene.n_fluid
        self._find_box()
        grow_walls(self)
        self.migrate()
        self.balance()

    def resume(self) -> None:
        """Take up a state whose particles have just been appended anywhere."""
        if not np.isfinite(self.bodies.x[:, : self.bodies.end]).all():
            raise Diverged("a position is not a finite number")
        if not 0.0 <= self.reach <= self.farthest_reach * (1 + MARGIN):
            known = f"0 .. {self.farthest_reach:.4g} m"
            raise Diverged(f"neighbours are known for {self.reach:.4g} m of their way, which is not within {known}")
        self._forces_at = -1
        self.migrate()
        self.balance()
        self.sort()

    # ---- walls

    def _find_box(self) -> None:
        """The box around all fluid, in physical axes."""
        bodies = self.bodies
        x = bodies.x[:, bodies.fluid]
        both = np.concatenate([-x, x]).max(axis=1, initial=-np.inf)
        self._set_box(self.world.max_array(both))

    def _set_box(self, reach: NDArray[np.float64]) -> None:
        d = self.scene.dimensions
        low, high = np.empty(d), np.empty(d)
        low[self.axes], high[self.axes] = self.origin - reach[:d], self.origin + reach[d:]
        self.box = low, high

    def _move_walls(self, time: float) -> None:
        """Walls to where they are at `time`."""
        if self.walls.moving:
            a = self.tasks.arena
            shift, speed = self.walls.move(time)
            a["wall_shift"][:], a["wall_speed"][:] = shift[:, self.axes], speed[:, self.axes]
            self.tasks.each(self.motion.carry)

    def wall_forces(self) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """Force [d] and torque [3] of the fluid on each measured wall, now. Collective."""
        return wall_forces(self)

    def current_forces(self) -> None:
        """a of the present state, if it is not known: the next step will not evaluate it again."""
        if self.integrate is symplectic:
            self.evaluate_forces()
        else:
            self.evaluate(start=True)

    def _add_impulses(self) -> None:
        """The integrals over time of |F| and F on the measured walls."""
        if any(wall.measure_force for wall in self.scene.walls):
            forces = self.wall_forces()
            for wall in self.scene.walls:
                if wall.measure_force:
                    force = forces[wall.name][0]
                    parts = [float(np.sqrt(np.sum(force * force))), *force]
                    self.impulses[wall.index, : len(parts)] += np.array(parts) * self.time_step

    # ---- who is where

    def migrate(self) -> None:
        """Particles that left the slab go to their new ranks."""
        if self.world.size > 1:
            self.bodies.migrate(self.iteration, self.slabs.owner[self.cells.layer_of(self.bodies)])

    def balance(self) -> None:
        """Cuts of equal load, if the present ones are far from it."""
        if self.world.size == 1:
            return
        layer = self.cells.layer_of(self.bodies)
        load = self.world.sum_int(np.bincount(layer + 1, minlength=self.grid.layers + 1)[1:])  # 0: nobody
        cuts = balanced_cuts(load, self.world.size)
        prefix = np.concatenate(([0], np.cumsum(load)))
        worst, best = (np.diff(prefix[list(c)]).max() for c in (self.domain.cuts, cuts))
        if worst > 1.03 * best:
            self.domain = self.domain.with_cuts(cuts)
            self.migrate()

    @property
    def slabs(self) -> Slabs:
        """Who owns which layers, found again when the cuts have changed."""
        if self._slabs is None or self._slabs.domain is not self.domain:
            self._slabs = Slabs(self.domain, self.world, self.bodies.maps.around)
        return self._slabs

    def sort(self) -> None:
        """Ghosts and cells for the positions as they are."""
        bodies, cells = self.bodies, self.cells
        with self.timers.section("ghosts"):
            if self.walls.moving and any(bodies.maps.mirrored):
                bodies.maps, mirrors = self._maps()
                self.tasks.arena.set(mirrors=mirrors)
            if self.world.size > 1 or len(bodies.maps.planes) > 1:
                bodies.choose_ghosts(cells.layer_of(bodies), self.grid.layer, self.slabs)
                bodies.refresh(self.iteration)
        with self.timers.section("sort"):
            cells.sort(bodies, self.domain.row_range(self.world.rank))
            cells.find(self.scene.support * (1 + MARGIN) + 2 * self.reach)

    def step(self) -> None:
        """x^n, v^n, rho^n -> n + 1."""
        self.integrate(self)
        with self.timers.section("update"):
            if self.law.shifting:
                self.numbers[1] = self.time_step * np.sqrt(self.largest[0])
                self.tasks.each(self.motion.spread)
            if self.faces:
                self.tasks.each(self.motion.swap)
            self.tasks.each(self.motion.rewrap)
            self.strays.settle()
            self.outflow.leave()
        self.time += self.time_step
        self.iteration += 1
        with self.timers.section("migrate"):
            grow_walls(self)
            self.migrate()
            period = self.scene.config.numerics.balance_period
            if period and self.iteration % period == 0:
                self.balance()
        self.reach = self.next_reach
        self.sort()

    def advance(self, most: int) -> None:
        """One step, of `most` that may be done at once."""
        self.step()

    # ---- what integrators are made of

    def evaluate(self, start: bool = False) -> None:
        """a and d rho / dt of the present x, v, rho; `start`: these are x^n, v^n, rho^n."""
        if not start or self._forces_at != self.iteration:
            with self.timers.section("pairs"):
                self.evaluations += 1
                self.sums.everything(self.iteration)
        self._forces_at = self.iteration if start else -1

    def evaluate_forces(self) -> None:
        """a of the present x, v, rho."""
        if self._forces_at != self.iteration:
            with self.timers.section("pairs"):
                self.evaluations += 1
                self.sums.forces(self.iteration)
            self._forces_at = self.iteration

    def evaluate_rates(self) -> None:
        """d rho / dt of x and rho as in `evaluate_forces`, and the new v."""
        with self.timers.section("pairs"):
            self.sums.rates(self.iteration)

    def choose_step(self) -> None:
        """dt from the largest speed, acceleration and density error of all particles. Collective."""
        with self.timers.section("dt"):
            self.tasks.each(self.motion.largest)
            found = self.tasks.arena["found"]
            worst = np.nan if np.isnan(found).any() else found.max(axis=0)
            worst = self.world.max_array(np.where(np.isnan(worst), np.inf, worst) * np.ones(found.shape[1]))
            self.largest, reach = worst[:3], worst[3:]
            if not np.isfinite(self.largest).all():
                self.runaway.no_number()
            self._set_box(reach)
            speed, acceleration, density = self.largest
            self.time_step = self.choose(float(np.sqrt(speed)), float(np.sqrt(acceleration)), float(density))
            self.strays.find(float(density))
            self.runaway.see(float(np.sqrt(speed)), float(np.sqrt(acceleration)), float(density))
            self._add_impulses()
        if self.farthest_reach:
            self._widen(*np.sqrt(worst[:2]))

    def _widen(self, speed: float, acceleration: float) -> None:
        """Neighbours as far as this step takes them from each other, and about as far as the next one may."""
        dt = self.time_step
        way = dt * max(speed, 0.5 * speed + 0.25 * dt * acceleration)  # of the stages where rates are evaluated
        if way > self.farthest_reach * (1 + MARGIN):
            raise Diverged("a particle moves farther in a step than where its neighbours are known")
        expected = min(SPARE * way + LEAST * self.scene.h, self.farthest_reach)
        if not way <= self.reach:
            self.reach = expected
            self.sort()  # which has lost the sums
            self._forces_at = -1
            self.evaluate(start=True)
        self.next_reach = expected

    def _each(self, kernel: Any, *numbers: float, **more: int) -> None:
        with self.timers.section("update"):
            self.numbers[: 1 + len(numbers)] = self.time_step, *numbers
            self.tasks.each(kernel, **more)

    def keep(self) -> None:
        """Remember x^n, v^n, rho^n."""
        self._each(self.motion.keep)

    def combine(
        self, old: float, now: float, new: float, *, until: float = 1.0, with_new_velocity: bool = False
    ) -> None:
        """y = old y^n + now y + new dt f(y); the stage stands for t^n + until dt."""
        self._each(self.motion.advance, old, now, new, float(with_new_velocity), at=self.sums.rate)
        self._move_walls(self.time + until * self.time_step)

    def kick(self) -> None:
        """v = v + dt a."""
        self._each(self.motion.kick)

    def drift(self) -> None:
        """x = x + dt v, rho = rho + dt D."""
        self._each(self.motion.drift, at=self.sums.rate)
        self._move_walls(self.time + self.time_step)

    # ---- what others see

    def scalars(self) -> dict[str, float]:
        """Energies, mass, momentum, extremes, forces, gauges (see sph.diagnostics). Collective."""
        with self.timers.section("scalars"):
            return scalars.scalars(self) | self.gauges.values(self.time)

    def fields(self) -> Mapping[str, FieldArray]:
        """None: there is no mesh."""
        return {}

    def particles(self) -> Mapping[str, ParticleArray]:
        """Fluids and walls by name."""
        return snapshot.particles(self)

    def state(self) -> Mapping[str, Shard]:
        """Fluid and walls in order of their ids, bit for bit. Collective."""
        return checkpoint.state(self)

    def columns(self, reader: Reader) -> Mapping[str, Column]:
        """What the arrays of a checkpoint of this scene are."""
        return checkpoint.columns(self, reader)

    def restore(self, reader: Reader) -> None:
        """Take the state of a checkpoint, written by any number of ranks, for the present one. Collective."""
        checkpoint.restore(self, reader)

    def guard(self) -> str | None:
        """Why this rank's state is no solution, or None. Collective where no series has looked at the energy lately."""
        return self.runaway.trouble()

    def worst(self) -> list[str]:
        """Lines on the worst particles of this rank. Collective."""
        return snapshot.worst(self)

    def close(self) -> None:
        """Free what MPI holds (all ranks together)."""
        self.bodies.free()

    @property
    def local_items(self) -> int:
        """Particles of this rank."""
        return self.bodies.n

    def physical(self, name: str, rows: NDArray[np.int64] | None = None) -> NDArray[np.float64]:
        """Column x (absolute) or v of bodies, the own ones if not told which, [n, d] in physical order of axes."""
        rows = self.bodies.rows if rows is None else rows
        values = np.empty((len(rows), self.scene.dimensions))
        values[:, self.axes] = self.bodies.arena[name][:, rows].T
        if name == "x":
            values += self.scene.low
        return values
