"""Ways out of a search that certifies nothing, each with its price."""

from __future__ import annotations

import math
from collections.abc import Mapping

from hpcpic.core.app.text import duration, percent
from hpcpic.core.errors import CheckFailed
from hpcpic.core.study.recommend import Recommendation

HOPELESS = 0.99  # a tolerance that says nothing, and that --tolerance refuses
SEEDS = (2, 3, 4)  # of the ensemble that a refusal measures
DAYS = 1e6  # s: what takes longer is no way out
HALVINGS = 12  # of all knobs together, that a way out may name


def ways(made: Recommendation, tolerance: float) -> list[str]:
    """What to do where nothing is certified, each with its price."""
    search = made.search
    reached = search.error(search.value) + search.uncertainty
    found, enough = list[str](), 1.05 * reached
    if enough < HOPELESS:
        found.append(f"--tolerance {percent(enough).replace(' ', '')} is certified by the case itself, at no cost")
    if reached <= tolerance:
        found = [f"the case itself is off by {percent(search.error(search.value))}: it may stay as it is"]
    if search.quieter:
        found.append(f"a start with less noise: {' '.join(f'--set {setting}' for setting in search.quieter)}")
    return [*found, *dearer(made, tolerance), *deeper(made, tolerance), *ensemble(made, tolerance)]


def dearer(made: Recommendation, tolerance: float) -> list[str]:
    """Settings that the laws promise to be good enough, and that were not run for their price."""
    proposal, search = made.first(tolerance), made.search
    price = made.price(proposal)
    seconds = price * search.base.seconds
    if price <= search.budget.left or seconds > DAYS:
        return []
    pilots = math.ceil(max(2.0 * price, search.budget.used + price))  # the other half may go to the search
    return [f"--pilots {pilots} runs {made.text(proposal)} too, {duration(seconds)}"]


def deeper(made: Recommendation, tolerance: float) -> list[str]:
    """Finer pilots, until the reference is known to half of the tolerance; or a finer case where none helps."""
    search = made.search
    doubts = {law.name: law.doubt for law in search.laws.values()}
    halved = dict.fromkeys(doubts, 0)
    cost = {knob.name: knob.cost for knob in search.knobs}
    finest = {law.name: min(float(law.sizes[0]) / law.here, 1.0) for law in search.laws.values()}
    extra = 0.0
    while sum(doubts.values()) > 0.5 * tolerance and sum(halved.values()) < HALVINGS:
        name = max(doubts, key=doubts.__getitem__)
        doubts[name] *= 0.5 ** search.laws[name].used
        halved[name] += 1
        extra += (2.0 ** halved[name] / finest[name]) ** cost[name]
    if sum(doubts.values()) > 0.5 * tolerance or not extra:
        return []
    drawn = any(halved[law.name] and law.random for law in search.laws.values())
    if not drawn:
        pilots = search.budget.asking(search.budget.used + extra)
        if extra * search.base.seconds > DAYS:
            return []
        return [f"--pilots {pilots} may measure it: about {duration(extra * search.base.seconds)} more"]
    sizes = {name: search.own[name] * 0.5**n for name, n in halved.items() if n}
    factor = math.prod(2.0 ** (cost[name] * n) for name, n in halved.items())
    sets = " ".join(f"--set {word}" for word in different(made, sizes))
    return [f"start from a finer case: {sets}, {duration(factor * search.base.seconds)} a pilot"]


def different(made: Recommendation, sizes: Mapping[str, float]) -> list[str]:
    """The --set list of these sizes, without what the case says already."""
    knobs = made.pilots.knobs
    own = set(knobs.settings(made.search.own, knobs.time))
    return [word for word in knobs.settings({**made.search.own, **sizes}, knobs.time) if word not in own]


def ensemble(made: Recommendation, tolerance: float) -> list[str]:
    """Where numbers are drawn: how far seeds lie apart, and how many make a mean that is known to the tolerance."""
    search, knobs = made.search, made.pilots.knobs
    other = knobs.seed or knobs.shaken
    if other is None or not any(not law.asymptotic and not law.idle for law in search.laws.values()):
        return []
    if (needed := search.budget.used + len(SEEDS)) > search.budget.allowance:
        return [f"--pilots {math.ceil(needed)} tells how far seeds lie apart"]
    values = [search.value] if knobs.seed else []
    for seed in SEEDS:
        more = (*other(seed), *search.snapshot)
        pilot = made.pilots.run(search.own, search.quantity.time, None, more, words=f"seed {seed}")
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
