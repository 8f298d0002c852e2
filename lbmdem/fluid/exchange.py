"""Populations that cross from slab to slab: five of nineteen (three of nine) each way, sent from where they are."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.pieces import Parcel, Pieces
from hpcpic.core.comm.tags import Channel
from hpcpic.core.comm.world import World
from hpcpic.core.space.domain import Domain
from hpcpic.core.space.fields import aligned_zeros
from hpcpic.core.tasks.arena import Arena
from hpcpic.core.tasks.graph import Bound
from lbmdem.kernels.layout import Layout, storage_order
from lbmdem.kernels.node_kinds import receive


def neighbours(domain: Domain, rank: int) -> tuple[int | None, int | None]:
    """The ranks that own the planes below and above the slab; None beyond a face or without planes."""
    full = [r for r in range(domain.ranks) if domain.cuts[r + 1] > domain.cuts[r]]
    if rank not in full or len(full) == 1:
        return None, None
    at, last = full.index(rank), len(full) - 1
    below = full[at - 1] if at or domain.periodic[0] else None
    above = full[(at + 1) % len(full)] if at < last or domain.periodic[0] else None
    return below, above


def tell_iteration(messages: Sequence[Pieces], iteration: int) -> None:
    """messages[iteration % 2] go first, at this iteration; the others at the next."""
    for later in range(2):
        messages[(iteration + later) % 2].messages.at(iteration + later)


class Exchange:
    """After the collision of a step that began at parity p: `messages[p]`, then the tasks `unpacks[p]`."""

    def __init__(self, world: World, domain: Domain, layout: Layout, arena: Arena) -> None:
        below, above = neighbours(domain, world.rank)
        self.open = (below is not None, above is not None)
        self._layout, self._arena, self._slots = layout, arena, arena["populations"]
        crossing = [(i, j) for i, j in layout.lattice.pairs if storage_order(layout.lattice, i)[0]]
        self._moves = np.array([storage_order(layout.lattice, i)[1:] for i, _ in crossing], np.int64)
        self.messages: list[Pieces] = []
        self.unpacks: list[list[Bound]] = []
        for parity in range(2):
            low = np.array([i + parity for i, _ in crossing], np.int64)
            high = np.array([j - parity for _, j in crossing], np.int64)
            sends, receives, unpacks = [], [], []
            if above is not None:
                buffer = self._buffer(len(crossing))
                sends.append(Parcel(above, Channel.POPULATIONS_UP, self._plane(high, layout.planes)))
                receives.append(Parcel(above, Channel.POPULATIONS_DOWN, [buffer]))
                unpacks.append(self._unpack(buffer, low, layout.planes, layout.planes + 1, 1))
            if below is not None:
                buffer = self._buffer(len(crossing))
                sends.append(Parcel(below, Channel.POPULATIONS_DOWN, self._plane(low, 0)))
                receives.append(Parcel(below, Channel.POPULATIONS_UP, [buffer]))
                unpacks.append(self._unpack(buffer, high, 0, 0, -1))
            self.messages.append(Pieces(world, sends, receives, stride=2))
            self.unpacks.append(unpacks)

    @property
    def width(self) -> int:
        """Elements of a plane with what its rows have before the first and after the last."""
        return self._layout.plane_stride + self._layout.lanes

    def _buffer(self, slots: int) -> NDArray:
        return aligned_zeros((slots, self.width), self._slots.dtype)

    def _plane(self, slots: NDArray[np.int64], plane: int) -> list[NDArray]:
        start = plane * self._layout.plane_stride
        return [self._slots[slot, start : start + self.width] for slot in slots]

    def _unpack(self, buffer: NDArray, slots: NDArray, plane: int, beyond: int, sign: int) -> Bound:
        place = {"slots": slots, "moves": self._moves, "plane": plane, "beyond": beyond, "sign": sign}
        return self._arena.bind(receive, buffer=buffer, **place)

    def at(self, iteration: int) -> None:
        """The next launch begins at this iteration."""
        tell_iteration(self.messages, iteration)

    def free(self) -> None:
        for pieces in self.messages:
            pieces.free()
