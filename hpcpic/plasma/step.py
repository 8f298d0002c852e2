"""The simulation flow of the thesis (9.2): allocation, rewind, loop."""

import math
from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.case import accelerations
from hpcpic.core.comm.world import World
from hpcpic.core.errors import Diverged
from hpcpic.core.files.arrays import Column, Counts, FieldArray, ParticleArray, Rows, Shard
from hpcpic.core.files.sealed import Reader
from hpcpic.core.run.balance import Balance
from hpcpic.core.run.gauges import Gauges
from hpcpic.core.run.worst import worst_particles
from hpcpic.core.space.domain import MAX_IMBALANCE, Domain, block_ranges
from hpcpic.core.tasks.graph import Pool, TaskError
from hpcpic.core.timers import Timers
from hpcpic.plasma.case.config import PlasmaConfig
from hpcpic.plasma.diagnostics import scalars, snapshot
from hpcpic.plasma.diagnostics.energy_watch import STEPS_BETWEEN_LOOKS, EnergyWatch
from hpcpic.plasma.diagnostics.field_modes import FieldModes
from hpcpic.plasma.diagnostics.histograms import Histograms
from hpcpic.plasma.diagnostics.kept_motion import KeptMotion, Motion
from hpcpic.plasma.diagnostics.node_moments import NodeMoments
from hpcpic.plasma.diagnostics.series_sums import SeriesSums
from hpcpic.plasma.field.mesh import SHIFT, Mesh
from hpcpic.plasma.forecast.cuts import first_cuts, laying_out, row_costs
from hpcpic.plasma.forecast.scales import total_plasma_frequency
from hpcpic.plasma.particles.cloud import CHUNK, Cloud
from hpcpic.plasma.particles.driven import NOT_FINITE, driven_kernel
from hpcpic.plasma.particles.push_spec import PushSpec, groups_of_charge
from hpcpic.plasma.physics.species_fields import asked_for
from hpcpic.plasma.setup.scene import Scene
from hpcpic.plasma.sizes import WHOLE_BITS

COLDEST = 0.1  # lambda_D/dx to which the grid heats any colder plasma: that is no growth without end yet


