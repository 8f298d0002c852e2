"""The search of `tradeoff`: laws of the knobs from pilots, the cheapest settings for a tolerance, a verification."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.app.knobs import Choice, Knob, Quantity
from hpcpic.core.case.config import dotted
from hpcpic.core.errors import CheckFailed
from hpcpic.core.study.error_models import ErrorModel, Level, cheapest, fit, norm, relative_cost
from hpcpic.core.study.pilot import Pilot, Pilots, Settings, value_of

LADDERS = (  # times the case's own size: coarser where that is legal, finer where it is affordable
    (2.0, 4.0), (1.4, 2.0), (0.5, 2.0), (0.7, 1.4), (0.5, 0.25), (0.7, 0.5), (0.8, 0.65),
)  # fmt: skip
NEGLIGIBLE = 0.25  # of the error wanted: a knob that makes less at its coarsest level
STRIDE = 4.0  # to the next level of a knob that shows little effect
PILOTS = 10  # pilots of the case's own cost that a search may take, or this share of the run itself:
SHARE = 0.25
LIMIT_MARGIN = 0.8  # of the end of stability
UNSURE = 1.25  # times the one difference measured is the error of another scheme
WORTH = 0.8  # times the cost: another scheme must save this much to be chosen
CHEAP = 0.9  # times the cost of the case, by the estimate: a scheme that can only save time is tried
DEAR = 1.5  # times the cost of the case, by the estimate: a scheme that is not tried
NEIGHBOUR = 1.25
DEAREST = 2.0  # times the cost of the case's pilot: a neighbour that is not run
TRIES = 4


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
class Proposal:
    """Sizes in a scheme, the error each may make (with safety), and the cost beside the case's own."""

    scheme: Scheme
    sizes: Mapping[str, float]
    shares: Mapping[str, float]
    cost: float

    @property
    def bound(self) -> float:
        return sum(self.shares.values())


@dataclass(frozen=True, slots=True)
class Verified:
    """A proposal that was run: pilot, its measured error, those of the coarser and finer neighbour."""

    proposal: Proposal
    pilot: Pilot
    error: float
    neighbours: Mapping[str, float]
    warnings: list[str] = field(default_factory=list)


