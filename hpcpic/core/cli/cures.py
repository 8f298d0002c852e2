"""Changes that cure a case which a derived number refuses, and their costs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from hpcpic.core.app.app import App
from hpcpic.core.app.rates import read_rates
from hpcpic.core.app.read import Case, read_case
from hpcpic.core.app.text import duration
from hpcpic.core.case.config import Path, dotted
from hpcpic.core.case.derived import Derived
from hpcpic.core.case.texts import value_text
from hpcpic.core.errors import ConfigError

if TYPE_CHECKING:
    from hpcpic.core.app.knobs import Knob, Knobs

Change = Callable[[float], tuple[str, ...]]  # factor on a size -> settings
Judge = Callable[[tuple[str, ...]], str]  # settings -> verdict

DOUBLINGS = 13  # finer or coarser than the case
FINEST = 1e-3  # relative width at which the search for a legal size ends
WAYS = (  # verdicts, what is said where all numbers have such ones, and where the one that is to be cured has
    (("ok", "warn"), "the nearest legal one", "the nearest legal one for this number"),
    (("ok",), "without a warning", "without a warning of this number"),
)
OTHERS = {"warn": "; others warn", "fail": "; others still refuse the case"}  # by the worst of all numbers


def cures(app: App, read: Case, sets: Sequence[str], refused: Derived, ranks: int) -> list[str]:
    """Lines, a way each: the nearest legal size of the knob, the nearest good one, other schemes, --force. Those come
    first after which nothing refuses the case.
    """
    if app.knobs is None:
        return []
    finder = Finder(app, read, tuple(sets), refused, ranks)
    found: dict[tuple[str, ...], str] = {}
    usual = finder.usual(refused)
    for change in finder.changes(refused):
        for verdicts, all_are, this_is in WAYS[:1] if usual else WAYS:
            for judge, words in ((finder.worst, all_are), (finder.verdict, this_is)):
                assignments = finder.nearest(change, verdicts, judge)
                if assignments:
                    worst = finder.worst(assignments)
                    found.setdefault(assignments, words + ("" if worst in verdicts else OTHERS[worst]))
                    break
        if found:
            break
    if usual:
        found.setdefault(usual, "the default, without a warning")
    for choice in finder.knobs.choices:
        for value in choice.others:
            assignments = (f"{dotted(choice.key)}={value}",)
            if finder.verdict(assignments) != "fail":
                still = OTHERS["fail"] if finder.worst(assignments) == "fail" else ""
                found.setdefault(assignments, f"another scheme{still}")
    found = dict(sorted(found.items(), key=lambda way: finder.worst(way[0]) == "fail"))
    lines = [f"{' '.join(f'--set {word}' for word in a)}: {words}, {finder.cost(a)}" for a, words in found.items()]
    if refused.forceable:
        firm = any(number.verdict == "fail" and not number.forceable for number in finder.numbers(()) or ())
        words = f"lifts this limit{OTHERS['fail']}" if firm else "runs it as it is"
        lines.append(f"--force: {words}, {finder.cost(())}")
    return lines


class Finder:
    """Tries settings on the derived number that refuses the case."""

    def __init__(self, app: App, read: Case, sets: tuple[str, ...], refused: Derived, ranks: int) -> None:
        assert app.knobs is not None
        self.app, self.path, self.sets, self.ranks, self.name = app, read.path, sets, ranks, refused.name
        self.config = read.config
        self.knobs: Knobs = app.knobs(read.config)
        self._numbers: dict[tuple[str, ...], list[Derived] | None] = {}
        self.seconds = self.estimated(())

    def estimated(self, assignments: tuple[str, ...]) -> float:
        config = read_case(self.app, self.path, (*self.sets, *assignments)).config
        return float(self.app.estimate(config, self.ranks, 1, read_rates()).seconds)

    def cost(self, assignments: tuple[str, ...]) -> str:
        seconds = self.estimated(assignments)
        return f"{seconds / self.seconds:.3g} times the cost ({duration(seconds)})"

    def numbers(self, assignments: tuple[str, ...]) -> list[Derived] | None:
        """All numbers under these settings, None where they are not valid."""
        if assignments not in self._numbers:
            try:
                config = read_case(self.app, self.path, (*self.sets, *assignments)).config
                self._numbers[assignments] = self.app.derived(config, self.ranks)
            except ConfigError:
                self._numbers[assignments] = None
        return self._numbers[assignments]

    def worst(self, assignments: tuple[str, ...]) -> str:
        """The worst verdict of all numbers under these settings."""
        numbers = self.numbers(assignments)
        verdicts = {"fail"} if numbers is None else {number.verdict for number in numbers}
        return next(verdict for verdict in ("fail", "warn", "ok") if verdict in {*verdicts, "ok"})

    def verdict(self, assignments: tuple[str, ...]) -> str:
        """The number's verdict under these settings; "fail" also where they are not valid, or another number fails."""
        numbers = self.numbers(assignments)
        if numbers is None:
            return "fail"
        own = [number.verdict for number in numbers if number.name == self.name]
        others = [number.verdict for number in self.numbers(()) or ()]
        worse = sum(n.verdict == "fail" for n in numbers) > sum(verdict == "fail" for verdict in others) - 1
        return "fail" if worse and "fail" in (n.verdict for n in numbers) else own[0] if own else "ok"

    def changed(self, knob: Knob, factor: float) -> tuple[str, ...]:
        """Settings that a size brings with it, without those that stay as they are."""
        own = knob.size(self.config)
        before = self.knobs.settings({knob.name: own}, self.knobs.time)
        return tuple(a for a in self.knobs.settings({knob.name: factor * own}, self.knobs.time) if a not in before)

    def changes(self, refused: Derived) -> list[Change]:
        """The changes to try: of the knob whose limit it is or whose setting it names, of the setting itself."""
        found: list[Change] = [
            partial(self.changed, knob)
            for knob in self.knobs.knobs
            if knob.limit == refused.name or knob.key == refused.key
        ]
        value = self.at(refused.key)
        if isinstance(value, float) and value:
            found.append(lambda factor: (f"{dotted(refused.key)}={float(f'{value * factor:.4g}')!r}",))
        return found

    def usual(self, refused: Derived) -> tuple[str, ...]:
        """The default of the scheme whose limit it is, the best known, where nothing warns of it; else ()."""
        if not any(choice.key == refused.key for choice in self.knobs.choices):
            return ()
        field = type(self.at(refused.key[:-1])).model_fields[str(refused.key[-1])]
        if field.is_required():
            return ()
        assignments = (f"{dotted(refused.key)}={value_text(field.default)}",)
        return assignments if self.worst(assignments) == "ok" else ()

    def at(self, key: Path) -> Any:
        """The value of the case at a key; None where a part of it is not given."""
        value: Any = self.config
        for part in key:
            value = value[part] if isinstance(part, int) else getattr(value, part, None)
        return value

    def nearest(self, change: Change, verdicts: tuple[str, ...], judge: Judge) -> tuple[str, ...]:
        """Settings of the size next to the case's own of which `judge` gives one of the verdicts; () for none."""
        for step in (0.5, 2.0):
            tried = (step**n for n in range(1, DOUBLINGS + 1))
            good = next((factor for factor in tried if judge(change(factor)) in verdicts), None)
            if good is None:
                continue
            near = good / step
            while abs(math.log(good / near)) > FINEST:
                middle = math.sqrt(near * good)
                near, good = (near, middle) if judge(change(middle)) in verdicts else (middle, good)
            return change(good)
        return ()
