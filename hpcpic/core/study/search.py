"""The search of `tradeoff`: laws of the knobs from pilots, the reference that they give, other schemes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.app.knobs import Choice, Knob, Quantity
from hpcpic.core.case.config import dotted
from hpcpic.core.errors import CheckFailed
from hpcpic.core.study.budget import Budget
from hpcpic.core.study.error_models import ErrorModel, Level, fit, hidden, levelled, norm, scattered
from hpcpic.core.study.field import seen_field
from hpcpic.core.study.pilot import Pilot, Pilots, Settings, value_of
from hpcpic.core.study.quantities import is_nothing, telling
from hpcpic.core.study.record import Hint

LADDERS = (  # times the case's own size: coarser where that is legal, finer where it is affordable
    (2.0, 4.0), (1.4, 2.0), (1.2, 1.4), (0.5, 2.0), (0.7, 1.4), (0.5, 0.25), (0.7, 0.5), (0.8, 0.65),
)  # fmt: skip
NEGLIGIBLE = 0.25  # of the error wanted: a knob that makes less at its coarsest level
FIRST = (2.0, 1.4, 1.2, 0.7, 0.8)  # times the case's own size: the second level of a knob whose order theory knows
DRAWN = (4.0, 16.0)  # likewise, of one whose errors are drawn: no order is observed, so levels may lie far apart
STRIDE = 4.0  # to the next level of a knob that shows little effect
SAVES = 0.9  # times the price: a coarser level must cost less than that for a still coarser one to be of use
MORE = (0.7, 0.5)  # times the finest size: levels that a law in doubt may want, and where errors scatter:
MORE_SCATTERED = (1.4, 1.2, 0.84, 0.7)  # those above 1 times the case's
LEVELS = 12  # of one knob
UNSURE = 1.25  # times the one difference measured is the error of another scheme
WORTH = 0.8  # times the cost: another scheme must save this much to be chosen
CHEAP = 0.9  # times the cost of the case, by the estimate: a scheme that can only save time is tried
DEAR = 1.5  # times the cost of the case, by the estimate: a scheme that is not tried
TIMED = 0.1  # seconds of a pilot below which its clock says nothing of the cost of a scheme


@dataclass(frozen=True, slots=True)
class Scheme:
    """A combination of discrete settings: its cost beside the case's, its own error, and its laws."""

    others: Settings
    cost: float
    floor: float
    laws: tuple[ErrorModel, ...]

    @property
    def words(self) -> str:
        return ", ".join(f"{key.rpartition('.')[2]} = {value}" for key, value in self.others.items())


@dataclass(frozen=True, slots=True)
class Alternative:
    """One other value of a choice: cost beside the case's, the law it changes, or an error of its own."""

    others: Settings
    cost: float
    law: ErrorModel | None
    floor: float = 0.0


