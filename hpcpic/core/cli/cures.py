"""What to change when a derived number refuses a case, and what each way costs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from hpcpic.core.cli.app import App
from hpcpic.core.cli.rates import read_rates
from hpcpic.core.cli.read import Case, read_case
from hpcpic.core.cli.text import duration
from hpcpic.core.errors import ConfigError
from hpcpic.core.files.config import dotted
from hpcpic.core.files.derived import Derived

if TYPE_CHECKING:
    from hpcpic.core.cli.knobs import Knob, Knobs

RANGE = 1e4  # times finer or coarser than the case
FINEST = 1e-3  # relative width at which the search for a legal size ends


def cures(app: App, read: Case, sets: Sequence[str], refused: Derived, ranks: int) -> list[str]:
    """Lines, a way each: the nearest legal size of the knob, the nearest good one, other schemes, --force."""
    if app.knobs is None:
        return []
    finder = Finder(app, read, tuple(sets), refused, ranks)
    found: dict[tuple[str, ...], str] = {}
    knob = next((knob for knob in finder.knobs.knobs if knob.limit == refused.name), None)
    if knob is not None:
        for verdicts, words in ((("ok", "warn"), "the nearest legal one"), (("ok",), "without a warning")):
            assignments = finder.nearest(knob, verdicts)
            if assignments:
                found.setdefault(assignments, words)
    for choice in finder.knobs.choices:
        for value in choice.others:
            assignments = (f"{dotted(choice.key)}={value}",)
            if finder.verdict(assignments) != "fail":
                found.setdefault(assignments, "another scheme")
    lines = [f"{' '.join(f'--set {word}' for word in a)}: {words}, {finder.cost(a)}" for a, words in found.items()]
    if refused.forceable:
        lines.append(f"--force: runs it as it is, {finder.cost(())}")
    return lines


class Finder:
    """Tries settings on the derived number that refuses the case."""

    def __init__(self, app: App, read: Case, sets: tuple[str, ...], refused: Derived, ranks: int) -> None:
        assert app.knobs is not None
        self.app, self.path, self.sets, self.ranks, self.name = app, read.path, sets, ranks, refused.name
        self.config = read.config
        self.knobs: Knobs = app.knobs(read.config)
        self.seconds = self.estimated(())

    def estimated(self, assignments: tuple[str, ...]) -> float:
        config = read_case(self.app, self.path, (*self.sets, *assignments)).config
        return float(self.app.estimate(config, self.ranks, 1, read_rates()).seconds)

    def cost(self, assignments: tuple[str, ...]) -> str:
        seconds = self.estimated(assignments)
        return f"{seconds / self.seconds:.3g} times the cost ({duration(seconds)})"

    def verdict(self, assignments: tuple[str, ...]) -> str:
        """Of the number under these settings; "fail" also where they are not valid, or another number refuses."""
        try:
            config = read_case(self.app, self.path, (*self.sets, *assignments)).config
        except ConfigError:
            return "fail"
        numbers = self.app.derived(config, self.ranks)
        own = [number.verdict for number in numbers if number.name == self.name]
        others = [number.verdict for number in self.app.derived(self.config, self.ranks)]
        worse = sum(n.verdict == "fail" for n in numbers) > sum(verdict == "fail" for verdict in others) - 1
        return "fail" if worse and "fail" in (n.verdict for n in numbers) else own[0] if own else "ok"

    def changed(self, knob: Knob, factor: float) -> tuple[str, ...]:
        """Settings that a size brings with it, without those that stay as they are."""
        own = knob.size(self.config)
        before = self.knobs.settings({knob.name: own}, self.knobs.time)
        return tuple(a for a in self.knobs.settings({knob.name: factor * own}, self.knobs.time) if a not in before)

    def nearest(self, knob: Knob, verdicts: tuple[str, ...]) -> tuple[str, ...]:
        """Settings of the size next to the case's own that gets one of the verdicts; () where there is none."""
        for far in (1.0 / RANGE, RANGE):
            near, good = 1.0, far
            if self.verdict(self.changed(knob, far)) not in verdicts:
                continue
            while abs(math.log(good / near)) > FINEST:
                middle = math.sqrt(near * good)
                near, good = (near, middle) if self.verdict(self.changed(knob, middle)) in verdicts else (middle, good)
            return self.changed(knob, good)
        return ()
