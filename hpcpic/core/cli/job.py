"""The main job of `run` and `restart`: all ranks agree on the case, make its model, and go through the loop."""

from __future__ import annotations

import itertools
import json
import logging
import math
import shlex
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

from hpcpic.core import memory
from hpcpic.core.app import use
from hpcpic.core.app.app import App, AppLoader
from hpcpic.core.app.forecast import Estimate
from hpcpic.core.app.rates import read_rates
from hpcpic.core.app.text import amount
from hpcpic.core.case.config import Tree, leaves, loads
from hpcpic.core.case.texts import value_text
from hpcpic.core.comm.world import World
from hpcpic.core.cores import crowded
from hpcpic.core.errors import ConfigError, FileError, HpcpicError
from hpcpic.core.files.rundir import RunDir, write_atomic
from hpcpic.core.run import checkpoint, log, summary
from hpcpic.core.run.failure import Agreed, Failure, everywhere, guarded, share
from hpcpic.core.run.outputs import trigger_of
from hpcpic.core.run.signals import Stop, WallLimit, process_start
from hpcpic.core.run.triggers import Every, EverySeconds, parse_interval, parse_wall
from hpcpic.version import __version__

if TYPE_CHECKING:
    from hpcpic.core.run import loop
    from hpcpic.core.run.model import Model


@dataclass(frozen=True, slots=True)
class Flags:
    """What `run` and `restart` have in common on the command line."""

    threads: int | None = None
    wall: str | None = None
    checkpoint_every: str | None = None
    patience: str = "0:10:00"
    quiet: bool = False
    summary: bool = True  # printed at the end

    def interval(self) -> Every | EverySeconds | None:
        return None if self.checkpoint_every is None else parse_interval(self.checkpoint_every)

    def seconds(self) -> float | None:
        return None if self.wall is None else parse_wall(self.wall)


@dataclass(slots=True)
class Plan:
    """What rank 0 has made ready and tells the others: texts and numbers only."""

    folder: str
    config: str  # with every default filled in
    restart: bool = False
    finished: bool = False  # what a restart finds
    allowed: str = ""  # words of the command that let it run beyond limits
    used: dict[str, str] = field(default_factory=dict)  # name -> text of Python files of the user
    warnings: list[str] = field(default_factory=list)
    history: list[Mapping[str, Any]] = field(default_factory=list)


SECOND = 2.0  # times the patience: who only waits for others leaves it to the watchdog, which knows more
PATIENCE_SECONDS = 2.0  # of setting up, before a line says why it takes so long
TELL_SECONDS = 4.0  # between two lines on compiling
LEFT = (".failed", "post-mortem.txt", "STOP")  # by an earlier part of the run

_jobs = itertools.count()  # of this process, one but for pilots

Prepare = Callable[[App, World], tuple[RunDir, Plan]]


def job(app_loader: AppLoader, prepare: Prepare, flags: Flags, raises: bool = False) -> int:
    """Start MPI and do the job; the exit code, the same on all ranks. `prepare` runs on rank 0 and holds the
    folder. raises: errors are raised instead of printed, for a program that is not ours.
    """
    started = process_start() if next(_jobs) == 0 and not raises else time.monotonic()
    world = World.start()
    return guarded(world, lambda failure: _Job(app_loader(), world, failure, flags, started).do(prepare), raises)