class Search:
    """Search for the cheapest setting for one quantity of a case. Errors are relative to the norm of the reference."""

    def __init__(
        self, pilots: Pilots, knobs: Sequence[Knob], choices: Sequence[Choice], quantity: Quantity, wanted: float
    ) -> None:
        self.pilots, self.knobs, self.choices, self.quantity = pilots, knobs, choices, quantity
        self.wanted = wanted  # the least error that matters
        self.own = pilots.sizes_of(pilots.read.config)
        self.base = self.pilot(self.own, words="the case itself")
        self.value = self.measured(self.base)
        self.scale = abs(quantity.exact) if quantity.exact else norm(self.value)
        if not self.scale:
            raise CheckFailed(f"{quantity.name} is zero in the case itself: no relative error")
        self.levels: dict[str, list[Level]] = {}
        self._caps: dict[str, float] = {}
        self.laws: dict[str, ErrorModel] = {}
        for knob in knobs:
            self.climb(knob)
        while self.finer():
            pass
        self.schemes = list(self.combinations())

    # ------------------------------------------------------------------------------------------ pilots

    def pilot(self, sizes: Mapping[str, float], others: Settings | None = None, words: str = "") -> Pilot:
        return self.pilots.run(sizes, self.quantity.time, others, words=words)

    def measured(self, pilot: Pilot) -> NDArray[np.float64]:
        return value_of(pilot, self.quantity.measure)

    @property
    def allowance(self) -> float:
        """Price that the search may have, without the verification."""
        production = self.base.price * self.pilots.knobs.time / self.quantity.time
        return max(PILOTS * self.base.price, SHARE * production)

    def affordable(self, price: float) -> bool:
        return self.pilots.paid + price <= self.allowance

    def climb(self, knob: Knob) -> None:
        """Three levels of one knob, all else as in the case; more while it shows little effect."""
        name = knob.name
        self.levels[name] = [self.base.level(name, self.value)]
        for ladder in LADDERS:
            finer = sum(f**-knob.cost for f in ladder if f < 1.0) * self.base.price
            if len(self.levels[name]) >= 3 or not self.affordable(finer):
                continue
            if all(self.legal(name, self.own[name] * factor) for factor in ladder):
                for factor in ladder:
                    self.add(knob, self.own[name] * factor)
        if len(self.levels[name]) < 3:
            raise CheckFailed(self.stuck(knob))
        self.refit(knob)
        while True:
            law = self.laws[name]
            coarsest = float(law.sizes[-1])
            low = law.bound(coarsest) < NEGLIGIBLE * self.wanted
            if not low or len(law.sizes) > 5 or not self.legal(name, coarsest * STRIDE):
                return
            if not self.add(knob, coarsest * STRIDE):
                return
            self.refit(knob)

    def stuck(self, knob: Knob) -> str:
        """A sentence on why there are no three levels of a knob."""
        own = self.own[knob.name]
        found = [f"{knob.name}: no three levels about {knob.shown(own):.4g} {knob.unit}".rstrip()]
        for word, factor in (("coarser", 1.4), ("finer", 0.7)):
            number = self.pilots.beyond({**self.own, knob.name: factor * own}, self.quantity.time, {})
            found += [f"{word}: {number}"] if number else []
        left, price = self.allowance - self.pilots.paid, self.base.price
        found.append(f"{max(left / price, 0.0):.2g} of {self.allowance / price:.2g} pilots of the case's cost are left")
        others = ",".join(k.name for k in self.knobs if k is not knob)
        return "; ".join([*found, f"without it: --knobs {others}"] if others else found)

    def legal(self, name: str, size: float, margin: float = 1.0) -> bool:
        return self.pilots.legal({**self.own, name: size}, self.quantity.time, {}, margin)

    def add(self, knob: Knob, size: float) -> bool:
        """One more level; False when it is one that is there, or shows nothing."""
        name = knob.name
        pilot = self.pilot({**self.own, name: size}, words=f"{name} x {size / self.own[name]:.3g}")
        if any(abs(math.log(pilot.sizes[name] / level.size)) < 0.05 for level in self.levels[name]):
            return False
        try:
            value = self.measured(pilot)
        except CheckFailed:
            return False
        self.levels[name].append(pilot.level(name, value))
        return True

    def refit(self, knob: Knob) -> None:
        own = self.own[knob.name]
        self.laws[knob.name] = fit(knob.name, self.levels[knob.name], own, knob.order, knob.cost, self.scale)

    def finer(self) -> bool:
        """A finer level of the knob that the reference is least sure of, while that helps and is affordable."""
        doubtful = max(self.laws.values(), key=doubt)
        knob = next(k for k in self.knobs if k.name == doubtful.name)
        size = 0.5 * float(doubtful.sizes[0])
        price = self.base.price * (self.own[knob.name] / size) ** knob.cost
        if self.quantity.exact is not None or self.uncertainty <= 0.5 * self.wanted:
            return False
        if not self.affordable(price) or not self.legal(knob.name, size) or not self.add(knob, size):
            return False
        self.refit(knob)
        return True

    # --------------------------------------------------------------------------------------- reference

    @property
    def reference(self) -> NDArray[np.float64]:
        """The exact value, or the case's with every knob's error taken off (Richardson)."""
        if self.quantity.exact is not None:
            return np.full_like(self.value, self.quantity.exact)
        return self.value - self.scale * sum(law.signed for law in self.laws.values())

    @property
    def uncertainty(self) -> float:
        """Relative uncertainty of the reference: what the safety factors add to the error of the case."""
        return 0.0 if self.quantity.exact is not None else sum(doubt(law) for law in self.laws.values())

    @property
    def floor(self) -> float:
        """Error of the case that no knob accounts for; known where the exact value is."""
        if self.quantity.exact is None:
            return 0.0
        return norm((self.value - self.reference) / self.scale - sum(law.signed for law in self.laws.values()))

    def error(self, value: NDArray) -> float:
        return norm(value - self.reference) / self.scale

    # ----------------------------------------------------------------------------------------- schemes

    def combinations(self) -> list[Scheme]:
        """The case's scheme and those that other discrete settings make of it, each tried by one pilot."""
        tried = [
            [None, *filter(None, (self.alternative(choice, value) for value in choice.others))]
            for choice in self.choices
        ]
        return [combined(tuple(self.laws.values()), picks) for picks in itertools.product(*tried)]

    def alternative(self, choice: Choice, value: str) -> Alternative | None:
        """One other discrete setting, unless it is too dear or does not run."""
        others = {dotted(choice.key): value}
        estimate = self.pilots.app.estimate
        ranks, threads = self.pilots.shape
        configs = (self.pilots.config(self.own, self.quantity.time, o) for o in ({}, others))
        own, its = (estimate(config, ranks, threads, {}).step_seconds for config in configs)
        legal = self.pilots.legal(self.own, self.quantity.time, others)
        law = self.laws.get(choice.acts_on)
        least = NEGLIGIBLE * self.wanted
        saves_only = law is None or law.idle or law.bound(float(law.sizes[-1])) < least  # nothing to gain but time
        if its > (CHEAP if saves_only else DEAR) * own or not legal or not self.affordable(self.base.price):
            return None
        pilot = self.pilot(self.own, others, words=f"{choice.name} = {value}")
        try:
            change = (self.measured(pilot) - self.value) / self.scale
        except CheckFailed:
            return None
        cost = max(pilot.seconds / self.base.seconds, its / own)  # what both say: either alone may be off
        if law is None or saves_only:
            return Alternative(others, cost, None, UNSURE * norm(change)) if cost < WORTH else None
        signed = law.signed + change
        error = norm(signed) + doubt(law)
        if error > WORTH * law.error(law.here) and cost > WORTH:
            return None
        return Alternative(others, cost, self.changed(law, signed, error, others))

    def changed(self, law: ErrorModel, signed: NDArray, error: float, others: Settings) -> ErrorModel:
        """The law of a knob in another scheme, from its error here and at the coarsest level."""
        coarse = float(law.sizes[-1])
        pilot = self.pilot({**self.own, law.name: coarse}, others, words=f"{law.name} x {coarse / law.here:.3g}")
        try:
            there = norm((self.measured(pilot) - self.value) / self.scale + law.signed) + doubt(law)
        except CheckFailed:
            there = error * (coarse / law.here) ** law.used
        sizes, errors = np.array([law.here, coarse]), np.array([error, max(error, there)])
        return replace(law, sizes=sizes, errors=errors, signed=signed)

    # -------------------------------------------------------------------------------------- proposals

    def propose(self, tolerance: float) -> Proposal:
        """The cheapest settings by the laws whose errors together are within the tolerance."""
        made = [self.proposed(scheme, tolerance) for scheme in self.schemes]
        found = [proposal for proposal in made if proposal is not None]
        if not found:
            raise CheckFailed(
                f"errors that no knob accounts for are {self.floor:.2g}, as large as the tolerance {tolerance:.2g}"
            )
        best = min(found, key=lambda p: p.cost)
        return best if not best.scheme.others or best.cost < WORTH * found[0].cost else found[0]

    def proposed(self, scheme: Scheme, tolerance: float) -> Proposal | None:
        budget = tolerance - self.floor - scheme.floor
        if budget <= 0.25 * tolerance:
            return None
        sizes = cheapest(scheme.laws, budget, self.caps())
        for _ in range(20):
            if self.pilots.legal(sizes, self.quantity.time, scheme.others, LIMIT_MARGIN):
                break
            sizes = {name: min(size, max(0.9 * size, self.own[name])) for name, size in sizes.items()}
        return self.realised(scheme, sizes)

    def realised(self, scheme: Scheme, sizes: Mapping[str, float]) -> Proposal:
        """With the sizes there really are, and the errors they may make."""
        real = self.pilots.sizes_of(self.pilots.config(sizes, self.quantity.time, scheme.others))
        sizes = {law.name: real[law.name] for law in scheme.laws}
        shares = {law.name: law.bound(sizes[law.name]) for law in scheme.laws}
        if self.floor:
            shares["rest"] = self.floor
        shares |= {"scheme": scheme.floor} if scheme.floor else {}
        return Proposal(scheme, sizes, shares, scheme.cost * relative_cost(scheme.laws, sizes))

    def caps(self) -> dict[str, float]:
        """Sizes at LIMIT_MARGIN of the end of stability, or where the case is refused."""
        if not self._caps:
            for law in self.laws.values():
                low, high = float(law.sizes[0]), 2.0 * float(law.sizes[-1])
                if not self.legal(law.name, high, LIMIT_MARGIN):
                    for _ in range(12):
                        middle = math.sqrt(low * high)
                        low, high = (middle, high) if self.legal(law.name, middle, LIMIT_MARGIN) else (low, middle)
                    self._caps[law.name] = low
        return self._caps

    def verify(self, tolerance: float) -> Verified:
        """Propose, run it and its neighbours; on a miss propose for less. Raises CheckFailed."""
        if self.uncertainty > 0.5 * tolerance:
            raise CheckFailed(
                f"the reference itself is known to {self.uncertainty:.2g} only, tolerance {tolerance:.2g}: "
                f"ask for {2 * self.uncertainty:.2g}, or start from a finer case"
            )
        proposal, misses = self.first(tolerance), 0
        while True:
            error = self.error(self.measured(self.pilot(proposal.sizes, proposal.scheme.others, "recommended")))
            if error + self.uncertainty <= tolerance:
                return self.compared(proposal, error)
            if proposal.scheme.others:  # what it and the knobs do together is not in the laws: without it
                self.schemes = self.schemes[:1]
                proposal = self.first(tolerance)
                continue
            misses += 1
            if misses == TRIES:
                mine = f"the case itself is off by {self.error(self.value):.2g} (allowed {tolerance:.2g})"
                raise CheckFailed(f"{TRIES} settings were run, {mine}")
            proposal = self.after_miss(misses, proposal, tolerance, error)

    def first(self, tolerance: float) -> Proposal:
        """What is run first: the cheapest by the laws, or the case itself where that is known to be as good."""
        good = self.error(self.value) + self.uncertainty <= tolerance
        try:
            proposal = self.propose(tolerance)
        except CheckFailed:
            if not good:
                raise
            return self.realised(self.schemes[0], self.own)
        return self.realised(self.schemes[0], self.own) if good and proposal.cost >= 1.0 else proposal

    def after_miss(self, misses: int, proposal: Proposal, tolerance: float, error: float) -> Proposal:
        """What knobs do together is not in the laws: ask them for less, go half-way back to the case, take the case."""
        if misses == 1:
            try:
                asked = self.propose(0.8 * tolerance**2 / (error + self.uncertainty))
            except CheckFailed:
                asked = proposal
            if asked.cost < 1.0:
                return asked
        return self.nearer(proposal, 0.5) if misses < TRIES - 1 else self.realised(self.schemes[0], self.own)

    def nearer(self, proposal: Proposal, part: float) -> Proposal:
        """The proposal with this part of its way from the case, in logs, where it is coarser."""
        sizes = {}
        for name, size in proposal.sizes.items():
            factor = size / self.own[name]
            sizes[name] = self.own[name] * max(factor, 1.0) ** part * min(factor, 1.0)
        return self.realised(proposal.scheme, sizes)

    def unpromised(self, proposal: Proposal, error: float) -> list[str]:
        """A warning where the laws alone would not say that the proposal is good enough."""
        if proposal.bound <= self.wanted * 1.001:
            return []
        return [f"it is off by {error:.2g}, but the laws of its knobs promise no less than {proposal.bound:.2g}"]

    def compared(self, proposal: Proposal, error: float) -> Verified:
        """With the settings beside it: where their errors do not follow the laws a small one is luck."""
        neighbours: dict[str, float] = {}
        warnings = self.unpromised(proposal, error)
        laws = {law.name: law for law in proposal.scheme.laws}
        for words, factor in (("coarser", NEIGHBOUR), ("finer", 1.0 / NEIGHBOUR)):
            sizes = {name: size if laws[name].idle else size * factor for name, size in proposal.sizes.items()}
            cost = proposal.scheme.cost * relative_cost(proposal.scheme.laws, sizes) * self.base.seconds
            legal = self.pilots.legal(sizes, self.quantity.time, proposal.scheme.others)
            if not legal or cost > DEAREST * self.base.seconds:
                continue
            beside = self.pilot(sizes, proposal.scheme.others, f"{words} neighbour")
            try:
                neighbours[words] = self.error(self.measured(beside))
            except CheckFailed as failure:
                warnings.append(f"the {words} neighbour: {failure.message}")
                continue
            bound = sum(law.bound(sizes[law.name]) for law in proposal.scheme.laws) + proposal.scheme.floor + self.floor
            if neighbours[words] > 2.0 * bound + self.uncertainty:
                warnings.append(
                    f"the {words} neighbour is off by {neighbours[words]:.2g}, more than twice the law's {bound:.2g}"
                )
        pilot = self.pilot(proposal.sizes, proposal.scheme.others, "recommended")
        return Verified(proposal, pilot, error, neighbours, warnings)


@dataclass(frozen=True, slots=True)
class Alternative:
    """One other value of a choice: cost beside the case's, the law it changes, or an error of its own."""

    others: Settings
    cost: float
    law: ErrorModel | None
    floor: float = 0.0


def doubt(law: ErrorModel) -> float:
    """The uncertainty of the case's own error of this knob."""
    return (law.safety - 1.0) * norm(law.signed)


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
