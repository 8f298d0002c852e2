"""`python -m fault_matrix.faulty PROGRAM VERB ...`: a program with a fault, which $FAULT tells as JSON.

{"kind": name below, "rank": 1, "step": 20, "pause": seconds slept in every step}
"""

from __future__ import annotations

import ctypes
import json
import os
import resource
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from typing import Any

import numpy as np
import psutil
from numpy.typing import NDArray

from hpcpic.core.cli import main as face
from hpcpic.core.comm import ghosts
from hpcpic.core.comm.messages import Messages
from hpcpic.core.comm.world import World
from hpcpic.core.files import image
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.run import checkpoint

FAULT: dict[str, Any] = {"kind": "none", "rank": 1, "step": 20, "pause": 0.0}
FAULT |= json.loads(os.environ.get("FAULT", "{}"))


class Damaged:
    """A checkpoint in which one number is another: `change(value)`. Rows are those of the whole array."""

    def __init__(self, reader: Any, name: str, row: int, word: int, change: Callable[[Any], Any]) -> None:
        self._reader, self._name, self._at, self._change = reader, name, (row, word), change

    def __getattr__(self, name: str) -> Any:
        return getattr(self._reader, name)

    def read(self, name: str, lo: int = 0, hi: int | None = None) -> np.ndarray:
        rows = self._reader.read(name, lo, hi)
        row, word = self._at
        if name == self._name and lo <= row < lo + len(rows):
            flat = rows.reshape(len(rows), -1)
            flat[row - lo, word] = self._change(flat[row - lo, word])
        return rows


def floats(reader: Any) -> list[str]:
    """Names of the arrays of floating point numbers in a checkpoint that hold one at `middle`."""
    names = [name for name in reader.names if reader.total(name) and reader.read(name, 0, 0).dtype.kind == "f"]
    return [name for name in names if np.isfinite(reader.read(name, at := middle(reader, name), at + 1).flat[0])]


def middle(reader: Any, name: str) -> int:
    """The row of an array whose first number becomes another."""
    return reader.total(name) // 2


def become(app: Any, world: Any, which: Callable[[Any], str], value: float) -> None:
    """An array of the state, chosen by `which(reader)`, gets another value in its middle row. Collective."""
    own = tempfile.mkdtemp() if world.rank == 0 else ""
    folder = RunDir(world.bcast(own.encode()).decode())
    checkpoint.write(world, folder, app.iteration, app.time, app.state())
    reader = checkpoint.newest(folder, world)
    name = which(reader)
    app.restore(Damaged(reader, name, middle(reader, name), 0, lambda _: value))


def misnumber_messages() -> None:
    """From now on this rank's messages say that they belong to an iteration two later."""
    at, refresh = Messages.at, ghosts.Refresh.start

    def later(messages: Messages, iteration: int) -> None:
        at(messages, iteration + 2)

    def refresh_later(exchange: ghosts.Refresh, iteration: int, values: NDArray) -> None:
        refresh(exchange, iteration + 2, values)

    Messages.at, ghosts.Refresh.start = later, refresh_later  # type: ignore[method-assign, assignment]


def take_memory() -> None:
    """No more address space than there is now, and 4 MiB."""
    now = psutil.Process().memory_info().vms
    resource.setrlimit(resource.RLIMIT_AS, (now + (4 << 20), resource.RLIM_INFINITY))


def stand_still() -> None:
    """The next write of this process takes ten seconds."""
    pwrite = os.pwrite

    def late(*words: Any) -> int:
        os.pwrite = pwrite
        time.sleep(10.0)
        return pwrite(*words)

    os.pwrite = late


def stop_within_checkpoint() -> None:
    """SIGTERM when half of a checkpoint is written."""
    write = image.write_shards

    def write_shards(path: Any, slots: Any, shards: Any) -> None:
        write(path, slots, dict(list(shards.items())[:1]))
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.2)
        write(path, slots, shards)

    image.write_shards = write_shards


def fail_here(kind: str, world: Any) -> None:
    """What befalls one rank."""
    if kind == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    if kind == "stop":
        os.kill(os.getpid(), signal.SIGSTOP)
    if kind == "term":
        os.kill(os.getpid(), signal.SIGTERM)
    if kind == "segv":
        ctypes.string_at(0)
    if kind == "raise":
        raise ZeroDivisionError("told to fail")
    if kind == "exit":
        sys.exit(3)
    if kind == "collective":
        world.comm.Barrier()  # the others do not come
        time.sleep(600)
    if kind == "hang":
        time.sleep(600)
    if kind == "misnumber":
        misnumber_messages()
    if kind == "stall":
        stand_still()
    if kind == "term in checkpoint":
        stop_within_checkpoint()


def with_fault(simulator: type) -> type:
    kind, rank, at = FAULT["kind"], FAULT["rank"], FAULT["step"]

    class Faulty(simulator):  # type: ignore[misc]
        def __init__(self, config: Any, world: Any, pool: Any, timers: Any) -> None:
            if kind == "raise at start" and world.rank == rank:
                raise ZeroDivisionError("told to fail")
            if kind == "small files":
                resource.setrlimit(resource.RLIMIT_FSIZE, (30_000, 30_000))
            self._ranks, self._within = world, False  # _within: step is called by advance
            super().__init__(config, world, pool, timers)

        def before(self) -> None:
            time.sleep(FAULT["pause"])
            if self.iteration == at:
                if kind.startswith("nan "):
                    become(self, self._ranks, lambda reader: floats(reader)[int(kind.split()[1])], np.nan)
                elif kind.startswith("value "):
                    _, name, value = kind.split()
                    become(self, self._ranks, lambda _: name, float(value))
                elif self._ranks.rank == rank:
                    fail_here(kind, self._ranks)

        def step(self) -> None:
            if not self._within:
                self.before()
            super().step()

        def advance(self, most: int) -> None:
            """Single steps where they are slowed down; else none beyond the fault."""
            self.before()
            ahead = at - self.iteration
            self._within = True
            super().advance(1 if FAULT["pause"] else min(most, ahead) if ahead > 0 else most)
            self._within = False

    Faulty.__name__ = simulator.__name__
    return Faulty


def jumping_clock() -> None:
    """The clock of the day jumps an hour forward and back, as when it is set."""
    now, calls = time.time, iter(range(10**9))
    time.time = lambda: now() + (3600.0 if next(calls) % 2 else -3600.0)


def main() -> None:
    program = sys.argv.pop(1)
    load_app = import_module(f"{program}.__main__").load_app
    if FAULT["kind"] == "clock":
        jumping_clock()

    def load() -> type:
        simulator = with_fault(app.load())
        if FAULT["kind"] == "no memory" and World.start().rank == FAULT["rank"]:
            take_memory()
        return simulator

    def faulty_app() -> Any:
        return replace(load_app(), load=load)

    app = load_app()
    face.program(faulty_app, app.name, app.title)


if __name__ == "__main__":
    main()
