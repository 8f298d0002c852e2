"""The search of `tradeoff`: how large an error each knob makes, from short runs of the case (pilots).

1. Levels. Run the case as it is, then each knob alone at one or two other sizes (`run_first_levels`), and at coarser
   ones while its error stays negligible (`run_coarser_levels`).
2. Laws. Fit error = A size^p to the levels of each knob (`fit_law`, error_models.py).
3. Reference. The value of the case, with the error of every law taken off (Richardson extrapolation, `reference`), or
   the exact value. What the laws do not know of it is its `uncertainty`.
4. While that exceeds half of the error wanted, run one more level of the knob that it comes from (`refine_reference`).

What a pilot costs is foretold, and one that does not fit into the budget is left out. schemes.py tries other discrete
settings; recommend.py turns laws into a setting, and runs it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.app.knobs import Choice, Knob, Quantity
from hpcpic.core.errors import CheckFailed
from hpcpic.core.study.error_models import ErrorModel, Level, fit, hidden, levelled, norm, scattered
from hpcpic.core.study.field import seen_field
from hpcpic.core.study.pilot import Budget, Pilot, Pilots, Settings, value_of
from hpcpic.core.study.quantities import is_nothing, telling
from hpcpic.core.study.record import Hint

# Factors on the case's own size of a knob, in the order in which they are tried: coarser where that is legal, finer
# where it is affordable.
PAIRS = (  # two levels beside the case, of a knob whose order is to be observed
    (2.0, 4.0), (1.4, 2.0), (1.2, 1.4), (0.5, 2.0), (0.7, 1.4), (0.5, 0.25), (0.7, 0.5), (0.8, 0.65),
)  # fmt: skip
SINGLES = (2.0, 1.4, 1.2, 0.7, 0.8)  # one level beside the case, of a knob whose order theory knows
PAIR_OF_NOISE = (4.0, 16.0)  # of a knob whose errors are drawn: no order is observed, so levels may lie far apart
COARSENING = 4.0  # times the coarsest level: the next one of a knob whose error is negligible
REFINEMENTS = (0.7, 0.5)  # times the finest level: the next one, to know the reference better
REFINEMENTS_OF_SCATTER = (1.4, 1.2, 0.84, 0.7)  # likewise where errors scatter; factors above 1 are on the case's size
MAX_LEVELS = 12  # of one knob
MAX_LEVELS_COARSENED = 5  # of a knob that may get a coarser one
NEGLIGIBLE = 0.25  # of the error wanted: the error of a knob at its coarsest level
SAVING = 0.9  # times the price of the case: where the coarsest level costs more, a coarser one is of no use
SAME_LEVEL = 0.05  # difference of the logs of two sizes that are one level


class Search:
    """The laws of the knobs of one case, for one quantity, and its reference. Making one runs its pilots. Errors are
    relative to the norm of the reference.

    case_sizes: of the knobs in the case; base: the pilot of the case as it is. levels, laws: by knob; field_laws: those
    of the field beside the quantity. finer: pilots with one knob finer than the case.
    """

    def __init__(
        self,
        pilots: Pilots,
        knobs: Sequence[Knob],
        choices: Sequence[Choice],
        quantity: Quantity,
        wanted: float,
        allowance: float | None = None,
        *,
        trust_theory: bool = False,
        hints: Mapping[str, Hint] | None = None,
    ) -> None:
        """wanted: the least error that matters; allowance: pilots that search and verification may take together.
        trust_theory: two levels of a knob will do where theory knows its order, as the run of a recommendation checks
        it. hints: of earlier searches, by knob. Raises CheckFailed.
        """
        self.pilots, self.knobs, self.choices, self.quantity = pilots, knobs, choices, quantity
        self.wanted, self.trust_theory, self.hints = wanted, trust_theory, hints or {}
        self.case_sizes = pilots.sizes_of(pilots.read.config)
        self.base = self.pilot(self.case_sizes, words="the case itself")
        self.budget = Budget(pilots, self.base, float(quantity.time), self.snapshot, allowance)
        self.left_out = ""  # the level that was wanted most, and is dearer than what is left
        self.value = self.measured(self.base)
        self.scale = abs(quantity.exact) if quantity.exact else norm(self.value)
        self.refuse_nothing()
        self.levels: dict[str, list[Level]] = {}
        self.finer: list[Pilot] = []
        self.laws: dict[str, ErrorModel] = {}
        self.field_laws: dict[str, ErrorModel] = {}
        self.field = self.field_of(self.base)
        self.field_scale = norm(self.field) if self.field is not None else 0.0
        for knob in knobs:
            self.run_first_levels(knob)
        for knob in knobs:
            self.run_coarser_levels(knob)
        while self.uncertainty > 0.5 * self.wanted and self.refine_reference():
            pass

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
        """Settings by which a pilot writes the field beside the quantity."""
        seen = self.pilots.knobs.seen
        return seen.snapshot(float(self.quantity.time)) if seen else ()

    def measured(self, pilot: Pilot) -> NDArray[np.float64]:
        """The quantity of a pilot, as a vector. Raises CheckFailed where the run does not show it."""
        if not self.quantity.field:
            return value_of(pilot, self.quantity.measure)
        value = self.field_of(pilot)
        if value is None:
            raise CheckFailed(f"the pilot {pilot.folder} did not finish: {pilot.words}")
        return value

    def field_of(self, pilot: Pilot) -> NDArray[np.float64] | None:
        """The field beside the quantity, as a vector; None where there is none, or the run did not finish."""
        seen = self.pilots.knobs.seen
        return seen_field(pilot.folder, seen) if seen and not pilot.exit_code else None

    def level(self, knob: str, pilot: Pilot) -> Level:
        """Raises CheckFailed where the run does not show the quantity."""
        value, field = self.measured(pilot), self.field_of(pilot)
        noise = self.quantity.noise(pilot.series) / self.scale if self.quantity.noise else 0.0
        return Level(pilot.sizes[knob], value, pilot.seconds, pilot.price, noise, field)

    def cost(self, sizes: Mapping[str, float], others: Settings | None = None) -> float:
        """The cost of a pilot to come, in pilots of the case's own cost."""
        return self.budget.cost(tuple(self.knobs), sizes, others or {})

    # ------------------------------------------------------------------------------------------ levels

    def run_first_levels(self, knob: Knob) -> None:
        """Two levels of a knob where its order is taken from theory, else three; the case is one of them.

        The sizes that earlier searches hint at are tried first. Raises CheckFailed where too few are legal and
        affordable.
        """
        name, hint = knob.name, self.hints.get(knob.name)
        order_known = self.trust_theory and not knob.noisy and (hint is None or hint.steady)
        enough = 2 if order_known else 3
        factors = [hint.levels(knob.noisy)] if hint else []
        factors += [(factor,) for factor in SINGLES] if order_known else [PAIR_OF_NOISE] if knob.noisy else []
        unaffordable = []  # their costs
        self.levels[name] = [self.level(name, self.base)]
        for those in (*factors, *PAIRS):
            sizes = [self.case_sizes[name] * factor for factor in those]
            if len(self.levels[name]) >= enough or not all(self.legal(name, size) for size in sizes):
                continue
            cost = sum(self.cost({**self.case_sizes, name: size}) for size in sizes)
            if not self.budget.affordable(cost):
                unaffordable.append(cost)
                continue
            for size in sizes:
                self.add_level(knob, size)
        if len(self.levels[name]) < enough:
            raise CheckFailed(self.too_few_levels(knob, min(unaffordable, default=0.7**-knob.cost + 0.5**-knob.cost)))
        self.fit_law(knob)
        if self.spread(name) <= self.noise(name):
            self.observe_orders([name])  # whether its effect has an order, or is hidden by noise

    def run_coarser_levels(self, knob: Knob) -> None:
        """Coarser levels of a knob while its error is negligible and a coarser run saves something."""
        while True:
            law, coarsest = self.laws[knob.name], max(self.levels[knob.name], key=lambda level: level.size)
            saves = coarsest.price < SAVING * self.base.price
            wanted = self.negligible(law) and len(law.sizes) <= MAX_LEVELS_COARSENED and saves
            if not (wanted and self.run_level(knob, COARSENING * float(law.sizes[-1]))):
                return

    def negligible(self, law: ErrorModel) -> bool:
        """True if the error of a knob at its coarsest level matters little beside the error wanted."""
        return law.bound(float(law.sizes[-1])) < NEGLIGIBLE * self.wanted

    def run_level(self, knob: Knob, size: float) -> bool:
        """One more level of a knob, and its law; False where the size is not legal, not affordable (then `left_out`
        says so) or tells nothing new.
        """
        if not self.legal(knob.name, size):
            return False
        cost = self.cost({**self.case_sizes, knob.name: size})
        if not self.budget.affordable(cost):
            self.left_out = self.left_out or (
                f"{knob.name} = {knob.shown(size):.4g} would cost {cost:.3g} pilots of the case's own cost"
            )
            return False
        if not self.add_level(knob, size):
            return False
        self.fit_law(knob)
        return True

    def too_few_levels(self, knob: Knob, cost: float) -> str:
        """Why a knob has too few levels, in a sentence; cost: pilots that the cheapest further ones take."""
        size = self.case_sizes[knob.name]
        reasons = [f"{knob.name}: no three levels about {knob.shown(size):.4g} {knob.unit}".rstrip()]
        for word, factor in (("coarser", 1.4), ("finer", 0.7)):
            number = self.pilots.beyond({**self.case_sizes, knob.name: factor * size}, self.quantity.time, {})
            reasons += [f"{word}: {number}"] if number else []
        used, share = self.budget.used, self.budget.share
        reasons.append(f"{max(share - used, 0.0):.2g} of {share:.2g} pilots of the case's cost are left")
        needed = self.budget.asking(used + cost)
        reasons.append(f"--pilots {needed} pays for them, {needed * self.base.seconds:.2g} s in all")
        others = ",".join(k.name for k in self.knobs if k is not knob)
        return "; ".join([*reasons, f"without it: --knobs {others}"] if others else reasons)

    def knob(self, law: ErrorModel) -> Knob:
        return next(knob for knob in self.knobs if knob.name == law.name)

    def legal(self, name: str, size: float, margin: float = 1.0) -> bool:
        return self.pilots.legal({**self.case_sizes, name: size}, self.quantity.time, {}, margin)

    def add_level(self, knob: Knob, size: float) -> bool:
        """Run one more level; False where it is one that has been run, or does not show the quantity."""
        name = knob.name
        sizes = {**self.case_sizes, name: size}
        real = self.pilots.sizes_of(self.pilots.config(sizes, self.quantity.time, {}))[name]
        if any(abs(math.log(real / level.size)) < SAME_LEVEL for level in self.levels[name]):
            return False
        pilot = self.pilot(sizes, words=f"{name} x {real / self.case_sizes[name]:.3g}")
        try:
            level = self.level(name, pilot)
        except CheckFailed:
            return False
        if norm(level.value - self.value) > self.scale:
            return False  # an error as large as the quantity follows no law
        self.levels[name].append(level)
        if level.size < self.case_sizes[name]:
            self.finer.append(pilot)
        return True

    def spread(self, name: str) -> float:
        """The largest relative difference of a level of a knob from the case."""
        return max(norm(level.value - self.value) for level in self.levels[name]) / self.scale

    def noise(self, name: str) -> float:
        """Half the 95 % interval of the difference of two levels of a knob, where the quantity is a mean over time."""
        levels = self.levels[name]
        return max(math.hypot(levels[0].noise, level.noise) for level in levels)

    def fit_law(self, knob: Knob) -> None:
        """The law of a knob from its levels, and that of the field beside the quantity."""
        name, levels = knob.name, self.levels[knob.name]
        law = fit(name, levels, self.case_sizes[name], knob.order, knob.cost, self.scale)
        if not law.idle and not law.asymptotic:
            if knob.noisy:
                law = scattered(law, levels, self.scale)
            elif self.spread(name) <= self.noise(name):
                law = hidden(law, self.spread(name))
            elif len(levels) >= 4:
                law = levelled(law, levels, self.scale)
        self.laws[name] = law
        fields = [replace(level, value=level.field) for level in levels if level.field is not None]
        if self.field_scale and len(fields) >= min(len(levels), 3):
            self.field_laws[name] = fit(name, fields, self.case_sizes[name], knob.order, knob.cost, self.field_scale)

    def refine_reference(self) -> bool:
        """One more level of the knob whose law leaves most doubt about the reference, or of the next one where that
        is not affordable. False where no level helps, or none is affordable.
        """
        if self.quantity.exact is not None:
            return False
        self.left_out = ""
        for law in sorted(self.laws.values(), key=lambda law: -law.doubt):
            knob = self.knob(law)
            if law.doubt < 0.1 * self.wanted:
                return False
            if len(self.levels[knob.name]) >= MAX_LEVELS:
                continue
            if self.observe_orders([law.name]):
                return True
            if self.hidden_by_noise(law):
                return False
            finest = float(law.sizes[0])
            for factor in REFINEMENTS if law.steady else REFINEMENTS_OF_SCATTER:
                if self.run_level(knob, factor * (self.case_sizes[knob.name] if factor > 1.0 else finest)):
                    return True
        return False

    def hidden_by_noise(self, law: ErrorModel) -> bool:
        """True where more draws of the start's noise do not make the reference known, and a start with less would."""
        return self.knob(law).noisy and law.random and law.doubt > self.wanted and bool(self.pilots.knobs.quieter)

    @property
    def assumed(self) -> list[str]:
        """Knobs whose order is taken from theory, as two levels do not show it."""
        return [law.name for law in self.laws.values() if law.assumed]

    def observe_orders(self, names: Sequence[str]) -> bool:
        """A third level of those of these knobs whose order is taken from theory; True if one could be run."""
        observed = []
        for knob in (knob for knob in self.knobs if knob.name in names and self.laws[knob.name].assumed):
            finest, coarsest = self.laws[knob.name].sizes[[0, -1]].tolist()
            sizes = (2.0 * coarsest, *(factor * finest for factor in REFINEMENTS))
            observed.append(any(self.run_level(knob, size) for size in sizes))
        return any(observed)

    # --------------------------------------------------------------------------------------- reference

    @property
    def reference(self) -> NDArray[np.float64]:
        """The exact value, or the case's with every knob's error taken off (Richardson)."""
        if self.quantity.exact is not None:
            return np.full_like(self.value, self.quantity.exact)
        return self.value - self.scale * sum(law.signed for law in self.laws.values())

    @property
    def uncertainty(self) -> float:
        """Relative uncertainty of the reference: the doubts of the laws, and the interval of a mean over time where
        that hides the effect of a knob.
        """
        if self.quantity.exact is not None:
            return 0.0
        noise = max((levels[0].noise for levels in self.levels.values()), default=0.0)
        drawn = noise if any(law.random for law in self.laws.values()) else 0.0
        return drawn + sum(law.doubt for law in self.laws.values())

    @property
    def quieter(self) -> tuple[str, ...]:
        """Settings of a start with less noise, where the reference is least sure because of the noise of the start."""
        worst = max(self.laws.values(), key=lambda law: law.doubt)
        return self.pilots.knobs.quieter if self.knob(worst).noisy and worst.doubt else ()

    @property
    def floor(self) -> float:
        """Error of the case that no knob accounts for; known where the exact value is."""
        if self.quantity.exact is None:
            return 0.0
        return norm((self.value - self.reference) / self.scale - sum(law.signed for law in self.laws.values()))

    def error(self, value: NDArray) -> float:
        """Relative distance of a value from the reference."""
        return norm(value - self.reference) / self.scale

    def field_error(self, pilot: Pilot) -> float:
        """Relative error of the field beside the quantity; nan where its reference is not known."""
        field = self.field_of(pilot)
        laws = self.field_laws.values()
        known = len(laws) == len(self.knobs) and all(law.idle or law.asymptotic for law in laws)
        if field is None or self.field is None or not known:
            return math.nan
        off = (field - self.field) / self.field_scale + sum(law.signed for law in laws)
        return norm(off)
