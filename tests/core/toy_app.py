"""A tiny simulator of the closed shape, for tests of the run loop: a field carried round a periodic ring.

u_i <- (1 - c) u_i + c u_(i-1), rows cut over the ranks, one ghost row by message. It can be told to fail at a
step. `python toy_app.py run CASE` is the whole command line.
"""

from __future__ import annotations

import os
import resource
import signal
import sys
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from hpcpic.core.app.app import App
from hpcpic.core.app.forecast import Estimate
from hpcpic.core.case.derived import Derived
from hpcpic.core.case.schema import REQUIRED, Section, setting, validate
from hpcpic.core.cli.main import program
from hpcpic.core.errors import Diverged
from hpcpic.core.files.arrays import Column, FieldArray, ParticleArray, Shard
from hpcpic.core.space.domain import Domain, even_cuts


class Fault(Section):
    kind: Literal[
        "none",
        "raise",
        "raise everywhere",
        "exit",
        "thread",
        "nan",
        "diverge",
        "kill",
        "kill in checkpoint",
        "hang",
        "full disk",
        "stall",
    ] = setting("none", "what goes wrong")
    rank: int = setting(0, "on which rank")
    step: int = setting(0, "at the beginning of which step")


class Output(Section):
    series: int = setting(1, "steps between rows of the series", ge=0)
    field: int = setting(0, "steps between snapshots of the field", ge=0)
    openpmd: int = setting(0, "steps between openPMD files", ge=0)
    particle: int = setting(0, "steps between snapshots of the particles", ge=0)


class ToyConfig(Section):
    steps: int = setting(REQUIRED, "number of steps", ge=0)
    rows: int = setting(64, "points of the ring", ge=1)
    courant: float = setting(0.25, "c")
    pause: float = setting(0.0, "sleep in every step", "s", ge=0)
    stop_SEM: float = setting(0.0, "as in the plasma", ge=0)
    fault: Fault = Fault()
    output: Output = Output()

    @property
    def n_steps(self) -> int:
        return self.steps

    @property
    def end_time(self) -> float:
        return self.steps / 1024


