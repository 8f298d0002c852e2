"""One step of fluid and grains (Mansouri et al. 2011, section 4)."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.world import World
from hpcpic.core.errors import ConfigError
from hpcpic.core.files.arrays import Column, FieldArray, ParticleArray, Rows, Shard
from hpcpic.core.files.sealed import Reader
from hpcpic.core.run.balance import PERIOD, Balance
from hpcpic.core.space.domain import Domain
from hpcpic.core.tasks.graph import Pool
from hpcpic.core.timers import Timers
from lbmdem.case.config import FluidSection, LbmDemConfig
from lbmdem.coupling.contact_pressure import ContactPressure
from lbmdem.coupling.driven_grains import DrivenGrains
from lbmdem.coupling.immersed import Immersed
from lbmdem.diagnostics import guard, snapshot
from lbmdem.diagnostics.sample import sample_ends
from lbmdem.diagnostics.scalars import ENOUGH_OVERLAP, Diagnostics
from lbmdem.fluid.drive import Drive
from lbmdem.fluid.faces import Face
from lbmdem.fluid.fluid import Fluid
from lbmdem.fluid.obstacles import obstacle_walls
from lbmdem.forecast.contacts import foretold_overlap
from lbmdem.forecast.cuts import Grains, first_cuts, laying_out, row_costs, sums_by_row
from lbmdem.forecast.estimate import output_periods
from lbmdem.forecast.pressures import pressures
from lbmdem.grains.dem import Dem
from lbmdem.grains.placement import place_grains
from lbmdem.kernels.layout import FLUID
from lbmdem.physics.velocity_sets import LATTICES
from lbmdem.physics.wall_rules import RULES
from lbmdem.setup.overlap_survey import starts
from lbmdem.setup.scene import Scene
from lbmdem.sizes import STEPS_PER_CALL

SUM_UNIT = 1024.0  # sums of rows are integers, so that all ranks have the same
MAX_OVERLAP = 0.1  # over diameter, at which grains are no grains any more, unless they start so


class LbmDem:
    """Populations and grains at `iteration`; `time` in s. A case without fluid has no populations."""

    particle_name = "grain"
    local_items = None  # slabs are of equal cost, not of equal height

    def __init__(self, config: LbmDemConfig, world: World, pool: Pool, timers: Timers) -> None:
        self.scene = scene = Scene(config)
        self.world, self.pool, self.timers = world, pool, timers
        self.n_steps, self.end_time, self.periods = config.n_steps, config.end_time, output_periods(config)
        self.time_periods: Mapping[str, float] = {}
        self.iteration = 0
        self.max_overlap = max(MAX_OVERLAP, 1.1 * starts(config)[1])
        self.balance = Balance(world, self, self._take)
        before = self._slabs(first_cuts(config, world.size))
        self.table = table = place_grains(config, world, pool, before)
        self.work_items = math.prod(scene.points) if config.fluid else len(table)
        self.work_unit = "node" if config.fluid else "particle"
        placed = Grains(table.x[:, -1], table.radius / config.spacing)
        self._make(first_cuts(config, world.size, placed))

    def _slabs(self, cuts: Sequence[int]) -> Domain:
        points, periodic = self.scene.points[::-1], self.scene.periodic[::-1]
        return Domain(tuple(self.scene.config.domain.size[::-1]), points, periodic, tuple(cuts), offset=0.5)

    def lay_out(self, cuts: Sequence[int]) -> None:
        """Make all anew for slabs with these cuts, without a state; what was seen so far stays known. Collective."""
        diagnostics, bits = self.diagnostics, self.grain_bits
        self._make(cuts)
        self.diagnostics.go_on(diagnostics)
        if self.grain_bits and bits:
            self.grain_bits.trouble = bits.trouble

    def _make(self, cuts: Sequence[int]) -> None:
        """The fluid, its solids and the grains as at the start, for slabs with these cuts. Collective."""
        scene, world, pool, table, config = self.scene, self.world, self.pool, self.table, self.scene.config
        self.domain = domain = self._slabs(cuts)
        self.fluid = self._fluid(config.fluid) if config.fluid else None
        grains_move, frozen = bool((~table.fixed).any()), config.coupling.frozen
        if self.fluid:
            self._fill(self.fluid, stays=not grains_move or frozen)
        self.drive = Drive(scene, self.fluid) if self.fluid else None
        solid = len(table) or config.obstacle
        self.immersed = self._immersed(self.fluid) if self.fluid and solid else None
        self.solids_move = grains_move and self.immersed is not None and not frozen
        at_rest = grains_move and self.immersed is not None and frozen
        if self.immersed and self.solids_move:
            self.immersed.link_anew()
        pressure = ContactPressure(self.fluid, world, table.radius) if self.fluid and at_rest else None
        solids = self.immersed, pressure
        self.grains = DrivenGrains(scene, world, pool, domain, table, *solids) if grains_move else None
        self.dem = self.grains.dem if self.grains else None
        self.grain_bits = guard.GrainBits(self.dem) if self.dem and self.fluid else None
        self.start_solid()
        self._check_fluid()
        heights = self.coordinates()[-1].ravel()
        parts = self.fluid, self.drive, self.immersed, self.grains
        self.diagnostics = Diagnostics(scene, world, domain, table, heights, *parts)
        if self.dem:
            self.diagnostics.expected_overlap = max(ENOUGH_OVERLAP, foretold_overlap(config))
        self.scalar_units = self.diagnostics.units
        own = any(grains.acceleration for grains in config.grains)
        self.driven = own or (self.drive is not None and self.drive.changes)

    def _fluid(self, fluid: FluidSection) -> Fluid:
        """The fluid, at rest."""
        scene, config = self.scene, self.scene.config
        forced = any(fluid.body_force) or config.shaking is not None
        made = Fluid(
            self.world, self.pool, self.domain, LATTICES[scene.lattice],
            tau=scene.tau,
            collision=fluid.collision,
            magic=fluid.magic,
            force=scene.body_force(0) if forced else None,
            storage=fluid.storage,
            blocks=config.simulation.blocks,
            faces={name: Face(face.kind, face.density, face.velocity) for name, face in scene.faces.items()},
        )  # fmt: skip
        for name, face in scene.faces.items():
            if face.profile != "uniform":
                made.set_face(name, velocity=scene.inflow(name, self.coordinates()))
        return made

    def _fill(self, fluid: Fluid, stays: bool) -> None:
        """The flow at the start. stays: no solid in it ever moves."""
        config, table = self.scene.config, self.table
        near = RULES[config.coupling.bounce_back].reach < 2
        fluid.stays = stays and near and not config.coupling.keeps_mass
        sample = sample_ends(table.x, table.radius, config.domain.size[-1]) if len(table) else None
        axes = self.coordinates()
        fluid.set_equilibrium(self.scene.initial_density(axes, sample), self.scene.initial_velocity(axes))

    def coordinates(self) -> tuple[NDArray, ...]:
        """x, y(, z) of this rank's nodes in m, which broadcast to the slab in storage order."""
        d, dx = self.scene.dimensions, self.scene.config.spacing
        low, high = self.domain.row_range(self.world.rank)
        ranges = [np.arange(low, high), *(np.arange(n) for n in self.domain.points[1:])]
        along = [((r + 0.5) * dx).reshape([-1 if k == axis else 1 for k in range(d)]) for axis, r in enumerate(ranges)]
        return tuple(along[::-1])

    def _immersed(self, fluid: Fluid) -> Immersed:
        """The solids of the fluid: obstacles, and grains, of which those that stay are linked once."""
        coupling, table, units = self.scene.config.coupling, self.table, self.scene.units
        assert coupling.refill is not None  # as in every completed case
        ids = np.flatnonzero(table.fixed | coupling.frozen)
        return Immersed(
            fluid, self.world, self.pool,
            rule=coupling.bounce_back,
            refill=coupling.refill,
            fixed=(ids, self.nodes(table.x[ids]), table.radius[ids] / units.dx,
                   table.v[ids] / units.velocity, table.omega[ids] * units.dt),
            walls=obstacle_walls(self.scene),
        )  # fmt: skip

    def nodes(self, x: NDArray) -> NDArray[np.float64]:
        """Places [n, d] in m as coordinates in which node i is at i."""
        return x / self.scene.units.dx - 0.5

    def step(self) -> None:
        """Advance by one time step, from n to n + 1. Cuts follow before it: of the last step more is asked than a
        checkpoint holds.
        """
        self._follow()
        if self.fluid and self.drive:
            with self.timers.section("fluid"):
                self.drive.apply(self.iteration)  # body force and pressures that change
                self.fluid.step()  # collide [4], bounce back [6] and momentum exchange [7], stream, faces (Zou & He)
        if self.grains:
            with self.timers.section("grains"):
                if self.grain_bits:
                    self.grain_bits.compare(self.iteration)
                self.grains.move(self.iteration)  # n_d steps of the contacts [1], [2] under the forces of the fluid
            with self.timers.section("solid"):
                self.mark_solid()  # nodes that grains have covered and left (3.3)
            if self.grain_bits:
                self.grain_bits.keep()
        self.iteration += 1

    def advance(self, most: int) -> None:
        """Some steps, `most` at most: what the fluid does in one pass over memory when nothing moves in it, or what
        grains without a fluid do in one call.
        """
        if self.driven or (self.fluid and self.grains):
            self.step()
        elif self.fluid:
            with self.timers.section("fluid"):
                n = self.fluid.leap(most)
            self.iteration += n
        elif self.grains:
            self._follow()
            with self.timers.section("grains"):
                n = min(most, STEPS_PER_CALL, PERIOD - self.iteration % PERIOD)
                self.grains.move(self.iteration, n)
            self.iteration += n

    def start_solid(self) -> None:
        """The fluid sees the grains for the first time, or where a checkpoint has them."""
        if self.immersed and self.dem and self.solids_move:
            self.immersed.start(*self._moving_grains(self.dem), frame=self.scene.frame(self.iteration))

    def mark_solid(self) -> None:
        """The fluid sees the grains where they are now."""
        if self.immersed and self.dem and self.solids_move:
            self.immersed.move(*self._moving_grains(self.dem), frame=self.scene.frame(self.iteration + 1))

    def _moving_grains(self, dem: Dem) -> tuple[NDArray, NDArray, NDArray, NDArray, NDArray]:
        """Numbers, places, radii, velocities and angular velocities of own grains and ghosts, in lattice units."""
        grains, units = dem.grains, self.scene.units
        moving = ~grains.fixed
        return (
            grains.ids[moving],
            self.nodes(grains.x[moving]),
            grains.radius[moving] / units.dx,
            grains.v[moving] / units.velocity,
            grains.omega[moving] * units.dt,
        )

    def _check_fluid(self) -> None:
        """ConfigError where solids fill the box. Collective."""
        if self.fluid and not self.world.any(bool((self.fluid.solid.inner == FLUID).any())):
            raise ConfigError("no node of the lattice is in the fluid: grains and obstacles fill the whole box")

    @property
    def time_step(self) -> float:
        return self.scene.time_step

    @property
    def time(self) -> float:
        return self.iteration * self.time_step

    def scalars(self) -> dict[str, float]:
        """See lbmdem.diagnostics. Collective."""
        with self.timers.section("scalars"):
            return self.diagnostics.scalars(self.iteration)

    def fields(self) -> Mapping[str, FieldArray]:
        """Velocity, pressure and solid nodes. Collective."""
        return snapshot.fields(self.scene, self.fluid) if self.fluid else {}

    def particles(self) -> Mapping[str, ParticleArray]:
        """Grains by set. Collective."""
        return snapshot.grains(self.scene, self.world, self.table, self.dem, self.immersed)

    def state(self) -> Mapping[str, Shard]:
        """Populations by rows, grains by number, bit for bit. Collective."""
        return snapshot.state(self.world, len(self.table), self.fluid, self.dem, self.immersed)

    def columns(self, reader: Reader) -> Mapping[str, Column]:
        """Types and limits of the arrays of a checkpoint of this scene."""
        return snapshot.columns(reader, len(self.table), self.fluid, self.dem, self.immersed, guard.MAX_DENSITY)

    def restore(self, reader: Reader) -> None:
        """Take the state of a checkpoint, written by any number of ranks. Collective."""
        self._take(reader)
        self.balance.look()

    def _take(self, reader: Rows) -> None:
        """Take a state on the present cuts. Collective."""
        self.iteration = reader.step
        if self.dem:
            self.dem.restore(reader)
            self.start_solid()
        if self.grain_bits:
            self.grain_bits.keep()
        if self.fluid and self.drive:
            snapshot.restore_fluid(reader, self.world, self.fluid)
            self.drive.restore(self.iteration)
        if self.immersed:
            self.immersed.restore(reader.read("pending"))

    def _follow(self) -> None:
        if self.iteration:
            self.balance.follow()

    def row_costs(self) -> NDArray[np.float64] | None:
        """Time of a step by row, ns; None where nothing moves that the fluid sees. Collective."""
        config, dem = self.scene.config, self.dem
        if not dem or (self.fluid and not self.solids_move) or self.world.size > self.domain.points[0]:
            return None
        own = slice(dem.grains.n)
        placed = Grains(dem.grains.x[own, -1], dem.grains.radius[own] / config.spacing)
        sums = self.world.sum_int(np.rint(SUM_UNIT * sums_by_row(config, placed)).astype(np.int64))
        return row_costs(config, sums / SUM_UNIT)

    def laying_out(self) -> float:
        """Time that new cuts take, ns."""
        return laying_out(self.scene.config, self.world.size)

    def guard(self) -> str | None:
        """Why this rank's state is no solution, or None."""
        found = guard.fault(self.diagnostics, self.fluid, self.dem, self.max_overlap)
        if found and found.endswith(guard.CURE):
            found += "".join(f"; {number}" for number in pressures(self.scene.config) if number.verdict != "ok")
        return found or (self.grain_bits.trouble if self.grain_bits else None)

    def worst(self) -> list[str]:
        """Lines on the worst grains and nodes of this rank. Collective."""
        return snapshot.worst(self.world, self.dem, self.fluid)

    def close(self) -> None:
        """Release what MPI holds. Collective."""
        if self.immersed:
            self.immersed.free()
        if self.fluid:
            self.fluid.free()
