"""Messages made of several pieces of memory, sent from where they are."""

from collections.abc import Sequence
from typing import NamedTuple

from mpi4py import MPI
from numpy.typing import NDArray

from hpcpic.core.comm.messages import Message, Messages
from hpcpic.core.comm.world import World


class Parcel(NamedTuple):
    """C-contiguous arrays that travel one after the other to or from a peer, under a channel."""

    peer: int
    channel: int
    pieces: Sequence[NDArray]


class Pieces:
    """Parcels that leave and come together: `messages` is for a task graph, or start() and wait() it.

    The arrays belong to the messages from the start to the end of an exchange.
    stride: iterations between two exchanges.
    """

    def __init__(self, world: World, sends: Sequence[Parcel], receives: Sequence[Parcel], stride: int = 1) -> None:
        self._types: list[MPI.Datatype] = []
        there, back = ([self._message(parcel) for parcel in parcels] for parcels in (sends, receives))
        self.messages = Messages(world.comm, sends=there, receives=back, stride=stride)

    def _message(self, parcel: Parcel) -> Message:
        for piece in parcel.pieces:
            if not piece.flags.c_contiguous:
                raise ValueError("a piece of a message must be contiguous")
        places = [MPI.Get_address(piece) for piece in parcel.pieces]
        lengths = [piece.nbytes for piece in parcel.pieces]
        kind = MPI.BYTE.Create_hindexed(lengths, places).Commit()
        self._types.append(kind)
        whole = (0, 1, kind)  # MPI_BOTTOM: the type holds the addresses
        return Message(parcel.peer, parcel.channel, whole, parcel.pieces)

    def free(self) -> None:
        """Release the types; no exchange may be under way."""
        self.messages.free()
        for kind in self._types:
            kind.Free()
        self._types = []