class Search:
    """Search for the cheapest setting for one quantity of a case. Errors are relative to the norm of the reference."""

    def __init__(
        self,
        pilots: Pilots,
        knobs: Sequence[Knob],
        choices: Sequence[Choice],
        quantity: Quantity,
        wanted: float,
        most: float | None = None,
        *,
        brief: bool = False,
        hints: Mapping[str, Hint] | None = None,
    ) -> None:
        """wanted: the least error that matters; most: pilots that may be taken; brief: two levels of a knob will do
        where theory knows its order, as a recommendation is to be run that checks it; hints: of earlier searches.
        """
        self.pilots, self.knobs, self.choices, self.quantity = pilots, knobs, choices, quantity
        self.wanted, self.brief, self.hints = wanted, brief, hints or {}
        self.own = pilots.sizes_of(pilots.read.config)
        self.base = self.pilot(self.own, words="the case itself")
        self.budget = Budget(pilots, self.base, float(quantity.time), self.snapshot, most)
        self.left_out = ""  # the level that was wanted most, and is dearer than what is left
        self.value = self.measured(self.base)
        self.scale = abs(quantity.exact) if quantity.exact else norm(self.value)
        self.refuse_nothing()
        self.levels: dict[str, list[Level]] = {}
        self.finer: list[Pilot] = []  # with one knob finer than the case
        self.laws: dict[str, ErrorModel] = {}
        self.shadows: dict[str, ErrorModel] = {}  # laws of the field beside the quantity
        self.field = self.field_of(self.base)
        self.field_scale = norm(self.field) if self.field is not None else 0.0
        for knob in knobs:
            self.climb(knob)
        for knob in knobs:
            self.stride(knob)
        while self.uncertainty > 0.5 * self.wanted and self.more():
            pass
        self.schemes = list(self.combinations())

    def refuse_nothing(self) -> None:
        """Raises CheckFailed for a quantity that is zero, by symmetry or at all."""
        name, series = self.quantity.column, self.base.series
        if self.scale and not (name and is_nothing(series, name)):
            return
        why = f"{name} is zero by symmetry" if name else f"{self.quantity.name} is zero"
        others = ", ".join(column for column in telling(series) if column != name)
        raise CheckFailed(f"{why} in this scene: no relative error. Columns that are not: {others}")

    # ------------------------------------------------------------------------------------------ pilots

    def pilot(self, sizes: Mapping[str, float], others: Settings | None = None, words: str = "") -> Pilot:
        return self.pilots.run(sizes, float(self.quantity.time), others, self.snapshot, words=words)

    @property
    def snapshot(self) -> tuple[str, ...]:
        """Settings by which a pilot writes the field that is looked at."""
        seen = self.pilots.knobs.seen
        return seen.snapshot(float(self.quantity.time)) if seen else ()

    def measured(self, pilot: Pilot) -> NDArray[np.float64]:
        if not self.quantity.field:
            return value_of(pilot, self.quantity.measure)
        value = self.field_of(pilot)
        if value is None:
            raise CheckFailed(f"the pilot {pilot.folder} did not finish: {pilot.words}")
        return value

    def field_of(self, pilot: Pilot) -> NDArray[np.float64] | None:
        seen = self.pilots.knobs.seen
        return seen_field(pilot.folder, seen) if seen and not pilot.exit_code else None

    def level(self, knob: str, pilot: Pilot) -> Level:
        value, field = self.measured(pilot), self.field_of(pilot)
        noise = self.quantity.noise(pilot.series) / self.scale if self.quantity.noise else 0.0
        return Level(pilot.sizes[knob], value, pilot.seconds, pilot.price, noise, field)

    def cost(self, sizes: Mapping[str, float], others: Settings | None = None) -> float:
        """What a pilot will cost, in pilots of the case's own cost."""
        return self.budget.cost(tuple(self.knobs), sizes, others or {})

    def fits(self, knob: Knob, size: float) -> bool:
        """True if the search may run one more level of a knob, which is told where it is left out."""
        cost = self.cost({**self.own, knob.name: size})
        fits = self.budget.affordable(cost)
        if not fits and not self.left_out:
            self.left_out = f"{knob.name} = {knob.shown(size):.4g} would cost {cost:.3g} pilots of the case's own cost"
        return fits

    def climb(self, knob: Knob) -> None:
        """Levels of one knob, all else as in the case: two where theory knows its order, three of others. Those that
        earlier searches and theory say to tell most are tried first.
        """
        name, hint = knob.name, self.hints.get(knob.name)
        known = self.brief and not knob.noisy and (hint is None or hint.steady)
        enough, lacking = 2 if known else 3, []
        usual = [(factor,) for factor in FIRST] if known else [DRAWN] if knob.noisy else []
        self.levels[name] = [self.level(name, self.base)]
        for ladder in ([hint.levels(knob.noisy)] if hint else []) + usual + [*LADDERS]:
            sizes = [self.own[name] * factor for factor in ladder]
            if len(self.levels[name]) >= enough or not all(self.legal(name, size) for size in sizes):
                continue
            cost = sum(self.cost({**self.own, name: size}) for size in sizes)
            if not self.budget.affordable(cost):
                lacking.append(cost)
                continue
            for size in sizes:
                self.add(knob, size)
        if len(self.levels[name]) < enough:
            raise CheckFailed(self.stuck(knob, min(lacking, default=0.7**-knob.cost + 0.5**-knob.cost)))
        self.refit(knob)
        if self.spread(name) <= self.noise(name):
            self.complete([name])  # whether its effect has an order, or is drowned

    def stride(self, knob: Knob) -> None:
        """Coarser levels of a knob while it shows little effect."""
        name = knob.name
        while True:
            law = self.laws[name]
            coarsest = float(law.sizes[-1])
            low = law.bound(coarsest) < NEGLIGIBLE * self.wanted
            size = coarsest * STRIDE
            wanted = low and len(law.sizes) <= 5 and self.legal(name, size) and self.saves(name)
            if not (wanted and self.fits(knob, size) and self.add(knob, size)):
                return
            self.refit(knob)

    def saves(self, name: str) -> bool:
        """True if the coarsest level of a knob costs less than the case: its own price tells what coarser ones save."""
        coarsest = max(self.levels[name], key=lambda level: level.size)
        return coarsest.price < SAVES * self.base.price

    def stuck(self, knob: Knob, cost: float) -> str:
        """A sentence on why there are no three levels of a knob, the cheapest of which cost so many pilots."""
        own = self.own[knob.name]
        found = [f"{knob.name}: no three levels about {knob.shown(own):.4g} {knob.unit}".rstrip()]
        for word, factor in (("coarser", 1.4), ("finer", 0.7)):
            number = self.pilots.beyond({**self.own, knob.name: factor * own}, self.quantity.time, {})
            found += [f"{word}: {number}"] if number else []
        used, share = self.budget.used, self.budget.share
        found.append(f"{max(share - used, 0.0):.2g} of {share:.2g} pilots of the case's cost are left")
        needed = self.budget.asking(used + cost)
        found.append(f"--pilots {needed} pays for them, {needed * self.base.seconds:.2g} s in all")
        others = ",".join(k.name for k in self.knobs if k is not knob)
        return "; ".join([*found, f"without it: --knobs {others}"] if others else found)

    def legal(self, name: str, size: float, margin: float = 1.0) -> bool:
        return self.pilots.legal({**self.own, name: size}, self.quantity.time, {}, margin)

    def add(self, knob: Knob, size: float) -> bool:
        """One more level; False when it is one that is there, or shows nothing."""
        name = knob.name
        wanted = {**self.own, name: size}
        real = self.pilots.sizes_of(self.pilots.config(wanted, self.quantity.time, {}))[name]
        if any(abs(math.log(real / level.size)) < 0.05 for level in self.levels[name]):
            return False
        pilot = self.pilot(wanted, words=f"{name} x {real / self.own[name]:.3g}")
        try:
            level = self.level(name, pilot)
        except CheckFailed:
            return False
        if norm(level.value - self.value) > self.scale:
            return False  # an error as large as the quantity follows no law
        self.levels[name].append(level)
        if level.size < self.own[name]:
            self.finer.append(pilot)
        return True

    def spread(self, name: str) -> float:
        """The farthest that a level of a knob is from the case's own value, relative."""
        return max(norm(level.value - self.value) for level in self.levels[name]) / self.scale

    def noise(self, name: str) -> float:
        """Half the 95 % interval of the difference of two levels of a knob, where the quantity is a mean over time."""
        levels = self.levels[name]
        return max(math.hypot(levels[0].noise, level.noise) for level in levels)

    def refit(self, knob: Knob) -> None:
        """The law of one knob, and that of the field beside it."""
        name, levels = knob.name, self.levels[knob.name]
        law = fit(name, levels, self.own[name], knob.order, knob.cost, self.scale)
        spread, noise = self.spread(name), self.noise(name)
        if knob.noisy and not law.idle and not law.asymptotic:
            law = scattered(law, levels, self.scale)
        elif not law.idle and not law.asymptotic and spread <= noise:
            law = hidden(law, spread)
        elif not law.idle and not law.asymptotic and len(levels) >= 4:
            law = levelled(law, levels, self.scale)
        self.laws[name] = law
        fields = [replace(level, value=level.field) for level in levels if level.field is not None]
        if self.field_scale and len(fields) >= min(len(levels), 3):
            self.shadows[name] = fit(name, fields, self.own[name], knob.order, knob.cost, self.field_scale)

    def more(self) -> bool:
        """A further level of the knob that the reference is least sure of, or the next, where that is affordable."""
        if self.quantity.exact is not None:
            return False
        self.left_out = ""
        for law in sorted(self.laws.values(), key=lambda law: -law.doubt):
            knob = next(k for k in self.knobs if k.name == law.name)
            if law.doubt < 0.1 * self.wanted:
                return False
            if len(self.levels[knob.name]) >= LEVELS:
                continue
            if self.complete([law.name]):
                return True
            if self.hopeless(law):
                return False
            finest = float(law.sizes[0])
            for factor in MORE if law.steady else MORE_SCATTERED:
                size = factor * (self.own[knob.name] if factor > 1.0 else finest)
                if self.legal(knob.name, size) and self.fits(knob, size) and self.add(knob, size):
                    self.refit(knob)
                    return True
        return False

    def hopeless(self, law: ErrorModel) -> bool:
        """True where more draws of the start's noise do not make the reference known, and a start with less would."""
        noisy = any(knob.noisy and knob.name == law.name for knob in self.knobs)
        return noisy and law.random and law.doubt > self.wanted and bool(self.pilots.knobs.quieter)

    @property
    def assumed(self) -> list[str]:
        """Knobs whose order theory alone tells."""
        return [law.name for law in self.laws.values() if law.assumed]

    def complete(self, names: Sequence[str]) -> bool:
        """A third level of these knobs, where theory alone tells their order; True if any was there to be had."""
        found = False
        for knob in (knob for knob in self.knobs if knob.name in names and self.laws[knob.name].assumed):
            law = self.laws[knob.name]
            for size in (2.0 * float(law.sizes[-1]), *(factor * float(law.sizes[0]) for factor in MORE)):
                if self.legal(knob.name, size) and self.fits(knob, size) and self.add(knob, size):
                    self.refit(knob)
                    found = True
                    break
        return found

    # --------------------------------------------------------------------------------------- reference

    @property
    def reference(self) -> NDArray[np.float64]:
        """The exact value, or the case's with every knob's error taken off (Richardson)."""
        if self.quantity.exact is not None:
            return np.full_like(self.value, self.quantity.exact)
        return self.value - self.scale * sum(law.signed for law in self.laws.values())

    @property
    def uncertainty(self) -> float:
        """Relative uncertainty of the reference: what the safety factors add to the error of the case, and the interval
        of the mean where that hides the effect of a knob.
        """
        if self.quantity.exact is not None:
            return 0.0
        noise = max((levels[0].noise for levels in self.levels.values()), default=0.0)
        drawn = noise if any(law.random for law in self.laws.values()) else 0.0
        return drawn + sum(law.doubt for law in self.laws.values())

    @property
    def quieter(self) -> tuple[str, ...]:
        """Settings of a start with less noise, where it is noise of the start that the reference is unsure of."""
        unsure = max(self.laws.values(), key=lambda law: law.doubt)
        noisy = any(knob.noisy and knob.name == unsure.name for knob in self.knobs)
        return self.pilots.knobs.quieter if noisy and unsure.doubt else ()

    @property
    def floor(self) -> float:
        """Error of the case that no knob accounts for; known where the exact value is."""
        if self.quantity.exact is None:
            return 0.0
        return norm((self.value - self.reference) / self.scale - sum(law.signed for law in self.laws.values()))

    def error(self, value: NDArray) -> float:
        return norm(value - self.reference) / self.scale

    def field_error(self, pilot: Pilot) -> float:
        """Relative error of the field beside the quantity; nan where none is known."""
        field = self.field_of(pilot)
        steady = len(self.shadows) == len(self.knobs) and all(w.idle or w.asymptotic for w in self.shadows.values())
        if field is None or self.field is None or not steady:
            return math.nan
        off = (field - self.field) / self.field_scale + sum(law.signed for law in self.shadows.values())
        return norm(off)

    # ----------------------------------------------------------------------------------------- schemes

    def combinations(self) -> list[Scheme]:
        """The case's scheme and those that other discrete settings make of it, each tried by one coarse pilot."""
        tried = [
            [None, *filter(None, (self.alternative(choice, value) for value in choice.others))]
            for choice in self.choices
        ]
        return [combined(tuple(self.laws.values()), picks) for picks in itertools.product(*tried)]

    def alternative(self, choice: Choice, value: str) -> Alternative | None:
        """One other discrete setting at a coarse level, unless it is too dear or does not run."""
        others = {dotted(choice.key): value}
        estimate, (ranks, threads) = self.pilots.app.estimate, self.pilots.shape
        configs = (self.pilots.config(self.own, self.quantity.time, o) for o in ({}, others))
        own, its = (estimate(config, ranks, threads, {}).step_seconds for config in configs)
        law = self.laws.get(choice.acts_on)
        least = NEGLIGIBLE * self.wanted
        saves_only = law is None or law.idle or law.bound(float(law.sizes[-1])) < least  # nothing to gain but time
        law = next(iter(self.laws.values())) if law is None else law
        size = float(law.sizes[-1])
        at = {**self.own, law.name: size}
        if its > (CHEAP if saves_only else DEAR) * own or not self.budget.affordable(self.cost(at, others)):
            return None
        if not self.pilots.legal(at, self.quantity.time, others):
            return None
        pilot = self.pilot(at, others, words=f"{choice.name} = {value}, {law.name} x {size / law.here:.3g}")
        beside = next(level for level in self.levels[law.name] if level.size == size)
        try:
            change = (self.measured(pilot) - beside.value) / self.scale
        except CheckFailed:
            return None
        timed = beside.seconds > TIMED
        cost = max(its / own, pilot.seconds / beside.seconds if timed else 0.0)  # either alone may be off
        if saves_only:
            return Alternative(others, cost, None, UNSURE * norm(change)) if cost < WORTH else None
        changed = self.changed(law, beside, change, pilot)
        if changed.error(law.here) > WORTH * law.error(law.here) and cost > WORTH:
            return None
        return Alternative(others, cost, changed)

    def changed(self, law: ErrorModel, beside: Level, change: NDArray, pilot: Pilot) -> ErrorModel:
        """The law of a knob in another scheme, from its error at the coarsest level and the order; where the field's
        error is no smaller, that of the quantity is luck.
        """
        off = (beside.value - self.value) / self.scale + law.signed  # of the case's own scheme there
        error, own = norm(off + change) + law.doubt, max(norm(off), 1e-300)
        shadow, field = self.shadows.get(law.name), self.field_of(pilot)
        if shadow is not None and field is not None and self.field is not None and not shadow.idle:
            there = norm((field - self.field) / self.field_scale + shadow.signed)
            error = max(error, own * min(there / shadow.error(beside.size), 1e3))
        sizes = np.array([law.here, beside.size])
        errors = error * (sizes / beside.size) ** law.used
        return replace(law, sizes=sizes, errors=errors)


def combined(laws: tuple[ErrorModel, ...], picks: Sequence[Alternative | None]) -> Scheme:
    """Laws of a scheme. Of two choices that change one knob's law the worse counts: they were not tried together."""
    others: dict[str, str] = {}
    cost, floor = 1.0, 0.0
    known = {law.name: law for law in laws}
    new: dict[str, ErrorModel] = {}
    for pick in filter(None, picks):
        others |= pick.others
        cost *= pick.cost
        floor += pick.floor
        if pick.law is not None:
            before = new.get(pick.law.name)
            worse = before is not None and before.errors[-1] > pick.law.errors[-1]
            new[pick.law.name] = before if worse and before is not None else pick.law
    return Scheme(others, cost, floor, tuple((known | new).values()))
