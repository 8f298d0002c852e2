"""Solids immersed in a fluid: which nodes they cover, the links to them, and what the fluid does to them.

Two kinds: what stays (walls of any form, grains that do not move) is linked once; grains that move are placed anew
before every step. Lattice units; node i of an axis is at the coordinate i. Forces are summed in integers, so that their
bits do not depend on ranks, threads and blocks.
"""

import math
from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.world import World
from hpcpic.core.tasks.graph import Pool
from lbmdem.coupling.arrays import MOVING_LINKS
from lbmdem.coupling.moving_links import MovingLinks, set_up_links
from lbmdem.coupling.refill import Refill
from lbmdem.coupling.wall_links import WallLinks
from lbmdem.fluid.fixed_links import Directions, FixedLinks
from lbmdem.fluid.fluid import Fluid
from lbmdem.fluid.solid_nodes import Change, Solid, Window, kernel_axes, kernel_rotation
from lbmdem.fluid.surfaces import Bodies, Surfaces, Wall, mark_walls
from lbmdem.kernels import links as kernels
from lbmdem.kernels.grain_rasters import Table
from lbmdem.kernels.layout import FLUID, Layout
from lbmdem.sizes import GAINS, parts_of

SUM_BITS, TERM_BITS = 61, 49  # of the sums, and of terms: 2^51 is the largest integer that `to_fixed` makes
NO_GAINS = np.zeros((0, GAINS), np.int64)
STILL = np.zeros(3)
GrainColumns = tuple[NDArray, NDArray, NDArray, NDArray, NDArray]


class Gains(NamedTuple):
    """Force, torque and mass (of the fluid) that grains gain in a step, and walls when these are among the bodies, in
    units of 1 / scale."""

    ids: NDArray[np.int64]
    sums: NDArray[np.int64]
    walls: NDArray[np.int64] = NO_GAINS


class FixedGains:
    """Gains of a step from fixed links, summed when first read, which must be before the step after the next one."""

    def __init__(self, links: FixedLinks, pool: Pool, parity: int, scale: NDArray[np.float64]) -> None:
        self.ids = links.bodies.ids
        self._links, self._pool, self._parity, self._scale = links, pool, parity, scale

    @cached_property
    def _of_all(self) -> NDArray[np.int64]:
        return self._links.gains(self._pool, self._parity, self._scale)

    @property
    def sums(self) -> NDArray[np.int64]:
        return self._of_all[: len(self.ids)]

    @property
    def walls(self) -> NDArray[np.int64]:
        return self._of_all[len(self.ids) :]


