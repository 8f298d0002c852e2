"""Sets of persistent requests that compiled code can start and test."""

import ctypes
from collections.abc import Sequence
from functools import cache

import numpy as np
from mpi4py import MPI


@cache
def mpi_address(function: str) -> int:
    """Address of an MPI function in the library that mpi4py itself is linked with."""
    library = ctypes.CDLL(MPI.__file__)  # finds names in the extension and in what it is linked with
    address = ctypes.cast(getattr(library, function), ctypes.c_void_p).value
    assert address is not None
    return address


class RequestSet:
    """Persistent requests of one exchange; they are started and completed together. No requests is legal.

    record: int64[6] = number of requests, address of their opaque handles, of the statuses, of an int32
    flag, of MPI_Startall and of MPI_Testall. The handles are copied as bytes, whatever the library makes
    them of, so the same compiled caller serves MPICH (4-byte handles) and Open MPI (pointers).
    """

    def __init__(self, requests: Sequence[MPI.Prequest]) -> None:
        self._requests = list(requests)
        size = MPI._sizeof(MPI.Request)
        handles = b"".join(ctypes.string_at(MPI._addressof(request), size) for request in self._requests)
        self._handles = np.frombuffer(handles + bytes(size), np.uint8).copy()
        self._statuses = np.zeros((len(self._requests) + 1) * MPI._sizeof(MPI.Status), np.uint8)
        self._flag = np.zeros(1, np.int32)
        buffers = [b.ctypes.data for b in (self._handles, self._statuses, self._flag)]
        functions = [mpi_address("MPI_Startall"), mpi_address("MPI_Testall")]
        self.record = np.array([len(self._requests), *buffers, *functions], np.int64)

    def __len__(self) -> int:
        return len(self._requests)

    def start(self) -> None:
        if self._requests:
            MPI.Prequest.Startall(self._requests)

    def wait(self) -> None:
        if self._requests:
            MPI.Request.Waitall(self._requests)

    def test(self) -> bool:
        """True when all are complete."""
        return not self._requests or MPI.Request.Testall(self._requests)

    def free(self) -> None:
        """Release the requests; none may be active."""
        for request in self._requests:
            request.Free()
        self._requests = []
        self.record[0] = 0