class Plasma:
    """The state x^n, v^(n-1/2), rho^n of a run, and the step to n + 1.

    `iteration` n, -2 while particles are distributed and -1 while velocities are rewound; `time` n dt in s.
    """

    work_unit = particle_name = "particle"

    def __init__(self, config: PlasmaConfig, world: World, pool: Pool, timers: Timers) -> None:
        self.scene = scene = Scene(config)
        self.world, self.pool, self.timers = world, pool, timers
        self.n_steps, self.end_time, self.work_items = config.n_steps, config.end_time, scene.n_particles
        self.periods: Mapping[str, int] = config.periods
        self.time_periods: Mapping[str, float] = {}
        self.spec = PushSpec.of(scene, scalars.moments())
        self.field_scale = self._field_scale()
        self._drivers = self._compiled_drivers()
        self._own = {steps: np.array([one.own_impulse(steps) for one in scene.species]) for steps in (-0.5, 1.0)}
        self.balance = Balance(world, self, self._take)
        self.lay_out(first_cuts(config, world.size))
        self.scalar_units = scalars.units(config)
        self._distribute()
        self._rewind()
        self.iteration = 0
        self._energy = self._watch()
        real = np.dtype(self.spec.dtype)
        self.kept_motion = KeptMotion(scene, 2.0 ** WHOLE_BITS[real.itemsize], real)

    def _compiled_drivers(self) -> list[Callable]:
        """Kernels of accelerations of the user's own, of each species that has one."""
        scene = self.scene
        named = [(k, species.section.acceleration) for k, species in enumerate(scene.species)]
        sides = tuple(float(side) for side in scene.velocity_spacing)
        kernels, d = self.spec.kernels(), scene.dimensions
        return [driven_kernel(accelerations.compiled(name), kernels, k, d, sides) for k, name in named if name]

    def lay_out(self, cuts: Sequence[int]) -> None:
        """Make what holds particles and fields, and what looks at them, for slabs with these cuts. Collective."""
        scene, world, pool, config = self.scene, self.world, self.pool, self.scene.config
        points, lengths = scene.points[::-1], tuple(scene.lengths[::-1])
        self.domain = domain = Domain(lengths, tuple(points), (True,) * scene.dimensions, tuple(cuts))
        charge, weight = groups_of_charge(scene, self.spec)
        self.mesh = Mesh(world, pool, domain, scene, self.spec.shape.ghosts, weight)
        self._parts = np.zeros(len(weight), np.int64)  # of each group in all, as Mesh.check wants them
        for species, (group, parts) in zip(scene.species, charge):
            self._parts[group] += species.n * (parts >> SHIFT)
        self.cloud = Cloud(
            world, pool, domain, self.spec,
            blocks=config.simulation.plasma_chunks or pool.threads,
            mover=scene.mover(self.field_scale),
            charge=charge,
            e=self.mesh.e,
            scale=self.field_scale,
            capacity=scene.n_particles // world.size,
        )  # fmt: skip
        self.mesh.collect_from(self.cloud.patches, self.cloud.delivery)
        self.sums = SeriesSums(scene, world, self.mesh, self.cloud, self.field_scale)
        self._modes = FieldModes(scene, domain, world) if config.output.modes else None
        self._gauges = Gauges(config.gauge, domain, world)
        asked = asked_for(config)
        self._node_moments = NodeMoments(scene, world, domain, self.cloud, asked) if asked else None
        self._histograms = Histograms(scene, world, self.cloud) if self.periods["histogram"] else None
        self._drives = [task for driver in self._drivers for task in self.cloud.bind_driven(driver)]

    def _field_scale(self) -> float:
        """A power of two that turns E into about a cell per step^2 for the lightest species."""
        kicks = [float(np.abs(species.half_kick[0])) for species in self.scene.species if species.q]
        return 2.0 ** round(math.log2(max(kicks))) if kicks else 1.0

    def _distribute(self) -> None:
        """Allocation phase (9.2.1): every rank makes its share of the particles by number, then they go home."""
        self.iteration = -2
        cells = np.array(self.scene.spacing)
        steps = self.scene.time_step / self.scene.velocity_spacing
        with self.world.first_on_node():  # compiles the random numbers
            for species in self.scene.species:
                species.positions(np.zeros(0, np.int64))
                species.velocities(np.zeros(0, np.int64))
        for k, species in enumerate(self.scene.species):
            low, high = block_ranges(species.n, self.world.size)[self.world.rank]
            for first in range(0, -(-species.n // self.world.size), CHUNK):  # as often on every rank
                numbers = np.arange(low + first, min(low + first + CHUNK, high))
                ids = numbers + species.first
                self.cloud.place(k, species.positions(ids) / cells, species.velocities(ids) * steps, numbers)
                self.cloud.migrate(self.iteration)
                self.cloud.deliver()
        self.cloud.deposit_all()
        self._deposit_checked()

    def _deposit_checked(self) -> None:
        """rho of particles that have just been placed."""
        self.mesh.deposit(self.iteration)
        self.mesh.check(self._parts)
        self._solved = False

    def _rewind(self) -> None:
        """Rewind phase (9.2.1): v^0 -> v^(-1/2) with the field of x^0."""
        self.iteration = -1
        self.solve()
        self._drive(0.0, -0.5)
        self.cloud.rewind(self.scene.mover(self.field_scale, steps=-0.5))

    def _drive(self, time: float, steps: float) -> None:
        """The impulse of accelerations of the user's own for so many steps, before the mover turns it."""
        if self._drives:
            self.cloud.arena["moment"][:] = time, self.time_step, steps
            self.cloud.arena["own"][:] = self._own[steps]
            try:
                self.cloud.each(self._drives)
            except TaskError as error:
                if error.code < NOT_FINITE:
                    raise
                species = self.scene.species[error.code - NOT_FINITE].section
                told = f"the acceleration {species.acceleration!r} of {species.name} is not a finite number"
                raise Diverged(f"{told} at t = {time:.6g} s") from error

    def solve(self) -> None:
        """E^n from rho^n (5.10), (5.13), unless it is known."""
        if not self._solved:
            with self.timers.section("field"):
                self.mesh.solve(self.iteration)
            self._solved = True

    def step(self) -> None:
        """x^n, v^(n-1/2), rho^n -> n + 1 (9.2.2)."""
        if not self.work_items:  # nothing changes without particles
            self.iteration += 1
            return
        self.solve()  # E^n from rho^n
        with self.timers.section("push"):
            self._drive(self.time, 1.0)
            # E at the particles (5.14), v (5.19) by Boris (5.4.1), x (5.18), charge of who stays
            self.cloud.push(self.iteration)
        with self.timers.section("deposit"):
            self.mesh.deliver_and_deposit(self.iteration)  # who left for another tile; rho^(n+1) (5.1)
        self._solved = False
        self.iteration += 1
        self.balance.follow()

    def advance(self, most: int) -> None:
        """One step, of `most` that may be done at once."""
        self.step()

    @property
    def time_step(self) -> float:
        return self.scene.time_step

    @property
    def time(self) -> float:
        return self.iteration * self.time_step

    @property
    def local_items(self) -> int:
        """Particles of this rank."""
        return self.cloud.n

    def scalars(self) -> dict[str, float]:
        """Energies, momentum, charge and field modes, all at t = n dt (see diagnostics.scalars). Collective."""
        self.solve()
        with self.timers.section("scalars"):
            values = self.sums.scalars()
            if self._modes:
                values |= self._modes.values(snapshot.fields(self.mesh, {"E"})["E"].values)
            if self._gauges:
                values |= self._gauges.values(self._fields({gauge.what for gauge in self.scene.config.gauge}))
        self._energy.see(values["energy_total"], self.time, self.iteration)
        motion = Motion(self.iteration, self.sums.places, self.sums.momentum_before_turn)
        self.kept_motion.see(motion, values["energy_kinetic"] + abs(values["energy_field"]))
        return values

    def fields(self) -> Mapping[str, FieldArray]:
        """What the case asks for of rho, phi, E and the fields of the species, at t = n dt. Collective."""
        self.solve()
        return self._fields(self.scene.config.output.fields)

    def _fields(self, names: Collection[str]) -> dict[str, FieldArray]:
        found = snapshot.fields(self.mesh, names)
        return found | self._node_moments.arrays_of(self.iteration, names) if self._node_moments else found

    def histograms(self) -> Mapping[str, Counts]:
        """The histograms of the case at t = n dt, by name. Collective."""
        self.solve()
        with self.timers.section("histograms"):
            return self._histograms.counted() if self._histograms else {}

    def particles(self) -> Mapping[str, ParticleArray]:
        """x^n and v^(n-1/2) by species. Collective."""
        self.solve()
        return snapshot.particles(self.scene, self.cloud)

    def state(self) -> Mapping[str, Shard]:
        """The particles in order of their numbers, bit for bit: x^n relative to tiles, v^(n-1/2). Collective."""
        return snapshot.state(self.scene, self.world, self.cloud)

    def columns(self, reader: Reader) -> Mapping[str, Column]:
        """What the arrays of a checkpoint of this scene are."""
        return snapshot.columns(self.scene, self.cloud.spec)

    def restore(self, reader: Reader) -> None:
        """Take the state of a checkpoint, written by any number of ranks, for the present one. Collective."""
        self._take(reader)
        self.balance.look()

    def _take(self, state: Rows) -> None:
        """Take a state on the present cuts. Collective."""
        self.iteration, self.kept_motion.kept = state.step, None
        snapshot.restore(self.scene, self.world, self.cloud, state)
        self._deposit_checked()

    def row_costs(self) -> NDArray[np.float64] | None:
        """Time of a step by row, ns; None if no rank has much more to do than the mean. Collective."""
        config, low_high, n = self.scene.config, self.domain.row_range(self.world.rank), self.cloud.n
        rows, all_rows = int(np.diff(low_high)[0]), self.domain.points[0]
        mine = row_costs(config, np.full(rows, n / max(rows, 1))).sum()
        mean = row_costs(config, np.full(all_rows, self.work_items / all_rows)).sum() / self.world.size
        if self.world.max(float(mine)) <= MAX_IMBALANCE * mean:
            return None
        return row_costs(config, self.world.sum_int(snapshot.particles_by_row(self.scene, self.cloud)))

    def laying_out(self) -> float:
        """Time that new cuts take, ns."""
        return laying_out(self.scene.config, self.world.size)

    def guard(self) -> str | None:
        """Why this rank's state is no solution, or None. Collective where the energy was not seen for long."""
        fed = bool(any(self.scene.config.field.electric) or self._drives)  # energy comes in
        if not fed and self.iteration - self._energy.step >= STEPS_BETWEEN_LOOKS:
            self.scalars()
        return self.mesh.trouble() or (None if fed else self._energy.trouble()) or self.kept_motion.trouble

    def worst(self) -> list[str]:
        """Lines on the worst particles of this rank. Collective."""
        return worst_particles(snapshot.particles(self.scene, self.cloud))

    def _watch(self) -> EnergyWatch:
        wp, species = total_plasma_frequency(self.scene.config), self.scene.species
        v = COLDEST * wp * max(self.scene.spacing)
        cold = 0.5 * self.scene.dimensions * v * v * sum(s.n * s.m for s in species)
        return EnergyWatch(cold, wp, self.scene.n_particles)

    def close(self) -> None:
        """Free what MPI holds (all ranks together)."""
        if self._node_moments:
            self._node_moments.free()
        self.mesh.free()
        self.cloud.free()
