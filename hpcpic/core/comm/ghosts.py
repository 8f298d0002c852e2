"""Ghost particles: copies of other ranks' particles. Who is copied is chosen once, values are sent often."""

from collections.abc import Collection, Mapping

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
        self._choices = 0
        self.n = 0

    @property
    def messages(self) -> int:
        return len(self._members.keys() - {self._world.rank})

    def choose(self, members: Mapping[int, NDArray[np.int64]], peers: Collection[int] | None = None) -> int:
        """Collective: members[rank] are the rows of this rank that `rank` keeps as ghosts. Returns `n`.

        peers: the other ranks that may keep any, or whose rows this one may; then nobody else is asked. A rank is a
        peer of its peers.
        """
        self._choices += 1  # the tag of its messages
        counts = np.zeros(self._world.size, np.int64)
        for peer, rows in members.items():
            counts[peer] = len(rows)
        expected = counts.copy()
        if peers is not None:
            self._tell(counts, expected, peers)
        elif self._world.size > 1:
            self._world.comm.Alltoall(counts, expected)
        ends = np.cumsum(expected)
        self._members = {peer: np.asarray(rows) for peer, rows in members.items() if len(rows)}
        self._places = {int(p): slice(ends[p] - expected[p], ends[p]) for p in np.flatnonzero(expected)}
        self.n = int(ends[-1])
        return self.n

    def _tell(self, counts: NDArray[np.int64], expected: NDArray[np.int64], peers: Collection[int]) -> None:
        """Numbers of members by messages between peers, instead of one collective of all ranks."""
        strangers = set(np.flatnonzero(counts).tolist()) - set(peers) - {self._world.rank}
        if strangers:
            raise ValueError(f"ghosts for ranks {sorted(strangers)}, which are no peers of rank {self._world.rank}")
        comm, label = self._world.comm, tag(self._choices, self._channel)
        requests = [comm.Irecv(expected[peer : peer + 1], peer, label) for peer in peers]
        requests += [comm.Isend(counts[peer : peer + 1], peer, label) for peer in peers]
        MPI.Request.Waitall(requests)

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
