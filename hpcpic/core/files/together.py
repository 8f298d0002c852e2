"""Failures of one rank become the same error on all ranks, so that none is left waiting."""

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.errors import FileError

if TYPE_CHECKING:
    from hpcpic.core.comm.world import World

MESSAGE_BYTES = 4096
CURES = {
    errno.ENOSPC: "; free some space, or choose a folder on another disk",
    errno.EDQUOT: "; the quota is used up: free some space, or choose a folder on another disk",
    errno.EACCES: "; check the permissions",
    errno.EROFS: "; choose a folder on another disk",
}


class Alone:
    """A world of one process, without MPI: for export, plots and reading."""

    rank = 0
    size = 1
    comm: Any = None

    def bcast(self, content: bytes | None) -> bytes:
        return content or b""

    def barrier(self) -> None:
        """Nobody to wait for."""

    def any(self, flag: bool) -> bool:
        return flag

    def max(self, value: float) -> float:
        return value

    def sum_int(self, values: NDArray[np.int64]) -> NDArray[np.int64]:
        return values.copy()


ALONE = Alone()


@contextmanager
def together(world: "World | Alone", doing: str = "") -> Iterator[None]:
    """Run the body on every rank; when it fails on some, all ranks raise the error of the lowest of them.

    OSError and FileError become a FileError "doing: what the system says; cure"; any other exception is a bug
    and becomes a RuntimeError, on the rank itself with its cause.
    """
    error: Exception | None = None
    try:
        yield
    except Exception as caught:
        error = caught
    if not world.any(error is not None):
        return
    message, is_bug = _spread(world, error, doing)
    raise RuntimeError(message) if is_bug else FileError(message) from error


def _spread(world: "World | Alone", error: Exception | None, doing: str) -> tuple[str, bool]:
    """Message and kind of the error of the lowest failing rank."""
    failing = world.size - int(world.max(float(world.size - world.rank) if error else 0.0))
    buffer = np.zeros(MESSAGE_BYTES, np.uint8)
    if world.rank == failing:
        assert error is not None
        bug = not isinstance(error, OSError | FileError)
        text = (f"{doing}: " if doing else "") + explain(error) + (f" (rank {failing})" if world.size > 1 else "")
        content = text.encode()[: MESSAGE_BYTES - 1]
        buffer[0] = bug
        buffer[1 : 1 + len(content)] = np.frombuffer(content, np.uint8)
    if world.size > 1:
        world.comm.Bcast(buffer, root=failing)
    return buffer[1:].tobytes().rstrip(b"\0").decode(errors="replace"), bool(buffer[0])


def explain(error: Exception) -> str:
    """One sentence: what the system says, where, and a cure where one is known."""
    if isinstance(error, FileError):
        return error.message
    if isinstance(error, OSError):
        where = f" ({error.filename})" if error.filename else ""
        return f"{error.strerror or error}{where}{CURES.get(error.errno or 0, '')}"
    return f"{type(error).__name__}: {error}"