class Immersed:
    """Walls and grains in a fluid. Per step: fluid.step(), `forces`, and `move` if grains move.

    fixed: ids (ascending), centres[n, d], radii[n], velocities[n, d] and angular velocities[n, 1 or 3] of the surfaces
    of the grains that stay, the same on all ranks. refill: see `lbmdem.coupling.refill`.
    """

    def __init__(
        self,
        fluid: Fluid,
        world: World,
        pool: Pool,
        *,
        rule: str = "cli",
        refill: str = "local",
        fixed: GrainColumns | None = None,
        walls: Sequence[Wall] = (),
    ) -> None:
        self.fluid, self._world, self._pool = fluid, world, pool
        self._rule, self._dimensions = rule, fluid.lattice.dimensions
        self._blocks = parts_of(pool.threads)
        self.window = Window.of(fluid.domain, world.rank, ((1, 1),) * fluid.domain.ndim)
        mark_walls(self.window, fluid.ids, walls, self._dimensions)
        planes = fluid.layout.planes
        sizes = {"shares": planes, "cuts": planes + 1, "parts": 8}
        self._solid = Solid(self.window, fluid.ids, pool, MOVING_LINKS, **sizes)
        self.refill = Refill(self.window, fluid, world, refill)
        self._walls = tuple(walls)
        self._fixed = sorted_table(*fixed) if fixed else sorted_table(*_no_grains(self._dimensions))
        self._solid.rebuild(self._fixed)
        fluid.solid_changed(fill=False)
        self._fixed_links = self._link(Bodies(*self._fixed, self._walls))
        self._set_scale(self._fixed.radii, self._fixed_links)
        self.links: MovingLinks | None = None  # to grains, from when they move
        self._table = self._fixed  # of the grains that are linked anew
        self._gains: list[Gains | FixedGains] = []  # of the last step
        self._earlier: list[Gains | FixedGains] = []  # of the one before
        self._gained = 0  # the step that ended with these: passes of several steps count none
        self._pending = Gains(self._fixed.ids[:0], NO_GAINS)
        self._owed = 0  # mass that the fluid has gained since some was put back, but for what is pending
        fluid.hooks.append(self._bounce)
        if not self._fixed_links.reads_further and not self.refill.keeps_mass:
            fluid.carry(self._fixed_links.of_planes, self._fixed_links, self._take)  # until grains move

    def _link(self, bodies: Bodies) -> FixedLinks:
        """Find the links to bodies that stay, and bind their tasks."""
        fluid = self.fluid
        links = FixedLinks(self.window, fluid.layout, fluid.f, fluid.ids, bodies, self._rule, self._blocks)
        if self.refill.counts_momentum:
            links.arena["speed"][...] = 0.0  # what they sweep over is not counted
        return links

    def _set_scale(self, radii: NDArray[np.float64], stay: FixedLinks | WallLinks) -> None:
        """Units of the sums, powers of two: no sum of terms below 2 over all links of a body overflows. Collective."""
        radius = self._world.max(float(radii.max(initial=1.0)))
        arm = max(radius + 2.0, self._world.max(float(np.abs(stay.arm).max(initial=0.0))))
        linked = int(self._world.sum_int(np.array([stay.count], np.int64))[0])
        links = max(8.0 * (2.0 * radius + 2.0) ** 2, float(linked))
        bits = [SUM_BITS - math.ceil(math.log2(4.0 * links * length)) for length in (1.0, arm)]
        force, torque = (2.0 ** min(b, TERM_BITS) for b in bits)
        self._scale = np.array([force] * 3 + [torque] * 3 + [force])

    def start(self, *moving: NDArray, frame: NDArray = STILL) -> None:
        """Place the moving grains near this slab (all that touch it), in any order; populations stay. Collective.

        moving: as `GrainColumns`; frame[d]: acceleration of a shaken frame. From then on all grains are linked at every
        step, those that stay too: others may come near them.
        """
        self._take_grains(moving, frame)
        links = self.links or self.link_anew()
        self.refill.bind(self._solid.arena)  # after all that the first step needs
        self._set_scale(self._table.radii, self._wall_links)
        self._solid.arena["scale"][:] = self._scale
        self._solid.rebuild(self._table)
        self.fluid.solid_changed(fill=False)
        links.place()

    def link_anew(self) -> MovingLinks:
        """From now on look for all links at every step; `start` must follow. Collective.

        All that a step does is bound here, so that it is compiled while grains are set up.
        """
        del self._fixed_links
        self.fluid.carry(None)
        window, layout, ids = self.window, self.fluid.layout, self.fluid.ids
        assert isinstance(layout, Layout)  # nodes of a fluid in which grains move are all held
        open_mass = 0.0 if self.refill.counts_momentum else 1.0
        arena = self._solid.arena
        set_up_links(arena, window, layout, self.fluid.f, ids, self._rule, open_mass)
        walls = Bodies(*sorted_table(*_no_grains(self._dimensions)), self._walls)
        surfaces = Surfaces(window, self._solid.nodes, walls, Directions(layout.lattice).e, self._dimensions)
        self.links = links = MovingLinks(arena, self._pool, int(window.inner[2, 0]))
        self.fluid.leave_to_links(links.of_planes)
        self._solid.expect_updates()
        self._wall_links = WallLinks(arena, surfaces, self._blocks)
        return links

    def move(self, *moving: NDArray, frame: NDArray = STILL) -> None:
        """Move the grains of `start` to their new places; nodes that they uncover are filled. Collective."""
        if self.links is None:
            self.start(*moving, frame=frame)
            return
        self._take_grains(moving, frame)
        self.refill.exchange()
        change = self._solid.update(self._table)
        covered, filled = self.refill.change(change)
        self.fluid.nodes_changed(self._solid.settle())
        self.links.place()
        if self.refill.keeps_mass and len(covered) + len(filled):
            self._pending = self._account(change, covered, filled)

    def _take_grains(self, moving: Sequence[NDArray], frame: NDArray) -> None:
        """What links see of a shaken fluid has been pushed for half a step more than it is told with: so are grains."""
        ids, centres, radii, velocity, omega = moving
        d = self._dimensions
        seen = sorted_table(ids, centres, radii, velocity - 0.5 * frame[:d], omega)
        self._table = _merged(self._fixed, seen)
        self.refill.frame[...] = kernel_axes(frame[None, :d])[0]

    def _account(self, change: Change, covered: NDArray, filled: NDArray) -> Gains:
        """Gains of grains from nodes that they cover and uncover: part of the next step's forces, or of mass alone."""
        table, e = self._table, kernel_axes(self.fluid.lattice.e)
        sums = np.zeros((len(table.ids), GAINS), np.int64)
        parts = ((1.0, change.covered, change.taken_by, covered), (-1.0, change.uncovered, change.left_by, filled))
        for sign, nodes, owners, populations in parts:
            rows, gains = np.searchsorted(table.ids, owners), np.zeros((len(nodes), GAINS))
            gains[:, 6] = -sign * populations.sum(axis=1)
            if self.refill.counts_momentum:  # else links do, as that of what they sweep over
                # one direction after the other: the bits of a product of matrices depend on the number of nodes
                gains[:, :3] = sign * sum(h[:, None] * way for h, way in zip(populations.T, e))
                gains[:, 3:6] = np.cross(self.refill.arms(nodes, table.centres[rows]), gains[:, :3])
            with np.errstate(invalid="ignore"):  # no number: the guard tells it
                np.add.at(sums, rows, np.rint(gains * self._scale).astype(np.int64))
        return Gains(table.ids, sums)

    def _bounce(self, fluid: Fluid, parity: int) -> None:
        """After the sweep: what comes back from the solids at the next step."""
        if self.links is None:
            self._fixed_links.run(self._pool, parity)
            self._take(fluid.iteration + 1)
        else:
            walls = self._wall_links.run(self._pool, parity)
            self._remember([Gains(self._table.ids, self.links.gains(), walls), self._pending], fluid.iteration + 1)
            self._pending = Gains(self._table.ids[:0], NO_GAINS)
        if self.refill.keeps_mass:
            self._keep_mass(fluid.iteration + 1)

    def _take(self, iteration: int) -> None:
        """The links that stay have kept what grains gain in the step to this iteration."""
        self._remember([FixedGains(self._fixed_links, self._pool, iteration % 2, self._scale)], iteration)

    def _remember(self, gains: list[Gains | FixedGains], iteration: int) -> None:
        self._earlier, self._gains, self._gained = self._gains, gains, iteration

    def _keep_mass(self, iteration: int) -> None:
        """Put back evenly what links and nodes have lost by this iteration, now and then. Collective."""
        self._owed += sum(int(part[:, 6].sum()) for gains in self._gains for part in (gains.sums, gains.walls))
        if self.links is not None and iteration % self.refill.steps_owed:
            return
        inner = tuple(slice(*self.window.inner[axis]) for axis in (2, 1, 0))
        here = np.array([self._owed, np.count_nonzero(self.fluid.ids[inner] == FLUID)], np.int64)
        self._owed = 0
        gained, nodes = (float(total) for total in self._world.sum_int(here))
        if nodes:
            self.refill.add_evenly(-gained / nodes / float(self._scale[6]))

    def owed(self) -> float:
        """Mass that the fluid has gained, which is still to be taken from all its nodes. Collective."""
        gained = np.array([self._owed + self._pending.sums[:, 6].sum()], np.int64)
        return float(self._world.sum_int(gained)[0] / self._scale[6])

    def forces(self, ids: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Force [n, d] and torque [n, 1 or 3] on the grains of these numbers, as `all_forces`. Collective."""
        parts = [*self._gains, *self._earlier]
        greatest = max([ids.max(initial=-1), *(gains.ids.max(initial=-1) for gains in parts)])
        force, torque = self.all_forces(int(self._world.max(float(greatest))) + 1)
        return force[ids], torque[ids]

    def all_forces(self, number: int, steps: int = 2) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Force [number, d] and torque [number, 1 or 3] on the grains 0 .. number - 1. Collective.

        The mean of the last two steps: links leave an alternation from step to step (Ladd, J. Fluid Mech. 271 (1994)
        285), which would grow with grains that answer it; before the first step there was none. So grains get all that
        the fluid gives, half of it a step later. steps = 1: of the last one alone, which closes the balance.
        """
        force, torque = self._physical(self._total(self._last(steps), number))
        return force / steps, torque / steps

    def _last(self, steps: int) -> list[Gains | FixedGains]:
        return [*self._gains, *(self._earlier if steps == 2 else [])]

    def _total(self, parts: Sequence[Gains | FixedGains], number: int) -> NDArray[np.int64]:
        sums = np.zeros((number, GAINS), np.int64)
        for part in parts:
            sums[part.ids] += part.sums
        return self._world.sum_int(sums)

    def wall_forces(self, steps: int = 2) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Force and torque on the walls, about their centres: of the steps that `all_forces` takes. Collective."""
        force, torque = self._physical(self._of_walls(self._last(steps)))
        return force / steps, torque / steps

    def _of_walls(self, parts: Sequence[Gains | FixedGains]) -> NDArray[np.int64]:
        found = [part.walls for part in parts if len(part.walls)]
        return self._world.sum_int(sum(found, start=np.zeros((len(self._walls), GAINS), np.int64)))

    def pending(self, number: int) -> NDArray[np.int64]:
        """For a checkpoint, of grains 0 .. number - 1 and of the walls [.., 14]: what the last `move` left for the next
        step, and the last step. Collective."""
        last = self._gains if self._gained == self.fluid.iteration else []
        grains = [self._total(parts, number) for parts in ([self._pending], last)]
        if number:  # what is owed is taken with what is pending, whoever brought it
            grains[0][0, 6] += self._world.sum_int(np.array([self._owed], np.int64))[0]
        if self.refill.keeps_mass and not self.refill.counts_momentum:
            grains[1][:, 6] = 0  # counted in what is owed
        walls = [self._of_walls(parts) for parts in ([], last)]
        return np.vstack((np.hstack(grains), np.hstack(walls)))

    def pending_shape(self, number: int) -> tuple[int, int]:
        return number + len(self._walls), 2 * GAINS

    def restore(self, pending: NDArray[np.int64]) -> None:
        """Take `pending` of a checkpoint; `start` places the grains. All ranks give the same."""
        here = pending if self._world.rank == 0 else np.zeros_like(pending)
        number = len(pending) - len(self._walls)
        left, last = (np.array(part, np.int64) for part in np.hsplit(here, 2))
        ids = np.arange(number)
        self._pending = Gains(ids, left[:number])
        self._gains = self._earlier = [Gains(ids, last[:number], last[number:])]
        self._gained = self.fluid.iteration

    def free(self) -> None:
        """Release what MPI holds (all ranks together)."""
        self.refill.free()

    def _physical(self, sums: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        values = sums / self._scale
        if self._dimensions == 3:
            return values[:, :3], values[:, 3:6]
        return values[:, [0, 2]], -values[:, 4:5]

    def counts(self) -> dict[str, int]:
        """Links of the last step, those without the nodes of their rule, those lost to another solid. Collective."""
        if self.links is None:
            here = np.array([self._fixed_links.count, self._fixed_links.fallbacks, 0], np.int64)
        else:
            here = self.links.counters.sum(axis=0) + self._wall_links.counters.sum(axis=0)
        total = self._world.sum_int(here)
        names = {"links": kernels.LINKS, "fallbacks": kernels.FALLBACKS, "lost": kernels.LOST}
        return {name: int(total[at]) for name, at in names.items()}


def sorted_table(ids: NDArray, centres: NDArray, radii: NDArray, velocity: NDArray, omega: NDArray) -> Table:
    """Grains in the order of ids and in the axes of the kernels."""
    order = np.argsort(ids)
    motion = np.hstack((kernel_axes(velocity), kernel_rotation(omega)))
    return Table(
        np.asarray(ids, np.int64)[order], kernel_axes(centres)[order], np.asarray(radii, np.float64)[order],
        motion[order],
    )  # fmt: skip


def _merged(a: Table, b: Table) -> Table:
    if not len(a.ids):
        return b
    order = np.argsort(np.concatenate((a.ids, b.ids)))
    return Table(*(np.ascontiguousarray(np.concatenate(pair)[order]) for pair in zip(a, b)))


def _no_grains(dimensions: int) -> GrainColumns:
    rotations = np.zeros((0, 3 if dimensions == 3 else 1))
    return np.zeros(0, np.int64), np.zeros((0, dimensions)), np.zeros(0), np.zeros((0, dimensions)), rotations
