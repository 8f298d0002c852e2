"""Records (opaque bytes, as particles) to their new ranks, any distance; and rows of a field to new cuts.

Nearly all records go to the previous or the next slab. For these a receive of fixed capacity is posted, and
its length is read from the status: one message, no count before it. What goes farther or does not
fit travels in a second, general round, which takes place only if a reduction started with the first says so.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from hpcpic.core.comm.tags import Channel, tag
from hpcpic.core.comm.world import World
from hpcpic.core.space.domain import Domain, ring_neighbours
from hpcpic.core.space.fields import Field
from hpcpic.core.space.particles import Particles

Records = NDArray[np.uint8]  # [n, record_bytes]


def send_anywhere(
    world: World, outgoing: Mapping[int, Records], record_bytes: int, label: int
) -> list[Records]:
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


class Migrate:
    """Records to their new ranks. Collective: every rank calls start and finish.

    capacity: records of one message to a neighbour, the same on all ranks; grows when it was too small.
    cuts: slabs, so that neighbours are the next ranks with rows; without it all ranks count as such.
    moved, messages: records sent to other ranks and messages sent by this rank, since the start.
    """

    def __init__(
        self,
        world: World,
        record_bytes: int,
        channel: Channel,
        *,
        cuts: Sequence[int] | None = None,
        capacity: int = 1024,
    ) -> None:
        self._world = world
        self._record_bytes = record_bytes
        self._channel = channel
        self.moved = 0
        self.messages = 0
        self._neighbours = ring_neighbours(cuts or range(world.size + 1), world.rank)
        self._wants = np.zeros(2, np.int64)  # most records for one neighbour, and whether any go farther
        self._world_wants = np.zeros(2, np.int64)
        self._none = np.empty((0, record_bytes), np.uint8)
        self._status = [MPI.Status() for _ in range(2 * len(self._neighbours) + 1)]
        self._allocate(capacity)

    def _allocate(self, capacity: int) -> None:
        self.capacity = capacity
        self._incoming = [np.empty((capacity, self._record_bytes), np.uint8) for _ in self._neighbours]

    def start(self, iteration: int, outgoing: Mapping[int, Records]) -> None:
        """Send C-contiguous records, which must stay until `finish`; earlier arrivals are no longer valid."""
        comm, label, rank = self._world.comm, tag(iteration, self._channel), self._world.rank
        self._iteration = iteration
        self._own = [outgoing[rank]] if len(outgoing.get(rank, ())) else []
        if self._world.size == 1:
            return
        near = [(peer, outgoing.get(peer, self._none)) for peer in self._neighbours]
        self._far = {
            peer: r for peer, r in outgoing.items() if peer not in self._neighbours and peer != rank and len(r)
        }
        self.moved += sum(len(r) for _, r in near) + sum(map(len, self._far.values()))
        self.messages += len(near)
        self._wants[0], self._wants[1] = max((len(r) for _, r in near), default=0), bool(self._far)
        self._far |= {peer: r[self.capacity :] for peer, r in near if len(r) > self.capacity}
        # Few statements from here on: a step has left nothing of this in the caches.
        self._requests = [comm.Irecv(into, peer, label) for peer, into in zip(self._neighbours, self._incoming)]
        self._requests += [comm.Isend(r[: self.capacity], peer, label) for peer, r in near]
        self._requests.append(comm.Iallreduce(self._wants, self._world_wants, MPI.MAX))

    def finish(self) -> list[Records]:
        """Arrivals [n, record_bytes], none empty, valid until the next start; those to oneself first."""
        if self._world.size == 1:
            return self._own
        MPI.Request.Waitall(self._requests, self._status)
        counts = [status.Get_count(MPI.BYTE) // self._record_bytes for status in self._status[: len(self._incoming)]]
        arrived = [into[:n] for into, n in zip(self._incoming, counts) if n]
        most, farther = self._world_wants.tolist()
        if farther or most > self.capacity:
            self.messages += len(self._far)
            label = tag(self._iteration, self._channel.far)
            arrived += send_anywhere(self._world, self._far, self._record_bytes, label)
        if most > self.capacity:
            self._allocate(most + most // 4)  # `arrived` keeps the old buffers
        return self._own + arrived


def recut_field(world: World, field: Field, domain: Domain) -> Field:
    """Collective: the same inner values on the slabs of `domain`, in a new field whose ghosts are zero."""
    moved = field.like(domain)
    axis = len(field.leading)
    old, new = np.moveaxis(field.inner, axis, 0), np.moveaxis(moved.inner, axis, 0)
    row_bytes = 8 + int(np.prod(old.shape[1:], dtype=np.int64)) * field.dtype.itemsize
    owners = domain.owner(np.arange(*field.rows))
    outgoing = {}
    for peer in np.unique(owners):
        rows = np.flatnonzero(owners == peer)
        records = np.empty((len(rows), row_bytes), np.uint8)
        records[:, :8] = (rows + field.rows[0])[:, None].view(np.uint8)
        records[:, 8:] = np.ascontiguousarray(old[rows]).reshape(len(rows), -1).view(np.uint8)
        outgoing[int(peer)] = records
    for records in send_anywhere(world, outgoing, row_bytes, tag(0, Channel.RECUT)):
        rows = np.ascontiguousarray(records[:, :8]).view(np.int64)[:, 0] - moved.rows[0]
        values = np.ascontiguousarray(records[:, 8:]).view(field.dtype)
        new[rows] = values.reshape(len(rows), *new.shape[1:])
    return moved


def recut_particles(world: World, particles: Particles, owners: NDArray[np.int64]) -> None:
    """Collective: particle k goes to rank owners[k]."""
    leaving = np.flatnonzero(owners != world.rank)
    peers = owners[leaving]
    outgoing = {int(peer): particles.pack(leaving[peers == peer]) for peer in np.unique(peers)}
    particles.take(leaving)
    for records in send_anywhere(world, outgoing, particles.record_bytes, tag(0, Channel.RECUT)):
        particles.append(particles.unpack(records))
