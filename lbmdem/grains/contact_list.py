"""The list of pairs that may touch: grains and grains, grains and walls."""

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.world import World
from lbmdem.grains.room import Room
from lbmdem.kernels.grains import search
from lbmdem.kernels.grains.contact_forces import LANES
from lbmdem.physics.contact_law import Law

Springs = tuple[NDArray[np.int64], NDArray[np.float64]]  # ids [m, 2] (smaller first), tangential springs [m, 3] m


def _padded(n: int) -> int:
    return -(-n // LANES) * LANES


class ContactList:
    """Slots of all pairs within a margin: near grains, then farther ones, then walls; each part in whole vectors.

    low, high: rows of the two (of the plane for walls); lines, springs, busy: see kernels.contacts.
    """

    def __init__(self, n_walls: int, history: bool) -> None:
        self.n_walls, self.history = n_walls, history
        self._others = np.empty(0, np.int64)
        self.n_grain_slots = self.n_slots = 0
        self.keys = np.zeros((0, 2), np.int64)
        self.room = Room()
        self.springs = np.zeros(3 * LANES)

    def build(
        self,
        rows: NDArray,
        ids: NDArray[np.int64],
        inverse_mass: NDArray,
        n_own: int,
        margin: float,
        lengths: NDArray,
        inverses: NDArray,
        walls: NDArray,
        number: int,
        law: Law,
        springs: Springs,
    ) -> None:
        """Pairs of the n_own first grains with any of ids.size, and of walls; inverse_mass: 0 for fixed grains."""
        n = ids.size
        begins = self._find(rows, ids, n_own, margin, lengths, inverses)
        others = self._others[: begins[-1]]
        found = np.empty((0, 2), np.int64)
        for _ in range(2):
            m = search.near_walls(rows, n_own, margin, walls, self.n_walls, found)
            found = np.empty((m, 2), np.int64) if m > len(found) else found
        near = 0.1 * margin
        close, far = search.count_slots(rows, ids, n_own, near, lengths, inverses, begins, others)
        self.n_near = _padded(close)
        self.n_grain_slots = self.n_near + _padded(far)
        self.n_slots = self.n_grain_slots + _padded(len(found))
        self.low, self.high = (self.room.rows(name, self.n_slots, np.int32) for name in ("low", "high"))
        self.low[:], self.high[:] = n, n
        slots = np.empty(begins[-1], np.int64)
        search.number_slots(
            rows, ids, n_own, near, lengths, inverses, begins, others, 0, self.n_near, self.low, self.high, slots
        )
        at = slice(self.n_grain_slots, self.n_grain_slots + len(found))
        self.high[self.n_grain_slots :] = self.n_walls
        self.low[at], self.high[at] = found.T
        self.begins = self.room.rows("begins", n_own + 1, np.int64)
        self.slots = self.room.rows("slots", len(slots) + len(found), np.int64)
        search.join_walls(n_own, begins, slots, found, self.n_grain_slots, self.begins, self.slots)
        self._prepare(ids, inverse_mass, number, law, springs)

    def _find(self, rows, ids, n_own, margin, lengths, inverses) -> NDArray[np.int64]:
        n = ids.size
        size = (2.0 * float(rows[:n, 3].max()) + margin) if n else 1.0
        shape = np.where(inverses > 0.0, np.maximum(1, np.floor(lengths / size)), 0).astype(np.int64)
        shape[(inverses == 0.0) & (lengths == 0.0)] = 1  # the third axis of a plane
        place, chain = np.empty((n, 3), np.int64), np.empty(n, np.int64)
        head = np.empty(1 << max(4, (2 * n).bit_length()), np.int64)
        search.locate(rows, n, size, shape, inverses, place, head, chain)
        begins = np.zeros(n_own + 1, np.int64)
        for _ in range(2):
            wanted = search.neighbours(
                rows, ids, n_own, n, margin, lengths, inverses, shape, place, head, chain, begins, self._others
            )
            if wanted <= self._others.size:
                break
            self._others = np.empty(wanted + wanted // 8 + 64, np.int64)
        return begins

    def _prepare(self, ids, inverse_mass, number, law, springs) -> None:
        """Arrays of the slots, dashpots, and the springs of contacts that were there before."""
        self.lines = self.room.rows("lines", self.n_slots, shape=(LANES,))
        busy = self.room.rows("busy", self.n_slots // LANES, np.uint8)
        self.lines[:], busy[:] = 0.0, 0
        self.damping = self.room.rows("damping", self.n_slots)
        inverse = np.append(inverse_mass, np.nan)
        total = inverse[self.low]
        total[: self.n_grain_slots] += inverse[self.high[: self.n_grain_slots]]
        self.damping[:] = 2.0 * law.damping * np.sqrt(law.stiffness / total)
        if not self.history:
            return
        named = np.append(ids, number + self.n_walls)  # whom padding names
        self.keys = np.stack([named[self.low], number + self.high.astype(np.int64)], 1)
        self.keys[: self.n_grain_slots, 1] = named[self.high[: self.n_grain_slots]]
        if len(self.springs) < 3 * self.n_slots:
            self.springs = np.zeros(3 * len(self.room.whole["low"]))
        self.spring_columns[:] = 0.0
        old, values = springs
        if len(old) and self.n_slots:
            base = number + self.n_walls + 1
            wanted, known = self.keys @ [base, 1], old @ [base, 1]
            order = np.argsort(known, kind="stable")
            at = np.minimum(np.searchsorted(known[order], wanted), len(order) - 1)
            same = known[order][at] == wanted
            self.spring_columns[:, same] = values[order[at[same]]].T

    @property
    def spring_columns(self) -> NDArray[np.float64]:
        """View [3, slots] of the tangential springs."""
        return self.springs.reshape(3, -1)[:, : self.n_slots]

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
        if not self.history:
            return np.zeros((0, 2), np.int64), np.zeros((0, 3))
        values = self.spring_columns.T
        some = np.flatnonzero(values.any(axis=1))
        return self.keys[some], values[some]
