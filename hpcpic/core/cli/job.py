"""The job of `run` and `restart`: all ranks agree on the case, make its model, and step it to the end."""

from __future__ import annotations

import itertools
import json
import logging
import shlex
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

from hpcpic.core import memory
from hpcpic.core.app import use
from hpcpic.core.app.app import App, AppLoader
from hpcpic.core.app.rates import read_rates
from hpcpic.core.case.config import loads
from hpcpic.core.cli.estimate import facts as estimate_facts
from hpcpic.core.comm.world import World
from hpcpic.core.cores import crowded
from hpcpic.core.errors import HpcpicError
from hpcpic.core.files.atomic import write_atomic
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.run import checkpoint, log, summary
from hpcpic.core.run.failure import Agreed, Failure, everywhere, guarded, share
from hpcpic.core.run.outputs import trigger_of
from hpcpic.core.run.signals import Stop, WallLimit, process_start
from hpcpic.core.run.triggers import Every, EverySeconds, parse_interval, parse_wall
from hpcpic.version import __version__

if TYPE_CHECKING:
    from hpcpic.core.run.model import Model


@dataclass(frozen=True, slots=True)
class Flags:
    """Options that `run` and `restart` share, as the command line gives them. ConfigError for a time that is none."""

    threads: int | None = None
    wall: str | None = None
    checkpoint_every: str | None = None
    patience: str = "0:10:00"
    quiet: bool = False
    summary: bool = True  # printed at the end

    def __post_init__(self) -> None:
        self.interval(), self.seconds(), parse_wall(self.patience)  # before there is a folder

    def interval(self) -> Every | EverySeconds | None:
        return None if self.checkpoint_every is None else parse_interval(self.checkpoint_every)

    def seconds(self) -> float | None:
        return None if self.wall is None else parse_wall(self.wall)


@dataclass(slots=True)
class Plan:
    """The job as rank 0 has prepared it and sends it to the other ranks: texts and numbers only."""

    folder: str
    config: str  # text of the case, with every default filled in
    restart: bool = False
    finished: bool = False  # the run that a restart would go on with
    allowed: str = ""  # words of the command that let it run beyond limits
    used: dict[str, str] = field(default_factory=dict)  # name -> text of Python files of the user
    warnings: list[str] = field(default_factory=list)
    history: list[Mapping[str, Any]] = field(default_factory=list)  # parts of the run before this job


POOL_PATIENCE = 2.0  # times the patience: a rank that only waits leaves it to the watchdog, which knows more
LEFTOVERS = (".failed", "post-mortem.txt", "STOP")  # of an earlier part of the run

_jobs = itertools.count()  # of this process: one, but with pilots

Prepare = Callable[[App, World], tuple[RunDir, Plan]]


def job(app_loader: AppLoader, prepare: Prepare, flags: Flags, raises: bool = False) -> int:
    """Start MPI and do the job; the exit code, the same on all ranks.

    prepare: makes the folder, or opens it, holds it, and plans the job; on rank 0. raises: errors are raised instead of
    printed, for a program of the user.
    """
    started = process_start() if next(_jobs) == 0 and not raises else time.monotonic()
    world = World.start()
    return guarded(world, lambda failure: _Job(app_loader(), world, failure, flags, started).do(prepare), raises)


