"""From the laws of a search to a setting that was run: certified, or marked as known less well; or none.

1. Propose. Of all settings whose errors by the laws are together within the tolerance, the cheapest (proposals.py).
2. Run it. Where it misses the tolerance, propose for less, then go half-way back to the case (`attempts`). What the
   search has run already, the case and finer pilots, is a candidate too (`held`).
3. Doubt it. Run the settings beside it (`with_neighbours`). Where a finer one is off by more than the tolerance, the
   small error of this one is luck (`luck`). Where the order of an error is only theory's, a run at another size must
   confirm it (`unchecked_orders`).
4. Where nothing is certified, let the search run one more level, and begin again (`verify`).

Certified: the measured error and the uncertainty of the reference are together within the tolerance, and so they are of
every setting measured that is finer. Marked: the measured error is, and what is known does not suffice for more.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hpcpic.core.app.text import percent
from hpcpic.core.errors import CheckFailed
from hpcpic.core.study.error_models import relative_cost
from hpcpic.core.study.pilot import Pilot
from hpcpic.core.study.proposals import ROUNDING, Proposal, Proposals, Scheme, schemes_of
from hpcpic.core.study.search import Search

NEIGHBOUR = 1.25  # times coarser or finer
OTHER_SIZE = 1.1  # times, at least: sizes so far apart tell more than one
MAX_NEIGHBOUR_COST = 2.0  # pilots of the case's cost, or what is left if that is less
MAX_MISSES = 4
FINER_LEVEL_COST = 3.0  # pilots of the case's cost: about what a finer level of one knob takes
WELL_KNOWN = 0.25  # times the tolerance: where the reference is known better, a miss is one of the laws
UNKNOWN = 3.0  # times the tolerance: where the reference is not known better, nothing is said of any setting
FIELD_LOST = 1.0  # error of the field beside the quantity at which nothing is left of it
FIELD_WARNED = 2.0  # times the tolerance: an error of the field beside the quantity that is told as a warning


@dataclass(frozen=True, slots=True)
class Verified:
    """A proposal that was run: its pilot, its measured error, and that of the field beside it (nan: not known).

    neighbours: errors of the "coarser" and the "finer" one, as far as they were run, at `neighbour_sizes`. as_promised:
    sizes of those runs that are as good as the laws say. luck: why a small error is luck, in a sentence.
    """

    proposal: Proposal
    pilot: Pilot
    error: float
    field_error: float
    certified: bool
    neighbours: Mapping[str, float] = field(default_factory=dict)
    neighbour_sizes: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    as_promised: list[Mapping[str, float]] = field(default_factory=list)
    luck: str = ""


class Recommendation:
    """The cheapest settings that a search's laws allow, and their verification."""

    def __init__(self, search: Search) -> None:
        self.search, self.pilots, self.proposals = search, search.pilots, Proposals(search)

    def verify(self, tolerance: float) -> Verified:
        """A certified setting; else, as long as that is affordable, more is learnt of the reference; else what comes
        nearest to the tolerance. Raises CheckFailed.
        """
        while True:
            runs = self.attempts(tolerance)
            if runs and runs[-1].certified:
                run = self.without_luck(runs[-1], tolerance)
                unchecked = self.unchecked_orders(run) if run.certified else []
                if not unchecked:
                    return run
                if not self.observe_orders(unchecked):
                    return replace(run, certified=False)
            elif self.search.refine_reference():
                self.proposals.use([Scheme({}, 1.0, 0.0, tuple(self.search.laws.values()))])
            else:
                return self.nearest(runs, tolerance)

    def attempts(self, tolerance: float) -> list[Verified]:
        """Propose and run; on a miss propose for less. Those that were run, a certified one last."""
        search, price, runs = self.search, self.proposals.price, list[Verified]()
        if search.uncertainty >= tolerance and search.quieter:
            return runs  # whatever is run: a start with less noise is the next thing to be tried
        proposal, misses = self.aimed(tolerance), 0
        if price(proposal) > 1.0 and self.observe_orders(search.assumed):  # which costs less than the wrong run
            proposal = self.aimed(tolerance)
        held = self.held(tolerance)
        if held and price(proposal) >= price(held.proposal):  # as far as the laws know, less may be enough
            proposal = self.proposals.propose_or_case(tolerance)
        while misses < MAX_MISSES:
            if held and price(proposal) >= price(held.proposal):
                return [*runs, held]
            run = self.run(proposal)
            if run is None and not misses:  # as far as can be known, that may be enough
                run = self.run(proposal := self.proposals.propose_or_case(tolerance))
            if run is not None:
                runs.append(run)
                if self.within(run.error, tolerance) and not self.field_lost(run):
                    return [*runs[:-1], replace(run, certified=True)]
            if proposal.scheme.others:  # what it and the knobs do together is not in the laws: without it
                self.proposals.use(self.proposals.schemes[:1])
                proposal = self.aimed(tolerance)
                continue
            if run is not None and self.observe_orders(search.assumed):  # they do not foretell it
                proposal, held = self.aimed(tolerance), self.held(tolerance)
                continue
            dear = run is not None and price(proposal) > FINER_LEVEL_COST
            if dear and search.uncertainty > WELL_KNOWN * tolerance:
                break  # a finer level tells more of the reference, and costs less than another such run
            misses += 1
            error = run.error if run and not self.field_lost(run) else tolerance
            proposal = self.after_miss(misses, proposal, tolerance, error)
        return [*runs, held] if held else runs

    def aimed(self, tolerance: float) -> Proposal:
        """The cheapest settings by the laws for an error that leaves room for the uncertainty of the reference."""
        return self.proposals.propose_or_case(max(tolerance - self.search.uncertainty, 0.5 * tolerance))

    def expected(self, tolerance: float) -> Proposal:
        """The settings that would be run first, or those that the search has run and that are certified for less."""
        proposal, held = self.aimed(tolerance), self.held(tolerance)
        price = self.proposals.price
        return held.proposal if held and price(held.proposal) <= price(proposal) else proposal

    def after_miss(self, misses: int, proposal: Proposal, tolerance: float, error: float) -> Proposal:
        """The next proposal after a run that was off by this error. The laws do not hold what the knobs do together, so
        they are asked for less, again and again where that is finer than the case. Else half-way back to the case, and
        at last the case.
        """
        finer = self.proposals.price(proposal) > 1.0
        if misses == 1 or finer:
            try:
                smaller = self.proposals.propose(0.8 * tolerance**2 / (error + self.search.uncertainty))
            except CheckFailed:
                smaller = proposal
            if smaller.cost < 1.0 or finer:
                return smaller
        return self.proposals.halfway(proposal) if misses < MAX_MISSES - 1 else self.proposals.case()

    def held(self, tolerance: float) -> Verified | None:
        """The cheapest of what the search has run already, the case and what is finer, that is certified as it is."""
        search, good = self.search, []
        for pilot in (search.base, *search.finer):
            proposal = self.proposals.at(self.proposals.schemes[0], pilot.sizes)
            error = search.error(search.measured(pilot))
            run = Verified(proposal, pilot, error, search.field_error(pilot), True)
            legal = pilot is search.base or self.proposals.legal(proposal)
            if legal and self.within(error, tolerance) and not self.luck(run, tolerance):
                good.append(run)
        return min(good, key=lambda run: self.proposals.price(run.proposal), default=None)

    def run(self, proposal: Proposal) -> Verified | None:
        """The proposal, run; None where that is beyond what is left of the allowance, or shows nothing."""
        search = self.search
        if search.cost(proposal.sizes, proposal.scheme.others) > search.budget.left:
            return None
        pilot = search.pilot(proposal.sizes, proposal.scheme.others, "recommended")
        try:
            error = search.error(search.measured(pilot))
        except CheckFailed:
            return None
        return Verified(proposal, pilot, error, search.field_error(pilot), False)

    def within(self, error: float, tolerance: float) -> bool:
        """True if an error that was measured is within the tolerance wherever in its interval the reference lies."""
        return error + self.search.uncertainty <= tolerance

    def without_luck(self, run: Verified, tolerance: float) -> Verified:
        """A certified run with its neighbours. Where they show that its small error is luck, the cheapest certified run
        of the search instead, or this one, not certified.
        """
        run = self.with_neighbours(run)
        luck = self.luck(run, tolerance)
        if not luck:
            return run
        held = self.held(tolerance)
        if held is not None and held.pilot is not run.pilot:
            held = self.with_neighbours(held)
            if not self.luck(held, tolerance):
                held.warnings.append(f"{self.proposals.text(run.proposal)} would do by itself, but {luck}")
                return held
        return replace(run, certified=False, luck=luck)

    def luck(self, run: Verified, tolerance: float) -> str:
        """Why a small error is luck: a measured setting, as fine as this one in every knob and finer in one, does not
        hold the tolerance, or the field is lost; "" if neither is. Errors that grow towards finer sizes tell that a
        small one among them is chance.
        """
        if lost := self.field_lost(run):
            return lost
        search, sizes = self.search, run.proposal.sizes
        measured: dict[str, tuple[Mapping[str, float], float]] = {
            f"the {words} neighbour": (run.neighbour_sizes[words], error) for words, error in run.neighbours.items()
        }
        if not run.proposal.scheme.others:  # in which the levels were run
            for knob in search.knobs:
                for level in search.levels[knob.name]:
                    words = f"the case with {knob.name} = {knob.shown(level.size):.4g}"
                    measured[words] = {**search.case_sizes, knob.name: level.size}, search.error(level.value)
        acting = [law.name for law in run.proposal.scheme.laws if not law.idle]
        for words, (other_sizes, error) in measured.items():
            ratios = [other_sizes[name] / sizes[name] for name in acting]
            finer = ratios and max(ratios) < ROUNDING and min(ratios) < 1.0 / ROUNDING
            if finer and not self.within(error, tolerance):
                return f"{words} is off by {percent(error)}: that this setting, which is coarser, is by less is luck"
        return ""

    def field_lost(self, run: Verified) -> str:
        """By how much the field at the end is off where nothing is left of it, in a sentence; "" elsewhere, and where
        the user has named the quantity.
        """
        seen, quantity = self.pilots.knobs.seen, self.search.quantity
        if not seen or quantity.asked or not run.field_error > FIELD_LOST:
            return ""
        off = percent(run.field_error)
        return f"the field {seen.name} at the end is off by {off}: that {quantity.name} is by less is luck"

    def unchecked_orders(self, run: Verified) -> list[str]:
        """Knobs whose order is theory's, where no run at a third size is as good as the laws say."""
        laws = self.search.laws
        return [
            name for name in self.search.assumed
            if not any(
                abs(np.log(sizes[name] / laws[name].sizes)).min() > math.log(OTHER_SIZE) for sizes in run.as_promised
            )
        ]  # fmt: skip

    def observe_orders(self, names: Sequence[str]) -> bool:
        """True if the search could observe the order of one of these knobs; proposals use the new laws then."""
        if not self.search.observe_orders(names):
            return False
        self.proposals.use(schemes_of(self.search))
        return True

    def nearest(self, runs: list[Verified], tolerance: float) -> Verified:
        """The cheapest of these runs, none certified, and the case that is within the tolerance as far as is known;
        else the best. Raises CheckFailed where none is within it, or where the reference is not known.
        """
        search, case = self.search, self.proposals.case()
        runs = [*runs, Verified(case, search.base, search.error(search.value), search.field_error(search.base), False)]
        good = [run for run in runs if run.error <= tolerance and self.proposals.legal(run.proposal)]
        if not good or search.uncertainty > UNKNOWN * tolerance:
            errors = {self.proposals.text(run.proposal): run.error for run in runs}
            raise CheckFailed("; ".join(f"{text}: off by {percent(error)}" for text, error in errors.items()))
        near = [run for run in good if run.error + search.uncertainty <= 1.5 * tolerance]
        cheapest_run = min(near, key=lambda run: run.proposal.cost, default=None)
        run = self.with_neighbours(cheapest_run or min(good, key=lambda run: run.error))
        return replace(run, luck=self.field_lost(run))

    def why_not_certified(self, run: Verified, tolerance: float) -> str:
        """Why a setting that was run is not certified, in a sentence."""
        error, unknown = run.error, self.search.uncertainty
        if not run.luck and not self.within(error, tolerance):
            return (
                f"off by {percent(error)} from a reference known to {percent(unknown)} may be "
                f"{percent(error + unknown)}, beyond the {percent(tolerance)} asked for"
            )
        luck = run.luck or self.luck(run, tolerance)
        return luck or f"theory alone tells the order of the error in {', '.join(self.unchecked_orders(run))}"

    def with_neighbours(self, run: Verified) -> Verified:
        """The run with the errors of its neighbours, coarser and finer in every knob, and with warnings."""
        search, proposal = self.search, run.proposal
        neighbours: dict[str, float] = {}
        neighbour_sizes: dict[str, Mapping[str, float]] = {}
        warnings = self.warnings_of(run)
        as_promised = [run.pilot.sizes] if run.error <= proposal.bound + search.uncertainty else []
        laws, others = {law.name: law for law in proposal.scheme.laws}, proposal.scheme.others
        for words, factor in (("coarser", NEIGHBOUR), ("finer", 1.0 / NEIGHBOUR)):
            sizes = {name: size if laws[name].idle else size * factor for name, size in proposal.sizes.items()}
            cost = proposal.scheme.cost * relative_cost(proposal.scheme.laws, sizes)
            legal = self.pilots.legal(sizes, search.quantity.time, others)
            too_dear = cost > self.neighbour_allowance(proposal) or search.cost(sizes, others) > search.budget.left
            if not legal or too_dear:
                continue
            pilot = search.pilot(sizes, others, f"{words} neighbour")
            try:
                neighbours[words], neighbour_sizes[words] = search.error(search.measured(pilot)), pilot.sizes
            except CheckFailed as failure:
                warnings.append(f"the {words} neighbour: {failure.message}")
                continue
            bound = sum(law.bound(sizes[law.name]) for law in proposal.scheme.laws) + proposal.scheme.floor
            as_promised += [pilot.sizes] if neighbours[words] <= bound + search.floor + search.uncertainty else []
            if neighbours[words] > 2.0 * (bound + search.floor) + search.uncertainty:
                warnings.append(
                    f"the {words} neighbour is off by {percent(neighbours[words])}, more than twice the law's "
                    f"{percent(bound + search.floor)}"
                )
        return replace(run, neighbours=neighbours, neighbour_sizes=neighbour_sizes, warnings=warnings,
                       as_promised=as_promised)  # fmt: skip

    def neighbour_allowance(self, proposal: Proposal) -> float:
        """Pilots that a neighbour may cost. Where the laws do not promise the tolerance it alone can tell luck."""
        left = max(self.search.budget.left, 0.0)
        return min(MAX_NEIGHBOUR_COST, left) if proposal.bound <= self.search.wanted * ROUNDING else left

    def warnings_of(self, run: Verified) -> list[str]:
        """Warnings where the laws alone would not say that the proposal is good enough, where the field beside the
        quantity is worse than it, and those that the run itself gave and the case's did not.
        """
        wanted, warnings, seen = self.search.wanted, [], self.pilots.knobs.seen
        if run.proposal.bound > wanted * ROUNDING:
            warnings.append(
                f"it is off by {percent(run.error)}, but the laws of its knobs promise no less than "
                f"{percent(run.proposal.bound)}"
            )
        if run.field_error > FIELD_WARNED * wanted and seen:
            warnings.append(
                f"the field {seen.name} at the end is off by {percent(run.field_error)}: errors may cancel in "
                f"{self.search.quantity.name} that do not cancel elsewhere"
            )
        of_case = {words.partition(":")[2][:12] for words in self.search.base.warnings}
        return warnings + [words for words in run.pilot.warnings if words.partition(":")[2][:12] not in of_case]
