"""Grains of one rank: state, copies of other ranks' grains, and the way of a grain to the rank that owns it.

Rank r owns the grains whose centre was in its slab when the list of pairs was last made. Ghosts are copies, at their
own place (not at that of an image), of all grains that may come near one of the slab.

Few grains are held by all ranks together: each moves them all, which costs less than messages. The ghosts are then all
grains of the other ranks.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.ghosts import Refresh
from hpcpic.core.comm.migrate import send_anywhere
from hpcpic.core.comm.sharding import by_id
from hpcpic.core.comm.tags import Channel, tag
from hpcpic.core.comm.world import World
from hpcpic.core.files.arrays import Column
from hpcpic.core.space.domain import Domain, block_ranges, wrap
from hpcpic.core.space.records import pack_rows, record_type, unpack_rows
from hpcpic.core.tasks.arena import Arena
from lbmdem.grains.arrays import DRIVEN, GRAINS
from lbmdem.grains.contact_list import Springs
from lbmdem.sizes import MAX_REPLICATED, ROW

X, V, OMEGA, TURN = 0, 4, 8, 12  # first values of a row: position and radius, velocity, angular velocity, orientation
COLUMNS, MORE = (  # types and shapes; the second of scenes with accelerations of the user's own
    {
        array.name: (np.dtype(array.dtype), tuple(int(n) for n in array.shape[1:]))
        for array in arrays
        if array.name != "origin"
    }
    for arrays in (GRAINS, DRIVEN)
)
OUT_OF_PLANE = [V + 2, OMEGA, OMEGA + 1]  # motions that discs do not have
INVERSES = [7, 11]  # values of a row: 1 / mass and 1 / inertia, of fixed grains 0
QUATERNION_ERROR = 1e-6  # by which a quaternion may miss its length
STATE = tuple(name for name in COLUMNS if name not in ("id", "given"))
MAX_DISORDER = 32  # one in so many grains may follow one of a cell beyond its own
MAX_CELL = 1e6  # cells farther from the origin are one
SPRING = np.dtype([("key", np.int64, (2,)), ("value", np.float64, (3,))])  # that travels with a grain


def replicated(world: World, number: int) -> bool:
    """True where all ranks hold all of so many grains."""
    return world.size > 1 and number <= MAX_REPLICATED


class Grains:
    """n own grains, then n_ghosts copies; rows[n + n_ghosts + 1, 16], the last one touches nothing.

    The views x[m, d], v, omega[m, 1 or 3], radius, angle or orientation hold own grains and ghosts, in this order;
    columns[name] are of the `held` ones: own grains, or all when held together. Order and number change when `settle`
    is called; version counts that.
    """

    def __init__(self, world: World, domain: Domain, columns: Mapping[str, NDArray], arena: Arena) -> None:
        self.world, self.domain, self.arena = world, domain, arena
        self._types = COLUMNS | {name: kind for name, kind in MORE.items() if name in arena.declared}
        self.dimensions = domain.ndim
        self.number = len(columns["radius"])
        self.replicated = replicated(world, self.number)
        self._made_of = {name: np.asarray(columns[name]) for name in ("mass", "inertia", "fixed", "radius")}
        self.columns = self._first(columns)
        self.set_added(0.0, 0.0)
        self.n = len(self.columns["id"])
        self.lengths = np.zeros(3)
        self.lengths[: self.dimensions] = domain.lengths[::-1]
        self.periodic = np.zeros(3, np.bool_)
        self.periodic[: self.dimensions] = domain.periodic[::-1]
        self.inverses = np.where(self.periodic, 1.0 / np.where(self.lengths > 0.0, self.lengths, 1.0), 0.0)
        self.greatest = world.max(float(self.columns["row"][:, 3].max(initial=0.0)))
        self._layout, self.version = record_type(self.columns), 0
        self._refresh = Refresh(world, Channel.GHOSTS)
        self._round = 0
        self.n_ghosts = 0
        self._lay_out()

    def _first(self, given: Mapping[str, NDArray]) -> dict[str, NDArray]:
        """Columns of this rank from those of the scene, which are of all grains."""
        n, d = len(given["radius"]), self.dimensions
        columns: dict[str, NDArray] = {
            name: np.zeros((n, *shape), dtype) for name, (dtype, shape) in self._types.items()
        }
        columns["id"][:] = np.arange(n)
        for name in ("mass", "inertia", "fixed"):
            columns[name][:] = given[name]
        row = columns["row"]
        row[:, X : X + d], row[:, V : V + d] = given["x"], given["v"]
        for axis, (length, periodic) in enumerate(zip(self.domain.lengths[::-1], self.domain.periodic[::-1])):
            if periodic:
                row[:, axis] = wrap(row[:, axis], length)
        row[:, OMEGA + (2 if d == 2 else 0) : OMEGA + 3] = np.reshape(given["omega"], (n, 1 if d == 2 else 3))
        row[:, 3], row[:, TURN] = given["radius"], 1.0 if d == 3 else 0.0
        if self.replicated:
            return columns
        mine = self._owner(row) == self.world.rank
        return {name: column[mine] for name, column in columns.items()}

    def _owner(self, rows: NDArray) -> NDArray[np.int64]:
        """The rank that owns each row."""
        along = rows[:, self.dimensions - 1] / self.domain.spacing[0]
        return np.asarray(self.domain.owner(np.clip(np.floor(along), 0, self.domain.points[0] - 1).astype(np.int64)))

    # ---- views

    @property
    def held(self) -> int:
        """Grains that this rank moves."""
        return len(self.columns["id"])

    @property
    def x(self) -> NDArray[np.float64]:
        return self.rows[:-1, X : X + self.dimensions]

    @property
    def v(self) -> NDArray[np.float64]:
        return self.rows[:-1, V : V + self.dimensions]

    @property
    def omega(self) -> NDArray[np.float64]:
        return self.rows[:-1, OMEGA + (2 if self.dimensions == 2 else 0) : OMEGA + 3]

    @property
    def radius(self) -> NDArray[np.float64]:
        return self.rows[:-1, 3]

    @property
    def orientation(self) -> NDArray[np.float64]:
        """Quaternion [m, 4] (scalar first) of spheres, angle [m] (rad) of discs."""
        return self.rows[:-1, TURN] if self.dimensions == 2 else self.rows[:-1, TURN:]

    @property
    def mass(self) -> NDArray[np.float64]:
        """Mass [m] of own grains and ghosts, kg."""
        return self._constants[:, 0]

    @property
    def inertia(self) -> NDArray[np.float64]:
        return self._constants[:, 1]

    @property
    def fixed(self) -> NDArray[np.bool_]:
        return self._constants[:, 2] > 0.0

    # ---- who owns whom

    def settle(self, springs: Springs, margin: float, reach: float) -> Springs:
        """Collective: every grain to its owner, in an order that is good for caches, and new ghosts.

        margin: of surfaces of a pair, reach: of the surface of a ghost and this slab (m). Springs of contacts travel
        with either grain.
        """
        self._round += 1
        if self.world.size > 1 and not self.replicated:
            springs = self._send(springs)
        place = self._places(2.0 * self.greatest + margin)
        disorder = np.count_nonzero(place[1:] < place[:-1])
        if self._laid_out and self.world.size == 1 and disorder * MAX_DISORDER <= self.held:
            return springs
        others = self._owner(self.columns["row"]) != self.world.rank
        order = np.argsort(np.where(others & self.replicated, np.inf, place), kind="stable")
        self.columns = {name: column[order] for name, column in self.columns.items()}
        self.n = self.held - int(np.count_nonzero(others)) if self.replicated else self.held
        exchange = self.world.size > 1 and not self.replicated
        self.n_ghosts = self._refresh.choose(self._members(margin, reach)) if exchange else self.held - self.n
        self._lay_out()
        self.version += 1
        return springs

    def _places(self, size: float) -> NDArray[np.float64]:
        """Numbers of the cells of a size (m) that the grains are in, in lines along x. Their order changes little from
        one list to the next: a stable sort finds long runs.
        """
        cell = np.clip(np.floor(self.columns["row"][:, :3] / size), -MAX_CELL, MAX_CELL)
        cell -= cell.min(axis=0, initial=0.0)
        nx, ny, _ = cell.max(axis=0, initial=0.0) + 1.0
        return (cell[:, 2] * ny + cell[:, 1]) * nx + cell[:, 0]

    def _send(self, springs: Springs) -> Springs:
        """Grains, and the springs of their contacts, to the ranks that own them. Collective."""
        owners, ids = self._owner(self.columns["row"]), self.columns["id"]
        outgoing, kept = {}, owners == self.world.rank
        loose = {}
        for peer in np.unique(owners[~kept]).tolist():
            going = owners == peer
            outgoing[peer] = pack_rows(self.columns, going)
            mine = np.isin(springs[0], ids[going]).any(axis=1)
            loose[peer] = pack_rows({"key": springs[0][mine], "value": springs[1][mine]}, slice(None))
        label = tag(self._round, Channel.PARTICLES)
        arrived = send_anywhere(self.world, outgoing, self._layout.itemsize, label)
        parts = [{name: column[kept] for name, column in self.columns.items()}]
        parts += [unpack_rows(records, self._layout) for records in arrived]
        self.columns = {name: np.concatenate([part[name] for part in parts]) for name in self._types}
        return self._with_others(springs, loose)

    def _with_others(self, springs: Springs, loose: Mapping[int, NDArray]) -> Springs:
        """Springs with those that other ranks have for this one; loose: records for them. Collective."""
        found = [springs]
        for records in send_anywhere(self.world, loose, SPRING.itemsize, tag(self._round, Channel.RECUT)):
            part = unpack_rows(records, SPRING)
            found.append((part["key"], part["value"]))
        return np.concatenate([keys for keys, _ in found]), np.concatenate([values for _, values in found])

    def _members(self, margin: float, reach: float) -> dict[int, NDArray[np.int64]]:
        """By rank, own grains that may come near its slab or its grains."""
        axis, rows = self.dimensions - 1, self.columns["row"]
        at, radius, length = rows[:, axis], rows[:, 3], self.lengths[axis]
        members = {}
        for peer in range(self.world.size):
            low, high = (edge * self.domain.spacing[0] for edge in self.domain.row_range(peer))
            if peer == self.world.rank or high <= low:
                continue
            low, high = (-np.inf if low == 0.0 else low), (np.inf if high >= length else high)
            if self.periodic[axis]:
                low, high = max(low, 0.0), min(high, length)
                middle, half = 0.5 * (low + high), 0.5 * (high - low)
                beyond = np.abs(at - middle - length * np.rint((at - middle) / length)) - half
            else:
                beyond = np.maximum(low - at, at - high)
            near = beyond < radius + max(self.greatest + margin, reach + margin)
            members[peer] = np.flatnonzero(near)
        return members

    def _lay_out(self) -> None:
        """One array of rows: own grains, ghosts, and one that touches nothing."""
        self._laid_out = True
        held, total = self.held, self.n + self.n_ghosts
        self.arena.reserve(grains=held, rows=total + 1)
        self.rows = self.arena["row"][: total + 1]
        for name, values in self.columns.items():
            kept = self.arena[name][:held]
            kept[:] = values
            self.columns[name] = kept
        self.rows[-1] = np.nan
        self.ids, self._constants = np.empty(total, np.int64), np.empty((total, 3))
        here = np.stack([self.columns[name] for name in ("mass", "inertia", "fixed")], 1).astype(np.float64)
        self.ids[:held], self._constants[:held] = self.columns["id"], here
        if self.world.size > 1 and not self.replicated:
            self.ids[held:], self._constants[held:] = self._sent(self.columns["id"]), self._sent(here)
            self.refresh()

    def _sent(self, values: NDArray) -> NDArray:
        self._round += 1
        self._refresh.start(self._round, np.ascontiguousarray(values))
        return self._refresh.finish()

    def refresh(self) -> None:
        """Collective: ghosts as their owners' grains are now."""
        if self.world.size > 1 and not self.replicated:
            self.rows[self.n : -1] = self._sent(self.columns["row"])

    def share(self, name: str) -> None:
        """Collective: a column as the owners have it in the rows of own grains."""
        if self.replicated:
            values = self.columns[name]
            bits = np.zeros((self.number, *values.shape[1:]), np.int64)
            bits[self.ids[: self.n]] = values[: self.n].view(np.int64)
            values[:] = self.world.sum_int(bits)[self.ids].view(np.float64)

    # ---- state

    def part(self) -> tuple[int, int]:
        """Range of ids that `state` of this rank holds."""
        return block_ranges(self.number, self.world.size)[self.world.rank]

    def state(self, more: Mapping[str, NDArray] | None = None) -> dict[str, NDArray]:
        """Collective: what changes, in id order, of the ids of `part`; `more` are columns of own grains."""
        columns = {name: self.columns[name][: self.n] for name in STATE} | dict(more or {})
        layout = {name: (column.dtype, column.shape[1:]) for name, column in columns.items()}
        return by_id(self.world, [(self.ids[: self.n], columns)], layout, self.number)

    def state_columns(self) -> dict[str, Column]:
        """Types and limits of the arrays of `state` in a checkpoint; masses, radii and so on do not change in a run."""
        n, made = self.number, self._made_of
        found = {name: Column(dtype, (n, *shape)) for name, (dtype, shape) in COLUMNS.items() if name in STATE}
        for name in ("mass", "inertia", "fixed", "pull"):
            found[name] = replace(found[name], low=made[name].astype(np.float64), high=made[name].astype(np.float64))
        low, high = np.full((n, ROW), -np.inf), np.full((n, ROW), np.inf)
        low[:, 3] = high[:, 3] = made["radius"]
        low[:, INVERSES] = high[:, INVERSES] = made["inverses"]
        if self.dimensions == 3:
            low[:, TURN:], high[:, TURN:] = -1.0 - QUATERNION_ERROR, 1.0 + QUATERNION_ERROR
        found["row"] = replace(found["row"], low=low, high=high)
        return found

    def set_added(self, mass: NDArray | float, inertia: NDArray | float) -> None:
        """Give all grains added mass and inertia [number], which divide all forces and make no weight."""
        made, ids = self._made_of, self.columns["id"]
        free, total = made["fixed"] == 0, made["mass"] + mass
        inverses = [np.where(free, 1.0 / whole, 0.0) for whole in (total, made["inertia"] + inertia)]
        made["inverses"], made["pull"] = np.column_stack(inverses), np.where(free, made["mass"] / total, 0.0)
        self.columns["row"][:, INVERSES], self.columns["pull"][:] = made["inverses"][ids], made["pull"][ids]

    def are_as_made(self) -> bool:
        """True if the held grains are as heavy and as large as those of the scene, and discs move in their plane: no
        step changes that.
        """
        ids, made, row = self.columns["id"], self._made_of, self.columns["row"]
        found = {name: self.columns[name] for name in ("mass", "inertia", "fixed", "pull")}
        found |= {"radius": row[:, 3], "inverses": row[:, INVERSES]}
        planar = self.dimensions == 3 or not row[:, OUT_OF_PLANE].any()
        return planar and all(np.array_equal(values, made[name][ids]) for name, values in found.items())

    def take(self, ids: NDArray[np.int64], arrays: Mapping[str, NDArray]) -> None:
        """Collective: these grains instead of those of this rank; `settle` next."""
        if self.replicated:
            ids, arrays = np.arange(self.number), {name: self._gathered(arrays[name]) for name in STATE}
        self._laid_out = False
        self.columns = {name: np.zeros((len(ids), *shape), dtype) for name, (dtype, shape) in self._types.items()}
        self.columns["id"][:] = ids
        for name in STATE:
            self.columns[name][:] = arrays[name]

    def all_springs(self, springs: Springs) -> Springs:
        """Collective: the springs of either grain of this rank's `part`, of those that a state has at the smaller
        number; those of all where ranks hold all grains.
        """
        keys, values = springs
        if self.replicated:
            return self._gathered(keys), self._gathered(values)
        self._round += 1
        ends = [high for _, high in block_ranges(self.number, self.world.size)]
        others = np.searchsorted(ends, keys[:, 1], side="right")  # beyond the last rank: walls
        loose = {}
        for peer in set(others.tolist()) & (set(range(self.world.size)) - {self.world.rank}):
            loose[peer] = pack_rows({"key": keys, "value": values}, others == peer)
        return self._with_others(springs, loose)

    def _gathered(self, part: NDArray) -> NDArray:
        """Rows of all ranks, in rank order, on all ranks."""
        whole = self.world.gather_rows(part)
        content = self.world.bcast(None if whole is None else whole.tobytes())
        return np.frombuffer(content, part.dtype).reshape(-1, *part.shape[1:])
