"""Ghost layers: `Fill` copies owners' values into ghosts, `Fold` (its adjoint) adds ghosts to their owners.

Rows of the slab axis travel as messages, whole and packed; the ghosts of other periodic axes are copied in
the rank. Filling goes through the axes in order and folding in reverse order, so that corners come right.
Ghosts beyond a wall (an axis that is not periodic) are not filled, and what they hold is dropped by a fold.
"""

from abc import ABC, abstractmethod
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.layers import ADD, CLEAR, COPY, PACK, UNPACK, UNPACK_ADD, Kernel
from hpcpic.core.comm.messages import Message, Messages
from hpcpic.core.comm.world import World
from hpcpic.core.space.domain import Domain
from hpcpic.core.space.fields import Field, aligned_zeros
from hpcpic.core.tasks.graph import Graph, bind


@dataclass(frozen=True, slots=True)
class Share:
    """The layers that two ranks exchange, as layers of the rank's own array (its ghosts counted).

    sources: inner layers that the peer keeps as ghosts; ghosts: layers that the peer owns. The k-th source
    here is the k-th ghost there.
    """

    sources: NDArray[np.int64]
    ghosts: NDArray[np.int64]


def _ghost_layers(cuts: Sequence[int], periodic: bool, rank: int, below: int, above: int) -> list[tuple[int, int]]:
    """(layer, global row) of each ghost of the rank that has an owner."""
    low, high, n = cuts[rank], cuts[rank + 1], cuts[-1]
    rows = [*range(low - below, low), *range(high, high + above)]
    layers = [row - low + below for row in rows]
    return [(layer, row % n) for layer, row in zip(layers, rows) if periodic or 0 <= row < n]


_NOTHING = Share(np.zeros(0, np.int64), np.zeros(0, np.int64))


def halo_plan(cuts: Sequence[int], periodic: bool, rank: int, below: int, above: int) -> dict[int, Share]:
    """Who shares which layers with `rank`; the rank itself is among them when it is its own neighbour.

    For any widths and cuts: owners may be several slabs away, slabs may be empty.
    """
    ranks = len(cuts) - 1
    ends = np.asarray(cuts[1:])
    sources: dict[int, list[int]] = {}
    ghosts: dict[int, list[int]] = {}
    for peer in range(ranks):
        for layer, row in _ghost_layers(cuts, periodic, peer, below, above):
            owner = int(np.searchsorted(ends, row, side="right"))
            if owner == rank:
                sources.setdefault(peer, []).append(row - cuts[rank] + below)
            if peer == rank:
                ghosts.setdefault(owner, []).append(layer)
    return {
        peer: Share(np.array(sources.get(peer, []), np.int64), np.array(ghosts.get(peer, []), np.int64))
        for peer in sorted(sources.keys() | ghosts.keys())
    }


def _packed(n_layers: int, layers: NDArray) -> NDArray:
    """Memory of a message: [n_layers, before, after]."""
    before, _, after = layers.shape
    return aligned_zeros((n_layers, before, after), layers.dtype)


class _Leg:
    """The messages to and from one peer: layers out and layers in."""

    def __init__(self, peer: int, out: NDArray[np.int64], into: NDArray[np.int64], layers: NDArray) -> None:
        self.peer, self.out, self.into = peer, out, into
        self.send, self.receive = _packed(len(out), layers), _packed(len(into), layers)


class _Operation(NamedTuple):
    """A kernel call of an exchange, what it reads and what it changes: "inner", "ghosts" or a message."""

    kernel: Kernel
    arrays: dict[str, Any]
    ins: tuple[str, ...]
    inouts: tuple[str, ...]


