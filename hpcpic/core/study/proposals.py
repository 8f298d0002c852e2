"""Proposals of `tradeoff`: the cheapest settings that the laws of a search allow, in the case's scheme and in others.

A scheme is a combination of discrete settings. Each setting other than the case's is judged by one coarse pilot.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.app.knobs import Choice
from hpcpic.core.app.text import percent
from hpcpic.core.case.config import dotted
from hpcpic.core.errors import CheckFailed
from hpcpic.core.study.error_models import ErrorModel, Level, cheapest, norm, relative_cost
from hpcpic.core.study.pilot import Pilot, Settings
from hpcpic.core.study.search import Search

SCHEME_SAFETY = 1.25  # times the one difference measured is the error of another scheme
WORTHWHILE = 0.8  # times the cost: another scheme must cost less than this to be chosen
MAX_COST_OF_SAVING = 0.9  # times the cost of the case, by the estimate: a scheme that can only save time is tried
MAX_COST = 1.5  # times the cost of the case, by the estimate: a dearer scheme is not tried
CLOCK_SECONDS = 0.1  # of a pilot, below which its clock says nothing of the cost of a scheme

LIMIT_MARGIN = 0.8  # of the end of stability
LEAST_BUDGET = 0.25  # of the tolerance, for the knobs of a scheme whose own error takes the rest
ROUNDING = 1.001  # times a size or an error: the same
OUT_OF_REACH = 5.0  # times what all pilots may cost
BACKWARD_STEPS, BACKWARD_FACTOR = 24, 0.9  # from sizes that `check` refuses or warns of, to smaller ones


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


def schemes_of(search: Search) -> list[Scheme]:
    """The case's scheme first, then those that other discrete settings make of it."""
    per_choice = [
        [None, *filter(None, (alternative(search, choice, value) for value in choice.others))]
        for choice in search.choices
    ]
    return [combined(tuple(search.laws.values()), picks) for picks in itertools.product(*per_choice)]


def alternative(search: Search, choice: Choice, value: str) -> Alternative | None:
    """One other discrete setting, run with its knob at the coarsest level; None where that is too dear, does not run,
    or brings nothing.
    """
    others = {dotted(choice.key): value}
    estimate, (ranks, threads) = search.pilots.app.estimate, search.pilots.shape
    configs = (search.pilots.config(search.case_sizes, search.quantity.time, o) for o in ({}, others))
    case_seconds, seconds = (estimate(config, ranks, threads, {}).step_seconds for config in configs)
    law = search.laws.get(choice.acts_on)
    saves_only = law is None or law.idle or search.negligible(law)  # there is no error to gain, only time
    law = next(iter(search.laws.values())) if law is None else law
    size = float(law.sizes[-1])
    sizes = {**search.case_sizes, law.name: size}
    too_dear = seconds > (MAX_COST_OF_SAVING if saves_only else MAX_COST) * case_seconds
    if too_dear or not search.budget.affordable(search.cost(sizes, others)):
        return None
    if not search.pilots.legal(sizes, search.quantity.time, others):
        return None
    pilot = search.pilot(sizes, others, words=f"{choice.name} = {value}, {law.name} x {size / law.here:.3g}")
    level = next(level for level in search.levels[law.name] if level.size == size)
    try:
        change = (search.measured(pilot) - level.value) / search.scale
    except CheckFailed:
        return None
    clocked = pilot.seconds / level.seconds if level.seconds > CLOCK_SECONDS else 0.0
    cost = max(seconds / case_seconds, clocked)  # either alone may be off
    if saves_only:
        return Alternative(others, cost, None, SCHEME_SAFETY * norm(change)) if cost < WORTHWHILE else None
    new_law = changed_law(search, law, level, change, pilot)
    if new_law.error(law.here) > WORTHWHILE * law.error(law.here) and cost > WORTHWHILE:
        return None
    return Alternative(others, cost, new_law)


def changed_law(search: Search, law: ErrorModel, level: Level, change: NDArray, pilot: Pilot) -> ErrorModel:
    """The law of a knob in another scheme, from its error at the coarsest level and the order. Where the field's error
    is no smaller, a smaller one of the quantity is luck.
    """
    case_error = (level.value - search.value) / search.scale + law.signed  # of the case's own scheme at this level
    error, case_norm = norm(case_error + change) + law.doubt, max(norm(case_error), 1e-300)
    field_law, field = search.field_laws.get(law.name), search.field_of(pilot)
    if field_law is not None and field is not None and search.field is not None and not field_law.idle:
        field_error = norm((field - search.field) / search.field_scale + field_law.signed)
        error = max(error, case_norm * min(field_error / field_law.error(level.size), 1e3))
    sizes = np.array([law.here, level.size])
    errors = error * (sizes / level.size) ** law.used
    return replace(law, sizes=sizes, errors=errors)


def combined(laws: tuple[ErrorModel, ...], picks: Sequence[Alternative | None]) -> Scheme:
    """The scheme of one alternative (or none) of each choice. Of two that change one knob's law the worse counts: they
    were not tried together.
    """
    others: dict[str, str] = {}
    cost, floor = 1.0, 0.0
    new: dict[str, ErrorModel] = {}
    for pick in filter(None, picks):
        others |= pick.others
        cost *= pick.cost
        floor += pick.floor
        if pick.law is not None:
            candidates = [pick.law, *filter(None, [new.get(pick.law.name)])]
            new[pick.law.name] = max(candidates, key=lambda law: float(law.errors[-1]))
    return Scheme(others, cost, floor, tuple(({law.name: law for law in laws} | new).values()))


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