class Toy:
    scalar_units: Mapping[str, str] = {"mass": "1", "energy_total": "J"}
    work_unit, particle_name = "node", "particle"

    def __init__(self, config: ToyConfig, world: Any, pool: Any, timers: Any) -> None:
        self.config, self.world, self.timers = config, world, timers
        self.domain = Domain((1.0,), (config.rows,), (True,), even_cuts(config.rows, world.size))
        self.low, self.high = self.domain.row_range(world.rank)
        self.u = 1.0 + 0.5 * np.sin(2 * np.pi * np.arange(self.low, self.high) / config.rows)
        self.iteration = 0
        self.time_step = np.float64(1 / 1024)  # as apps have it that reduce it over ranks
        self.work_items, self.local_items = config.rows, self.high - self.low
        self.n_steps, self.end_time = config.n_steps, config.end_time
        self.time_periods: Mapping[str, float] = {}
        self.periods = {name: getattr(config.output, name) for name in type(config.output).model_fields}
        self.replace_faulty_parts()

    @property
    def time(self) -> float:
        return self.iteration * self.time_step

    def advance(self, most: int) -> None:
        self.step()

    def step(self) -> None:
        self.fail_if_asked()
        with self.timers.section("advect"):
            before = np.concatenate([self.row_before(), self.u])
            self.u = (1 - self.config.courant) * before[1:] + self.config.courant * before[:-1]
        if self.config.pause:
            time.sleep(self.config.pause)
        self.iteration += 1

    def row_before(self) -> np.ndarray:
        """The last row of the rank before, round the ring; every rank has rows here."""
        ghost = np.empty(1)
        size, rank = self.world.size, self.world.rank
        self.world.comm.Sendrecv(self.u[-1:].copy(), (rank + 1) % size, 0, ghost, (rank - 1) % size, 0)
        return ghost

    def scalars(self) -> dict[str, float]:
        whole = self.world.gather_rows(self.u)
        mass = float(whole.sum()) if whole is not None else 0.0
        mass = float(np.frombuffer(self.world.bcast(np.float64(mass).tobytes()))[0])
        return {"mass": mass, "energy_total": mass / 2}

    def fields(self) -> dict[str, FieldArray]:
        return {"u": FieldArray(self.u, "1")}

    def particles(self) -> dict[str, ParticleArray]:
        ids = np.arange(self.low, self.high)
        place = np.zeros((len(ids), 3))
        place[:, 0] = ids / self.config.rows
        return {"points": ParticleArray(ids, place, {"u": self.u}, {"u": "1"})}

    def state(self) -> dict[str, Shard]:
        rows = self.config.rows
        return {
            "id": Shard(np.arange(self.low, self.high), self.low, rows),
            "u": Shard(self.u, self.low, rows),
        }

    def columns(self, reader: Any) -> dict[str, Column]:
        rows = self.config.rows
        return {"id": Column(np.int64, (rows,), 0, rows - 1, increasing=True), "u": Column(np.float64, (rows,), -9, 9)}

    def restore(self, reader: Any) -> None:
        self.iteration = reader.step
        self.u = reader.read("u", self.low, self.high)

    def worst(self) -> list[str]:
        return []

    def close(self) -> None:
        """Nothing to give back."""

    def guard(self) -> str | None:
        if np.isfinite(self.u).all():
            return None
        return f"u is not finite in row {self.low + int(np.argmin(np.isfinite(self.u)))}"

    def fail_if_asked(self) -> None:
        fault = self.config.fault
        here = fault.rank == self.world.rank or fault.kind == "raise everywhere"
        if not here or self.iteration != fault.step:
            return
        if fault.kind in ("raise", "raise everywhere"):
            raise ZeroDivisionError("the toy was told to fail")
        if fault.kind == "exit":
            sys.exit(3)
        if fault.kind == "thread":
            thread = threading.Thread(target=lambda: 1 / 0, name="worker")
            thread.start()
            thread.join()
        if fault.kind == "nan":
            self.u[0] = np.nan
        if fault.kind == "diverge":
            raise Diverged("the toy was told to diverge")
        if fault.kind == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        if fault.kind == "hang":
            threading.Event().wait()

    def replace_faulty_parts(self) -> None:
        """ "kill in checkpoint": this rank dies when the file is half written; "full disk": no file above 4 MiB;
        "stall": the first write of a run that goes takes 5 s.
        """
        if self.config.fault.kind == "full disk":
            resource.setrlimit(resource.RLIMIT_FSIZE, (4 << 20, 4 << 20))
        if self.config.fault.kind == "stall" and self.world.rank == 0:
            from hpcpic.core.files import series

            pwrite, series.FLUSH_SECONDS = os.pwrite, 0.2

            def late(*words: Any) -> int:
                if self.iteration:
                    os.pwrite = pwrite
                    time.sleep(5.0)
                return pwrite(*words)

            os.pwrite = late
        if self.config.fault.kind == "kill in checkpoint":
            from hpcpic.core.files import image

            write = image.write_shards

            def half(path: Any, slots: Any, shards: Any) -> None:
                write(path, slots, dict(list(shards.items())[:1]))
                if self.world.rank == self.config.fault.rank and self.iteration >= self.config.fault.step:
                    os.kill(os.getpid(), signal.SIGKILL)
                write(path, slots, shards)

            image.write_shards = half


def estimate(config: ToyConfig, ranks: int, threads: int, rates: Mapping[str, float]) -> Estimate:
    step = config.rows * rates.get("toy", 1e-9) / ranks + 1e-5
    return Estimate({"u": 8.0 * config.rows / ranks}, {"checkpoints": 32.0 * config.rows}, step, step * config.steps)


def derived(config: ToyConfig, ranks: int) -> list[Derived]:
    verdict = "ok" if 0 <= config.courant <= 1 else "fail"
    return [
        Derived("Courant number", "c", config.courant, limit="<= 1", verdict=verdict, source="CFL",
                cure="take courant = 1", key=("courant",), forceable=True),
        Derived("rows per rank", "n", config.rows / ranks, limit=">= 1", cure="take fewer ranks",
                verdict="ok" if config.rows >= ranks else "fail"),
    ]  # fmt: skip


APP = App(
    name="toy",
    title="a field carried round a ring",
    schema=lambda: ToyConfig,
    configure=lambda tree: validate(ToyConfig, tree),
    cases=lambda: {},
    derived=derived,
    estimate=estimate,
    load=lambda: Toy,
    until=lambda config, t: (f"steps={round(1024 * t)}",),
    stop_sem=lambda config: config.stop_SEM,
    free=("steps", "output", "fault", "pause", "stop_SEM"),
    bench=lambda quick: {"toy": 2e-9},
    command=(sys.executable, str(Path(__file__).resolve())),
)

if __name__ == "__main__":
    program(lambda: APP, APP.name, APP.title)
