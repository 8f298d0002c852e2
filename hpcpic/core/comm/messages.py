"""Non-blocking messages tagged by the iteration, which compiled code starts and tests.

A set of messages is made once; each start is an MPI_Isend or MPI_Irecv for every message, under the tag of the
iteration (`tags.tag`). A message of another iteration never matches: the set then never completes, which the pool
reports as `Stuck` with the name of the exchange.
"""

import ctypes
from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from hpcpic.core.comm.tags import CHANNELS, WINDOW
from hpcpic.core.tasks.scheduler import MESSAGE_WORDS, start_messages

MOST_ITEMS = 2**31 - 1  # that MPI_Isend counts
ITERATION = 7  # word of a record


class Message(NamedTuple):
    """One message of a set: to or from `peer`, under `channel`; a C-contiguous array, or [address, count, datatype] and
    the arrays that lie there.
    """

    peer: int
    channel: int
    buffer: NDArray | tuple[int, int, MPI.Datatype]
    pieces: Sequence[NDArray] = ()


@cache
def mpi_address(function: str) -> int:
    """Address of an MPI function in the library that mpi4py itself is linked with."""
    library = ctypes.CDLL(MPI.__file__)  # finds names in the extension and in what it is linked with
    address = ctypes.cast(getattr(library, function), ctypes.c_void_p).value
    assert address is not None
    return address


def _call(function: str, *arguments: int) -> int:
    """Call an MPI function whose arguments are an int and addresses; other threads of Python go on meanwhile."""
    kinds = [ctypes.c_int, *[ctypes.c_void_p] * (len(arguments) - 1)]
    return ctypes.CFUNCTYPE(ctypes.c_int, *kinds)(mpi_address(function))(*arguments)


def _row(function: str, message: Message, comm: MPI.Comm) -> list[int]:
    """A line of the table that compiled code reads; its handles are of any library's kind, as int64."""
    buffer = message.buffer
    if isinstance(buffer, tuple):
        address, count, kind = buffer
    else:
        if not buffer.flags.c_contiguous:
            raise ValueError("the array of a message must be C-contiguous")
        address, count, kind = buffer.ctypes.data, buffer.nbytes, MPI.BYTE
    if count > MOST_ITEMS:
        raise ValueError(f"a message of {count} bytes: at most {MOST_ITEMS}")
    of_type, of_ranks = (ctypes.c_int64(MPI._handleof(thing)).value for thing in (kind, comm))
    return [mpi_address(function), address, count, of_type, message.peer, message.channel, of_ranks]


class Messages:
    """The messages of one exchange: started together, complete together. No messages at all is legal.

    Call `at` with the iteration before a start; every start advances it by `stride`, so that one graph may hold the
    set more than once. The arrays belong to the messages from a start to its completion. record: int64 words for
    compiled code (see `tasks.scheduler.start_messages`).
    """

    def __init__(
        self, comm: MPI.Comm, *, sends: Sequence[Message] = (), receives: Sequence[Message] = (), stride: int = 1
    ) -> None:
        self._kept = (sends, receives)  # the table holds their bare addresses
        rows = [_row("MPI_Irecv", m, comm) for m in receives] + [_row("MPI_Isend", m, comm) for m in sends]
        self._n = len(rows)
        self._table = np.array(rows, np.int64).reshape(-1, MESSAGE_WORDS)
        size = MPI._sizeof(MPI.Request)
        null = ctypes.string_at(MPI._addressof(MPI.REQUEST_NULL), size)
        self._handles = np.frombuffer(null * (self._n + 1), np.uint8).copy()
        self._statuses = np.zeros((self._n + 1) * MPI._sizeof(MPI.Status), np.uint8)
        self._flag = np.zeros(1, np.int32)
        places = [array.ctypes.data for array in (self._handles, self._statuses, self._flag)]
        functions = [self._table.ctypes.data, mpi_address("MPI_Testall")]
        self.record = np.array([self._n, *places, *functions, size, 0, stride, WINDOW, CHANNELS], np.int64)

    def __len__(self) -> int:
        return self._n

    def at(self, iteration: int) -> None:
        """The next start is of this iteration."""
        self.record[ITERATION] = iteration

    def start(self) -> None:
        """Start all messages, without a task graph."""
        code = start_messages(self.record.ctypes.data)
        assert not code, f"MPI returned the error code {code}"

    def wait(self) -> None:
        """Return when all messages are complete."""
        _call("MPI_Waitall", self._n, self._handles.ctypes.data, self._statuses.ctypes.data)

    def free(self) -> None:
        """Withdraw receives that nothing has matched, as after a failure: their memory may go."""
        size = MPI._sizeof(MPI.Request)
        for k in range(len(self._kept[1])):
            handle = self._handles[k * size : (k + 1) * size]
            if handle.tobytes() != ctypes.string_at(MPI._addressof(MPI.REQUEST_NULL), size):
                for function in ("MPI_Cancel", "MPI_Request_free"):
                    address: Any = ctypes.c_void_p(handle.ctypes.data)
                    ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p)(mpi_address(function))(address)