class _Job:
    def __init__(self, app: App, world: World, failure: Failure, flags: Flags, started: float) -> None:
        self.app, self.world, self.failure, self.flags = app, world, failure, flags
        self.started = started
        self.rundir: RunDir | None = None
        self.history: list[Mapping[str, Any]] = []  # the parts before this one
        self.allowed, self.restart = "", False
        self.part: dict[str, Any] | None = None  # this one, once it has begun
        self.going: Model | None = None  # the model in it
        self.compiling: Any = None

    def do(self, prepare: Prepare) -> int:
        collected = log.start(
            self.world.rank, self.world.size, logging.WARNING if self.flags.quiet else logging.INFO
        )
        stop = Stop(self.failure.stop_now)
        file = None
        try:
            plan = Plan(**json.loads(share(self.world, lambda: self._prepared(prepare))))
            self.history, self.allowed, self.restart = plan.history, plan.allowed, plan.restart
            self.rundir = self.rundir or RunDir(plan.folder)
            self.failure.use(self.rundir.path)
            self.failure.on_failure = self._note_failure
            if self.world.rank == 0:
                file = log.to_file(self.rundir.log)
            for warning in plan.warnings:
                collected.messages.append(warning)
                if self.world.rank == 0:
                    log.ROOT.warning(warning)
            return self._run(plan, stop, collected.messages)
        except Agreed as agreed:
            begun = self.part is not None or (self.rundir is not None and not self.restart)
            if begun and self.world.rank == 0:
                self._note_failure(agreed.error.message, agreed.error.exit_code)
            raise
        finally:
            stop.close()
            if file:
                log.ROOT.removeHandler(file)
                with suppress(OSError):  # what a full disk did not take
                    file.close()
            if self.rundir:
                self.rundir.unlock()

    def _prepared(self, prepare: Prepare) -> bytes:
        self.rundir, plan = prepare(self.app, self.world)
        folder = self.rundir.path
        for left in (*map(folder.joinpath, LEFT), *folder.glob("trace-rank-*.txt")):
            left.unlink(missing_ok=True)
        return json.dumps(asdict(plan)).encode()

    def _run(self, plan: Plan, stop: Stop, warnings: list[str]) -> int:
        from hpcpic.core.run import compiling, loop
        from hpcpic.core.tasks.graph import Pool
        from hpcpic.core.timers import Timers

        assert self.rundir is not None
        tree = loads(plan.config, str(self.rundir.config))
        for name, text in plan.used.items():
            use.import_text(name, text, str(self.rundir.given / name))
        settings = fixed_settings(self.app, tree)
        config = self.app.configure(tree)
        threads, timers = self.flags.threads or self.world.default_threads(), Timers()
        crowd = crowded(self.world.node_size, threads, self.world.cores())
        if crowd and self.world.rank == 0:
            log.ROOT.warning(crowd)
        with everywhere():
            reader = checkpoint.newest(self.rundir, self.world) if plan.restart else None
            if reader:
                refuse_others(reader, self.app, settings)
                refuse_earlier_end(reader, config, plan.folder)
        if reader and plan.finished and loop.at_end(config, reader.step, reader.time):
            self._nothing_to_do(reader)
            return 0
        patience = parse_wall(self.flags.patience)
        pool = Pool(threads, self.world.cpus(threads), SECOND * patience)
        try:
            with (
                compiling.watched(timers) as self.compiling,
                _asking_for_patience(self.world, self.compiling) as set_up,
            ):
                make = self.app.load()
                memory.require_room(lambda: sum(self._estimated(config, threads).memory.values()))
                made = make(config, self.world, pool, timers)
                set_up.set()
                with _closing(made) as model:
                    if reader:
                        self._take_up(model, reader)
                    self._begin(model, plan, threads)
                    options = loop.Options(
                        stop, WallLimit(self.flags.seconds(), self.started), timers, threads, sys.stdout,
                        attributes={"program": self.app.name, "settings": settings},
                        stop_sem=self.app.stop_sem(config),
                        estimate=self._estimate(config, threads), warnings=warnings, quiet=self.flags.quiet,
                        patience=patience,
                    )  # fmt: skip
                    options.conserved = self._conserved(config, reader)
                    self._complete(options, model, reader, plan)
                    outcome = loop.run(model, self.world, self.rundir, options)
        finally:
            pool.close()
        if self.world.rank == 0 and self.flags.summary:
            self._say(summary.render({**outcome.facts, "program": self.app.name}))
        return outcome.exit_code

    def _complete(
        self, options: loop.Options, model: Model, reader: checkpoint.Reader | None, plan: Plan
    ) -> None:
        """What the model, the checkpoint and the command line say on how to run."""
        options.restarted_from = reader.step if reader else None
        options.history, options.started = plan.history, self.started
        options.replay, options.again = self._replay(plan.folder), self._again(plan.folder)
        options.checkpoint_every = (
            self.flags.interval() or trigger_of(model, "checkpoint", True) or options.checkpoint_every
        )

    def _replay(self, folder: str) -> str:
        return f"{self.app.name} restart {summary.shell_word(folder)}"

    def _again(self, folder: str) -> str:
        config, new = map(summary.shell_word, (f"{folder}/config.conf", f"{folder}-again"))
        return " ".join([f"{self.app.name} run {config} -o {new}{self.allowed}", *map(shlex.quote, use.words(folder))])

    def _take_up(self, model: Model, reader: checkpoint.Reader) -> None:
        """Go on from a checkpoint. Collective; raises Agreed."""
        with everywhere():
            checkpoint.hold(reader, model.columns(reader), self.world)
        if reader.version != __version__ and self.world.rank == 0:
            log.ROOT.warning(
                "%s: written by version %s; this is version %s, which may go on with other bits",
                reader.path, reader.version, __version__,
            )  # fmt: skip
        model.restore(reader)

    def _nothing_to_do(self, reader: checkpoint.Reader) -> None:
        """Tell it; the folder stays as the run has left it."""
        if self.world.rank == 0:
            log.say(
                sys.stdout,
                f"nothing to do: the run has finished, at step {reader.step}, t = {reader.time:g} s; "
                "--until T goes on to a later time\n",
            )

    def _begin(self, model: Model, plan: Plan, threads: int) -> None:
        """The folder says that this part of the run goes on: not before nothing can refuse it. Collective."""
        now = {"ranks": self.world.size, "threads": threads, "status": "running"}
        self.part = summary.part(now | {"first_step": model.iteration, "started": summary.date(self.started)})
        now |= {"start_seconds": time.monotonic() - self.started, "start_compiling_seconds": self.compiling.seconds}
        now |= {"exit_code": None, "reason": "", "work_unit": model.work_unit, f"{model.work_unit}s": model.work_items}

        def write() -> bytes:
            assert self.rundir is not None
            if plan.restart:
                write_atomic(self.rundir.config, plan.config)
            self.rundir.update(**now, history=[*self.history, self.part])
            return b""

        share(self.world, write)
        self.going = model

    def _conserved(self, config: Any, reader: checkpoint.Reader | None) -> summary.Conserved:
        """The conserved scalars of this scene, as the series has them up to the step of the checkpoint; on rank 0."""
        conserved = summary.Conserved(
            getattr(config, "conserved", summary.CONSERVED), getattr(config, "dissipated", ())
        )
        if reader and self.world.rank == 0 and self.rundir and (self.rundir.path / "series.h5").exists():
            from hpcpic.core.files.series import read_series

            series = read_series(self.rundir.path)
            for k in range(int((series.step <= reader.step).sum())):
                conserved.add({name: float(values[k]) for name, values in series.items()})
        return conserved

    def _estimate(self, config: Any, threads: int) -> dict[str, float]:
        """The estimate of this run, in the units of the summary; on rank 0."""
        if self.world.rank:
            return {}
        from hpcpic.core.cli.estimate import numbers

        return numbers(self._estimated(config, threads))

    def _estimated(self, config: Any, threads: int) -> Estimate:
        return self.app.estimate(config, self.world.size, threads, read_rates())

    def _say(self, text: str) -> None:
        assert self.rundir is not None
        log.say(sys.stdout, text + "\n")
        with suppress(OSError), open(self.rundir.log, "a", encoding="utf-8") as file:  # all of it is in run.json too
            file.write(text + "\n")

    def _note_failure(self, text: str, code: int) -> None:
        """Write the failure into the run folder, if that still works; called by the one rank that reports it."""
        from hpcpic.core.run.loop import write_post_mortem

        assert self.rundir is not None
        end: dict[str, Any] = {"status": "diverged" if code == 4 else "failed", "exit_code": code, "reason": text}
        if self.going:
            end["steps"] = self.going.iteration
        history = [*self.history, self.part | end] if self.part else self.history
        try:
            if code == 4 and self.going:
                where, _, what = text.strip().partition(": ")
                replay, again = self._replay(str(self.rundir.path)), self._again(str(self.rundir.path))
                write_post_mortem(self.rundir, what, where, self.going, replay, again)
            self.rundir.finish(**end, history=history)
        except (HpcpicError, OSError):
            log.write_error(f"{self.rundir.run_json} could not be written\n")


