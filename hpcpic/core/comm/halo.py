"""Ghost layers: `Fill` copies owners' values into ghosts, `Fold` (its adjoint) adds ghosts to their owners.

Rows of the slab axis travel as messages, whole and packed; the ghosts of other periodic axes are copied in
the rank. Filling goes through the axes in order and folding in reverse order, so that corners come right.
Ghosts beyond a wall (an axis that is not periodic) are not filled, and what they hold is dropped by a fold.
"""

from abc import ABC, abstractmethod
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from hpcpic.core.comm.layers import ADD, CLEAR, COPY, PACK, UNPACK, UNPACK_ADD, Kernel
from hpcpic.core.comm.requests import RequestSet
from hpcpic.core.comm.tags import tag
from hpcpic.core.comm.world import World
from hpcpic.core.space.domain import Domain
from hpcpic.core.space.fields import ALIGNMENT, Field, aligned_zeros
from hpcpic.core.tasks.graph import Graph, bind


@dataclass(frozen=True, slots=True)
class Share:
    """What two ranks have to do with each other, as layers of the rank's own array (its ghosts counted).

    sources: inner layers that the peer keeps as ghosts; ghosts: layers that the peer owns. The k-th source
    here is the k-th ghost there.
    """

    sources: NDArray[np.int64]
    ghosts: NDArray[np.int64]


def _ghost_layers(
    cuts: Sequence[int], periodic: bool, rank: int, below: int, above: int
) -> list[tuple[int, int]]:
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


class _Buffer:
    """A packed message: an int64 iteration on the first cache line, then `layers` layers [before, after]."""

    def __init__(self, n_layers: int, layers: NDArray) -> None:
        before, _, after = layers.shape
        n_bytes = n_layers * before * after * layers.itemsize
        self.bytes = aligned_zeros((ALIGNMENT + n_bytes,), np.uint8)
        self.header = self.bytes[:8].view(np.int64)
        self.body = self.bytes[ALIGNMENT:].view(layers.dtype).reshape(n_layers, before, after)


class _Leg:
    """The messages to and from one peer: layers out and layers in, buffers for even and odd iterations."""

    def __init__(self, peer: int, out: NDArray[np.int64], into: NDArray[np.int64], layers: NDArray) -> None:
        self.peer, self.out, self.into = peer, out, into
        self.send = [_Buffer(len(out), layers) for _ in range(2)]
        self.receive = [_Buffer(len(into), layers) for _ in range(2)]

    def requests(self, comm: MPI.Comm, parity: int, channel: int) -> list[MPI.Prequest]:
        """The receive first, so that the message finds its place."""
        label = tag(parity, channel)
        made = []
        if len(self.into):
            made.append(comm.Recv_init(self.receive[parity].bytes, self.peer, label))
        if len(self.out):
            made.append(comm.Send_init(self.send[parity].bytes, self.peer, label))
        return made


class _Operation(NamedTuple):
    """A kernel call of an exchange, what it reads and what it changes: "inner", "ghosts" or a message."""

    kernel: Kernel
    arguments: tuple
    ins: tuple[str, ...]
    inouts: tuple[str, ...]