class Proposals:
    """The cheapest settings by the laws, in `schemes`, the case's own first. Making them runs pilots of others."""

    def __init__(self, search: Search) -> None:
        self.search, self.pilots = search, search.pilots
        self.use(schemes_of(search))

    def use(self, schemes: list[Scheme]) -> None:
        """Propose in these schemes, the case's own first, by the laws that they hold."""
        self.schemes = schemes
        self._largest: dict[str, float] = {}

    def propose(self, tolerance: float) -> Proposal:
        """The cheapest settings by the laws whose errors together are within the tolerance. Raises CheckFailed."""
        found = [proposal for scheme in self.schemes if (proposal := self.propose_in(scheme, tolerance))]
        if not found:
            floor = self.search.floor
            raise CheckFailed(f"no knob accounts for errors of {percent(floor)}, of {percent(tolerance)} asked for")
        best = min(found, key=lambda p: p.cost)
        return best if not best.scheme.others or best.cost < WORTHWHILE * found[0].cost else found[0]

    def propose_in(self, scheme: Scheme, tolerance: float) -> Proposal | None:
        """The cheapest settings in one scheme; None where its own error takes the tolerance, or all are refused."""
        budget = tolerance - self.search.floor - scheme.floor
        if budget <= LEAST_BUDGET * tolerance:
            return None
        sizes = cheapest(scheme.laws, budget, self.largest_sizes())
        if self.theory_cost(sizes) > OUT_OF_REACH * self.search.budget.allowance:  # only told: not even set up
            shares = {law.name: law.bound(sizes[law.name]) for law in scheme.laws}
            return Proposal(scheme, sizes, shares, scheme.cost * self.theory_cost(sizes))
        for _ in range(BACKWARD_STEPS):
            number = self.pilots.beyond(sizes, self.search.quantity.time, scheme.others, LIMIT_MARGIN)
            if number is None:
                return self.at(scheme, sizes)
            turned = [k.name for k in self.search.knobs if k.limit == number.name or k.key == number.key]
            turned = turned or [name for name, size in sizes.items() if size > ROUNDING * self.search.case_sizes[name]]
            sizes = {name: BACKWARD_FACTOR * size if name in turned else size for name, size in sizes.items()}
        return None

    def propose_or_case(self, tolerance: float) -> Proposal:
        """The cheapest settings by the laws, or the case as it is where there are none."""
        try:
            return self.propose(tolerance)
        except CheckFailed:
            return self.case()

    def legal(self, proposal: Proposal) -> bool:
        """True if settings are neither near the end of stability nor where `check` warns, unless the case itself is."""
        return self.pilots.legal(proposal.sizes, self.search.quantity.time, proposal.scheme.others, LIMIT_MARGIN)

    def at(self, scheme: Scheme, sizes: Mapping[str, float]) -> Proposal:
        """These sizes, as the case can have them, with the errors that they may make by the laws."""
        real = self.pilots.sizes_of(self.pilots.config(sizes, self.search.quantity.time, scheme.others))
        sizes = {law.name: real[law.name] for law in scheme.laws}
        shares = {law.name: law.bound(sizes[law.name]) for law in scheme.laws}
        if self.search.floor:
            shares["rest"] = self.search.floor
        shares |= {"scheme": scheme.floor} if scheme.floor else {}
        return Proposal(scheme, sizes, shares, scheme.cost * relative_cost(scheme.laws, sizes))

    def case(self) -> Proposal:
        """The case as it is."""
        return self.at(self.schemes[0], self.search.case_sizes)

    def largest_sizes(self) -> dict[str, float]:
        """Sizes at LIMIT_MARGIN of the end of stability, or where the case is refused or warned of."""
        if not self._largest:
            for law in self.search.laws.values():
                low, high = float(law.sizes[0]), 2.0 * float(law.sizes[-1])
                if not self.search.legal(law.name, high, LIMIT_MARGIN):
                    for _ in range(12):
                        middle = math.sqrt(low * high)
                        legal = self.search.legal(law.name, middle, LIMIT_MARGIN)
                        low, high = (middle, high) if legal else (low, middle)
                    self._largest[law.name] = low
        return self._largest

    def halfway(self, proposal: Proposal) -> Proposal:
        """The proposal half-way back to the case, in logs, where it is coarser."""
        sizes = {}
        for name, size in proposal.sizes.items():
            factor = size / self.search.case_sizes[name]
            sizes[name] = self.search.case_sizes[name] * math.sqrt(max(factor, 1.0)) * min(factor, 1.0)
        return self.at(proposal.scheme, sizes)

    def theory_cost(self, sizes: Mapping[str, float]) -> float:
        """The cost of these sizes beside the case's, by theory."""
        search = self.search
        return math.prod((search.case_sizes[knob.name] / sizes[knob.name]) ** knob.cost for knob in search.knobs)

    def price(self, proposal: Proposal) -> float:
        """The cost of running a proposal, in pilots of the case's own cost."""
        theory = self.theory_cost(proposal.sizes)
        if theory > OUT_OF_REACH * self.search.budget.allowance:  # clocks of coarse pilots count what does not grow too
            return proposal.scheme.cost * theory
        config = self.pilots.config(proposal.sizes, self.search.quantity.time, proposal.scheme.others)
        return self.pilots.knobs.work(config) / self.search.base.work

    def text(self, proposal: Proposal) -> str:
        """The sizes and the scheme, as "dx = 0.01 dt = 0.02"."""
        sizes = [f"{knob.name} = {knob.shown(proposal.sizes[knob.name]):.4g}" for knob in self.search.knobs]
        return " ".join([*sizes, proposal.scheme.words]).strip()
