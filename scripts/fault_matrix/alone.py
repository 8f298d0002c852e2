"""`python -m fault_matrix.alone PROGRAM FOLDER kills|flips N`: faults tried on one process, without a launcher.

FOLDER holds a finished run. The last line printed is what was found, as JSON.
"""

from __future__ import annotations

import copy
import json
import logging
import os
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from fault_matrix.faulty import Damaged, floats
from hpcpic.core.case.config import load
from hpcpic.core.comm.world import World
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.run import checkpoint
from hpcpic.core.tasks.graph import Pool
from hpcpic.core.timers import Timers

STEPS = 10  # before a bit is flipped, and after
LONG_STEPS, CHANGE = 500, 1e-6  # of a campaign: a flip does harm that changes a scalar by more than this share of it
REMEMBERING = {"hpcpic": "kept_motion", "sph": "checksums", "lbmdem": "grain_bits"}  # what knows how the state was
ENERGIES = ("energy_total", "energy_kinetic")  # the first that a program has


def made(program: str, folder: Path) -> tuple[Any, World]:
    """The simulator of the run in the folder, at its initial state."""
    app = import_module(f"{program}.__main__").load_app()
    config, world = app.configure(load(folder / "config.conf")), World.alone()
    return app.load()(config, world, Pool(1), Timers()), world


def write_for_ever(app: Any, world: World, rundir: RunDir, tell: int) -> None:
    """Step and write; a byte to `tell` after every checkpoint."""
    while True:
        app.step()
        checkpoint.write(world, rundir, app.iteration, app.time, app.state())
        os.write(tell, b".")


def killed(app: Any, world: World, rundir: RunDir, delay: float) -> None:
    """A process that goes on from the newest checkpoint, killed this long after the first one it has written."""
    told, tell = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            app.restore(checkpoint.newest(rundir, world))
            write_for_ever(app, world, rundir, tell)
        finally:
            os._exit(1)
    os.close(tell)
    assert os.read(told, 1) == b".", "the writer ended by itself"
    time.sleep(delay)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    os.close(told)


def kills(app: Any, world: World, folder: Path, n: int) -> dict[str, Any]:
    """Kill at n random moments of writing; the state that survives is that of a run without kills."""
    rundir = RunDir(folder / "killed")
    rundir.path.mkdir()
    refused: list[str] = []
    handler = logging.Handler(logging.WARNING)
    handler.emit = lambda record: refused.append(record.getMessage())  # type: ignore[method-assign]
    logging.getLogger("hpcpic").addHandler(handler)
    app.step()
    begin = time.perf_counter()
    checkpoint.write(world, rundir, app.iteration, app.time, app.state())
    longest = 2 * (time.perf_counter() - begin)
    halves = 0
    for delay in np.random.default_rng(1).uniform(0, longest, n):
        killed(app, world, rundir, delay)
        halves += len(list(rundir.checkpoints.glob(".*.tmp")))
        checkpoint.newest(rundir, world)
    reader = checkpoint.newest(rundir, world)
    while app.iteration < reader.step:
        app.step()
    wanted = checkpoint.digest(world, app.state())
    app.restore(reader)
    same = checkpoint.digest(world, app.state()) == wanted
    return {"refused": refused, "halves": halves, "same": same, "step": reader.step}


def flipped(value: Any, bit: int) -> Any:
    """The number with one bit of its exponent turned; bit 0 doubles or halves it."""
    kind, low = (np.uint64, 52) if value.dtype == np.float64 else (np.uint32, 23)
    return (value.view(kind) ^ kind(1 << (low + bit))).view(value.dtype)


def begun(app: Any, world: World, folder: Path) -> Any:
    """A checkpoint of a run whose guard has seen some steps, and knows what is usual."""
    app.restore(checkpoint.newest(RunDir(folder), world))
    energy_after(app)
    rundir = RunDir(folder / "flips")
    rundir.path.mkdir()
    checkpoint.write(world, rundir, app.iteration, app.time, app.state())
    return checkpoint.newest(rundir, world)


def drawn(rng: np.random.Generator, reader: Any) -> tuple[str, int, int, int, np.ndarray, Damaged]:
    """A bit of an exponent in the state: array, row, number in it, bit, the row, and the state with it turned."""
    name = str(rng.choice(floats(reader)))
    row = int(rng.integers(reader.total(name)))
    one = reader.read(name, row, row + 1).reshape(-1)
    word, bit = int(rng.integers(one.size)), int(rng.integers(11 if one.dtype == np.float64 else 8))
    return name, row, word, bit, one, Damaged(reader, name, row, word, partial(flipped, bit=bit))