class Exchange(ABC):
    """What Fill and Fold have in common: legs, persistent requests by parity of the iteration, counters.

    messages, bytes: sent by this rank in one exchange. A message of another iteration is an error (the code
    WRONG_ITERATION in a task). One exchange of an object may be under way at a time.
    """

    def __init__(self, world: World, domain: Domain, field: Field, channel: int) -> None:
        self._iteration = np.zeros(1, np.int64)
        self._layers = field.layers(0)
        self._width = field.ghosts[0]
        plan = halo_plan(domain.cuts, domain.periodic[0], world.rank, *self._width)
        self._own = plan.pop(world.rank, _NOTHING)
        self._legs = [_Leg(peer, *self._ends(share), self._layers) for peer, share in plan.items()]
        self._requests = [
            RequestSet([r for leg in self._legs for r in leg.requests(world.comm, parity, channel)])
            for parity in range(2)
        ]
        self._sides: list[tuple[NDArray, tuple[int, int], Share]] = []  # the axes whose ghosts are copies
        for axis in range(1, domain.ndim):
            plan = halo_plan((0, domain.points[axis]), domain.periodic[axis], 0, *field.ghosts[axis])
            self._sides.append((field.layers(axis), field.ghosts[axis], plan.get(0, _NOTHING)))
        self._first = [self._before(parity) for parity in range(2)]
        self._last = [self._after(parity) for parity in range(2)]
        self.messages = sum(len(leg.out) > 0 for leg in self._legs)
        self.bytes = sum(leg.send[0].bytes.nbytes for leg in self._legs if len(leg.out))

    @staticmethod
    @abstractmethod
    def _ends(share: Share) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The layers that go out, and the layers that what comes in belongs to."""

    @abstractmethod
    def _before(self, parity: int) -> list[_Operation]:
        """What is done before the messages go."""

    @abstractmethod
    def _after(self, parity: int) -> list[_Operation]:
        """What is done when they have come."""

    def _packs(self, parity: int, reads: str) -> list[_Operation]:
        packs = []
        for leg in self._legs:
            if len(leg.out):
                buffer = leg.send[parity]
                arguments = (self._layers, leg.out, buffer.body, buffer.header, self._iteration)
                packs.append(_Operation(PACK, arguments, (reads,), (f"to {leg.peer}",)))
        return packs

    def _unpacks(self, parity: int, kernel: Kernel, writes: str) -> list[_Operation]:
        """In the order of ranks, so that sums of floats are repeatable."""
        unpacks = []
        for leg in self._legs:
            if len(leg.into):
                buffer = leg.receive[parity]
                arguments = (self._layers, leg.into, buffer.body, buffer.header, self._iteration)
                unpacks.append(_Operation(kernel, arguments, ("received",), (writes,)))
        return unpacks

    def add_to(
        self,
        graph: Graph,
        handle: Hashable,
        *,
        inner: Iterable[Hashable] = (),
        ghosts: Iterable[Hashable] = (),
        parity: int = 0,
    ) -> None:
        """Put the exchange into a task graph: pack, messages as a node, unpack.

        inner, ghosts: handles of these parts of the field, for both `handle` when not given. In two graphs
        that run in turn an exchange takes a parity each. Call `at(iteration)` before every launch. Compiles.
        """
        parts = {"inner": list(inner) or [handle], "ghosts": list(ghosts) or [handle]}
        requests = self._requests[parity]

        def handles(names: Iterable[str]) -> list[Hashable]:
            return [h for name in names for h in parts.get(name, [(id(requests), name)])]

        def add(operations: Iterable[_Operation]) -> None:
            for kernel, arguments, ins, inouts in operations:
                name = f"{type(self).__name__.lower()} {handle}: {kernel.compiled.__name__}"
                if kernel in (UNPACK, UNPACK_ADD):
                    name += " (1: a message of another iteration)"
                bound = bind(kernel.compiled, *arguments)
                graph.task(bound, ins=handles(ins), inouts=handles(inouts), priority=1, name=name)

        add(self._first[parity])
        if len(requests):
            packed = handles(f"to {leg.peer}" for leg in self._legs)
            name = f"{type(self).__name__.lower()} {handle}: ranks {[leg.peer for leg in self._legs]}"
            graph.message(requests, ins=packed, outs=handles(["received"]), name=name)
        add(self._last[parity])

    def at(self, iteration: int) -> None:
        """Tell the tasks made by `add_to` which iteration the next launch is."""
        self._iteration[0] = iteration

    def free(self) -> None:
        """Release the persistent requests; no exchange may be under way."""
        for requests in self._requests:
            requests.free()


class Fill(Exchange):
    """Owner to ghost: at `finish` the ghosts are what their owners' values were at `start`."""

    @staticmethod
    def _ends(share: Share) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        return share.sources, share.ghosts

    def _before(self, parity: int) -> list[_Operation]:
        own = _Operation(COPY, (self._layers, self._own.sources, self._own.ghosts), ("inner",), ("ghosts",))
        return [own, *self._packs(parity, "inner")]

    def _after(self, parity: int) -> list[_Operation]:
        sides = [
            _Operation(COPY, (layers, share.sources, share.ghosts), ("inner",), ("ghosts",))
            for layers, _, share in self._sides
        ]
        return [*self._unpacks(parity, UNPACK, "ghosts"), *sides]

    def start(self, iteration: int) -> None:
        """Without a task graph: pack and send. Until `finish` leave the ghosts alone."""
        self._iteration[0] = iteration
        for operation in self._first[iteration % 2]:
            operation.kernel.plain(*operation.arguments)
        self._requests[iteration % 2].start()

    def finish(self) -> None:
        """Wait for the messages and put what they bring where it belongs."""
        iteration = int(self._iteration[0])
        self._requests[iteration % 2].wait()
        for operation in self._last[iteration % 2]:
            code = operation.kernel.plain(*operation.arguments)
            assert not code, f"got a message that is not of iteration {iteration}"


class Fold(Exchange):
    """Ghost to owner, adding: the adjoint of Fill. Ghosts are zero after it; integers add exactly."""

    @staticmethod
    def _ends(share: Share) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        return share.ghosts, share.sources

    def _before(self, parity: int) -> list[_Operation]:
        sides: list[_Operation] = []
        for layers, width, share in reversed(self._sides):
            sides += [_adding(layers, share), _clearing(layers, width)]
        packs = self._packs(parity, "ghosts")
        return [*sides, _adding(self._layers, self._own), *packs, _clearing(self._layers, self._width)]

    def _after(self, parity: int) -> list[_Operation]:
        return self._unpacks(parity, UNPACK_ADD, "inner")


def _adding(layers: NDArray, share: Share) -> _Operation:
    return _Operation(ADD, (layers, share.sources, share.ghosts), ("ghosts",), ("inner", "ghosts"))


def _clearing(layers: NDArray, width: tuple[int, int]) -> _Operation:
    return _Operation(CLEAR, (layers, *width), (), ("ghosts",))