class _Job:
    """The job on one rank, done once."""

    def __init__(self, app: App, world: World, failure: Failure, flags: Flags, started: float) -> None:
        self.app, self.world, self.failure, self.flags = app, world, failure, flags
        self.started = started
        self.rundir: RunDir | None = None
        self.plan = Plan("", "")
        self.part: dict[str, Any] | None = None  # of the history: this job, once the folder says that it goes on
        self.model: Model | None = None  # likewise

    def do(self, prepare: Prepare) -> int:
        """Agree on a plan, and carry it out; the exit code. Raises Agreed."""
        collected = log.start(self.world.rank, self.world.size, logging.WARNING if self.flags.quiet else logging.INFO)
        stop = Stop(self.failure.stop_now)
        log_file = None
        try:
            self.plan = Plan(**json.loads(share(self.world, lambda: self._prepared(prepare))))
            self.rundir = self.rundir or RunDir(self.plan.folder)
            self.failure.use(self.rundir.path)
            self.failure.on_failure = self._note_failure
            if self.world.rank == 0:
                log_file = log.to_file(self.rundir.log)
            for warning in self.plan.warnings:
                collected.messages.append(warning)
                if self.world.rank == 0:
                    log.ROOT.warning(warning)
            return self._run(self.rundir, stop, collected.messages)
        except Agreed as agreed:
            begun = self.part is not None or (self.rundir is not None and not self.plan.restart)
            if begun and self.world.rank == 0:
                self._note_failure(agreed.error.message, agreed.error.exit_code)
            raise
        finally:
            stop.close()
            if log_file:
                log.ROOT.removeHandler(log_file)
                with suppress(OSError):  # what a full disk did not take
                    log_file.close()
            if self.rundir:
                self.rundir.unlock()

    def _prepared(self, prepare: Prepare) -> bytes:
        """The plan, on rank 0, which holds the folder from now on."""
        self.rundir, plan = prepare(self.app, self.world)
        folder = self.rundir.path
        for leftover in (*map(folder.joinpath, LEFTOVERS), *folder.glob("trace-rank-*.txt")):
            leftover.unlink(missing_ok=True)
        return json.dumps(asdict(plan)).encode()

    def _run(self, rundir: RunDir, stop: Stop, warnings: list[str]) -> int:
        """Read the case of the plan, make its model, and step it; the exit code. Collective."""
        from hpcpic.core.run import compiling, loop
        from hpcpic.core.tasks.graph import Pool
        from hpcpic.core.timers import Timers

        tree = loads(self.plan.config, str(rundir.config))
        for name, text in self.plan.used.items():
            use.import_text(name, text, str(rundir.given / name))
        settings = self.app.fixed_settings(tree)
        config = self.app.configure(tree)
        threads, timers = self.flags.threads or self.world.default_threads(), Timers()
        reader = self._checkpoint(rundir, config, settings) if self.plan.restart else None
        if reader and self.plan.finished and loop.at_end(config, reader.step, reader.time):
            self._say_nothing_to_do(reader)
            return 0
        crowd = crowded(self.world.node_size, threads, self.world.cores())
        if crowd and self.world.rank == 0:
            log.ROOT.warning(crowd)
        patience = parse_wall(self.flags.patience)
        pool = Pool(threads, self.world.cpus(threads), POOL_PATIENCE * patience)
        try:
            with compiling.watched(timers) as compile_time, compiling.reported(self.world, compile_time) as set_up:
                make = self.app.load()
                estimate = partial(self.app.estimate, config, self.world.size, threads, read_rates())
                memory.require_room(lambda: sum(estimate().memory.values()))
                made = make(config, self.world, pool, timers)
                set_up.set()
                with _closing(made) as model:
                    if reader:
                        self._restore(model, reader)
                    self._begin(rundir, model, threads, compile_time.seconds)
                    options = loop.Options(
                        stop, WallLimit(self.flags.seconds(), self.started), timers, threads, sys.stdout,
                        restarted_from=reader.step if reader else None,
                        history=self.plan.history,
                        attributes={"program": self.app.name, "settings": settings},
                        stop_sem=self.app.stop_sem(config),
                        patience=patience,
                        conserved=self._conserved(rundir, config, reader),
                        estimate=estimate_facts(estimate()) if self.world.rank == 0 else {},
                        warnings=warnings,
                        started=self.started,
                        replay=self._restart_command(self.plan.folder),
                        again=self._run_command(self.plan.folder),
                        quiet=self.flags.quiet,
                    )  # fmt: skip
                    interval = self.flags.interval() or trigger_of(model, "checkpoint", begun=True)
                    options.checkpoint_every = interval or options.checkpoint_every
                    outcome = loop.run(model, self.world, rundir, options)
        finally:
            pool.close()
        if self.world.rank == 0 and self.flags.summary:
            self._say(rundir, summary.render({**outcome.facts, "program": self.app.name}))
        return outcome.exit_code

    def _checkpoint(self, rundir: RunDir, config: Any, settings: Mapping[str, str]) -> checkpoint.Reader:
        """The checkpoint to go on from. Collective; raises Agreed."""
        with everywhere():
            reader = checkpoint.newest(rundir, self.world)
            checkpoint.require_same_case(reader, self.app.name, settings)
            checkpoint.require_later_end(reader, config, self.plan.folder)
        return reader

    def _restore(self, model: Model, reader: checkpoint.Reader) -> None:
        """Give the model the state of the checkpoint. Collective; raises Agreed."""
        with everywhere():
            checkpoint.hold(reader, model.columns(reader), self.world)
        if reader.version != __version__ and self.world.rank == 0:
            log.ROOT.warning(
                "%s: written by version %s; this is version %s, which may go on with other bits",
                reader.path, reader.version, __version__,
            )  # fmt: skip
        model.restore(reader)

    def _begin(self, rundir: RunDir, model: Model, threads: int, compiling_seconds: float) -> None:
        """Let the folder say that this part of the run goes on: not before nothing can refuse it. Collective."""
        now = {"ranks": self.world.size, "threads": threads, "status": "running"}
        self.part = summary.part(now | {"first_step": model.iteration, "started": summary.date(self.started)})
        now |= {"start_seconds": time.monotonic() - self.started, "start_compiling_seconds": compiling_seconds}
        now |= {"exit_code": None, "reason": "", "work_unit": model.work_unit, f"{model.work_unit}s": model.work_items}

        def write() -> bytes:
            if self.plan.restart:
                write_atomic(rundir.config, self.plan.config)
            rundir.update(**now, history=[*self.plan.history, self.part])
            return b""

        share(self.world, write)
        self.model = model

    def _conserved(self, rundir: RunDir, config: Any, reader: checkpoint.Reader | None) -> summary.Conserved:
        """The conserved scalars of this scene, as the series has them up to the step of the checkpoint; on rank 0."""
        conserved = summary.Conserved(
            getattr(config, "conserved", summary.CONSERVED), getattr(config, "dissipated", ())
        )
        if reader and self.world.rank == 0 and (rundir.path / "series.h5").exists():
            from hpcpic.core.files.series import read_series

            series = read_series(rundir.path)
            for k in range(int((series.step <= reader.step).sum())):
                conserved.add({name: float(values[k]) for name, values in series.items()})
        return conserved

    def _restart_command(self, folder: str) -> str:
        """The command that goes on from the newest checkpoint in the folder."""
        return f"{self.app.name} restart {summary.shell_word(folder)}"

    def _run_command(self, folder: str) -> str:
        """The command that does all of the run in the folder again, in another folder."""
        config, new = map(summary.shell_word, (f"{folder}/config.conf", f"{folder}-again"))
        files = map(shlex.quote, use.words(folder))
        return " ".join([f"{self.app.name} run {config} -o {new}{self.plan.allowed}", *files])

    def _say_nothing_to_do(self, reader: checkpoint.Reader) -> None:
        if self.world.rank == 0:
            log.say(
                sys.stdout,
                f"nothing to do: the run has finished, at step {reader.step}, t = {reader.time:g} s; "
                "--until T goes on to a later time\n",
            )

    def _say(self, rundir: RunDir, text: str) -> None:
        log.say(sys.stdout, text + "\n")
        with suppress(OSError), open(rundir.log, "a", encoding="utf-8") as file:  # all of it is in run.json too
            file.write(text + "\n")

    def _note_failure(self, text: str, code: int) -> None:
        """Write the failure into the run folder, if that still works; called by the one rank that reports it."""
        from hpcpic.core.run.loop import write_post_mortem

        assert self.rundir is not None
        end: dict[str, Any] = {"status": "diverged" if code == 4 else "failed", "exit_code": code, "reason": text}
        if self.model:
            end["steps"] = self.model.iteration
        history = [*self.plan.history, self.part | end] if self.part else self.plan.history
        try:
            if code == 4 and self.model:
                where, _, what = text.strip().partition(": ")
                folder = str(self.rundir.path)  # where it may have been moved to
                commands = self._restart_command(folder), self._run_command(folder)
                write_post_mortem(self.rundir, what, where, self.model, *commands)
            self.rundir.finish(**end, history=history)
        except (HpcpicError, OSError):
            log.write_error(f"{self.rundir.run_json} could not be written\n")


@contextmanager
def _closing(model: Model) -> Iterator[Model]:
    """Close the model where all ranks leave together; a rank that fails alone cannot."""
    try:
        yield model
    except Agreed:
        model.close()
        raise
    model.close()