class Exchange(ABC):
    """An exchange of layers: the messages and operations that Fill and Fold share.

    sent, bytes: messages of this rank in one exchange, which must not be under way twice at a time.
    """

    def __init__(self, world: World, domain: Domain, field: Field, channel: int) -> None:
        self._layers = field.layers(0)
        self._width = field.ghosts[0]
        plan = halo_plan(domain.cuts, domain.periodic[0], world.rank, *self._width)
        self._own = plan.pop(world.rank, _NOTHING)
        self._legs = [_Leg(peer, *self._ends(share), self._layers) for peer, share in plan.items()]
        self._messages = Messages(
            world.comm,
            sends=[Message(leg.peer, channel, leg.send) for leg in self._legs if len(leg.out)],
            receives=[Message(leg.peer, channel, leg.receive) for leg in self._legs if len(leg.into)],
        )
        self._sides: list[tuple[NDArray, tuple[int, int], Share]] = []  # the axes whose ghosts are copies
        for axis in range(1, domain.ndim):
            plan = halo_plan((0, domain.points[axis]), domain.periodic[axis], 0, *field.ghosts[axis])
            self._sides.append((field.layers(axis), field.ghosts[axis], plan.get(0, _NOTHING)))
        self._first, self._last = self._before(), self._after()
        self.sent = sum(len(leg.out) > 0 for leg in self._legs)
        self.bytes = sum(leg.send.nbytes for leg in self._legs if len(leg.out))

    @staticmethod
    @abstractmethod
    def _ends(share: Share) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The layers that go out, and the layers that what comes in belongs to."""

    @abstractmethod
    def _before(self) -> list[_Operation]:
        """The operations before the messages are sent."""

    @abstractmethod
    def _after(self) -> list[_Operation]:
        """The operations when the messages have arrived."""

    def _packs(self, reads: str) -> list[_Operation]:
        packs = []
        for leg in self._legs:
            if len(leg.out):
                arrays = {"layers": self._layers, "out": leg.out, "body": leg.send}
                packs.append(_Operation(PACK, arrays, (reads,), (f"to {leg.peer}",)))
        return packs

    def _unpacks(self, kernel: Kernel, writes: str) -> list[_Operation]:
        """In the order of ranks, so that sums of floats are repeatable."""
        unpacks = []
        for leg in self._legs:
            if len(leg.into):
                arrays = {"layers": self._layers, "into": leg.into, "body": leg.receive}
                unpacks.append(_Operation(kernel, arrays, ("received",), (writes,)))
        return unpacks

    def add_to(
        self,
        graph: Graph,
        handle: Hashable,
        *,
        inner: Iterable[Hashable] = (),
        ghosts: Iterable[Hashable] = (),
    ) -> None:
        """Put the exchange into a task graph: pack, messages as a node, unpack.

        inner, ghosts: handles of these parts of the field, for both `handle` when not given. Call `at(iteration)`
        before every launch. Compiles.
        """
        parts = {"inner": list(inner) or [handle], "ghosts": list(ghosts) or [handle]}

        def handles(names: Iterable[str]) -> list[Hashable]:
            return [h for name in names for h in parts.get(name, [(id(self), name)])]

        def add(operations: Iterable[_Operation]) -> None:
            for kernel, arrays, ins, inouts in operations:
                name = f"{type(self).__name__.lower()} {handle}: {kernel.compiled.__name__}"
                bound = bind(kernel.compiled, **arrays)
                graph.task(bound, ins=handles(ins), inouts=handles(inouts), priority=1, name=name)

        add(self._first)
        if len(self._messages):
            packed = handles(f"to {leg.peer}" for leg in self._legs)
            name = f"{type(self).__name__.lower()} {handle}: ranks {[leg.peer for leg in self._legs]}"
            graph.message(self._messages, ins=packed, outs=handles(["received"]), name=name)
        add(self._last)

    def at(self, iteration: int) -> None:
        """Tell the tasks made by `add_to` which iteration the next launch is."""
        self._messages.at(iteration)

    def free(self) -> None:
        """Withdraw receives that nothing has matched; no exchange may be under way."""
        self._messages.free()


class Fill(Exchange):
    """Owner to ghost: at `finish` the ghosts are what their owners' values were at `start`."""

    @staticmethod
    def _ends(share: Share) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        return share.sources, share.ghosts

    def _before(self) -> list[_Operation]:
        return [_copying(self._layers, self._own), *self._packs("inner")]

    def _after(self) -> list[_Operation]:
        sides = [_copying(layers, share) for layers, _, share in self._sides]
        return [*self._unpacks(UNPACK, "ghosts"), *sides]

    def start(self, iteration: int) -> None:
        """Without a task graph: pack and send. Until `finish` leave the ghosts alone."""
        self.at(iteration)
        for operation in self._first:
            operation.kernel.plain(**operation.arrays)
        self._messages.start()

    def finish(self) -> None:
        """Wait for the messages and put what they bring where it belongs."""
        self._messages.wait()
        for operation in self._last:
            operation.kernel.plain(**operation.arrays)


class Fold(Exchange):
    """Ghost to owner, adding: the adjoint of Fill. Ghosts are zero after it; integers add exactly."""

    @staticmethod
    def _ends(share: Share) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        return share.ghosts, share.sources

    def _before(self) -> list[_Operation]:
        sides: list[_Operation] = []
        for layers, width, share in reversed(self._sides):
            sides += [_adding(layers, share), _clearing(layers, width)]
        packs = self._packs("ghosts")
        return [*sides, _adding(self._layers, self._own), *packs, _clearing(self._layers, self._width)]

    def _after(self) -> list[_Operation]:
        return self._unpacks(UNPACK_ADD, "inner")


def _copying(layers: NDArray, share: Share) -> _Operation:
    arrays = {"layers": layers, "sources": share.sources, "ghosts": share.ghosts}
    return _Operation(COPY, arrays, ("inner",), ("ghosts",))


def _adding(layers: NDArray, share: Share) -> _Operation:
    arrays = {"layers": layers, "sources": share.sources, "ghosts": share.ghosts}
    return _Operation(ADD, arrays, ("ghosts",), ("inner", "ghosts"))


def _clearing(layers: NDArray, width: tuple[int, int]) -> _Operation:
    return _Operation(CLEAR, {"layers": layers, "below": width[0], "above": width[1]}, (), ("ghosts",))
