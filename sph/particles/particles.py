"""The bodies of one rank in the order of their cells: its own particles, fluid and wall, ghosts of others and images.

A ghost is a body seen through a map x -> turn x + shift: the identity for those next to a slab, shifts for
periodic sides, reflections for walls that mirror. The owner of a particle knows who needs which of its images.
"""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.ghosts import Refresh
from hpcpic.core.comm.migrate import Migrate
from hpcpic.core.comm.tags import Channel
from hpcpic.core.comm.world import World
from hpcpic.core.errors import ConfigError
from hpcpic.core.space.domain import Domain
from hpcpic.core.tasks.arena import Arena
from sph.kernels import readings
from sph.kernels.groups import OldState, Shown, State, Turns
from sph.kernels.marks import BODY, CODES, FLOWS, FLUID, OWN, REAL, WALL_BITS
from sph.particles.images import Maps

VECTOR = 16  # slots behind the last one that vectors may touch
PADS = 2  # layers and rows outside the domain, for walls and images
MOST = 2**31 * 7 // 8  # bodies of a rank: their slots are int32
IMAGES_REACH = 4  # layers from a body to where its image, but for a period, is looked for; with one to spare


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
    """Columns of n own particles and of ghosts, in slots below `end`; where flags are 0 nobody is.

    x, v, gradient, offset [d, capacity], shear, matrix [d d, capacity], drho, m [capacity]; key int64 (number of the
    particle CODES + image), flags int32 [capacity]. x, v, drho, m, key are lines of one array, state. Columns in
    `without` are empty. What comes is put behind all others, until the cells give it a slot.
    """

    def __init__(self, world: World, arena: Arena, motion: Any, d: int, maps: Maps) -> None:
        self.world, self.arena, self.motion, self.d, self.maps = world, arena, motion, d, maps
        arena.group(y=State, y_old=OldState, shown=Shown)
        self.n = self.end = 0
        self._name_lines()
        self._found: dict[str, Any] = {}  # rows that were asked for since the last sort
        self._ghosts = self._rows = self._codes = np.zeros(0, np.int64)
        self._refresh = Refresh(world, Channel.GHOSTS_VALUES)
        self._record = np.dtype([("numbers", np.float64, 2 * d + 2), ("id", np.int64), ("flags", np.int64)])
        self._migrate = Migrate(world, self._record.itemsize, Channel.PARTICLES)
        self._shift = np.zeros((0, d))
        self.moved = 0

    def _name_lines(self) -> None:
        """The lines of the state by name, here and in the arena."""
        state, d = self.arena["state"], self.d
        self.state, self.flags = state, self.arena["flags"]
        self.x, self.v, self.drho, self.m = state[:d], state[d : 2 * d], state[2 * d], state[2 * d + 1]
        self.key: NDArray[np.int64] = state[2 * d + 2].view(np.int64)
        self.arena.set(x=self.x, v=self.v, drho=self.drho, m=self.m, key=self.key)

    @property
    def rows(self) -> NDArray[np.int64]:
        """Slots of the own particles."""
        return self._find("own", lambda: np.flatnonzero(self.flags[: self.end] & OWN))

    @property
    def fluid(self) -> NDArray[np.int64]:
        """Slots of the own particles of the fluid."""
        return self._find("fluid", lambda: np.flatnonzero(self.flags[: self.end] & (OWN | FLUID) == OWN | FLUID))

    def number(self, row: int) -> int:
        """Of a particle."""
        return int(self.key[row] // CODES)

    def _find(self, what: str, find: Callable[[], Any]) -> Any:
        if what not in self._found:
            self._found[what] = find()
        return self._found[what]

    def own(self, name: str) -> NDArray:
        """Copy of a column, own particles only: [n] or [d, n]; "id": their numbers, "wall": 1 + number of their wall, 0
        for fluid.
        """
        if name in ("id", "wall"):
            return self.key[self.rows] // CODES >> (WALL_BITS if name == "wall" else 0)
        return self.arena[name][..., self.rows]

    def put(self, name: str, values: NDArray | float) -> None:
        """A column of the own particles."""
        self.arena[name][..., self.rows] = values

    @property
    def id(self) -> NDArray[np.int64]:
        """Numbers of the own particles."""
        return self.own("id")

    def reserve(self, capacity: int) -> bool:
        """Make room for so many slots. Whether there was none, so that arrays are elsewhere now."""
        slots = capacity + VECTOR
        if slots > MOST:
            raise ConfigError([f"{slots:.3g} particles on a rank, more than {MOST}: more ranks"])
        moved = self.arena.reserve(slots=slots)
        if moved:
            self._name_lines()
        return moved

    def clear(self) -> None:
        """No bodies."""
        self.flags[:] = 0
        self.n = self.end = 0
        self._ghosts = self._ghosts[:0]
        self._found.clear()

    def of_walls(self, wanted: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Slots of the bodies of the walls wanted[wall], images in them too, and of which wall each is."""
        return self._find("walls", lambda: self._look_for_walls(wanted))

    def _look_for_walls(self, wanted: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        images, none = np.array(self.maps.wall), np.zeros(0, np.int64)
        here = self.end, self.flags, self.key, images, wanted
        n = readings.of_walls(*here, none, none)
        slots, walls = np.empty((2, n), np.int64)
        readings.of_walls(*here, slots, walls)
        return slots, walls

    def append(self, x: NDArray, v: NDArray, drho: NDArray, m: NDArray, ids: NDArray, flags: NDArray | int) -> None:
        """Add own particles, x and v [d, k]."""
        rows = self._behind(len(ids))
        for name, values in (("x", x), ("v", v), ("drho", drho), ("m", m), ("flags", flags | BODY | OWN)):
            self.arena[name][..., rows] = values
        self.key[rows] = np.asarray(ids, np.int64) * CODES
        self.n += len(ids)

    def _behind(self, k: int) -> NDArray[np.int64]:
        """k new rows behind all others."""
        self._found.clear()
        self.reserve(self.end + k)
        self.end += k
        return np.arange(self.end - k, self.end)

    def sorted(self, place: NDArray[np.int32], end: int) -> None:
        """What was at row k is at place[k] now."""
        self._found.clear()
        self.flags[end : max(end, self.end)] = 0
        self.end = end
        self._rows, self._ghosts = (place[rows].astype(np.int64) for rows in (self._rows, self._ghosts))

    def remove(self, rows: NDArray[np.int64]) -> None:
        """Own particles are here no more."""
        self.flags[rows] = 0
        self.n -= len(rows)
        self._found.clear()

    # ---- between ranks

    def migrate(self, iteration: int, owners: NDArray[np.int64]) -> None:
        """The own particle at row k goes to rank owners[k]; forgets the ghosts. Collective."""
        self.forget_ghosts()
        if self.world.size == 1:
            return
        own = self.rows
        leaving = own[owners[own] != self.world.rank]
        peers = owners[leaving]
        outgoing = {int(peer): self._pack(leaving[peers == peer]) for peer in np.unique(peers)}
        self.remove(leaving)
        for records in self._migrate.send(iteration, outgoing):
            rows = np.ascontiguousarray(records).reshape(-1).view(self._record)
            numbers, d = rows["numbers"].T, self.d
            self.append(numbers[:d], numbers[d : 2 * d], numbers[2 * d], numbers[2 * d + 1], rows["id"], rows["flags"])
        self._found.clear()
        self.moved += len(leaving)

    def free(self) -> None:
        """Release what MPI holds (all ranks together)."""
        self._migrate.free()

    def _pack(self, index: NDArray) -> NDArray[np.uint8]:
        records = np.empty(len(index), self._record)
        records["numbers"] = self.state[: 2 * self.d + 2, index].T
        records["id"], records["flags"] = self.key[index] // CODES, self.flags[index]
        return records.view(np.uint8).reshape(len(index), -1)

    def forget_ghosts(self) -> None:
        """Nobody is where ghosts were."""
        self.flags[self._ghosts] = 0
        self._ghosts = self._rows = self._codes = self._ghosts[:0]
        self._found.clear()

    def choose_ghosts(self, layer: NDArray, layer_of: Callable, slabs: Slabs) -> None:
        """Who is seen where from now on: layer[end], not negative for own particles. Collective."""
        rows, codes = self._imaged(layer)
        self.forget_ghosts()
        if slabs.peers:
            beside = np.flatnonzero(slabs.beside[layer] & (layer >= 0))
            rows, codes = np.concatenate([beside, rows]), np.concatenate([np.zeros_like(beside), codes])
        if self.world.size == 1 and not len(rows):
            return
        shift = self.maps.shifts(codes, self.x[:, rows])
        members = {self.world.rank: np.arange(len(rows))}
        if slabs.peers:
            at = np.sum(self.maps.turns[codes, 0] * self.x[:, rows].T, axis=1) + shift[:, 0]
            members = self._seen_by(np.where(codes > 0, layer_of(at), layer[rows]), codes > 0, slabs)
        order = np.concatenate(list(members.values()))
        self._rows, self._codes, self._shift = rows[order], codes[order], shift[order]
        ends = np.cumsum([0, *map(len, members.values())])
        places = {peer: np.arange(*span) for peer, span in zip(members, pairwise(ends))}
        self._ghosts = self._behind(self._refresh.choose(places, slabs.peers))
        self._identify()

    def _imaged(self, layer: NDArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Rows of own particles, and their images; most often not many more than the last time."""
        room, bounds = len(self._rows) + len(self._rows) // 8, self.maps.bounds
        while True:
            rows, codes = np.empty((2, room), np.int64)
            n = self.motion.imaged(layer, self.x, *bounds, rows, codes)
            if n <= room:
                return rows[:n], codes[:n]
            room = n

    def _seen_by(self, at: NDArray, image: NDArray[np.bool_], slabs: Slabs) -> dict[int, NDArray[np.int64]]:
        """By rank, which of those in or beside its layers it has as ghosts (at[n]: layers), images only of its own."""
        members, last = {}, len(slabs.owner) - 1
        for peer in sorted({*slabs.peers, self.world.rank}):
            seen = np.zeros(len(at), bool)
            for near in (at - 1, at, at + 1):
                seen |= slabs.owner[np.clip(near, 0, last)] == peer
            members[peer] = np.flatnonzero(seen if peer != self.world.rank else seen & image)
        return members

    def _identify(self) -> None:
        """What of the ghosts does not change with time."""
        mirrored = np.array(self.maps.mirrored)[self._codes]
        flags = self.flags[self._rows] & ~OWN
        flags = np.where(self._codes > 0, flags & ~REAL, flags) & ~np.where(mirrored, FLOWS, 0)
        sent = np.stack([self.key[self._rows] + self._codes, flags, self.m[self._rows].view(np.int64)], axis=1)
        self._refresh.start(0, sent)
        got = self._refresh.finish()
        self.key[self._ghosts], self.flags[self._ghosts] = got[:, 0], got[:, 1]
        self.m[self._ghosts] = np.ascontiguousarray(got[:, 2]).view(np.float64)

    def refresh(self, iteration: int) -> None:
        """Ghosts' x, v, drho and gradient as they are now. Collective."""
        if self.world.size == 1 and not len(self._ghosts):
            return
        shown, maps = self.arena.value("shown"), self.maps
        kept = sum(len(lines) for lines in (shown.gradient, shown.shear, shown.matrix) if lines.size)
        values = np.empty((len(self._rows), 2 * self.d + 1 + kept))
        turns = Turns(maps.turns, maps.spin, maps.push)
        self.motion.ghost_values(self._rows, self._codes, self._shift, turns, shown, values)
        self._refresh.start(iteration, values)
        self.motion.take_ghosts(self._refresh.finish(), self._ghosts, shown)
