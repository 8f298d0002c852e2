"""Discrete elements: grains that touch, moved by velocity Verlet in substeps (Mansouri et al. 2011, section 2)."""

import inspect
import math
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.world import World
from hpcpic.core.errors import ConfigError, Diverged
from hpcpic.core.files.arrays import Column, Shard
from hpcpic.core.space import exact
from hpcpic.core.space.domain import Domain, block_ranges
from hpcpic.core.space.fields import aligned_zeros
from hpcpic.core.tasks.graph import Bound, Graph, Pool, bind
from lbmdem.grains.contact_list import ContactList, Springs
from lbmdem.grains.grains import STATE, Grains
from lbmdem.grains.room import Room
from lbmdem.kernels.grains import contact_forces as kernels
from lbmdem.kernels.grains import films, motion
from lbmdem.kernels.grains import substeps as whole
from lbmdem.physics.contact_law import Law, Wall, wall_rows
from lbmdem.physics.lubrication import Film

FEW = 500  # grains per thread up to which one thread does all substeps in one call
CHUNK = 512  # substeps for which the planes' places are made at a time
SCALARS = {"first", "last", "place", "first_wall", "planar"}
LEAST_SKIN, MOST_SKIN = 0.02, 0.5  # of the smallest radius
SELDOM, OFTEN = 250, 60  # substeps between two lists: beyond them the skin changes; results do not depend on it


class Reader(Protocol):
    """A checkpoint, as core.files.sealed.Reader."""

    time: float

    def read(self, name: str, lo: int, hi: int) -> NDArray: ...


