"""The bodies of one rank: its own particles, fluid and wall, and behind them ghosts of others and images.

A ghost is a body seen through a map x -> turn x + shift: the identity for those next to a slab, shifts for
periodic sides, reflections for walls that mirror. The owner of a particle knows who needs which of its images.
"""

import inspect
from collections.abc import Callable, Container, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.ghosts import Refresh
from hpcpic.core.comm.migrate import Migrate
from hpcpic.core.comm.tags import Channel
from hpcpic.core.comm.world import World
from hpcpic.core.errors import ConfigError
from hpcpic.core.space.domain import Domain
from hpcpic.core.tasks import Bound, Pool, bind
from sph.images import CODES, Maps
from sph.workspace import Workspace

FLUID, REAL, MIRRORED, REPULSIVE = 1, 2, 4, 8  # flags
PADS = 2  # layers and rows outside the domain, for walls and images
MOST = 2**28  # bodies of a rank: kernels.packing counts their bytes in int32
SLACK = 16  # one body more for so many, when there is no room
IMAGES_REACH = 4  # layers from a body to where its image, but for a period, is looked for; with one to spare


class Tasks:
    """Kernels run by the pool on arrays found by the names of their arguments."""

    def __init__(self, pool: Pool, parts: int) -> None:
        self.pool, self.parts = pool, parts
        self.arrays: dict[str, Any] = {}
        self._bound: dict[Any, list[Bound]] = {}
        self.workspace = Workspace(self)

    def set(self, **arrays: Any) -> None:
        """Name arrays; a new array for a name makes all tasks be bound again."""
        self.arrays.update(arrays)
        self._bound.clear()

    def each(self, kernel: Callable, **more: Any) -> None:
        """The kernel for every part (its first argument); `more`: arguments that are numbers, or other names."""
        key = (kernel, *more.items())
        if key not in self._bound:
            self._bound[key] = [bind(kernel, part, *self._arguments(kernel, more)) for part in range(self.parts)]
        self.pool.each(self._bound[key])

    def call(self, kernel: Callable, **more: Any) -> Any:
        """The kernel once, from here, with all its arguments by name."""
        return kernel(*self._arguments(kernel, more, 0))

    def _arguments(self, kernel: Any, more: Mapping[str, Any], skip: int = 1) -> list[Any]:
        names = list(inspect.signature(kernel.py_func).parameters)[skip:]
        values = (more.get(name, name) for name in names)
        return [self.arrays[value] if isinstance(value, str) else value for value in values]


def even(n: int, parts: int) -> NDArray[np.int64]:
    """parts + 1 bounds of n items."""
    return np.arange(parts + 1) * n // parts


class Slabs:
    """Who owns the layers of cells, known for a set of cuts: owner[layer]; beside[layer]: its own layers next to those
    of other ranks; peers: the other ranks that a body of this one, or an image of it, may be a ghost of, and the other
    way round. around: one end of the domain lies beside the other.
    """

    def __init__(self, domain: Domain, world: World, around: bool) -> None:
        layers, me = domain.points[0], world.rank
        self.domain, self.peers = domain, list[int]()
        self.beside = np.broadcast_to(False, layers)
        self.owner = np.broadcast_to(0, layers)  # many in a large tank: one rank owns them all, without a list
        if world.size == 1:
            return
        self.owner = np.asarray(domain.owner(np.arange(layers)))
        ends = np.concatenate([self.owner[:1], self.owner, self.owner[-1:]])
        self.beside = (ends[:-2] != me) | (ends[2:] != me)
        mine = np.flatnonzero(self.owner == me)
        if len(mine):
            self.peers = self._near(mine[0], mine[-1], around, me)

    def _near(self, first: int, last: int, around: bool, me: int) -> list[int]:
        near = self.owner[max(first - IMAGES_REACH, 0) : last + IMAGES_REACH + 1]
        if around:
            ends = self.owner[: IMAGES_REACH + PADS], self.owner[-IMAGES_REACH - PADS :]
            for here, there in (ends, ends[::-1]):
                if me in here:
                    near = np.concatenate([near, there])
        return [int(peer) for peer in np.unique(near) if peer != me]


