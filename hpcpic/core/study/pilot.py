"""Pilots: short runs of the user's scene with other sizes of its knobs, each in a folder of its own, done once; and the
budget of them.
"""

from __future__ import annotations

import hashlib
import math
import shutil
import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from hpcpic.core.app.app import App
from hpcpic.core.app.knobs import Knob, Knobs
from hpcpic.core.app.read import Case, read_case
from hpcpic.core.app.text import duration
from hpcpic.core.case.derived import Derived
from hpcpic.core.cli.launch import launch, within
from hpcpic.core.cli.restart import facts_of
from hpcpic.core.errors import CheckFailed, HpcpicError
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.files.series import Series, read_series
from hpcpic.core.study.sweep import run_once

USUAL_PILOTS = 20  # that search and verification may take, or this share of the run itself, or so many seconds:
USUAL_SHARE = 0.5
USUAL_SECONDS = 6.0  # to save time below it helps nobody
LEAST_SHARE, LEAST_REST = 6.0, 0.5  # pilots: the search has half of all, or all but the rest up to the least share
CLOCK_SECONDS = 0.02  # of the case's pilot: above it clocks count too

Settings = Mapping[str, str]  # dotted key -> value of a discrete setting


class Interrupted(HpcpicError):
    """A pilot was stopped from outside."""

    exit_code = 5


@dataclass(frozen=True, slots=True)
class Pilot:
    """One run: its case, its knobs' real sizes, exit code, seconds of its steps, those that `estimate` says, which
    other work of the machine does not change, counted work.
    """

    config: Any
    sizes: Mapping[str, float]
    exit_code: int
    words: str
    folder: Path
    seconds: float
    price: float
    work: float

    @property
    def series(self) -> Series:
        return read_series(self.folder)

    @property
    def warnings(self) -> list[str]:
        """The warnings of the run itself."""
        return [str(words) for words in facts_of(RunDir(self.folder)).get("warnings", ())]


class Pilots:
    """Runs of one case. `spent` counts the seconds of steps of all that were asked for."""

    def __init__(
        self, app: App, read: Case, sets: tuple[str, ...], knobs: Knobs, folder: Path, shape: tuple[int, int]
    ) -> None:
        self.app, self.read, self.sets, self.knobs = app, read, sets, knobs
        self.folder, self.shape = folder / "pilots", shape
        self.done: dict[str, Pilot] = {}
        self.start = within(app) if shape[0] == 1 else launch
        self.case_digest = repr(read.tree.files)
        self.began = time.monotonic()

    def assignments(self, sizes: Mapping[str, float], time: float, others: Settings) -> tuple[str, ...]:
        """The --set list, beside that of the pilots."""
        chosen = tuple(f"{key}={value}" for key, value in others.items())
        plain = {name: float(size) for name, size in sizes.items()}  # not numpy's, whose repr no case file knows
        return (*self.sets, *self.knobs.settings(plain, float(time)), *chosen)

    def config(self, sizes: Mapping[str, float], time: float, others: Settings) -> Any:
        """The case with these settings, completed."""
        return read_case(self.app, self.read.path, self.assignments(sizes, time, others)).config

    def beyond(self, sizes: Mapping[str, float], time: float, others: Settings, margin: float = 1.0) -> Derived | None:
        """The first derived number that is refused or beyond `margin` of the end of stability; with a margin also one
        that `check` warns of, where the case itself does not, or less.
        """
        for number in self.app.derived(self.config(sizes, time, others), self.shape[0]):
            stable = number.stable_above / margin <= number.value <= margin * number.stable_below
            if number.verdict == "fail" or not stable:
                return number
            if margin < 1.0 and number.verdict == "warn" and self.worse(number):
                return number
        return None

    @cached_property
    def own_numbers(self) -> dict[str, Derived]:
        return {number.name: number for number in self.app.derived(self.read.config, self.shape[0])}

    def worse(self, number: Derived) -> bool:
        """True if the case itself is not warned of this number, or is nearer to its limit."""
        own = self.own_numbers.get(number.name)
        if own is None or own.verdict == "ok":
            return True
        farther = number.value / own.value if own.value else 1.0
        return farther < 0.999 if number.limit.startswith(">") else farther > 1.001

    def legal(self, sizes: Mapping[str, float], time: float, others: Settings, margin: float = 1.0) -> bool:
        return self.beyond(sizes, time, others, margin) is None

    def foreseen(self, sizes: Mapping[str, float], time: float, others: Settings) -> float:
        """Seconds of a pilot's steps, by the estimate, before it is run."""
        sets = (*self.assignments(sizes, time, others), *self.knobs.pilot)
        config = read_case(self.app, self.read.path, sets).config
        told = self.app.estimate(config, *self.shape, {})
        return told.seconds - told.start if config.n_steps is None else config.n_steps * told.step_seconds

    def sizes_of(self, config: Any) -> dict[str, float]:
        return {knob.name: knob.size(config) for knob in self.knobs.knobs}

    def named(
        self, sizes: Mapping[str, float], time: float, others: Settings, more: tuple[str, ...]
    ) -> tuple[tuple[str, ...], str]:
        """The --set list of a pilot, and the name of its folder."""
        sets = (*self.assignments(sizes, time, others), *self.knobs.pilot, *more)
        return sets, hashlib.sha256(repr((self.case_digest, sets, self.shape)).encode()).hexdigest()[:12]

    def run(
        self,
        sizes: Mapping[str, float],
        time: float,
        others: Settings | None = None,
        more: tuple[str, ...] = (),
        flags: tuple[str, ...] = (),
        words: str = "",
    ) -> Pilot:
        """Run with these sizes until `time` [s], or take what was run before. Raises Interrupted."""
        sets, name = self.named(sizes, time, others or {}, more)
        if name in self.done:
            return self.done[name]
        config = read_case(self.app, self.read.path, sets).config
        rundir = RunDir(self.folder / name)
        code, how = run_once(self.app, self.read.path, sets, rundir, self.shape, flags, self.start)
        facts = facts_of(rundir)
        if code in (0, 4):
            shutil.rmtree(rundir.path / "checkpoints", ignore_errors=True)  # no run goes on from a pilot
        if code not in (0, 1, 2, 3, 4):
            raise Interrupted(f"pilot {rundir.path} ended with exit code {code}: {how}; the same command goes on")
        if code == 4:
            lines = (self.folder / f"{name}.txt").read_text(encoding="utf-8", errors="replace").splitlines()
            how = next((line for line in lines if line.startswith("diverged")), "diverged")
        steps = facts.get("steps", 0)
        seconds = steps * float((facts.get("step_seconds") or {}).get("median") or 0.0)
        seconds = seconds or float(facts.get("loop_seconds", 0.0))
        price = steps * self.app.estimate(config, *self.shape, {}).step_seconds
        pilot = Pilot(config, self.sizes_of(config), code, how, rundir.path, seconds, price, self.knobs.work(config))
        self.done[name] = pilot
        settings = "  ".join(f"{knob.name} = {knob.shown(pilot.sizes[knob.name]):.5g}" for knob in self.knobs.knobs)
        click.echo(f"  pilot {len(self.done):2d}  {settings}  {words}: {how.strip()}  {seconds:.3g} s")
        return pilot

    @property
    def spent(self) -> float:
        return sum(pilot.seconds for pilot in self.done.values())

    @property
    def took(self) -> str:
        """The time of the search in words: of steps, and by the clock, which counts starts and compiling too."""
        return f"{duration(self.spent)} of steps, {duration(time.monotonic() - self.began)} by the clock"