def flips(app: Any, world: World, folder: Path, n: int) -> dict[str, Any]:
    """Turn one bit of an exponent in the state, n times; how the guard or the energy shows it in a few steps."""
    reader, rng = begun(app, world, folder), np.random.default_rng(2)
    quiet = float(within_child(lambda: repr(energy_after(app))))
    found = {"caught": 0, "raised": 0, "crashed": 0, "harmless": 0, "silent": 0}
    for _ in range(n):
        name, row, word, bit, one, damaged = drawn(rng, reader)
        said = within_child(lambda: outcome(app, reader, damaged, quiet))  # noqa: B023 - called at once
        found[said] += 1
        print(f"{name}[{row}, {word}] {one[word]:.6g} -> {flipped(one[word], bit):.6g}: {said}")
    return found


def outcome(app: Any, reader: Any, damaged: Damaged, quiet: float) -> str:
    """caught by the guard, harmless (the energy is within 1 %), or silent."""
    turn_bit(app, reader, damaged)
    energy = energy_after(app)
    if app.guard():
        return "caught"
    return "harmless" if abs(energy - quiet) <= 1e-2 * abs(quiet) else "silent"


def campaign(app: Any, world: World, folder: Path, n: int) -> dict[str, Any]:
    """Flip bits as `flips` does, follow all scalars for LONG_STEPS steps, and list what is harmful and silent."""
    reader = begun(app, world, folder)
    quiet, control = (
        json.loads(within_child(lambda: (app.restore(reader), scalars_after(app, LONG_STEPS))[1])) for _ in range(2)
    )
    assert same_scalars(control, quiet), "a run without a flip differs from another"
    rng, silent = np.random.default_rng(5), []
    found: Counter[str] = Counter()

    def followed(damaged: Damaged) -> str:
        turn_bit(app, reader, damaged)
        return scalars_after(app, LONG_STEPS)

    for _ in range(n):
        name, row, word, bit, one, damaged = drawn(rng, reader)
        said = within_child(partial(followed, damaged))
        if said.startswith("{"):
            said = "harmless" if same_scalars(json.loads(said), quiet) else "silent"
        found.update((said, f"{said}: {name}"))
        if said == "silent":
            silent.append(f"{name}[{row}, {word}] {one[word]:.6g} -> {flipped(one[word], bit):.6g}")
            print(silent[-1], flush=True)
    return {"found": dict(sorted(found.items())), "silent": silent}


def scalars_after(app: Any, steps: int) -> str:
    """All scalars after so many steps, as JSON; "caught" when the guard, which looks at every tenth, sees something."""
    for step in range(steps):
        if step % STEPS == 0:
            app.scalars()
            if app.guard():
                return "caught"
        app.step()
    return "caught" if app.guard() else json.dumps({name: float(value) for name, value in app.scalars().items()})


def same_scalars(one: Mapping[str, float], other: Mapping[str, float]) -> bool:
    """To CHANGE of each, or of the largest of their kind where they are nought but for rounding."""
    kinds = {name: name.partition("_")[0] for name in other}
    largest = {kind: max(abs(other[name]) for name in other if kinds[name] == kind) for kind in set(kinds.values())}
    return all(abs(one[name] - other[name]) <= CHANGE * largest[kinds[name]] for name in other)


def turn_bit(app: Any, reader: Any, damaged: Damaged) -> None:
    """The state of the checkpoint with one bit turned, while the guards remember it as it was."""
    app.restore(reader)
    app.scalars()  # the guards see it
    guard = getattr(app, REMEMBERING.get(type(app).__module__.partition(".")[0], ""), None)
    kept = copy.deepcopy(guard.kept) if guard else None
    app.restore(damaged)
    if guard:
        guard.kept = kept


def within_child(body: Callable[[], str]) -> str:
    """What the body says, "raised" or "crashed"."""
    told, tell = os.pipe()
    child = os.fork()
    if child == 0:
        said = "raised"
        with suppress(Exception):
            said = body()
        os.write(tell, said.encode())
        os._exit(0)
    os.close(tell)
    os.waitpid(child, 0)
    with os.fdopen(told, "rb") as pipe:
        return pipe.read().decode() or "crashed"


def energy_after(app: Any) -> float:
    """The energy after STEPS steps, each watched by the guard."""
    for _ in range(STEPS):
        energies = app.scalars()
        if app.guard():
            break
        app.step()
    else:
        energies = app.scalars()
    return float(energies[next(name for name in ENERGIES if name in energies)])


def main() -> None:
    program, folder, what, n = sys.argv[1:]
    app, world = made(program, Path(folder))
    found = {"kills": kills, "flips": flips, "campaign": campaign}[what](app, world, Path(folder), int(n))
    print(json.dumps(found))


if __name__ == "__main__":
    main()