class Bodies:
    """Columns of n own particles and g ghosts behind them.

    x, v, a, gradient, normal, offset [d, capacity], shear, matrix [d d, capacity], drho, m, rate [capacity]; key int64
    (number of the particle CODES + image), flags, wall int32 [capacity]. wall: number of the wall + 1, 0 for fluid.
    Columns in `without` are empty.
    """

    LINES = ("x", "v", "a", "gradient", "x_old", "v_old", "normal", "offset")
    COLUMNS = ("drho", "m", "rate", "drho_old")
    WHOLE = (("key", np.int64), ("flags", np.int32), ("wall", np.int32))
    STATE = ("x", "v", "drho", "m", "key", "flags", "wall", "normal")

    def __init__(self, world: World, tasks: Tasks, motion: Any, d: int, maps: Maps, without: Container[str]) -> None:
        self.world, self.tasks, self.motion, self.d, self.maps = world, tasks, motion, d, maps
        self.without = without  # columns that nobody needs
        self.n = self.ghosts = self.capacity = 0
        self.columns: dict[str, NDArray] = {}
        self._lines: dict[str, list[str]] = {}  # names of the lines of each column
        self._of_wall: dict[int, NDArray[np.int64]] = {}
        self._kept = [name for name in self.STATE if name not in without]
        self.reserve(1024)
        self._refresh = Refresh(world, Channel.GHOSTS_VALUES)
        self._record = np.dtype([("numbers", np.float64, 3 * d + 2), ("id", np.int64), ("flags", np.int32, 2)])
        self._migrate = Migrate(world, self._record.itemsize, Channel.PARTICLES)
        self._rows = self._codes = np.zeros(0, np.int64)
        self._shift = np.zeros((0, d))
        self.moved = 0

    def __getattr__(self, name: str) -> NDArray:
        try:
            return self.__dict__["columns"][name]
        except KeyError:
            raise AttributeError(name) from None

    def own(self, name: str) -> NDArray:
        """View of a column, own particles only: [n] or [d, n]; "id": their numbers, a copy."""
        return self.key[: self.n] // CODES if name == "id" else self.columns[name][..., : self.n]

    @property
    def id(self) -> NDArray[np.int64]:
        """Numbers of the own particles."""
        return self.own("id")

    def reserve(self, capacity: int) -> None:
        """Room for `capacity` bodies."""
        if capacity <= self.capacity:
            return
        capacity += capacity // SLACK + 16  # vectors may overrun
        if capacity > MOST:
            raise ConfigError([f"{capacity:.3g} particles on a rank, more than {MOST}: more ranks"])
        shapes = {name: ((self.d, capacity), np.dtype(float)) for name in self.LINES}
        shapes |= {name: ((capacity,), np.dtype(float)) for name in self.COLUMNS}
        shapes |= {name: ((self.d**2, capacity), np.dtype(float)) for name in ("shear", "matrix")}
        shapes |= {name: ((capacity,), np.dtype(kind)) for name, kind in self.WHOLE}
        for name, (shape, kind) in shapes.items():
            if name in self.without:
                shape = (*shape[:-1], 0)
            fresh = np.zeros(shape, kind)
            if name in self.columns and fresh.size:
                fresh[..., : self.n + self.ghosts] = self.columns[name][..., : self.n + self.ghosts]
            self.columns[name] = fresh
        self.capacity = capacity
        self.tasks.set(**self.columns)
        for name in self._kept:
            lines = {f"{name}[{k}]": line for k, line in enumerate(np.atleast_2d(self.columns[name]))}
            self._lines[name] = list(lines)
            self.tasks.set(**lines)

    def clear(self) -> None:
        """No bodies."""
        self.n = self.ghosts = 0
        self._of_wall.clear()

    def of_wall(self, number: int) -> NDArray[np.int64]:
        """Rows of the bodies of a wall, ghosts too; found again when there are others."""
        if number not in self._of_wall:
            self._of_wall[number] = np.flatnonzero(self.wall[: self.n + self.ghosts] == number + 1)
        return self._of_wall[number]

    def append(
        self, x: NDArray, v: NDArray, drho: NDArray, m: NDArray, ids: NDArray, flags: NDArray | int,
        wall: NDArray | int, normal: NDArray | None = None,
    ) -> None:  # fmt: skip
        """Add own particles, x, v and normal [d, k]; forgets the ghosts."""
        self.ghosts = 0
        self._of_wall.clear()
        k = len(ids)
        self.reserve(self.n + k)
        rows = slice(self.n, self.n + k)
        for name, values in (("x", x), ("v", v), ("drho", drho), ("m", m), ("flags", flags), ("wall", wall)):
            self.columns[name][..., rows] = values
        if "normal" not in self.without:
            self.columns["normal"][:, rows] = 0.0 if normal is None else normal
        self.columns["key"][rows] = np.asarray(ids, np.int64) * CODES
        for name in {"a", "rate", "gradient"} - set(self.without):
            self.columns[name][..., rows] = 0.0
        self.n += k

    def sort(self, order: NDArray) -> None:
        """Own particles in another order, for locality alone; their rates and what is in the workspace are lost."""
        self._of_wall.clear()
        order_kind = {"order": ((self.capacity,), np.int32)}
        for name in self._kept:
            kind = self.columns[name].dtype
            moved = f"moved {kind}"
            self.tasks.workspace.need(moved, **order_kind, **{moved: ((self.capacity,), kind.type)})
            self.tasks.arrays["order"][: self.n] = order
            for line in self._lines[name]:
                self.tasks.each(self.motion.pick, chunks="own_chunks", line=line, moved=moved)
                self.tasks.each(self.motion.put, chunks="own_chunks", line=line, moved=moved)

    # ---- between ranks

    def migrate(self, iteration: int, owners: NDArray[np.int64]) -> None:
        """Own particle k goes to rank owners[k]; forgets the ghosts. Collective."""
        self.ghosts = 0
        if self.world.size == 1:
            return
        leaving = np.flatnonzero(owners != self.world.rank)
        peers = owners[leaving]
        outgoing = {int(peer): self._pack(leaving[peers == peer]) for peer in np.unique(peers)}
        self._remove(leaving)
        self._migrate.start(iteration, outgoing)
        for records in self._migrate.finish():
            rows = np.ascontiguousarray(records).reshape(-1).view(self._record)
            numbers, d = rows["numbers"].T, self.d
            self.append(
                numbers[:d], numbers[d : 2 * d], numbers[2 * d], numbers[2 * d + 1], rows["id"],
                rows["flags"][:, 0], rows["flags"][:, 1], None if "normal" in self.without else numbers[2 * d + 2 :],
            )  # fmt: skip
        self.moved += len(leaving)

    def _pack(self, index: NDArray) -> NDArray[np.uint8]:
        records, d = np.empty(len(index), self._record), self.d
        records["numbers"][:, :d] = self.x[:, index].T
        records["numbers"][:, d : 2 * d] = self.v[:, index].T
        records["numbers"][:, 2 * d], records["numbers"][:, 2 * d + 1] = self.drho[index], self.m[index]
        if "normal" not in self.without:
            records["numbers"][:, 2 * d + 2 :] = self.normal[:, index].T
        records["id"] = self.key[index] // CODES
        records["flags"][:, 0], records["flags"][:, 1] = self.flags[index], self.wall[index]
        return records.view(np.uint8).reshape(len(index), -1)

    def _remove(self, gone: NDArray) -> None:
        """Take particles out; the last ones move into their places."""
        self._of_wall.clear()
        left = self.n - len(gone)
        holes = gone[gone < left]
        movers = np.setdiff1d(np.arange(left, self.n), gone)
        for name in self._kept:
            self.columns[name][..., holes] = self.columns[name][..., movers]
        self.n = left

    def choose_ghosts(self, layer: NDArray, layer_of: Callable, slabs: Slabs) -> None:
        """Who is seen where from now on: layer[n] of the own particles. Collective."""
        if self.ghosts:
            self._of_wall.clear()
        self.ghosts = 0
        rows, codes, peers, shifts = [], [], [], []
        owner, me = slabs.owner, self.world.rank
        for k in range(len(self.maps.planes)):
            if k:
                index = self.maps.chosen(k, self.own("x"))
            else:
                index = np.flatnonzero(slabs.beside[layer]) if slabs.peers else np.arange(0)
            if not len(index):
                continue
            shift = self.maps.shifts(k, self.x[:, index])
            at = layer[index] if k == 0 else layer_of(self.maps.turned(k)[0] @ self.x[:, index] + shift[:, 0])
            for peer in sorted({*slabs.peers, *([me] if k else [])}):
                seen = np.zeros(len(index), bool)
                for step in (-1, 0, 1):
                    near = at + step
                    seen |= (owner[np.clip(near, 0, len(owner) - 1)] == peer)
                chosen = index[seen]
                rows.append(chosen)
                codes.append(np.full(len(chosen), k))
                peers.append(np.full(len(chosen), peer))
                shifts.append(shift[seen])
        none = np.zeros(0, np.int64)
        self._rows, self._codes, peer = (np.concatenate([*part, none]) for part in (rows, codes, peers))
        if self.world.size == 1 and not len(self._rows):
            return
        order = np.argsort(peer, kind="stable")
        self._shift = np.concatenate([*shifts, np.zeros((0, self.d))])[order]
        self._rows, self._codes, peer = self._rows[order], self._codes[order], peer[order]
        members = {int(p): np.flatnonzero(peer == p) for p in np.unique(peer)}
        ghosts = self._refresh.choose(members, slabs.peers)
        self.reserve(self.n + ghosts)
        self.ghosts = ghosts
        self._identify()

    def _identify(self) -> None:
        """What of the ghosts does not change with time."""
        if self.ghosts:
            self._of_wall.clear()
        mirrored = np.array(self.maps.mirrored)[self._codes]
        flags = self.flags[self._rows]
        flags = np.where(self._codes > 0, flags & ~REAL, flags) | np.where(mirrored, MIRRORED, 0)
        sent = np.zeros((len(self._rows), 3 + self.d), np.int64)
        if "normal" not in self.without:
            sent[:, 3:] = self.normal[:, self._rows].T.copy().view(np.int64)
        sent[:, 0] = self.key[self._rows] + self._codes
        sent[:, 1], sent[:, 2] = flags, self.m[self._rows].view(np.int64)
        self._refresh.start(0, sent)
        got = self._refresh.finish()
        ghosts = slice(self.n, self.n + self.ghosts)
        self.key[ghosts], self.flags[ghosts] = got[:, 0], got[:, 1]
        self.m[ghosts] = np.ascontiguousarray(got[:, 2]).view(np.float64)
        self.wall[ghosts] = np.array(self.maps.wall)[got[:, 0] % CODES]
        if "normal" not in self.without:
            self.normal[:, ghosts] = np.ascontiguousarray(got[:, 3:]).view(np.float64).T

    def refresh(self, iteration: int) -> None:
        """Ghosts' x, v, drho and gradient as they are now. Collective."""
        if self.world.size == 1 and not self.ghosts:
            return
        sizes = {"gradient": self.d, "shear": self.d**2, "matrix": self.d**2}
        extra = sum(size for name, size in sizes.items() if name not in self.without)
        values, maps = np.empty((len(self._rows), 2 * self.d + 1 + extra)), self.maps
        turns = np.array([maps.turned(k) for k in range(len(maps.planes))])
        self.motion.ghost_values(
            self._rows, self._codes, turns, self._shift, maps.spin, maps.push, self.x, self.v, self.drho,
            self.gradient, self.shear, self.matrix, values,
        )  # fmt: skip
        self._refresh.start(iteration, values)
        ghosts = self._refresh.finish()
        self.motion.take_ghosts(ghosts, self.n, self.x, self.v, self.drho, self.gradient, self.shear, self.matrix)
