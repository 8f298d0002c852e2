"""Persistent messages made of several pieces of memory, sent from where they are."""

from collections.abc import Sequence
from typing import NamedTuple

from mpi4py import MPI
from numpy.typing import NDArray

from hpcpic.core.comm.requests import RequestSet
from hpcpic.core.comm.tags import tag
from hpcpic.core.comm.world import World


class Message(NamedTuple):
    """C-contiguous arrays that travel one after the other to or from a peer, under a channel."""

    peer: int
    channel: int
    pieces: Sequence[NDArray]


class Pieces:
    """Messages that leave and come together: `requests` is for a task graph, or start() and wait() it.

    The arrays belong to the messages from the start to the end of an exchange. messages, bytes: sent in one exchange.
    """

    def __init__(self, world: World, sends: Sequence[Message], receives: Sequence[Message], parity: int = 0) -> None:
        self._kept = (sends, receives)  # MPI holds their bare addresses
        self._types: list[MPI.Datatype] = []
        made = [world.comm.Recv_init(self._buffer(m), m.peer, tag(parity, m.channel)) for m in receives]
        made += [world.comm.Send_init(self._buffer(m), m.peer, tag(parity, m.channel)) for m in sends]
        self.requests = RequestSet(made)
        self.messages = len(sends)
        self.bytes = sum(piece.nbytes for m in sends for piece in m.pieces)

    def _buffer(self, message: Message) -> list:
        for piece in message.pieces:
            if not piece.flags.c_contiguous:
                raise ValueError("a piece of a message must be contiguous")
        places = [MPI.Get_address(piece) for piece in message.pieces]
        lengths = [piece.nbytes for piece in message.pieces]
        kind = MPI.BYTE.Create_hindexed(lengths, places).Commit()
        self._types.append(kind)
        return [MPI.BOTTOM, 1, kind]

    def free(self) -> None:
        """Release requests and types; no exchange may be under way."""
        self.requests.free()
        for kind in self._types:
            kind.Free()
        self._types = []
