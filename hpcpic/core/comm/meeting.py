"""Calls that all ranks of a program must make: who makes another one is told, who waits long says so."""

import sys
import time

import numpy as np

from hpcpic.core.comm.world import NAP_SECONDS
from hpcpic.core.errors import ConfigError

TELL_SECONDS = 30.0  # after which who waits says so; others may have work of their own
AWAKE_SECONDS = 1e-3  # before a rank that waits sleeps between looks
NAME_BYTES = 64


def meet(call: str) -> None:
    """Wait until all ranks make this call. ConfigError on all ranks where one makes another one."""
    from mpi4py import MPI

    comm = MPI.COMM_WORLD
    if comm.Get_size() == 1:
        return
    own = np.frombuffer(call.encode()[:NAME_BYTES].ljust(NAME_BYTES), np.uint8)
    found = np.empty((comm.Get_size(), NAME_BYTES), np.uint8)
    request, since, told = comm.Iallgather(own, found), time.monotonic(), False
    while not request.Test():
        waited = time.monotonic() - since
        if waited > AWAKE_SECONDS:
            time.sleep(NAP_SECONDS)
        if waited > TELL_SECONDS and not told:
            told = True
            print(
                f"rank {comm.Get_rank()} of {comm.Get_size()}: {call} has waited for {waited:.0f} s: it is a "
                "collective call, which all ranks make, and not all have come",
                file=sys.stderr, flush=True,
            )  # fmt: skip
    if (found != own).any():
        calls = [row.tobytes().decode(errors="replace").rstrip() for row in found]
        made = {name: f"rank {calls.index(name)} calls {name}" for name in calls}
        raise ConfigError(f"collective calls are made by all ranks, in one order: {', '.join(made.values())}")
