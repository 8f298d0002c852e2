"""Bisection for the end of stability of one knob: two horizons, three seeds of a random scene, a second knob's map."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from hpcpic.core.app.knobs import Knob, Knobs
from hpcpic.core.case.derived import Derived
from hpcpic.core.errors import CheckFailed
from hpcpic.core.study.pilot import Pilot, Pilots

BLOWUP = 30.0  # growth that counts as unstable
FIRST = 1.1  # half width of the first bracket, a factor
WIDEST = 3.0  # times the theory's limit, or times the case's own size where there is no theory:
WIDEST_BLIND = 64.0
RESOLUTION = 1.01  # a bracket as narrow as this is a limit
AGREE = 1.05  # horizons, seeds and theory agree within this factor
STRAIGHT = 0.005  # a number that departs by less from a power of the size is one
LONGER = 4.0  # the second horizon
SEEDS = (2, 3)  # beside the case's own
COLUMNS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)  # sizes of the second knob of a map, times the case's


@dataclass(frozen=True, slots=True)
class Axis:
    """The knob on a scale x where instability lies above 1: value/limit, or limit/value, or size/own size."""

    knob: Knob
    number: Derived | None  # the case's own, None where no theory says anything
    at_one: float  # size
    power: float  # x ~ size^power

    def size(self, x: float) -> float:
        return self.at_one * x ** (1.0 / self.power)

    def x(self, size: float) -> float:
        return (size / self.at_one) ** self.power

    @property
    def most(self) -> float:
        """x of the largest size that the scene allows; infinite where the end of stability is towards small sizes."""
        return self.x(self.knob.largest) if self.power > 0.0 else math.inf

    @property
    def theory(self) -> float:
        """The limit of the derived number; nan without one."""
        if self.number is None:
            return math.nan
        return self.number.stable_below if math.isfinite(self.number.stable_below) else self.number.stable_above

    def as_theory(self, limit: Limit) -> bool:
        """Whether a limit agrees with that of theory, if there is one."""
        return self.number is not None and 1.0 / AGREE <= limit.x <= AGREE

    def over(self, numbers: Mapping[str, Derived]) -> float:
        """x of a case with these derived numbers."""
        assert self.number is not None
        value = numbers[self.number.name].value
        return value / self.theory if math.isfinite(self.number.stable_below) else self.theory / value


@dataclass(slots=True)
class Limit:
    """x of the largest stable and least unstable size; None in place of a side that was not met."""

    stable: float | None
    unstable: float | None
    slow: bool = False  # 4 times the horizon moves it by more than 5 %, not to theory's: no limit, a slow growth
    late: bool = False  # of the longer horizon
    shorter: float = math.nan  # x of the limit in the first horizon, where that is not it
    seeds: dict[int, bool] = field(default_factory=dict)  # seed -> same within 5 %
    tried: dict[float, float] = field(default_factory=dict)  # x -> growth, infinite of a run that diverged
    ended: str = ""  # what ended the least unstable run

    @property
    def x(self) -> float:
        """The limit, nan when the knob has none in range."""
        if self.stable is None or self.unstable is None:
            return math.nan
        return math.sqrt(self.stable * self.unstable)


class Limits:
    """Runs of one case beyond its limits."""

    def __init__(self, pilots: Pilots, knobs: Knobs) -> None:
        self.pilots, self.knobs = pilots, knobs
        self.case_sizes = pilots.sizes_of(pilots.read.config)

    def axis(self, knob: Knob, beside: Mapping[str, float] | None = None) -> Axis:
        """The scale of a knob, with the other knobs at `beside` or as in the case."""
        others = beside or {}
        here = self.number(knob, others)
        if here is None:
            return Axis(knob, None, self.case_sizes[knob.name], 1.0)
        there = self.number(knob, {**others, knob.name: 1.25 * self.case_sizes[knob.name]})
        assert there is not None
        config = self.config({**others, knob.name: 1.25 * self.case_sizes[knob.name]})
        ratio = knob.size(config) / self.case_sizes[knob.name]
        power = math.log(there.value / here.value) / math.log(ratio) if here.value > 0 else 0.0
        if abs(power) < 0.1:
            raise CheckFailed(f"{knob.name} does not change {here.name} {here.symbol}, which has the limit")
        below = math.isfinite(here.stable_below)
        x = here.value / here.stable_below if below else here.stable_above / here.value
        power = power if below else -power
        axis = Axis(knob, here, self.case_sizes[knob.name] * x ** (-1.0 / power), power)
        return replace(axis, at_one=self.end(axis, others))

    def end(self, axis: Axis, others: Mapping[str, float]) -> float:
        """The size at which theory ends stability: that of x = 1, but where the number rises faster than a power of the
        size, as that of a plasma's step with an exact phase, which is refused from half a turn on.
        """
        low, high = self.case_sizes[axis.knob.name], axis.at_one
        middle = math.sqrt(low * high)
        if axis.power < 0.0 or low >= high or all(self.straight(axis, others, size) for size in (middle, high)):
            return high
        while high > RESOLUTION * low:
            middle = math.sqrt(low * high)
            numbers = self.numbers({**others, axis.knob.name: middle})
            refused = any(number.verdict == "fail" and not number.forceable for number in numbers.values())
            low, high = (low, middle) if refused or axis.over(numbers) >= 1.0 else (middle, high)
        return math.sqrt(low * high)

    def straight(self, axis: Axis, others: Mapping[str, float], size: float) -> bool:
        """Whether the number at a size is the power of the size that it is about the case."""
        sizes = {**others, axis.knob.name: size}
        x = axis.x(axis.knob.size(self.config(sizes)))  # of the size that is made, as steps are whole
        return abs(axis.over(self.numbers(sizes)) / x - 1.0) < STRAIGHT

    def numbers(self, sizes: Mapping[str, float]) -> dict[str, Derived]:
        """The derived numbers at these sizes, by name."""
        config = self.config(sizes) if sizes else self.pilots.read.config
        return {number.name: number for number in self.pilots.app.derived(config, self.pilots.shape[0])}

    def config(self, sizes: Mapping[str, float]) -> Any:
        return self.pilots.config({**self.case_sizes, **sizes}, self.knobs.horizon, {})

    def number(self, knob: Knob, sizes: Mapping[str, float]) -> Derived | None:
        """The derived number that limits the knob, if it has a limit of stability."""
        number = self.numbers(sizes).get(knob.limit)
        bounded = number and (math.isfinite(number.stable_below) or math.isfinite(number.stable_above))
        return number if bounded else None

    def run(self, sizes: Mapping[str, float], longer: float = 1.0, seed: int | None = None, words: str = "") -> Pilot:
        more = self.knobs.seed(seed) if self.knobs.seed and seed is not None else ()
        time = longer * self.knobs.horizon
        return self.pilots.run({**self.case_sizes, **sizes}, time, None, more, ("--beyond-limits",), words)

    def growth(self, pilot: Pilot) -> float:
        """Factor by which the watched quantity has grown; infinite when the run diverged. Raises CheckFailed."""
        if pilot.exit_code == 4:
            return math.inf
        if pilot.exit_code:
            raise CheckFailed(f"the run {pilot.folder} did not start: {pilot.words}")
        return self.knobs.growth(pilot.series)

    def bisect(
        self, axis: Axis, beside: Mapping[str, float] | None = None, start: float = 1.0, longer: float = 1.0
    ) -> Limit:
        """The limit on the axis, from a bracket about `start`, at so many times the first horizon."""
        name, others = axis.knob.name, beside or {}
        tried: dict[float, float] = {}
        ends: dict[float, str] = {}

        def probe(x: float) -> tuple[float, bool]:
            words = f"{x:.4g} of the theory's limit" if axis.number else f"{x:.4g} of the case's"
            pilot = self.run({**others, name: axis.size(x)}, longer, words=words)
            real = axis.x(pilot.sizes[name])
            tried[real] = self.growth(pilot)
            how = ": ".join(pilot.words.strip().split(": ")[:3])  # without the ways out
            ends[real] = how if pilot.exit_code else f"growth: {tried[real]:.3g}"
            return real, tried[real] > BLOWUP

        limit = bracketed(probe, start, WIDEST if axis.number else WIDEST_BLIND, axis.most)
        limit.tried, limit.ended, limit.late = tried, ends.get(limit.unstable or 0.0, ""), longer > 1.0
        return limit

    def found(self, axis: Axis, beside: Mapping[str, float] | None = None, start: float = 1.0) -> Limit:
        """The limit of the first horizon, or that of the longer one where the first has another one or none."""
        name, others = axis.knob.name, beside or {}
        limit = self.bisect(axis, others, start)
        if math.isfinite(limit.x):
            below = self.run({**others, name: axis.size(limit.x / AGREE)}, LONGER, words="four times as long")
            limit.slow = self.growth(below) > BLOWUP
        hidden = axis.number is not None and limit.unstable is None  # theory has an end that has not shown yet
        if not hidden and (not limit.slow or axis.as_theory(limit)):
            return limit
        again = 1.0 if axis.number is not None or not math.isfinite(limit.x) else limit.x / FIRST
        late = self.bisect(axis, others, again, LONGER)
        late.slow, late.shorter = limit.slow and not axis.as_theory(late), limit.x
        return late

    def other_seeds(self, axis: Axis, limit: Limit) -> None:
        """Runs of other seeds on both sides of the limit."""
        name = axis.knob.name
        below, above = axis.size(limit.x / AGREE), axis.size(limit.x * AGREE)
        for seed in SEEDS if self.knobs.seed else ():
            quiet = self.growth(self.run({name: below}, seed=seed, words=f"seed {seed}")) <= BLOWUP
            limit.seeds[seed] = quiet and self.growth(self.run({name: above}, seed=seed, words=f"seed {seed}")) > BLOWUP

    def rates(self, axis: Axis) -> list[tuple[float, float]]:
        """(size, growth rate in 1/s) about the case's own size, over the longer horizon."""
        wanted = (min(factor * self.case_sizes[axis.knob.name], axis.knob.largest) for factor in (1.0, 2.0, 4.0, 8.0))
        found = {axis.knob.size(self.config({axis.knob.name: size})): 0.0 for size in wanted}  # some sizes end early
        for size in found:
            grown = self.growth(self.run({axis.knob.name: size}, LONGER, words="growth rate"))
            found[size] = math.log(max(grown, 1e-300)) / (LONGER * self.knobs.horizon)
        return list(found.items())

    def march(self, first: Knob, second: Knob) -> list[tuple[float, Axis, Limit]]:
        """(size of the second knob, axis and limit of the first) column by column, each from the last one's limit."""
        found: list[tuple[float, Axis, Limit]] = []
        start = 1.0
        for factor in COLUMNS:
            if (size := factor * self.case_sizes[second.name]) > second.largest:
                break
            beside = {second.name: size}
            beside = {second.name: second.size(self.config(beside))}
            axis = self.axis(first, beside)
            limit = self.found(axis, beside, start)
            found.append((beside[second.name], axis, limit))
            start = limit.x if math.isfinite(limit.x) else 1.0
        return found


def bracketed(
    probe: Callable[[float], tuple[float, bool]], start: float, widest: float, most: float = math.inf
) -> Limit:
    """Geometric bisection of a bracket about `start` that is widened until its ends differ, or until `most`.

    probe(x) -> the x that was really run, the nearest there is, and whether it was unstable.
    """
    stable: float | None = None
    unstable: float | None = None
    x = start / FIRST
    while stable is None or unstable is None or unstable > stable * RESOLUTION:
        if not start / widest / 1.5 < x < start * widest * 1.5:
            break
        real, grown = probe(min(x, most))
        if real in (stable, unstable):
            break  # there is nothing between the two
        stable, unstable = (stable, real) if grown else (real, unstable)
        if stable is None or unstable is None:
            x = start * FIRST if grown is False and real < start else real / 1.5 if grown else real * 1.5
        else:
            x = math.sqrt(stable * unstable)
    return Limit(stable, unstable)