class Dem:
    """Grains under a contact law, between walls, in a box with periodic axes; SI units, vectors as (x, y[, z]).

    columns: x[number, d], v, omega[number, 1 or 3], radius, mass, inertia, fixed of all grains, the same on all ranks;
    a fixed grain keeps its velocities. acceleration: of gravity (m/s2). reach: see Grains.settle. film: of fluid in
    gaps that the lattice does not resolve. The state after a step is at one time: positions, velocities, contact
    forces.
    """

    def __init__(
        self,
        world: World,
        pool: Pool,
        domain: Domain,
        columns: Mapping[str, NDArray],
        law: Law,
        walls: Sequence[Wall] = (),
        acceleration: Sequence[float] = (),
        reach: float = 0.0,
        film: Film | None = None,
    ) -> None:
        self.world, self.pool, self.law, self.walls, self.reach = world, pool, law, tuple(walls), reach
        self._constants, self._film = law.constants(film), film.cut_off if film else 0.0
        self.grains = grains = Grains(world, domain, columns)
        self.gravity = np.zeros(3)
        self.gravity[: len(acceleration)] = acceleration
        self.time = 0.0
        smallest = -world.max(-float(grains.columns["row"][:, 3].min(initial=np.inf)))
        self._check_box()
        self._skins = LEAST_SKIN * smallest, MOST_SKIN * smallest
        self.skin = 0.1 * smallest if math.isfinite(smallest) else 0.0
        self._age, self._dt = 0, 0.0
        self.list = ContactList(len(self.walls), law.shear > 0.0)
        self.wall_rows = aligned_zeros((len(self.walls) + 1, kernels.ROW), np.float64)
        self._walls_listed = self.wall_rows.copy()
        self._few = (world.size == 1 or grains.together) and (pool.threads == 1 or grains.number <= FEW * pool.threads)
        self._blocks = 1 if self._few or pool.threads == 1 else 4 * pool.threads
        self._farthest = np.zeros(8 * self._blocks)
        self._bounds: list[tuple[Bound, tuple[str, ...]]] = []
        self._told: list[dict[str, Any]] = []  # the arguments that each of them has
        self._room = Room()
        driven = (columns["fixed"] != 0) & (np.any(columns["v"], axis=1) | np.any(columns["omega"], axis=1))
        self._driven = bool(np.any(driven)) or any(wall.moves for wall in self.walls)
        self._set_walls(0.0, always=True)
        self.rebuild()
        self._set_dt(0.0)
        self.pool.run(self._forces)
        self._fresh = True
        self._check_start()

    def _check_box(self) -> None:
        grains = self.grains
        sides = grains.lengths[grains.periodic]
        if grains.number > 1 and self.world.any(bool(np.any(grains.columns["fixed"] == 0))):
            short = sides[sides < 4.0 * grains.greatest]
            if short.size:
                raise ConfigError(
                    f"a periodic side of {short.min():g} m is less than two diameters of the largest grain "
                    f"({4.0 * grains.greatest:g} m): a grain could touch two images of another"
                )

    def _check_start(self) -> None:
        """A contact whose normal is no vector: ConfigError on all ranks."""
        grains, pairs = self.grains, self.list
        bad = np.flatnonzero(~np.isfinite(pairs.lines[: pairs.n_grain_slots]).all(axis=1))
        if self.world.any(bad.size > 0):
            names = [f"{grains.ids[pairs.low[k]]} and {grains.ids[pairs.high[k]]}" for k in bad[:3]]
            raise ConfigError(f"grains have the same centre: {', '.join(names) or 'on another rank'}")

    # ---- tasks

    def _arguments(self) -> dict[str, object]:
        """Arrays of the kernels by the names of their arguments."""
        grains, pairs, whole = self.grains, self.list, self.grains.room.whole
        return self.list.room.whole | {
            "rows": whole["row"], "pull": whole["pull"], "forces": whole["force"], "given": whole["given"],
            "heat": whole["heat"], "work": whole["work"], "origin": self._room.whole["origin"],
            "lengths": grains.lengths, "inverses": grains.inverses, "planar": grains.dimensions == 2,
            "gravity": self.gravity, "farthest": self._farthest, "springs": pairs.springs,
            "first_wall": pairs.n_grain_slots, "walls": self.wall_rows, "law": self._constants,
        }  # fmt: skip

    def _jobs(self) -> list[tuple[Any, dict[str, int]]]:
        """Kernels of a substep with their ranges: first halves, forces, second halves."""
        pairs, parts, lanes = self.list, self._blocks, kernels.LANES
        grain_blocks = block_ranges(self.grains.held, parts)
        pair_blocks = [(a * lanes, b * lanes) for a, b in block_ranges(pairs.n_grain_slots // lanes, parts)]
        walls = block_ranges((pairs.n_slots - pairs.n_grain_slots) // lanes, parts)
        wall_blocks = [(pairs.n_grain_slots + a * lanes, pairs.n_grain_slots + b * lanes) for a, b in walls]
        kinds = (
            (motion.start, grain_blocks), (kernels.grain_pairs, pair_blocks), (kernels.wall_pairs, wall_blocks),
            (motion.finish, grain_blocks), (motion.count_work, grain_blocks),
        )  # fmt: skip
        return [
            (kernel, {"first": first, "last": last, "place": place})
            for kernel, blocks in kinds
            for place, (first, last) in enumerate(blocks)
        ]

    def _bind(self) -> None:
        """Bind the kernels of a substep, or tell those that are bound where the arrays are now."""
        values, jobs = self._arguments(), self._jobs()
        if not self._bounds:
            with self.world.first_on_node():
                for kernel, more in jobs:
                    names = tuple(inspect.signature(kernel.py_func).parameters)
                    known = values | more | {"dt": 0.0, "half": 0.0}
                    self._bounds.append((bind(kernel, *(known[name] for name in names)), names))
                    self._told.append(known)
                whole.substeps(0, 0, False, 0.0, np.zeros((0, 2), np.int64), self._farthest, self.wall_rows[None],
                               self.wall_rows, self._walls_listed)  # fmt: skip
                if self._film:
                    self._fastest_film(0.0)  # compiled
            bounds, parts = [bound for bound, _ in self._bounds], self._blocks
            self._start, self._touch = bounds[:parts], bounds[parts : 3 * parts]
            self._finish = bounds[3 * parts : 4 * parts]
            self._work = bounds[4 * parts :] if self._driven else []
            self._forces = self._graph()
            return
        for (bound, names), (_, more), told in zip(self._bounds, jobs, self._told):
            known = values | more
            for index, name in enumerate(names):
                new = known.get(name)
                if name in known and new is not told[name] and (name not in SCALARS or new != told[name]):
                    bound.update(index, new)
            told.update(known)

    def _graph(self) -> Graph:
        """Contact forces, and what grains make of them when all are there."""
        graph, lines = Graph(), [("lines", k) for k in range(len(self._touch))]
        for touch, line in zip(self._touch, lines):
            graph.task(touch, outs=[line])
        for k, finish in enumerate(self._finish):
            graph.task(finish, ins=lines, outs=[("sums", k)])
        for k, work in enumerate(self._work):
            graph.task(work, ins=[*lines, ("sums", k)])
        return graph.freeze()

    def _set_dt(self, dt: float) -> None:
        if dt != self._dt:
            self._dt = dt
            for bound, names in self._bounds:
                if "dt" in names:
                    bound.update(names.index("dt"), dt)
                if "half" in names:
                    bound.update(names.index("half"), 0.5 * dt)

    # ---- steps

    def verlet(self, dt: float, force: NDArray | None = None, torque: NDArray | None = None) -> None:
        """Collective: one substep under forces[n, d] (N) and torques[n, 1 or 3] (N m) on own grains."""
        self.advance(dt, 1, force, torque)

    def advance(
        self,
        dt: float,
        substeps: int,
        force: NDArray | None = None,
        torque: NDArray | None = None,
        time: float | None = None,
        usual: float | None = None,
    ) -> None:
        """Collective: substeps under constant given forces; `time` (s) at their start, for the walls. usual: the step
        of other calls, if it is not dt: springs are half of it ahead before and after this one."""
        self._give(force, torque)
        begin = self.time if time is None else time
        usual = dt if usual is None else usual
        if self._fresh:
            self._put_ahead(0.5 * usual)
        self._fresh = False
        self._put_ahead(0.5 * (dt - usual))
        self._substeps(dt, substeps, begin)
        self._put_ahead(0.5 * (usual - dt))

    def _put_ahead(self, time: float) -> None:
        """Tangential springs as they are after so much more time (s); contact forces stay."""
        if time and self.list.history:
            kept = self.list.lines.copy()
            self._set_dt(time)
            self.pool.each(self._touch)
            self.list.lines[:] = kept

    def _substeps(self, dt: float, substeps: int, begin: float) -> None:
        self._set_dt(dt)
        if self._few:
            for first in range(0, substeps, CHUNK):
                self._advance_alone(dt, begin, first, min(first + CHUNK, substeps))
            return
        for k in range(substeps):
            self.time = begin + (k + 1) * dt
            self.pool.each(self._start)
            self._set_walls(self.time)
            self._renew()
            self.pool.run(self._forces)
        self.grains.refresh()  # the ghosts had predicted velocities

    def fastest_film(self, time: float) -> float:
        """Collective: the greatest resistance x mobility (1/s) of the films within `time` (s) from now."""
        mine = self._fastest_film(time)
        return mine if self.grains.together else self.world.max(mine)

    def _fastest_film(self, time: float) -> float:
        grains, pairs = self.grains, self.list
        where = (pairs.low, pairs.high, pairs.n_grain_slots, grains.rows, self.wall_rows)
        return films.fastest(*where, grains.lengths, grains.inverses, self._constants, time)

    def _advance_alone(self, dt: float, begin: float, first: int, last: int) -> None:
        """Substeps first..last in compiled code, without messages."""
        motions = self.wall_rows[None]
        if any(wall.moves for wall in self.walls):
            motions = wall_rows(self.walls, begin + np.arange(first + 1, last + 1) * dt)
            if len(motions) == 1:
                self.wall_rows[:] = motions[0]
        bounds = [*self._start, *self._touch, *self._finish, *self._work]
        tasks = np.array([(bound.address, bound.context.ctypes.data) for bound in bounds])
        done, begun, steps = 0, False, last - first
        while done < steps:
            outcome = whole.substeps(
                done, steps, begun, self.skin, tasks, self._farthest, motions, self.wall_rows, self._walls_listed
            )
            begun = outcome < 0
            self._age += (-1 - outcome if begun else outcome) - done
            done = -1 - outcome if begun else outcome
            if begun:
                self._check(whole.distance_moved(self._farthest))
                self.rebuild()
        self.time = begin + last * dt

    def _give(self, force: NDArray | None, torque: NDArray | None) -> None:
        grains, d = self.grains, self.grains.dimensions
        grains.columns["given"][:] = 0.0
        given = grains.columns["given"][: grains.n]
        if force is not None:
            given[:, :d] = force
        if torque is not None:
            given[:, 6 if d == 2 else 4 : 7] = np.reshape(torque, (len(given), 1 if d == 2 else 3))
        grains.share("given")

    def _set_walls(self, time: float, always: bool = False) -> None:
        if always or any(wall.moves for wall in self.walls):
            self.wall_rows[:] = wall_rows(self.walls, np.array([time]))[0]

    def _renew(self) -> None:
        """Ghosts at their new places; a new list when a grain may have come from beyond the old one."""
        self._age += 1
        moved = self.world.max(whole.distance_moved(self._farthest))
        self._check(moved)
        if moved + max(moved, whole.wall_distance(self.wall_rows, self._walls_listed)) > self.skin:
            self.rebuild()
        else:
            self.grains.refresh()

    def _check(self, moved: float) -> None:
        if not moved < np.inf:
            raise Diverged("a grain's position is not a number")

    def rebuild(self) -> None:
        """Collective: grains to their owners, ghosts, and the list of pairs."""
        self._tune()
        self._list(self.list.stretched())

    def _tune(self) -> None:
        if 0 < self._age < OFTEN:
            self.skin = min(1.25 * self.skin, self._skins[1])
        elif self._age > SELDOM:
            self.skin = max(0.8 * self.skin, self._skins[0])
        self._age = 0

    def _list(self, springs: Springs) -> None:
        grains = self.grains
        margin = self.skin + self._film
        springs = grains.settle(springs, margin, self.reach)
        inverse = np.where(grains.fixed, 0.0, 1.0 / grains.mass)
        self.list.build(grains.rows, grains.ids, inverse, grains.held, margin, grains.lengths, grains.inverses,
                        self.wall_rows, grains.number, self.law, springs)  # fmt: skip
        self._room.rows("origin", grains.held, shape=(8,))[:] = grains.rows[: grains.held, :8]
        self._walls_listed[:] = self.wall_rows
        self._bind()

    def set_added(self, mass: NDArray, inertia: NDArray) -> None:
        """Added mass and inertia [n] of own grains: they divide all forces, and make no weight."""
        grains, c = self.grains, self.grains.columns
        added = np.zeros((grains.held, 2))
        added[: grains.n, 0], added[: grains.n, 1] = mass, inertia
        added = grains.shared(added)
        free, total = c["fixed"] == 0, c["mass"] + added[:, 0]
        c["row"][:, 7] = np.where(free, 1.0 / total, 0.0)
        c["row"][:, 11] = np.where(free, 1.0 / (c["inertia"] + added[:, 1]), 0.0)
        c["pull"][:] = np.where(free, c["mass"] / total, 0.0)

    # ---- checkpoints

    def state(self) -> dict[str, Shard]:
        """Collective: the state in id order: columns of Grains without "given", and with history partner[number, k]
        (ids, -1 for none; number + w for wall w) and spring[number, k, 3] (m) of contacts at their smaller id. Same
        bits for any ranks and threads.
        """
        grains, more = self.grains, {}
        if self.list.history:
            partner, spring = self.list.by_grain(grains.ids[: grains.n], self.world)
            more = {"partner": partner, "spring": spring}
        low, _ = grains.part()
        return {f"grains/{name}": Shard(part, low, grains.number) for name, part in grains.state(more).items()}

    def state_columns(self, reader: Reader) -> dict[str, Column]:
        """What the arrays of `state` are: what grains are made of is that of the scene."""
        found = {f"grains/{name}": column for name, column in self.grains.state_columns().items()}
        if self.list.history:
            n, others = self.grains.number, self.grains.number + len(self.walls)
            most = reader.shape("grains/partner")[1:2] or (None,)
            found["grains/partner"] = Column(np.int64, (n, *most), -1, others - 1)
            found["grains/spring"] = Column(np.float64, (n, *most, 3))
        return found

    def restore(self, reader: Reader) -> None:
        """Collective: go on from a checkpoint of any number of ranks."""
        grains = self.grains
        low, high = grains.part()
        ids = np.arange(low, high)
        grains.take(ids, {name: reader.read(f"grains/{name}", low, high) for name in STATE})
        springs = np.zeros((0, 2), np.int64), np.zeros((0, 3))
        if self.list.history:
            partner, spring = (reader.read(f"grains/{name}", low, high) for name in ("partner", "spring"))
            some = partner >= 0
            first = np.broadcast_to(ids[:, None], some.shape)
            springs = np.stack([first[some], partner[some]], 1), np.ascontiguousarray(spring[some])
            springs = grains.all_springs(springs)
        self.time, self._fresh = reader.time, False
        self._set_walls(self.time, always=True)
        self._list(springs)
        kept = self.list.springs.copy()
        self._set_dt(0.0)
        self.pool.each(self._touch)  # lines of forces for what is asked before the next step; no force changes
        self.list.springs[:] = kept

    # ---- what users ask for

    @property
    def version(self) -> int:
        """Changes when own grains change their order or their rank."""
        return self.grains.version

    def total(self, values: NDArray) -> float:
        """Collective: the sum over all grains of a column of own grains, the same bits on any ranks. Diverged."""
        largest = np.abs(values).max(initial=0.0)
        largest = self.world.max(float(largest) if np.isfinite(largest) else math.inf)
        if math.isinf(largest):
            raise Diverged("a mass, a place or a velocity of a grain is not a finite number")
        scale = exact.power_of_two_above(largest)
        return exact.value(self.world.sum_int(exact.exact_limbs(values, scale)), scale)
