"""From the laws of a search to a recommendation that was run: certified, or marked as known less well; or the ways out.

Certified: the measured error and the uncertainty of the reference are together within the tolerance, and so they are of
every setting measured that is finer. Marked: the measured error is, and what is known does not suffice for more.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hpcpic.core.app.text import percent
from hpcpic.core.errors import CheckFailed
from hpcpic.core.study.error_models import cheapest, relative_cost
from hpcpic.core.study.pilot import Pilot
from hpcpic.core.study.search import WORTH, Scheme, Search

LIMIT_MARGIN = 0.8  # of the end of stability
NEIGHBOUR = 1.25
APART = 1.1  # at least, of sizes that tell more than one
SAME = 1.001  # times a size: the same, to rounding
PROMISED = 1.001  # times the tolerance: a bound of the laws that promises it
DEAREST = 2.0  # times the cost of the case's pilot, or what is left if that is less: a neighbour that is not run
TRIES = 4
FINER = 3.0  # pilots of the case's cost: about what a finer level of one knob costs
UNSURE = 0.25  # times the tolerance: where the reference is known better, a miss is one of the laws
UNKNOWN = 3.0  # times the tolerance: where the reference is not known better, nothing is said of any setting
FAR = 5.0  # times what all pilots may cost
MOST_STEPS = 24  # of a tenth, back from what `check` warns of
LOST = 1.0  # error of the field beside the quantity at which nothing is left of it
SEEN = 2.0  # times the tolerance: an error of the field beside the quantity that is told as a warning


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
    """A proposal that was run: pilot, its measured error, that of the field beside it (nan: not known), those of the
    coarser and finer neighbour, `beside` their sizes. kept: sizes of all that were run and are as good as the laws say.
    luck: by which finer setting, or lost field, one sees that an error within the tolerance is luck.
    """

    proposal: Proposal
    pilot: Pilot
    error: float
    field: float
    certified: bool
    neighbours: Mapping[str, float] = dataclasses.field(default_factory=dict)
    beside: Mapping[str, Mapping[str, float]] = dataclasses.field(default_factory=dict)
    warnings: list[str] = dataclasses.field(default_factory=list)
    kept: list[Mapping[str, float]] = dataclasses.field(default_factory=list)
    luck: str = ""


class Recommendation:
    """The cheapest settings that a search's laws allow, and their verification."""

    def __init__(self, search: Search) -> None:
        self.search, self.pilots = search, search.pilots
        self.schemes = list(search.schemes)
        self._caps: dict[str, float] = {}

    # -------------------------------------------------------------------------------------- proposals

    def propose(self, tolerance: float) -> Proposal:
        """The cheapest settings by the laws whose errors together are within the tolerance. Raises CheckFailed."""
        made = [self.proposed(scheme, tolerance) for scheme in self.schemes]
        found = [proposal for proposal in made if proposal is not None]
        if not found:
            floor = self.search.floor
            raise CheckFailed(f"no knob accounts for errors of {percent(floor)}, of {percent(tolerance)} asked for")
        best = min(found, key=lambda p: p.cost)
        return best if not best.scheme.others or best.cost < WORTH * found[0].cost else found[0]

    def proposed(self, scheme: Scheme, tolerance: float) -> Proposal | None:
        budget = tolerance - self.search.floor - scheme.floor
        if budget <= 0.25 * tolerance:
            return None
        sizes = cheapest(scheme.laws, budget, self.caps())
        if self.nominal(sizes) > FAR * self.search.budget.allowance:  # told, and not even set up
            shares = {law.name: law.bound(sizes[law.name]) for law in scheme.laws}
            return Proposal(scheme, sizes, shares, scheme.cost * self.nominal(sizes))
        for _ in range(MOST_STEPS):
            number = self.pilots.beyond(sizes, self.search.quantity.time, scheme.others, LIMIT_MARGIN)
            if number is None:
                return self.realised(scheme, sizes)
            turned = [k.name for k in self.search.knobs if k.limit == number.name or k.key == number.key]
            turned = turned or [name for name, size in sizes.items() if size > 1.001 * self.search.own[name]]
            sizes = {name: 0.9 * size if name in turned else size for name, size in sizes.items()}
        return None

    def legal(self, sizes: Mapping[str, float], scheme: Scheme) -> bool:
        """Neither near the end of stability nor where `check` warns, unless the case itself is."""
        return self.pilots.legal(sizes, self.search.quantity.time, scheme.others, LIMIT_MARGIN)

    def realised(self, scheme: Scheme, sizes: Mapping[str, float]) -> Proposal:
        """With the sizes there really are, and the errors they may make."""
        real = self.pilots.sizes_of(self.pilots.config(sizes, self.search.quantity.time, scheme.others))
        sizes = {law.name: real[law.name] for law in scheme.laws}
        shares = {law.name: law.bound(sizes[law.name]) for law in scheme.laws}
        if self.search.floor:
            shares["rest"] = self.search.floor
        shares |= {"scheme": scheme.floor} if scheme.floor else {}
        return Proposal(scheme, sizes, shares, scheme.cost * relative_cost(scheme.laws, sizes))

    def itself(self) -> Proposal:
        return self.realised(self.schemes[0], self.search.own)

    def caps(self) -> dict[str, float]:
        """Sizes at LIMIT_MARGIN of the end of stability, or where the case is refused or warned of."""
        if not self._caps:
            for law in self.search.laws.values():
                low, high = float(law.sizes[0]), 2.0 * float(law.sizes[-1])
                if not self.search.legal(law.name, high, LIMIT_MARGIN):
                    for _ in range(12):
                        middle = math.sqrt(low * high)
                        legal = self.search.legal(law.name, middle, LIMIT_MARGIN)
                        low, high = (middle, high) if legal else (low, middle)
                    self._caps[law.name] = low
        return self._caps

    def nearer(self, proposal: Proposal, part: float) -> Proposal:
        """The proposal with this part of its way from the case, in logs, where it is coarser."""
        sizes = {}
        for name, size in proposal.sizes.items():
            factor = size / self.search.own[name]
            sizes[name] = self.search.own[name] * max(factor, 1.0) ** part * min(factor, 1.0)
        return self.realised(proposal.scheme, sizes)

    # ---------------------------------------------------------------------------------------- verified

    def verify(self, tolerance: float) -> Verified:
        """A certified setting; else, as long as that is affordable, more is learnt of the reference; else what comes
        nearest to the tolerance. Raises CheckFailed.
        """
        search = self.search
        while True:
            known = self.attempts(tolerance)
            if known and known[-1].certified:
                run = self.compared(known[-1])
                if luck := self.luck(run, tolerance):
                    other = self.held(tolerance)
                    if other is None or other.pilot is run.pilot or self.luck(held := self.compared(other), tolerance):
                        return dataclasses.replace(run, certified=False, luck=luck)
                    held.warnings.append(f"{self.text(run.proposal)} would do by itself, but {luck}")
                    run = held
                unsure = self.unchecked(run)
                if not unsure:
                    return run
                if not self.completed(unsure):
                    return dataclasses.replace(run, certified=False)
                continue
            if not search.more():
                break
            self.schemes = [Scheme({}, 1.0, 0.0, tuple(search.laws.values()))]
            self._caps.clear()
        own = self.itself()
        known.append(Verified(own, search.base, search.error(search.value), search.field_error(search.base), False))
        good = [run for run in known if run.error <= tolerance and self.legal(run.proposal.sizes, run.proposal.scheme)]
        if not good or search.uncertainty > UNKNOWN * tolerance:
            raise CheckFailed(self.told(known))
        near = [run for run in good if run.error + search.uncertainty <= 1.5 * tolerance]
        run = self.compared(
            min(near, key=lambda run: run.proposal.cost) if near else min(good, key=lambda run: run.error)
        )
        return dataclasses.replace(run, luck=self.lost(run))

    def attempts(self, tolerance: float) -> list[Verified]:
        """Propose and run; on a miss propose for less. Those that were run, a certified one last."""
        search, known = self.search, list[Verified]()
        if search.uncertainty >= tolerance and search.quieter:
            return known  # whatever is run: a start with less noise is the next thing to be tried
        proposal, misses = self.by_laws(self.certain(tolerance)), 0
        if self.price(proposal) > 1.0 and self.completed(search.assumed):  # which costs less than the wrong run
            proposal = self.by_laws(self.certain(tolerance))
        held = self.held(tolerance)
        if held and self.price(proposal) >= self.price(held.proposal):  # as far as the laws know, less may be enough
            proposal = self.by_laws(tolerance)
        while misses < TRIES:
            if held and self.price(proposal) >= self.price(held.proposal):
                return [*known, held]
            run = self.tried(proposal)
            if run is None and not misses:  # as far as can be known, that may be enough
                run = self.tried(proposal := self.by_laws(tolerance))
            if run is not None:
                known.append(run)
                if self.holds(run.error, tolerance) and not self.lost(run):
                    return [*known[:-1], dataclasses.replace(run, certified=True)]
            if proposal.scheme.others:  # what it and the knobs do together is not in the laws: without it
                self.schemes = self.schemes[:1]
                proposal = self.by_laws(self.certain(tolerance))
                continue
            if run is not None and self.completed(search.assumed):  # they do not foretell it
                proposal, held = self.by_laws(self.certain(tolerance)), self.held(tolerance)
                continue
            if run is not None and self.price(proposal) > FINER and search.uncertainty > UNSURE * tolerance:
                break  # a finer pilot tells more of the reference, and costs less than another such run
            misses += 1
            error = run.error if run and not self.lost(run) else tolerance
            proposal = self.after_miss(misses, proposal, tolerance, error)
        return [*known, held] if held else known

    def held(self, tolerance: float) -> Verified | None:
        """The cheapest of what the search has run already, the case and what is finer, that is certified as it is."""
        search, scheme = self.search, self.search.schemes[0]
        good = []
        for pilot in (search.base, *search.finer):
            proposal, error = self.realised(scheme, pilot.sizes), search.error(search.measured(pilot))
            run = Verified(proposal, pilot, error, search.field_error(pilot), True)
            allowed = pilot is search.base or self.legal(pilot.sizes, scheme)
            if allowed and self.holds(error, tolerance) and not self.luck(run, tolerance):
                good.append(run)
        return min(good, key=lambda run: self.price(run.proposal), default=None)

    def holds(self, error: float, tolerance: float) -> bool:
        """True if an error that was measured is within the tolerance wherever in its interval the reference lies."""
        return error + self.search.uncertainty <= tolerance

    def luck(self, run: Verified, tolerance: float) -> str:
        """A measured setting, as fine as this one in every knob and finer in one, that does not hold the tolerance; ""
        if there is none. Errors that grow towards finer sizes tell that a small one among them is chance.
        """
        if lost := self.lost(run):
            return lost
        search, sizes = self.search, run.proposal.sizes
        measured: dict[str, tuple[Mapping[str, float], float]] = {
            f"the {words} neighbour": (run.beside[words], error) for words, error in run.neighbours.items()
        }
        if not run.proposal.scheme.others:  # in which the levels were run
            for knob in search.knobs:
                for level in search.levels[knob.name]:
                    at = {**search.own, knob.name: level.size}
                    words = f"the case with {knob.name} = {knob.shown(level.size):.4g}"
                    measured[words] = at, search.error(level.value)
        acting = [law.name for law in run.proposal.scheme.laws if not law.idle]
        for words, (beside, error) in measured.items():
            ratios = [beside[name] / sizes[name] for name in acting]
            finer = ratios and max(ratios) < SAME and min(ratios) < 1.0 / SAME
            if finer and not self.holds(error, tolerance):
                return f"{words} is off by {percent(error)}: that this setting, which is coarser, is by less is luck"
        return ""

    def lost(self, run: Verified) -> str:
        """By how much the field at the end is off where nothing is left of it, beside a quantity that the user has not
        named: that this one is right is luck; "" elsewhere.
        """
        seen, quantity = self.pilots.knobs.seen, self.search.quantity
        if not seen or quantity.asked or not run.field > LOST:
            return ""
        off = percent(run.field)
        return f"the field {seen.name} at the end is off by {off}: that {quantity.name} is by less is luck"

    def unchecked(self, run: Verified) -> list[str]:
        """Knobs whose order theory alone tells, where no run at a third size of theirs is as good as the laws say."""
        laws = self.search.laws
        return [
            name for name in self.search.assumed
            if not any(abs(np.log(sizes[name] / laws[name].sizes)).min() > math.log(APART) for sizes in run.kept)
        ]  # fmt: skip

    def doubts(self, run: Verified, tolerance: float) -> str:
        """Why a setting that was run is not certified."""
        error, unknown = run.error, self.search.uncertainty
        if not run.luck and not self.holds(error, tolerance):
            return (
                f"off by {percent(error)} from a reference known to {percent(unknown)} may be "
                f"{percent(error + unknown)}, beyond the {percent(tolerance)} asked for"
            )
        luck = run.luck or self.luck(run, tolerance)
        return luck or f"theory alone tells the order of the error in {', '.join(self.unchecked(run))}"

    def completed(self, names: Sequence[str]) -> bool:
        """True if the search could complete the laws of these knobs, which the schemes have then."""
        if not self.search.complete(names):
            return False
        self.search.schemes = self.search.combinations()
        self.schemes = list(self.search.schemes)
        self._caps.clear()
        return True

    def certain(self, tolerance: float) -> float:
        """What the laws are asked for, so that the uncertainty of the reference has room beside it."""
        return max(tolerance - self.search.uncertainty, 0.5 * tolerance)

    def nominal(self, sizes: Mapping[str, float]) -> float:
        """The cost of these sizes beside the case's, by theory."""
        return math.prod((self.search.own[knob.name] / sizes[knob.name]) ** knob.cost for knob in self.search.knobs)

    def price(self, proposal: Proposal) -> float:
        """What running a proposal costs, in pilots of the case's own cost."""
        nominal = self.nominal(proposal.sizes)
        if nominal > FAR * self.search.budget.allowance:  # clocks of coarse pilots count what does not grow too
            return proposal.scheme.cost * nominal
        config = self.pilots.config(proposal.sizes, self.search.quantity.time, proposal.scheme.others)
        return self.pilots.knobs.work(config) / self.search.base.work

    def tried(self, proposal: Proposal) -> Verified | None:
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

    def told(self, known: list[Verified]) -> str:
        """What the settings that were run are off by."""
        rows = {self.text(run.proposal): f"{self.text(run.proposal)}: off by {percent(run.error)}" for run in known}
        return "; ".join(rows.values())

    def text(self, proposal: Proposal) -> str:
        sizes = [f"{knob.name} = {knob.shown(proposal.sizes[knob.name]):.4g}" for knob in self.search.knobs]
        return " ".join([*sizes, proposal.scheme.words]).strip()

    def first(self, tolerance: float) -> Proposal:
        """The cheapest by the laws, or what was run already where that is certified and costs less."""
        proposal, held = self.by_laws(self.certain(tolerance)), self.held(tolerance)
        return held.proposal if held and self.price(held.proposal) <= self.price(proposal) else proposal

    def by_laws(self, tolerance: float) -> Proposal:
        try:
            return self.propose(tolerance)
        except CheckFailed:
            return self.itself()

    def after_miss(self, misses: int, proposal: Proposal, tolerance: float, error: float) -> Proposal:
        """What knobs do together is not in the laws: ask them for less, also again where that is finer than the case;
        go half-way back to the case, take the case.
        """
        finer = self.price(proposal) > 1.0
        if misses == 1 or finer:
            try:
                asked = self.propose(0.8 * tolerance**2 / (error + self.search.uncertainty))
            except CheckFailed:
                asked = proposal
            if asked.cost < 1.0 or finer:
                return asked
        return self.nearer(proposal, 0.5) if misses < TRIES - 1 else self.itself()

    def compared(self, run: Verified) -> Verified:
        """With the settings beside it: where their errors do not follow the laws a small one is luck."""
        search, proposal = self.search, run.proposal
        neighbours: dict[str, float] = {}
        at: dict[str, Mapping[str, float]] = {}
        warnings = self.unpromised(run)
        kept = [run.pilot.sizes] if run.error <= proposal.bound + search.uncertainty else []
        laws = {law.name: law for law in proposal.scheme.laws}
        for words, factor in (("coarser", NEIGHBOUR), ("finer", 1.0 / NEIGHBOUR)):
            sizes = {name: size if laws[name].idle else size * factor for name, size in proposal.sizes.items()}
            cost = proposal.scheme.cost * relative_cost(proposal.scheme.laws, sizes)
            legal = self.pilots.legal(sizes, search.quantity.time, proposal.scheme.others)
            beyond = cost > self.dearest(proposal) or search.cost(sizes, proposal.scheme.others) > search.budget.left
            if not legal or beyond:
                continue
            beside = search.pilot(sizes, proposal.scheme.others, f"{words} neighbour")
            try:
                neighbours[words], at[words] = search.error(search.measured(beside)), beside.sizes
            except CheckFailed as failure:
                warnings.append(f"the {words} neighbour: {failure.message}")
                continue
            bound = sum(law.bound(sizes[law.name]) for law in proposal.scheme.laws) + proposal.scheme.floor
            kept += [beside.sizes] if neighbours[words] <= bound + search.floor + search.uncertainty else []
            if neighbours[words] > 2.0 * (bound + search.floor) + search.uncertainty:
                warnings.append(
                    f"the {words} neighbour is off by {percent(neighbours[words])}, more than twice the law's "
                    f"{percent(bound + search.floor)}"
                )
        return dataclasses.replace(run, neighbours=neighbours, beside=at, warnings=warnings, kept=kept)

    def dearest(self, proposal: Proposal) -> float:
        """What a neighbour may cost, in pilots. Where the laws do not promise the tolerance it alone can tell luck."""
        left = max(self.search.budget.left, 0.0)
        return min(DEAREST, left) if proposal.bound <= self.search.wanted * PROMISED else left

    def unpromised(self, run: Verified) -> list[str]:
        """Warnings where the laws alone would not say that the proposal is good enough, where the field beside the
        quantity is worse than it, and those that the run itself gave and the case's did not.
        """
        wanted, found, seen = self.search.wanted, [], self.pilots.knobs.seen
        if run.proposal.bound > wanted * PROMISED:
            found.append(
                f"it is off by {percent(run.error)}, but the laws of its knobs promise no less than "
                f"{percent(run.proposal.bound)}"
            )
        if run.field > SEEN * wanted and seen:
            found.append(
                f"the field {seen.name} at the end is off by {percent(run.field)}: errors may cancel in "
                f"{self.search.quantity.name} that do not cancel elsewhere"
            )
        own = {words.partition(":")[2][:12] for words in self.search.base.warnings}
        return found + [words for words in run.pilot.warnings if words.partition(":")[2][:12] not in own]
