"""Ghost particles: copies of other ranks' particles. Who is copied is chosen once, values are sent often."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from hpcpic.core.comm.tags import tag
from hpcpic.core.comm.world import World


class Refresh:
    """Owner to ghost, for rows of any array. Ghosts are in order of rank, then as their owner listed them.

    A rank may list members for itself (images across a periodic box): these are copied.
    n: ghosts of this rank; messages: sent by one start.
    """

    def __init__(self, world: World, channel: int) -> None:
        self._world = world
        self._channel = channel
        self._members: dict[int, NDArray[np.int64]] = {}
        self._places: dict[int, slice] = {}
        self._requests: list[MPI.Request] = []
        self.n = 0

    @property
    def messages(self) -> int:
        return len(self._members.keys() - {self._world.rank})

    def choose(self, members: Mapping[int, NDArray[np.int64]]) -> int:
        """Collective: members[rank] are the rows of this rank that `rank` keeps as ghosts. Returns `n`."""
        counts = np.zeros(self._world.size, np.int64)
        for peer, rows in members.items():
            counts[peer] = len(rows)
        if self._world.size > 1:
            self._world.comm.Alltoall(counts.copy(), counts)
        self._keep(members, dict(enumerate(counts.tolist())))
        return self.n

    def choose_and_send(
        self, iteration: int, members: Mapping[int, NDArray[np.int64]], peers: Sequence[int], values: NDArray
    ) -> NDArray:
        """`choose`, `start` and `finish` by one message to each peer, from whose length it learns how many there are.

        peers: the other ranks that may keep any, or whose rows this one may. A rank is a peer of its peers.
        """
        rank, comm, label = self._world.rank, self._world.comm, tag(iteration, self._channel)
        if strangers := members.keys() - {rank, *peers}:
            raise ValueError(f"ghosts for ranks {sorted(strangers)}, which are no peers of rank {rank}")
        sent = [comm.Isend(_bytes(values[members.get(peer, [])]), peer, label) for peer in peers]
        parts, status, row = {rank: values[members.get(rank, [])]}, MPI.Status(), values.shape[1:]
        for peer in peers:
            comm.Probe(peer, label, status)
            n = status.Get_count(MPI.BYTE) // (values.itemsize * math.prod(row))
            parts[peer] = np.empty((n, *row), values.dtype)
            comm.Recv(_bytes(parts[peer]), peer, label)
        MPI.Request.Waitall(sent)
        self._keep(members, {peer: len(part) for peer, part in parts.items()})
        return np.concatenate([parts[peer] for peer in sorted(parts)])

    def _keep(self, members: Mapping[int, NDArray[np.int64]], expected: Mapping[int, int]) -> None:
        """Remember who has which rows, and where those of others go."""
        self._members = {peer: np.asarray(rows) for peer, rows in members.items() if len(rows)}
        self._places, self.n = {}, 0
        for peer, n in sorted(expected.items()):
            if n:
                self._places[peer] = slice(self.n, self.n + n)
                self.n += n

    def start(self, iteration: int, values: NDArray) -> None:
        """Send the members' rows of values[n, ...]; the same type and shape of a row on all ranks."""
        comm, label = self._world.comm, tag(iteration, self._channel)
        self._ghosts = np.empty((self.n, *values.shape[1:]), values.dtype)
        self._requests = []
        for peer, place in self._places.items():
            if peer == self._world.rank:
                self._ghosts[place] = values[self._members[peer]]
            else:
                self._requests.append(comm.Irecv(_bytes(self._ghosts[place]), peer, label))
        for peer, rows in self._members.items():
            if peer != self._world.rank:
                self._requests.append(comm.Isend(_bytes(values[rows]), peer, label))

    def finish(self) -> NDArray:
        """The ghosts' rows [n, ...], as the owners' values were at `start`."""
        if self._requests:
            MPI.Request.Waitall(self._requests)
        return self._ghosts


def _bytes(rows: NDArray) -> NDArray[np.uint8]:
    """Whole rows of an array, of whatever type, as MPI takes them."""
    return np.ascontiguousarray(rows).reshape(-1).view(np.uint8)