class Budget:
    """The allowance of search and verification together, and what is left of it, in pilots of the case's own cost."""

    def __init__(
        self, pilots: Pilots, base: Pilot, time: float, more: tuple[str, ...], allowance: float | None = None
    ) -> None:
        """base: the case's pilot until `time` [s]; more: settings of all pilots; allowance: where the user gives it."""
        self.pilots, self.base, self.time, self.more = pilots, base, time, more
        usual = max(USUAL_PILOTS, USUAL_SHARE * pilots.knobs.time / time, USUAL_SECONDS / max(base.seconds, 1e-6))
        self.allowance = allowance or usual
        self.foreseen = pilots.foreseen(base.sizes, time, {})

    @property
    def share(self) -> float:
        """Pilots of the allowance that the search may take; the rest is for the verification."""
        return max(0.5 * self.allowance, min(LEAST_SHARE, self.allowance - LEAST_REST))

    @staticmethod
    def asking(share: float) -> int:
        """The allowance that gives the search this share."""
        return math.ceil(2.0 * share if share > LEAST_SHARE else share + LEAST_REST)

    @property
    def used(self) -> float:
        """The cost of all pilots so far, by the estimate, or by the clock if that says more."""
        base, clocked = self.base, self.base.seconds > CLOCK_SECONDS
        return sum(
            max(pilot.price / base.price, pilot.seconds / base.seconds if clocked else 0.0)
            for pilot in self.pilots.done.values()
        )

    @property
    def left(self) -> float:
        return self.allowance - self.used

    def cost(self, knobs: tuple[Knob, ...], sizes: Mapping[str, float], others: Settings) -> float:
        """The cost of a pilot to come: by theory, or by the estimate if that says more; 0 where it was run."""
        if self.pilots.named(sizes, self.time, others, self.more)[1] in self.pilots.done:
            return 0.0
        theory = math.prod((self.base.sizes[knob.name] / sizes[knob.name]) ** knob.cost for knob in knobs)
        if theory > self.left:
            return theory  # told, and not even set up
        return max(theory, self.pilots.foreseen(sizes, self.time, others) / self.foreseen)

    def affordable(self, cost: float) -> bool:
        """True if the search may run pilots of this cost; those that were run cost nothing, whatever is left."""
        return not cost or self.used + cost <= self.share


def value_of(pilot: Pilot, measure: Any) -> NDArray[np.float64]:
    """The quantity, as a vector. Raises CheckFailed where the run diverged or does not show it."""
    if pilot.exit_code:
        raise CheckFailed(f"the pilot {pilot.folder} did not finish: {pilot.words}")
    try:
        value = np.atleast_1d(np.asarray(measure(pilot.series), np.float64))
    except (ArithmeticError, ValueError, KeyError) as error:
        raise CheckFailed(f"the pilot {pilot.folder} does not show the quantity: {error}") from error
    if not np.isfinite(value).all():
        raise CheckFailed(f"the pilot {pilot.folder} gives no finite value of the quantity")
    return value