@contextmanager
def _asking_for_patience(world: World, compiling: Any) -> Iterator[threading.Event]:
    """While kernels are compiled, a line on rank 0 says now and then how far that is; one says that setting up takes
    long, until the event that is given is set.
    """
    from hpcpic.core.simd.team import team

    over, set_up = threading.Event(), threading.Event()

    def tell() -> None:
        again = time.monotonic()
        while not over.wait(PATIENCE_SECONDS):
            if compiling.depth and time.monotonic() >= again:
                again = time.monotonic() + TELL_SECONDS
                log.ROOT.info(
                    "compiling the kernels of this kind of scene, %d of %d so far, on %s; the next run finds them made",
                    team.n_done, team.n_asked, summary.several(world.node_size * team.size, "core"),
                )  # fmt: skip
            elif not compiling.any and not set_up.is_set():
                log.ROOT.info("setting up")
                set_up.set()

    if world.rank == 0:
        threading.Thread(target=tell, name="patience", daemon=True).start()
    try:
        yield set_up
    finally:
        over.set()


@contextmanager
def _closing(model: Model) -> Iterator[Model]:
    """Closes the model when all ranks leave together; a rank that fails alone cannot close it."""
    try:
        yield model
    except Agreed:
        model.close()
        raise
    model.close()


