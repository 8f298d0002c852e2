"""Calls that all ranks of a program must make: who makes another one is told, who waits long says so."""

import hashlib
import json
import sys
import time
from collections.abc import Mapping

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


def agree(settings: Mapping[str, str]) -> None:
    """Wait until all ranks are here, with the same settings. ConfigError on all ranks that names the keys where not."""
    from mpi4py import MPI

    comm = MPI.COMM_WORLD
    if comm.Get_size() == 1:
        return
    digest = hashlib.sha256(json.dumps(settings, sort_keys=True).encode()).digest()
    if len(set(comm.allgather(digest))) == 1:
        return
    found = comm.allgather(dict(settings))
    told = ["the ranks have different cases; every rank makes the same one, with the same arrays:"]
    for key in dict.fromkeys(key for one in found for key in one):
        values = [one.get(key, "not set") for one in found]
        other = next((rank for rank, value in enumerate(values) if value != values[0]), 0)
        if other:
            told.append(f"  {key}: {values[0]} on rank 0, {values[other]} on rank {other}")
    raise ConfigError(told)
