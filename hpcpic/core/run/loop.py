"""The step loop of every simulator: step, observe, agree whether to go on, checkpoint, end."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TextIO

from hpcpic.core.comm.world import World
from hpcpic.core.errors import FileError
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.run import checkpoint, summary
from hpcpic.core.run.failure import PATIENCE_SECONDS, Agreed, Watchdog
from hpcpic.core.run.guard import Guard, Verdict
from hpcpic.core.run.outputs import Outputs
from hpcpic.core.run.progress import Progress
from hpcpic.core.run.signals import Reason, Stop, WallLimit
from hpcpic.core.run.summary import Conserved, StepTimes
from hpcpic.core.run.triggers import Every, EverySeconds, EveryTime
from hpcpic.core.simd.compile import compilations
from hpcpic.core.timers import Timers

if TYPE_CHECKING:
    from hpcpic.core.run.model import Ending, Model

log = logging.getLogger("hpcpic.run")

CHECKPOINT_SECONDS = 900.0
CHECKPOINT_TRIES = 3
UNKNOWN_STEP_SECONDS = 60.0
LOOK_SECONDS = 0.1  # between two looks for the file STOP


@dataclass(slots=True)
class Options:
    """Options of a run; the same on all ranks."""

    stop: Stop
    wall: WallLimit
    timers: Timers
    threads: int
    screen: TextIO
    checkpoint_every: Every | EveryTime | EverySeconds = field(default_factory=lambda: EverySeconds(CHECKPOINT_SECONDS))
    stop_sem: float = 0.0
    patience: float = PATIENCE_SECONDS  # with a step that does not end
    restarted_from: int | None = None  # step of the checkpoint
    history: Sequence[Mapping[str, Any]] = ()  # the parts of the run before this one
    attributes: Mapping[str, Any] = field(default_factory=dict)  # of every checkpoint
    conserved: Conserved = field(default_factory=Conserved)  # a restart's has seen the series so far
    estimate: Mapping[str, float] | None = None
    warnings: list[str] = field(default_factory=list)  # grows while the run goes
    started: float = field(default_factory=time.monotonic)
    replay: str = ""  # command that goes on from the newest checkpoint
    again: str = ""  # command that does all of it again
    quiet: bool = False  # no line on how far the run is


@dataclass(frozen=True, slots=True)
class Outcome:
    """The end of a run, the same on all ranks. `facts` (rank 0 has all of them) are what run.json got."""

    exit_code: int
    status: str
    reason: str
    facts: Mapping[str, Any]


def run(model: Model, world: World, rundir: RunDir, options: Options) -> Outcome:
    """Step the model to its last step or to a reason to stop. Collective; raises Agreed and what the model raises."""
    watchdog = Watchdog(rundir, world.rank, options.patience)
    try:
        return _Run(model, world, rundir, options, watchdog).to_the_end()
    finally:
        watchdog.close()


def at_end(ending: Ending, step: int, time: float) -> bool:
    """True after the last step, or at the end time of a run that does not know their number."""
    return time >= ending.end_time if ending.n_steps is None else step >= ending.n_steps


class _Run:
    def __init__(self, model: Model, world: World, rundir: RunDir, options: Options, watchdog: Watchdog) -> None:
        self.model, self.world, self.rundir, self.options, self.watchdog = model, world, rundir, options, watchdog
        self.first = model.iteration
        self.step_times = StepTimes()
        self.progress = Progress(
            options.screen,
            self.first,
            model.n_steps,
            model.work_items,
            "p" if model.work_unit == "particle" else "n",
            times=(model.time, model.end_time),
        )
        self.outputs = Outputs(
            model,
            world,
            rundir,
            options.timers,
            progress=self.progress,
            conserved=options.conserved,
            rest=watchdog.rest,
            after=options.restarted_from,
        )
        self.guard = Guard(world, model.guard, model.iteration)
        self.checkpoint_failures = 0
        self.checkpoint_seconds = 0.0
        self.saved: int | None = options.restarted_from
        self.looked = 0.0

    def to_the_end(self) -> Outcome:
        model, options = self.model, self.options
        log.info(
            "%s on %s x %s",
            f"steps {self.first} to {model.n_steps}"
            if model.n_steps is not None
            else f"from step {self.first}, t = {model.time:g} s, to t = {model.end_time:g} s",
            summary.several(self.world.size, "rank"),
            summary.several(options.threads, "thread"),
        )
        options.timers.reset()
        started = time.perf_counter()
        self.outputs.look(model.iteration, model.time)
        verdict = self.agree()
        while not self.over(verdict):
            self.take_steps()
            self.outputs.look(model.iteration, model.time)
            if self.agreement_due():
                verdict = self.agree()
                if verdict.write:
                    self.write_series()
                if verdict.checkpoint and not self.over(verdict):
                    self.write_checkpoint()
            self.show_progress()
        options.stop.acknowledge()
        return self.finish(verdict, time.perf_counter() - started)

    def show_progress(self) -> None:
        model = self.model
        if self.world.rank == 0 and not self.options.quiet and self.progress.due(model.iteration, model.time):
            self.progress.items = model.work_items  # fluid comes and leaves
            self.progress.show(model.iteration, model.time, self.model.time_step, self.model.end_time)

    def take_steps(self) -> None:
        """One step, or as many as the model takes at once without an observer in between."""
        model, first = self.model, self.model.iteration
        begin = time.perf_counter()
        model.advance(self.unseen_steps())
        self.watchdog.step()
        steps = model.iteration - first
        if first == self.first:
            log.info("the first step was done after %.1f s", time.monotonic() - self.options.started)
        self.step_times.add((time.perf_counter() - begin) / steps, steps)

    def unseen_steps(self) -> int:
        """Steps from this one to the next that is observed, guarded, kept or the last: the same on all ranks."""
        step, every, last = self.model.iteration, self.options.checkpoint_every, self.model.n_steps
        if last is None:
            return 1
        looks: list[float] = [last - step, self.guard.ahead(step)]
        looks += [observer.trigger.ahead(step) for observer in self.outputs.observers]
        looks += [every.ahead(step)] if isinstance(every, Every) else []
        return int(min(looks))

    def at_end(self) -> bool:
        return at_end(self.model, self.model.iteration, self.model.time)

    def agreement_due(self) -> bool:
        step, every = self.model.iteration, self.options.checkpoint_every
        timely = isinstance(every, (Every, EveryTime)) and every.due(step, self.model.time)
        return self.guard.due(step) or self.at_end() or timely

    def agree(self) -> Verdict:
        """Collective: divergence, reasons to stop, and whether a checkpoint is due."""
        every, step = self.options.checkpoint_every, self.model.iteration
        if isinstance(every, EverySeconds):
            due = self.world.rank == 0 and every.due()
        else:
            due = every.due(step, self.model.time)
        with self.options.timers.section("guard"):
            verdict = self.guard.agree(step, self.reason(), due and step > self.first, self.outputs.due)
        self.options.stop.step_seconds = self.guard.step_seconds
        self.feed()
        return verdict

    def feed(self) -> None:
        """The watchdog; before the first interval is measured a step is trusted to take long."""
        self.watchdog.feed(self.guard.step_seconds or UNKNOWN_STEP_SECONDS)

    def reason(self) -> Reason:
        """The reason for which this rank would stop now."""
        heard = self.options.stop.reason
        now = time.monotonic()
        if self.world.rank != 0 or heard or now - self.looked < LOOK_SECONDS:
            return heard
        self.looked = now
        if self.rundir.stop_asked():
            return Reason.STOP_FILE
        if self.options.wall.over(self.guard.interval, self.checkpoint_seconds):
            return Reason.WALL
        return Reason.MEAN_KNOWN if self.step_times.known(self.options.stop_sem) else Reason.NONE

    def over(self, verdict: Verdict) -> bool:
        return bool(verdict.diverged) or verdict.reason is not Reason.NONE or self.at_end()

    def write_series(self) -> None:
        """Collective: what rank 0 writes is outside the others' patience, and they leave their cores to it."""
        self.watchdog.rest()
        self.outputs.flush()
        self.world.wait_for_work()
        self.feed()

    def write_checkpoint(self, last: Mapping[str, Any] | None = None) -> None:
        """Collective. A failure is a warning, until the third one in a row or the one of the `last` state."""
        self.write_series()
        model, options = self.model, self.options
        self.watchdog.rest()
        begin = time.perf_counter()
        try:
            with options.timers.section("checkpoint"):
                state = model.state() if last is None else last
                place = (model.iteration, model.time)
                checkpoint.write(self.world, self.rundir, *place, state, options.attributes)
        except FileError as error:
            if self.outputs.follow():  # moved while it was written
                return self.write_checkpoint(last)
            self.checkpoint_failures += 1
            if last is not None or self.checkpoint_failures == CHECKPOINT_TRIES:
                raise Agreed(error) from error
            log.warning("checkpoint at step %d: %s", model.iteration, error.message)
        else:
            self.checkpoint_failures = 0
            self.saved = model.iteration
        self.checkpoint_seconds = time.perf_counter() - begin
        options.checkpoint_every.done(model.time)
        self.feed()

    def finish(self, verdict: Verdict, loop_seconds: float) -> Outcome:
        self.watchdog.rest()
        loop_compiling, _ = self.options.timers.totals().get("compiling", (0.0, 0))
        status, code, reason = self.ending(verdict)
        if code == 0:
            self.outputs.look(self.model.iteration, self.model.time, at_end=True)
        self.write_series()
        self.watchdog.rest()
        digest = None if code == 4 else self.keep_state()
        self.outputs.follow()
        if code == 0 and self.world.any(bool(self.outputs.broken)):
            code, reason = 6, "the steps are all done, but output is missing (see the warnings)"
        facts = self.facts(status, code, reason, loop_seconds, loop_compiling) | {"state_digest": digest}
        if self.world.rank == 0:
            self.progress.clear()
            self.write_facts(facts)
        if code == 4:
            self.write_post_mortem(verdict)
        self.world.barrier()  # the folder is complete when any rank leaves
        return Outcome(code, status, reason, facts)

    def keep_state(self) -> str:
        """The state at the end, in a checkpoint unless it is in one; its digest. Collective."""
        with self.options.timers.section("checkpoint"):
            state = self.model.state()
        if self.saved != self.model.iteration:
            self.write_checkpoint(last=state)
            self.watchdog.rest()
        return checkpoint.digest(self.world, state)

    def ending(self, verdict: Verdict) -> tuple[str, int, str]:
        """status, exit code, reason"""
        step = self.model.iteration
        if verdict.diverged:
            return (
                "diverged",
                4,
                f"step {step}, t = {self.model.time:.6g} s, rank {verdict.rank}: {verdict.diverged}",
            )
        if self.at_end() or verdict.reason is Reason.NONE:
            return "finished", 0, ""
        if verdict.reason is Reason.MEAN_KNOWN:
            return "finished", 0, verdict.reason.text
        why = verdict.reason.text
        if verdict.reason is Reason.WALL and step == self.first:  # a job that is submitted again would never end
            why += f" came before the first step: the start alone took {time.monotonic() - self.options.started:.1f} s"
        return "stopped", 5, f"{why}; go on with: {self.options.replay}"

    def facts(self, status: str, code: int, reason: str, loop_seconds: float, loop_compiling: float) -> dict[str, Any]:
        """What run.json says at the end. Collective; timers are on rank 0 only."""
        model, options, world = self.model, self.options, self.world
        wall = time.monotonic() - options.started
        steps = model.iteration - self.first
        facts: dict[str, Any] = {
            "status": status,
            "exit_code": code,
            "reason": reason,
            "steps": model.iteration,
            "first_step": self.first,
            "steps_done": steps,
            "time": model.time,
            "wall_seconds": wall,
            "loop_seconds": loop_seconds,
            "loop_compiling_seconds": loop_compiling,
            "started": summary.date(options.started),
            "ranks": world.size,
            "threads": options.threads,
            "work_items": model.work_items,
            "work_unit": model.work_unit,
            "step_seconds": self.step_times.facts(),
            "peak_memory_mib_per_rank": summary.peak_memory_mib(world),
            "compiled_functions": round(world.max(float(compilations.n))),
            "load": summary.load(world, model.local_items),
            "timers": summary.sections(world, options.timers, options.timers.wall),
            "conservation": self.options.conserved.facts(),
            "estimate": dict(options.estimate or {}),
            "warnings": list(options.warnings),
            "folder": str(self.rundir.path),
        }
        return facts | _rates(facts)

    def write_facts(self, facts: dict[str, Any]) -> None:
        facts["history"] = [*self.options.history, summary.part(facts)]
        self.rundir.write_timers(facts["timers"])
        self.rundir.finish(**facts)

    def write_post_mortem(self, verdict: Verdict) -> None:
        """Collective; by the rank that has the worst particles."""
        model, options = self.model, self.options
        where = f"rank {verdict.rank} of {self.world.size}"
        worst = model.worst()
        if self.world.rank == verdict.rank:
            write_post_mortem(self.rundir, str(verdict.diverged), where, model, options.replay, options.again, worst)