def fixed_settings(app: App, tree: Tree) -> dict[str, str]:
    """key -> value of the settings that belong to the state: a restart cannot change them."""
    return {key: value_text(value) for key, value in leaves(tree.data) if not app.may_change(key)}


def refuse_others(reader: checkpoint.Reader, app: App, settings: Mapping[str, str]) -> None:
    """Raises unless the checkpoint was made with these settings: ConfigError lists what differs."""
    program = reader.attributes.get("program")
    if program != app.name:
        raise FileError(f"{reader.path}: a checkpoint of {program or 'another program'}, not of {app.name}")
    before: dict[str, str] = reader.attributes["settings"]
    differing = [key for key in {**before, **settings} if before.get(key) != settings.get(key)]
    if differing:
        raise ConfigError(
            [f"{reader.path}: the state was made with other settings; a restart cannot change them:"]
            + [f"  {key}: {before.get(key, 'not set')} then, {settings.get(key, 'not set')} now" for key in differing]
        )


def refuse_earlier_end(reader: checkpoint.Reader, config: Any, folder: str) -> None:
    """ConfigError where the run is to end before the checkpoint."""
    step = reader.time / max(reader.step, 1)  # on average
    if config.n_steps is None:  # its last step ends a little after the end
        end, beyond = config.end_time, config.end_time < reader.time - 2.0 * step
    else:
        end, beyond = config.n_steps * step, config.n_steps < reader.step
    if beyond:
        raise ConfigError(
            f"{folder}: the checkpoint is of step {reader.step}, t = {reader.time:g} s, "
            f"beyond the end asked for, t = {end:g} s"
        )


def require_memory(app: App, config: Any, ranks: int, here: int, force: bool) -> list[str]:
    """A warning where the ranks on this machine need more memory than it has: the out-of-memory killer of the kernel
    would end them without a message. ConfigError without `force`.
    """
    items = app.estimate(config, ranks, 1, read_rates()).memory
    wanted, there = here * sum(items.values()), memory.free() + here * memory.held()
    if wanted <= there:
        return []
    most = max(items, key=lambda name: items[name])
    text = (
        f"memory: {summary.several(here, 'rank')} on this machine take about {amount(wanted)}, most of it for "
        f"{most}, and there are {amount(there)}: a case of {there / wanted:.1%} of the size fits, or "
        f"{math.ceil(wanted / there)} such machines"
    )
    if not force:
        raise ConfigError(f"{text} (--force runs it, in Python force=True)")
    return [f"{text} (refused without --force)"]
