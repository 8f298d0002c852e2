"""Records (opaque bytes, as particles) to their new ranks, at any distance.

Nearly all records go to the previous or the next slab, in letters of a fixed size: messages sent by a task graph that
need no count before them (a letter's empty half costs less than a message more). What goes farther or does not fit
travels in a second, general round, which takes place only if any rank wants it. All learn that in log2(ranks) rounds of
small messages that go with the letters (dissemination: Hensgen, Finkel & Manber 1988).
"""

from collections.abc import Hashable, Iterable, Mapping, Sequence

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from hpcpic.core.comm.messages import Message, Messages
from hpcpic.core.comm.tags import Channel, tag
from hpcpic.core.comm.world import World
from hpcpic.core.simd.compile import njit
from hpcpic.core.space.domain import ring_neighbours
from hpcpic.core.space.fields import ALIGNMENT, aligned_zeros
from hpcpic.core.tasks.graph import Graph, bind

Records = NDArray[np.uint8]  # [n, record_bytes]


def send_anywhere(world: World, outgoing: Mapping[int, Records], record_bytes: int, label: int) -> list[Records]:
    """Collective: records to any ranks, oneself too; arrivals in rank order, none empty."""
    counts = np.zeros(world.size, np.int64)
    for peer, records in outgoing.items():
        counts[peer] = len(records)
    own = [outgoing[world.rank]] if counts[world.rank] else []
    if world.size == 1:
        return own
    expected = np.empty_like(counts)
    world.comm.Alltoall(counts, expected)
    arrived: dict[int, Records] = {world.rank: own[0]} if own else {}
    requests = []
    for peer in np.flatnonzero(expected).tolist():
        if peer != world.rank:
            arrived[peer] = np.empty((expected[peer], record_bytes), np.uint8)
            requests.append(world.comm.Irecv(arrived[peer], peer, label))
    for peer in np.flatnonzero(counts).tolist():
        if peer != world.rank:
            records = np.ascontiguousarray(outgoing[peer])
            requests.append(world.comm.Isend(records, peer, label))
    MPI.Request.Waitall(requests)
    return [arrived[peer] for peer in sorted(arrived)]


class Letter:
    """A message of a fixed size: how many records it holds, n[0], and records[capacity, record_bytes]."""

    def __init__(self, capacity: int, record_bytes: int) -> None:
        self.bytes = aligned_zeros((ALIGNMENT + capacity * record_bytes,), np.uint8)
        self.n = self.bytes[:8].view(np.int64)
        self.records: Records = self.bytes[ALIGNMENT:].reshape(capacity, record_bytes)


@njit
def join(mine, theirs):
    """mine[0] or theirs[0]."""
    mine[0] |= theirs[0]


class Migrate:
    """Records to their new ranks: letters to the neighbours, and `rest` for what is not in them.

    In a task graph: tasks fill `outgoing` and set wants[0] to 1 if records are
    left over, for ranks that are no neighbours or because a letter is full, else to 0; others read `incoming`. Then
    wants[0] tells whether any rank has records left over. `send` does it all for records that are at hand.
    peers: the next ranks with rows by `cuts`, all ranks having some without it. capacity: records of a letter.
    """

    def __init__(
        self,
        world: World,
        record_bytes: int,
        channel: Channel,
        *,
        cuts: Sequence[int] | None = None,
        capacity: int = 16,
    ) -> None:
        self._world, self._record_bytes, self._channel = world, record_bytes, channel
        self.peers = ring_neighbours(cuts or range(world.size + 1), world.rank)
        self.wants = np.zeros(1, np.int64)
        self._heard = [np.zeros(1, np.int64) for _ in range((world.size - 1).bit_length())]
        self._rounds: list[Messages] = []
        self._allocate(capacity)

    def _allocate(self, capacity: int) -> None:
        self.free()
        self.capacity = capacity
        self.incoming, self.outgoing = (
            [Letter(capacity, self._record_bytes) for _ in self.peers] for _ in ("incoming", "outgoing")
        )
        self._rounds = self._connect()

    def _connect(self) -> list[Messages]:
        """The messages of each round; the letters go with the first."""
        comm, rank, size = self._world.comm, self._world.rank, self._world.size
        sends, receives = (
            [Message(peer, self._channel, letter.bytes) for peer, letter in zip(self.peers, letters)]
            for letters in (self.outgoing, self.incoming)
        )
        rounds = []
        for k, heard in enumerate(self._heard):  # after round k one has heard of the 2^(k + 1) - 1 ranks before
            receives.append(Message((rank - 2**k) % size, self._channel.wanted, heard))
            sends.append(Message((rank + 2**k) % size, self._channel.wanted, self.wants))
            rounds.append(Messages(comm, sends=sends, receives=receives))
            sends, receives = [], []
        return rounds

    def add_to(self, graph: Graph, *, written: Iterable[Hashable], arrived: Hashable) -> None:
        """Messages for a task graph: from letters and wants, `written`, to letters, `arrived`, and wants.

        Call `at(iteration)` before every launch. Compiles.
        """
        sent = [*written]
        for k, (messages, heard) in enumerate(zip(self._rounds, self._heard)):
            graph.message(messages, ins=sent, outs=[("heard", k), *([] if k else [arrived])], name=f"migration {k}")
            graph.task(bind(join, mine=self.wants, theirs=heard), ins=[("heard", k)], inouts=["wants"], priority=1)
            sent = ["wants"]

    def at(self, iteration: int) -> None:
        """Tell the messages which iteration the next launch is."""
        for messages in self._rounds:
            messages.at(iteration)

    def send(self, iteration: int, outgoing: Mapping[int, Records]) -> list[Records]:
        """Collective, without a task graph: records to any ranks but this one; arrivals, valid until the next call."""
        left = dict(outgoing)
        for peer, letter in zip(self.peers, self.outgoing):
            records = left.pop(peer, letter.records[:0])
            n = letter.n[0] = min(len(records), self.capacity)
            letter.records[:n] = records[:n]
            if n < len(records):
                left[peer] = records[n:]
        self.wants[0] = bool(left)
        self.at(iteration)
        for messages, heard in zip(self._rounds, self._heard):
            messages.start()
            messages.wait()
            self.wants |= heard
        arrived = [letter.records[: letter.n[0]] for letter in self.incoming]
        return arrived + (self.rest(iteration, left) if self.wants[0] else [])

    def rest(self, iteration: int, outgoing: Mapping[int, Records]) -> list[Records]:
        """Collective, when wants[0] is set: all that is not in the letters; letters grow to hold what neighbours got.

        Arrivals as `send_anywhere`. The letters are new ones when `capacity` has changed.
        """
        sent = [int(letter.n[0]) + len(outgoing.get(peer, ())) for peer, letter in zip(self.peers, self.outgoing)]
        most = int(self._world.max(max(sent, default=0)))
        label = tag(iteration, self._channel.far)
        arrived = send_anywhere(self._world, outgoing, self._record_bytes, label)
        if most > self.capacity:
            self._allocate(most + most // 4)
        return arrived

    def free(self) -> None:
        """Withdraw receives that nothing has matched; no migration may be under way."""
        for messages in self._rounds:
            messages.free()
        self._rounds = []
