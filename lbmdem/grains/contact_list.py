"""The list of pairs that may touch: grains and grains, grains and walls."""

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.world import World
from hpcpic.core.physics.contact_law import ContactLaw
from hpcpic.core.tasks.arena import Arena
from lbmdem.kernels.grains import search
from lbmdem.kernels.grains.arrays import Cells
from lbmdem.physics.contact_law import LANES

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
        for kernel in (search.locate, search.neighbours, search.near_walls, search.count_slots, search.number_slots):
            arena.ask(kernel, rows="row")
        arena.ask(search.join_walls)
        self.n_grain_slots = self.n_slots = 0
        self.keys = np.zeros((0, 2), np.int64)

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
        arena.set(ids=ids, n_own=n_own, margin=margin, near=0.1 * margin, firsts=np.zeros(n_own + 1, np.int64))
        others = self._find(n)
        found = np.empty((0, 2), np.int64)
        for _ in range(2):
            m = arena.call(search.near_walls, rows="row", found=found)
            found = np.empty((m, 2), np.int64) if m > len(found) else found
        close, far = arena.call(search.count_slots, rows="row", others=others)
        n_near = _padded(close)
        self.n_grain_slots = n_near + _padded(far)
        self.n_slots = self.n_grain_slots + _padded(len(found))
        arena.reserve(slots=self.n_slots, entries=len(others) + len(found))
        self.low[:], self.high[:] = n, n
        slots, columns = np.empty(len(others), np.int64), {"low": self.low, "high": self.high}
        arena.call(search.number_slots, rows="row", others=others, far=n_near, slots=slots, **columns)
        of_walls = slice(self.n_grain_slots, self.n_grain_slots + len(found))
        self.high[self.n_grain_slots :] = self.n_walls
        self.low[of_walls], self.high[of_walls] = found.T
        arena.call(search.join_walls, slots=slots, found=found, first_slot=self.n_grain_slots)
        self._prepare(ids, inverse_mass, springs)

    def _find(self, n: int) -> NDArray[np.int64]:
        """Neighbours of own grains among n, one after the other; `firsts` says where those of each begin."""
        arena, box = self.arena, self.arena.value("box")
        size = (2.0 * float(arena["row"][:n, 3].max()) + arena["margin"]) if n else 1.0
        shape = np.where(box.inverses > 0.0, np.clip(np.floor(box.lengths / size), 1, max(n, 1)), 0).astype(np.int64)
        shape[(box.inverses == 0.0) & (box.lengths == 0.0)] = 1  # the third axis of a plane
        arena.set(cells=_cells(shape, n))
        arena.call(search.locate, rows="row", size=size)
        for _ in range(2):
            wanted = arena.call(search.neighbours, rows="row")
            if wanted <= arena["others"].size:
                break
            arena.set(others=np.empty(wanted + wanted // 8 + 64, np.int64))
        return arena["others"][: arena["firsts"][-1]]

    def _prepare(self, ids: NDArray[np.int64], inverse_mass: NDArray, springs: Springs) -> None:
        """Clear the lines, and set dashpots and the springs of contacts that were there before."""
        self.lines[:] = 0.0
        self.arena["busy"][: self.n_slots // LANES] = 0
        inverse = np.append(inverse_mass, np.nan)
        total = inverse[self.low]
        total[: self.n_grain_slots] += inverse[self.high[: self.n_grain_slots]]
        self.arena["damping"][: self.n_slots] = 2.0 * self.law.damping * np.sqrt(self.law.stiffness / total)
        if not self.remembers:
            return
        named = np.append(ids, self.number + self.n_walls)  # whom padding names
        self.keys = np.stack([named[self.low], self.number + self.high.astype(np.int64)], 1)
        self.keys[: self.n_grain_slots, 1] = named[self.high[: self.n_grain_slots]]
        self.springs[:] = 0.0
        old, values = springs
        if len(old) and self.n_slots:
            base = self.number + self.n_walls + 1
            wanted, known = self.keys @ [base, 1], old @ [base, 1]
            order = np.argsort(known, kind="stable")
            at = np.minimum(np.searchsorted(known[order], wanted), len(order) - 1)
            same = known[order][at] == wanted
            self.springs[:, same] = values[order[at[same]]].T

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
        values = self.springs.T
        kept = np.flatnonzero(values.any(axis=1))
        return self.keys[kept], values[kept]
