"""Ways out of a search that certifies nothing, each with its price."""

from __future__ import annotations

import math
from collections.abc import Mapping

from hpcpic.core.app.text import duration, percent
from hpcpic.core.errors import CheckFailed
from hpcpic.core.study.recommend import Recommendation

LARGEST_TOLERANCE = 0.99  # beyond it a tolerance says nothing, and --tolerance refuses it
SEEDS = (2, 3, 4)  # of the ensemble that a refusal measures
MAX_SECONDS = 1e6  # of a way out
MAX_HALVINGS = 12  # of all knobs together, in a way out


def ways(recommendation: Recommendation, tolerance: float) -> list[str]:
    """Sentences on what the user can do where nothing is certified, each with its price."""
    search, found = recommendation.search, list[str]()
    reached = search.error(search.value) + search.uncertainty
    enough = 1.05 * reached
    if reached <= tolerance:
        found.append(f"the case itself is off by {percent(search.error(search.value))}: it may stay as it is")
    elif enough < LARGEST_TOLERANCE:
        found.append(f"--tolerance {percent(enough).replace(' ', '')} is certified by the case itself, at no cost")
    if search.quieter:
        found.append(f"a start with less noise: {' '.join(f'--set {setting}' for setting in search.quieter)}")
    for more in (finer_pilots, unaffordable, ensemble):
        found += more(recommendation, tolerance)
    return found


def unaffordable(recommendation: Recommendation, tolerance: float) -> list[str]:
    """Settings that the laws promise to be good enough, and that were not run for their price."""
    proposal, search = recommendation.expected(tolerance), recommendation.search
    price = recommendation.proposals.price(proposal)
    seconds = price * search.base.seconds
    if price <= search.budget.left or seconds > MAX_SECONDS:
        return []
    pilots = math.ceil(max(2.0 * price, search.budget.used + price))  # the other half may go to the search
    return [f"--pilots {pilots} runs {recommendation.proposals.text(proposal)} too, {duration(seconds)}"]


def finer_pilots(recommendation: Recommendation, tolerance: float) -> list[str]:
    """Finer pilots, until the reference is known to half of the tolerance; or a finer case where none helps."""
    search = recommendation.search
    doubts = {law.name: law.doubt for law in search.laws.values()}
    halved = dict.fromkeys(doubts, 0)
    cost = {knob.name: knob.cost for knob in search.knobs}
    finest = {law.name: min(float(law.sizes[0]) / law.here, 1.0) for law in search.laws.values()}
    extra = 0.0
    while sum(doubts.values()) > 0.5 * tolerance and sum(halved.values()) < MAX_HALVINGS:
        name = max(doubts, key=doubts.__getitem__)
        doubts[name] *= 0.5 ** search.laws[name].used
        halved[name] += 1
        extra += (2.0 ** halved[name] / finest[name]) ** cost[name]
    if sum(doubts.values()) > 0.5 * tolerance or not extra:
        return []
    drawn = any(halved[law.name] and law.random for law in search.laws.values())
    if not drawn:
        pilots = search.budget.asking(search.budget.used + extra)
        if extra * search.base.seconds > MAX_SECONDS:
            return []
        return [f"--pilots {pilots} may measure it: about {duration(extra * search.base.seconds)} more"]
    sizes = {name: search.case_sizes[name] * 0.5**n for name, n in halved.items() if n}
    factor = math.prod(2.0 ** (cost[name] * n) for name, n in halved.items())
    sets = " ".join(f"--set {word}" for word in changed_settings(recommendation, sizes))
    return [f"start from a finer case: {sets}, {duration(factor * search.base.seconds)} a pilot"]


def changed_settings(recommendation: Recommendation, sizes: Mapping[str, float]) -> list[str]:
    """The --set list of these sizes, without what the case says already."""
    knobs, case_sizes = recommendation.pilots.knobs, recommendation.search.case_sizes
    before = set(knobs.settings(case_sizes, knobs.time))
    return [word for word in knobs.settings({**case_sizes, **sizes}, knobs.time) if word not in before]


def ensemble(recommendation: Recommendation, tolerance: float) -> list[str]:
    """How far the random states of a scene lie apart, and how many make a mean that is known to the tolerance."""
    search, knobs = recommendation.search, recommendation.pilots.knobs
    other = knobs.seed or knobs.shaken
    if other is None or not any(not law.asymptotic and not law.idle for law in search.laws.values()):
        return []
    if (needed := search.budget.used + len(SEEDS)) > search.budget.allowance:
        return [f"--pilots {math.ceil(needed)} tells how far seeds lie apart"]
    values = [search.value] if knobs.seed else []
    for seed in SEEDS:
        more = (*other(seed), *search.snapshot)
        pilot = recommendation.pilots.run(search.case_sizes, search.quantity.time, None, more, words=f"seed {seed}")
        try:
            values.append(search.measured(pilot))
        except CheckFailed:
            return []
    centre = sum(values) / len(values)
    squares = sum(float(((value - centre) ** 2).mean()) for value in values)
    spread = math.sqrt(squares / (len(values) - 1)) / search.scale
    runs = math.ceil((2.0 * spread / (0.5 * tolerance)) ** 2)
    if runs <= 1:
        return []
    return [
        f"seeds lie {percent(spread)} apart (standard deviation of {len(values)}): a mean over {runs} seeds is "
        f"known to {percent(0.5 * tolerance)} with 95 %, {duration(runs * search.base.seconds)} in all "
        f"(sweep{''.join(f' --set {word}' for word in other(1)[1:])} --set {other(1)[0]}:{runs}:{runs})"
    ]
