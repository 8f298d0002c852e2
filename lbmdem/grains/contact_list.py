"""The list of pairs that may touch: grains and grains, grains and walls."""

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.world import World
from hpcpic.core.physics.contact_law import ContactLaw
from hpcpic.core.tasks.arena import Arena
from lbmdem.kernels.grains import search
from lbmdem.kernels.grains.arrays import Cells
from lbmdem.sizes import LANES

Springs = tuple[NDArray[np.int64], NDArray[np.float64]]  # ids [m, 2] (smaller first), tangential springs [m, 3] m


def _padded(n: int) -> int:
    return -(-n // LANES) * LANES


def _cells(shape: NDArray[np.int64], n: int) -> Cells:
    """Room for n grains, one to two buckets for each (not fewer than cells along a periodic axis), and whole vectors
    from any grain on.
    """
    place, begins = np.empty((n, 3), np.int64), np.empty((1 << n.bit_length()) + 1, np.int64)
    return Cells(shape, place, begins, np.empty(n, np.int64), np.empty(n + LANES, np.int64), np.empty((4, n + LANES)))


class ContactList:
    """Slots of all pairs within a margin: near grains, then farther ones, then walls; each part in whole vectors.

    The arrays of the slots are those of `grains.arrays.CONTACTS`; the views `low`, `high`, `lines` hold the n_slots
    that are in use. number: grains of all ranks; n_walls: walls. remembers: the law has tangential springs.
    """

    def __init__(self, arena: Arena, number: int, n_walls: int, law: ContactLaw) -> None:
        self.arena, self.number, self.n_walls, self.law = arena, number, n_walls, law
        self.remembers = law.shear > 0.0
        none, pairs = np.empty(0, np.int64), np.empty((0, 2), np.int64)
        arena.set(ids=none, firsts=none, others=none, slots=none, found=pairs, size=0.0, margin=0.0)
        arena.set(cells=_cells(np.zeros(3, np.int64), 0))
        arena.set(near=0.0, far=0, n_own=0, first_slot=0, n_walls=n_walls)
        arena.set(inverse=np.empty(0), named=none, keys=pairs, values=np.empty((0, 3)), n_grain_slots=0)
        for kernel in (search.locate, search.neighbours, search.near_walls):
            arena.ask(kernel, rows="row")
        for kernel in (search.number_slots, search.join_walls, search.set_dashpots):
            arena.ask(kernel)
        if self.remembers:
            arena.ask(search.recall_springs, first_wall=number)
        self.n_grain_slots = self.n_slots = self.builds = 0

    @property
    def low(self) -> NDArray[np.int32]:
        return self.arena["low"][: self.n_slots]

    @property
    def high(self) -> NDArray[np.int32]:
        return self.arena["high"][: self.n_slots]

    @property
    def lines(self) -> NDArray[np.float64]:
        return self.arena["lines"][: self.n_slots]

    @property
    def springs(self) -> NDArray[np.float64]:
        """Tangential springs [3, n_slots], m."""
        return self.arena["springs"][:, : self.n_slots]

    def build(self, ids: NDArray[np.int64], inverse_mass: NDArray, n_own: int, margin: float, springs: Springs) -> None:
        """List the pairs of the n_own first grains with any of ids.size, and with walls.

        margin: greatest gap, m; inverse_mass: 0 for fixed grains; springs: of contacts that were there before.
        """
        n, arena = ids.size, self.arena
        self.builds += 1
        arena.set(ids=ids, n_own=n_own, margin=margin, near=0.1 * margin, firsts=np.zeros(n_own + 1, np.int64))
        close, far = self._find(n)
        found = np.empty((0, 2), np.int64)
        for _ in range(2):
            m = arena.call(search.near_walls, rows="row", found=found)
            found = np.empty((m, 2), np.int64) if m > len(found) else found
        n_near = _padded(close)
        self.n_grain_slots = n_near + _padded(far)
        self.n_slots = self.n_grain_slots + _padded(len(found))
        entries = int(arena["firsts"][-1])
        filmed = self.n_slots if arena.value("film").cut_off else 0
        arena.reserve(slots=self.n_slots, filmed=filmed, entries=entries + len(found))
        self.low[:], self.high[:] = n, n
        slots = np.empty(entries, np.int64)
        arena.call(search.number_slots, far=n_near, slots=slots)
        of_walls = slice(self.n_grain_slots, self.n_grain_slots + len(found))
        self.high[self.n_grain_slots :] = self.n_walls
        self.low[of_walls], self.high[of_walls] = found.T
        arena.call(search.join_walls, slots=slots, found=found, first_slot=self.n_grain_slots)
        self._prepare(ids, inverse_mass, springs)

    def _find(self, n: int) -> tuple[int, int]:
        """Find the neighbours of own grains among n: "others", one after the other, where "firsts" says; how many pairs
        are close, and how many are not."""
        arena, box = self.arena, self.arena.value("box")
        size = (2.0 * float(arena["row"][:n, 3].max()) + arena["margin"]) if n else 1.0
        shape = np.where(box.inverses > 0.0, np.clip(np.floor(box.lengths / size), 1, max(n, 1)), 0).astype(np.int64)
        shape[(box.inverses == 0.0) & (box.lengths == 0.0)] = 1  # the third axis of a plane
        arena.set(cells=_cells(shape, n))
        arena.call(search.locate, rows="row", size=size)
        for _ in range(2):
            wanted, close, far = arena.call(search.neighbours, rows="row")
            if wanted <= arena["others"].size:
                break
            arena.set(others=np.empty(wanted + wanted // 8 + 64, np.int64))
        return close, far

    def _prepare(self, ids: NDArray[np.int64], inverse_mass: NDArray, springs: Springs) -> None:
        """Set dashpots and the springs of contacts that were there before; lines of those that do not touch are zero
        when forces have been found.
        """
        self.arena["busy"][: self.n_slots // LANES] = 1
        nobody = self.number + self.n_walls  # whom padding names
        self.arena.set(n_grain_slots=self.n_grain_slots, named=np.append(ids, nobody))
        slots = {"low": self.low, "high": self.high}
        self.arena.call(search.set_dashpots, inverse=np.append(inverse_mass, np.nan), **slots)
        if self.remembers:
            keys, values = springs
            self.arena.call(search.recall_springs, first_wall=self.number, keys=keys, values=values, **slots)

    def by_grain(self, own: NDArray[np.int64], world: World) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Collective: partner[len(own), k] ids in order (-1: none) and spring[len(own), k, 3], at the smaller id."""
        keys, values = self.stretched()
        order = np.lexsort((keys[:, 1], keys[:, 0]))
        keys, values = keys[order], values[order]
        sorter = np.argsort(own)
        at = np.minimum(np.searchsorted(own[sorter], keys[:, 0]), max(len(own) - 1, 0))
        mine = own[sorter[at]] == keys[:, 0] if len(own) else np.zeros(0, bool)
        keys, values, rows = keys[mine], values[mine], sorter[at[mine]]
        first = np.searchsorted(keys[:, 0], keys[:, 0])
        place = np.arange(len(keys)) - first
        most = int(world.max(float(place.max(initial=-1) + 1)))
        partner, spring = np.full((len(own), most), -1), np.zeros((len(own), most, 3))
        partner[rows, place], spring[rows, place] = keys[:, 1], values
        return partner, spring

    def stretched(self) -> Springs:
        """Ids and springs of all pairs whose spring is not zero."""
        if not self.remembers:
            return np.zeros((0, 2), np.int64), np.zeros((0, 3))
        x, y, z = self.springs != 0.0
        kept = np.flatnonzero(x | y | z)
        low, high, named = self.low[kept], self.high[kept], self.arena["named"]
        of_grains = kept < self.n_grain_slots
        second = np.where(of_grains, named[np.where(of_grains, high, 0)], self.number + high)
        return np.stack([named[low], second], 1), np.ascontiguousarray(self.springs[:, kept].T)
