"""Discrete elements: grains that touch, moved by velocity Verlet in substeps (Mansouri et al. 2011, section 2)."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.world import World
from hpcpic.core.errors import ConfigError, Diverged
from hpcpic.core.files.arrays import Column, Rows, Shard
from hpcpic.core.files.sealed import Reader
from hpcpic.core.physics.contact_law import ContactLaw
from hpcpic.core.simd.team import team
from hpcpic.core.space import exact
from hpcpic.core.space.domain import Domain, block_ranges
from hpcpic.core.tasks.arena import Arena
from hpcpic.core.tasks.graph import Bound, Graph, Pool
from lbmdem.grains.arrays import CONTACTS, DRIVEN, GRAINS, STEP
from lbmdem.grains.contact_list import ContactList, Springs
from lbmdem.grains.grains import STATE, Grains, replicated
from lbmdem.grains.own_accelerations import Own, OwnAccelerations
from lbmdem.kernels.grains import contact_forces, films, motion
from lbmdem.kernels.grains.arrays import Box, Contacts, Frame, GrainArrays, GrainLists, Pushed
from lbmdem.kernels.grains.substeps import distance_moved, substeps, wall_distance
from lbmdem.physics.lubrication import Film
from lbmdem.physics.plane_walls import PlaneWall, wall_rows
from lbmdem.sizes import GRAINS_OF_ONE_THREAD, LANES, parts_of

WALL_SUBSTEPS = 512  # substeps for which the planes' places are made at a time
MIN_SKIN, MAX_SKIN = 0.02, 0.5  # of the smallest radius
SHORT_USE, LONG_USE = 60, 250  # substeps: a list used for fewer or more changes the skin, but no result
NO_FILM = Film(0.0, 0.0, 3)
UNSHAKEN = Frame(0, 1, np.zeros((0, 3)), np.zeros((0, 3)))


class Dem:
    """Grains under a contact law, between walls, in a box with periodic axes; SI units, vectors as (x, y[, z]).

    columns: x[number, d], v, omega[number, 1 or 3], radius, mass, inertia, fixed of all grains, the same on all ranks;
    a fixed grain keeps its velocities. acceleration: of gravity (m/s2). reach: see Grains.settle. film: of fluid in
    gaps that the lattice does not resolve. own: accelerations of the user's own. The state after a step is at one time:
    positions, velocities, contact forces.
    """

    def __init__(
        self,
        world: World,
        pool: Pool,
        domain: Domain,
        columns: Mapping[str, NDArray],
        law: ContactLaw,
        walls: Sequence[PlaneWall] = (),
        acceleration: Sequence[float] = (),
        reach: float = 0.0,
        film: Film | None = None,
        own: Sequence[Own] = (),
    ) -> None:
        self.world, self.pool, self.law, self.walls, self.reach = world, pool, law, tuple(walls), reach
        self._film = film or NO_FILM
        number = len(columns["radius"])
        few = pool.threads == 1 or number <= GRAINS_OF_ONE_THREAD * pool.threads
        self._serial = few and (world.size == 1 or replicated(world, number))
        parts = 1 if self._serial else parts_of(pool.threads)
        sizes = {"parts": parts, "cuts": parts + 1, "walls": len(walls) + 1}
        sizes |= dict.fromkeys(("grains", "rows", "slots", "filmed", "entries"), LANES)  # to begin with
        self.arena = arena = Arena((*GRAINS, *(DRIVEN if own else ()), *CONTACTS, *STEP), **sizes)
        arena.group(grains=GrainArrays, contacts=Contacts, lists=GrainLists, box=Box, pushed=Pushed)
        self.gravity = np.zeros(3)
        self.gravity[: len(acceleration)] = acceleration
        law = ContactLaw._make(value if isinstance(value, bool) else float(value) for value in law)
        arena.set(gravity=self.gravity, planar=domain.ndim == 2, law=law, film=self._film, dt=0.0, first_wall=0)
        self.grains = grains = Grains(world, domain, columns, arena)
        arena.set(lengths=grains.lengths, inverses=grains.inverses)
        self.time = 0.0
        smallest = -world.max(-float(grains.columns["row"][:, 3].min(initial=np.inf)))
        self._check_box()
        self._skins = MIN_SKIN * smallest, MAX_SKIN * smallest
        self.skin = 0.1 * smallest if math.isfinite(smallest) else 0.0
        self._age, self._dt = 0, 0.0
        self.list = ContactList(arena, grains.number, len(self.walls), law)
        self._walls_listed = arena["walls"].copy()
        driven = (columns["fixed"] != 0) & (np.any(columns["v"], axis=1) | np.any(columns["omega"], axis=1))
        self._works = bool(np.any(driven)) or any(wall.moves for wall in self.walls)
        self._own = OwnAccelerations(own, arena, grains) if own else None
        self._bind()
        self._set_walls(0.0, always=True)
        self.rebuild()
        self.pool.run(self._second_half)
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
        """ConfigError on all ranks where a contact has no normal."""
        grains, pairs = self.grains, self.list
        bad = np.flatnonzero(~np.isfinite(pairs.lines[: pairs.n_grain_slots]).all(axis=1))
        if self.world.any(bad.size > 0):
            names = [f"{grains.ids[pairs.low[k]]} and {grains.ids[pairs.high[k]]}" for k in bad[:3]]
            raise ConfigError(f"grains have the same centre: {', '.join(names) or 'on another rank'}")

    # ---- tasks

    def _bind(self) -> None:
        """Bind the kernels of a substep to the arrays: first half, contact forces, second half."""
        arena, parts = self.arena, self.arena.sizes["parts"]
        self._touch = [
            arena.bind(contact_forces.grain_pairs, parts, rows="row"),
            arena.bind(contact_forces.wall_pairs, parts, rows="row"),
        ]
        self._start = arena.bind(motion.start, parts)
        self._finish = [arena.bind(motion.finish, parts)]
        if self._works:
            self._finish.append(arena.bind(motion.count_work, parts))
        if self._own:
            self._finish += self._own.tasks
        if self._film.cut_off:
            arena.ask(films.fastest, **self._slots, rows="row", time=0.0)
        if self._serial:
            none = {"done": 0, "steps": 0, "begun": False, "skin": 0.0, "kernels": np.zeros((0, 2), np.int64)}
            arena.ask(substeps, **none, frame=UNSHAKEN, motion=arena["walls"][None], listed=self._walls_listed)
        self._first_half = self._graph([self._start], [])
        self._contacts = self._graph(self._touch, [])
        self._second_half = self._graph(self._touch, self._finish)

    def _graph(self, first: list[Bound], then: list[Bound]) -> Graph:
        """All parts of the first kernels, and when these are done those of the others, one after the other."""
        graph, parts = Graph(), range(self.arena.sizes["parts"])
        done = [(bound.name, part) for bound in first for part in parts]
        for bound in first:
            for part in parts:
                graph.task(bound, outs=[(bound.name, part)], part=part)
        for bound in then:
            for part in parts:
                graph.task(bound, ins=done, inouts=[("sums", part)], part=part)
        return graph.freeze()

    def _cut(self) -> None:
        """Divide grains and slots among the parts of the kernels."""
        arena, pairs, parts = self.arena, self.list, self.arena.sizes["parts"]
        arena["grain_cuts"][:] = cuts(self.grains.held, parts)
        arena["pair_cuts"][:] = LANES * cuts(pairs.n_grain_slots // LANES, parts)
        walls = (pairs.n_slots - pairs.n_grain_slots) // LANES
        arena["wall_cuts"][:] = pairs.n_grain_slots + LANES * cuts(walls, parts)
        arena.set(first_wall=pairs.n_grain_slots)

    def _set_dt(self, dt: float) -> None:
        if dt != self._dt:
            self._dt = dt
            self.arena.set(dt=dt)

    # ---- steps

    def advance(
        self,
        dt: float,
        substeps: int,
        force: NDArray | None = None,
        torque: NDArray | None = None,
        time: float | None = None,
        usual: float | None = None,
    ) -> None:
        """Collective: substeps under constant given forces; `time` (s) at their start, for the walls and the user's own
        accelerations. usual: the step of other calls, if it is not dt: springs are half of it ahead before and after
        this one.
        """
        begin = self.time if time is None else time
        self._give(self._own.start(force, begin) if self._own else force, torque)
        usual = dt if usual is None else usual
        if self._fresh:
            self._put_ahead(0.5 * usual)
        self._fresh = False
        self._put_ahead(0.5 * (dt - usual))
        self._substeps(dt, substeps, begin)
        self._put_ahead(0.5 * (usual - dt))

    def advance_shaken(
        self, dt: float, substeps: int, constant: NDArray, accelerations: NDArray, times: NDArray
    ) -> None:
        """Collective: steps of so many substeps, which begin at times[m] (s) and in which the frame has the
        accelerations[m, d]. Forces are constant[number, d] (N) by id less mass x acceleration. Its bits are those of as
        many calls of `advance`.
        """
        grains = self.grains
        if self._fresh:
            self._put_ahead(0.5 * dt)
        self._fresh = False
        if self._serial:
            self._give(None, None)
            ends = (times[:, None] + np.arange(1, substeps + 1) * dt).ravel()
            self._set_dt(dt)
            self._advance_alone(ends, Frame(0, substeps, accelerations, constant))
            return
        for acceleration, time in zip(accelerations, times.tolist()):
            own = slice(grains.n)
            self._give(constant[grains.ids[own]] - grains.mass[own, None] * acceleration, None)
            self._substeps(dt, substeps, time)

    def _put_ahead(self, time: float) -> None:
        """Move the tangential springs ahead by a time (s); contact forces stay."""
        if time and self.list.remembers:
            kept = self.list.lines.copy()
            self._set_dt(time)
            self.pool.run(self._contacts)
            self.list.lines[:] = kept

    def _substeps(self, dt: float, count: int, begin: float) -> None:
        """Do substeps from the time `begin` (s)."""
        self._set_dt(dt)
        if self._serial:
            self._advance_alone(begin + np.arange(1, count + 1) * dt, UNSHAKEN)
            return
        for k in range(count):
            self.time = begin + (k + 1) * dt
            self.pool.run(self._first_half)
            self._set_walls(self.time)
            self._renew()
            self.pool.run(self._second_half)
        self.grains.refresh()  # the ghosts had predicted velocities

    def fastest_film(self, time: float) -> float:
        """Collective: the greatest resistance x mobility (1/s) of the films within `time` (s) from now."""
        mine = self.arena.call(films.fastest, **self._slots, rows="row", time=time)
        return mine if self.grains.replicated else self.world.max(mine)

    @property
    def _slots(self) -> dict[str, int]:
        return {"n_slots": self.list.n_slots, "n_grain_slots": self.list.n_grain_slots}

    def _advance_alone(self, ends: NDArray, frame: Frame) -> None:
        """Substeps that end at these times (s) in compiled code, without messages."""
        for first in range(0, len(ends), WALL_SUBSTEPS):
            self._advance_few(ends[first : first + WALL_SUBSTEPS], frame._replace(first=first))

    def _advance_few(self, ends: NDArray, frame: Frame) -> None:
        """Those of as many as walls have their places made for at a time."""
        walls = self.arena["walls"]
        motions = walls[None]
        if any(wall.moves for wall in self.walls):
            motions = wall_rows(self.walls, ends)
            if len(motions) == 1:
                walls[:] = motions[0]
        bounds: list[Bound] = [self._start, *self._touch, *self._finish]
        team.want(bound.job for bound in bounds if not bound.ready)
        tasks = np.array([(bound.address, bound.context.ctypes.data) for bound in bounds])
        done, begun, steps = 0, False, len(ends)
        given = {"steps": steps, "kernels": tasks, "motion": motions, "listed": self._walls_listed, "frame": frame}
        while done < steps:
            outcome = self.arena.call(substeps, **given, done=done, begun=begun, skin=float(self.skin))
            begun = outcome < 0
            self._age += (-1 - outcome if begun else outcome) - done
            done = -1 - outcome if begun else outcome
            if begun:
                self._check(distance_moved(self.arena["farthest"]))
                self.rebuild()
        self.time = float(ends[-1])

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
            self.arena["walls"][:] = wall_rows(self.walls, np.array([time]))[0]

    def _renew(self) -> None:
        """Refresh the ghosts, or list the pairs anew when a grain may have come from beyond the old list."""
        self._age += 1
        moved = self.world.max(distance_moved(self.arena["farthest"]))
        self._check(moved)
        if moved + max(moved, wall_distance(self.arena["walls"], self._walls_listed)) > self.skin:
            self.rebuild()
        else:
            self.grains.refresh()

    def _check(self, moved: float) -> None:
        if not moved < np.inf:
            raise Diverged("a grain's position is not a number")

    def rebuild(self) -> None:
        """Collective: send grains to their owners, choose ghosts, and list the pairs."""
        self._tune()
        self._list(self.list.stretched())

    def _tune(self) -> None:
        """Change the skin where the last list was used for few substeps, or for many."""
        if 0 < self._age < SHORT_USE:
            self.skin = min(1.25 * self.skin, self._skins[1])
        elif self._age > LONG_USE:
            self.skin = max(0.8 * self.skin, self._skins[0])
        self._age = 0

    def _list(self, springs: Springs) -> None:
        grains = self.grains
        margin = self.skin + self._film.cut_off
        springs = grains.settle(springs, margin, self.reach)
        inverse = np.where(grains.fixed, 0.0, 1.0 / grains.mass)
        self.list.build(grains.ids, inverse, grains.held, margin, springs)
        self.arena["origin"][: grains.held] = grains.rows[: grains.held, :8]
        self._walls_listed[:] = self.arena["walls"]
        self._cut()

    # ---- checkpoints

    def state(self) -> dict[str, Shard]:
        """Collective: the state in id order: columns of Grains without "given", and with history partner[number, k]
        (ids, -1 for none; number + w for wall w) and spring[number, k, 3] (m) of contacts at their smaller id. Same
        bits for any ranks and threads.
        """
        grains, more = self.grains, {}
        if self.list.remembers:
            partner, spring = self.list.by_grain(grains.ids[: grains.n], self.world)
            more = {"partner": partner, "spring": spring}
        low, _ = grains.part()
        return {f"grains/{name}": Shard(part, low, grains.number) for name, part in grains.state(more).items()}

    def state_columns(self, reader: Reader) -> dict[str, Column]:
        """Types and limits of the arrays of `state`; masses, radii and so on are those of the scene."""
        found = {f"grains/{name}": column for name, column in self.grains.state_columns().items()}
        if self.list.remembers:
            n, others = self.grains.number, self.grains.number + len(self.walls)
            most = reader.shape("grains/partner")[1:2] or (None,)
            found["grains/partner"] = Column(np.int64, (n, *most), -1, others - 1)
            found["grains/spring"] = Column(np.float64, (n, *most, 3))
        return found

    def restore(self, reader: Rows) -> None:
        """Collective: go on from a state of any number of ranks."""
        grains = self.grains
        low, high = grains.part()
        ids = np.arange(low, high)
        grains.take(ids, {name: reader.read(f"grains/{name}", low, high) for name in STATE})
        springs = np.zeros((0, 2), np.int64), np.zeros((0, 3))
        if self.list.remembers:
            partner, spring = (reader.read(f"grains/{name}", low, high) for name in ("partner", "spring"))
            used = partner >= 0
            first = np.broadcast_to(ids[:, None], used.shape)
            springs = np.stack([first[used], partner[used]], 1), np.ascontiguousarray(spring[used])
            springs = grains.all_springs(springs)
        self.time, self._fresh = reader.time, False
        self._set_walls(self.time, always=True)
        self._list(springs)
        kept = self.list.springs.copy()
        self._set_dt(0.0)
        self.pool.run(self._contacts)  # lines of forces for what is asked before the next step; no force changes
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


def cuts(n: int, parts: int) -> NDArray[np.int64]:
    """Ends [parts + 1] of nearly equal parts of n."""
    return np.array([0, *(end for _, end in block_ranges(n, parts))], np.int64)