def write_post_mortem(
    rundir: RunDir, what: str, where: str, model: Model, replay: str, again: str, worst: Sequence[str] = ()
) -> None:
    """post-mortem.txt: what is wrong, where and when it was seen, from where to go on, lines on the worst particles and
    nodes of this rank. replay: from a checkpoint; again: from the start. Raises OSError.
    """
    kept = checkpoint.newest_step(rundir)
    lines = [
        f"what       {what}",
        f"where      {where}",
        f"when       seen at step {model.iteration}, t = {float(model.time)!r} s",
        f"kept       {'none: start again' if kept is None else f'checkpoint of step {kept}'}",
        f"replay     {again if kept is None else replay}",
    ]
    lines += ["", "the worst on this rank, as they were then", *worst] if worst else []
    (rundir.path / "post-mortem.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _rates(facts: Mapping[str, Any]) -> dict[str, Any]:
    """The names that users rely on: particles or nodes, ns_per_particle_step or mlups, of the median step."""
    items, seconds, unit = facts["work_items"], facts["step_seconds"]["median"], facts["work_unit"]
    found = {f"{unit}s": items}
    if facts["steps_done"] == 0:
        return found
    if not seconds > 0:
        seconds = facts["loop_seconds"] / facts["steps_done"]
    if items and unit == "particle":
        found["ns_per_particle_step"] = 1e9 * seconds / items
    elif items:
        found["mlups"] = 1e-6 * items / seconds
    return found | {"step_ms": 1e3 * seconds}
