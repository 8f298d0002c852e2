"""Models of the error of a quantity as a function of the size of each knob, and the cheapest sizes for a wanted error.

Sources: Roache, Verification and Validation in Computational Science and Engineering (1998): observed order, and
the safety factor 1.25, or 3 with the theory's order where the observed one is implausible; Celik et al., J. Fluids
Eng. 130 (2008): orders from levels whose ratio is not constant. Errors are relative to the norm of the quantity.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

PLAUSIBLE = (0.5, 1.5)  # times the theory's order
SAFETY, SAFETY_IMPLAUSIBLE = 1.25, 3.0
NO_EFFECT = 1e-11  # relative difference between levels that counts as none
LEAST_COST = 0.25  # of the theory's exponent: a knob that costs little now will cost more when it is finer
SMALL_SPREAD = 0.05  # relative change over all levels below which coarse ones are asymptotic too, and less noisy
STUDENT = {2: 12.7, 3: 4.3, 4: 3.2, 5: 2.8, 6: 2.6, 7: 2.5}  # levels: two-sided 95 % of one degree less
MAX_FITTED_LEVELS = 7  # levels of a least-squares fit, of four at least
EXTRAPOLATION = 1.3  # times the coarsest size measured: no proposal is coarser


@dataclass(frozen=True, slots=True)
class Level:
    """One pilot: size of the knob, value[n] of the quantity, seconds on the clock and by the estimate, half the 95 %
    interval of the value where it is a mean over time, and the field at the end.
    """

    size: float
    value: NDArray[np.float64]
    seconds: float
    price: float
    noise: float = 0.0
    field: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True)
class ErrorModel:
    """The error and cost of one knob. sizes[m] and errors[m] ascend; signed[n]: relative error of the case itself.

    order: observed; used: the one calculated with; safety: Roache's factor. cost: exponent c of seconds ~ size^-c.
    doubt: how far the error of the case itself may be from `signed`.

    | kind | levels | made by |
    | --- | --- | --- |
    | `idle` | all alike: the knob has no effect | `fit` |
    | `assumed` | two; the order is theory's | `fit` |
    | `steady` | three, with a plausible order | `fit` |
    | implausible order: theory's, with the safety 3 | three | `fit` |
    | `asymptotic`, not steady | four or more, scattered about a power law | `levelled` |
    | `random` | drawn anew at every size, or within the noise of sampling | `scattered`, `hidden` |
    """

    name: str
    sizes: NDArray[np.float64]
    errors: NDArray[np.float64]
    signed: NDArray[np.float64]
    here: float
    order: float
    theory: float
    used: float
    safety: float
    cost: float
    least_cost: float
    doubt: float = 0.0

    @property
    def idle(self) -> bool:
        """True if the knob has no effect."""
        return bool(self.errors[-1] <= NO_EFFECT)

    @property
    def asymptotic(self) -> bool:
        return self.safety == SAFETY and not self.random

    @property
    def steady(self) -> bool:
        """True if the order was observed in three levels."""
        return self.asymptotic and plausible(self.order, self.theory)

    @property
    def assumed(self) -> bool:
        """True if two levels say how large the error is, and theory alone how it falls."""
        return len(self.sizes) == 2 and self.asymptotic and not self.idle

    @property
    def case_level(self) -> int:
        """Index of the level that is the case itself."""
        return int(np.argmin(np.abs(np.log(self.sizes / self.here))))

    @property
    def random(self) -> bool:
        """True if the error is drawn anew at every size: no extrapolation takes it off."""
        return self.doubt > 0.0 and not self.signed.any()

    def error(self, size: float) -> float:
        """The relative error at a size, without the safety factor: a power law between the levels and beyond them."""
        if self.idle:
            return 0.0
        x, xs, ys = math.log(size), np.log(self.sizes), np.log(np.maximum(self.errors, 1e-300))
        if x <= xs[0]:
            return math.exp(ys[0] + self.used * (x - xs[0]))
        if x >= xs[-1]:
            return math.exp(ys[-1] + self.used * (x - xs[-1]))
        return math.exp(np.interp(x, xs, ys))

    def bound(self, size: float) -> float:
        """The error with its safety factor."""
        return self.safety * self.error(size)

    def size(self, bound: float) -> float:
        """The largest size whose error, with the safety factor, is within `bound`, as far as the levels tell it."""
        most = EXTRAPOLATION * float(self.sizes[-1])
        if self.bound(most) <= bound:
            return most
        least = 1e-4 * float(self.sizes[0])
        for _ in range(60):
            middle = math.sqrt(least * most)
            least, most = (middle, most) if self.bound(middle) <= bound else (least, middle)
        return least


def norm(value: NDArray) -> float:
    return float(np.sqrt(np.mean(np.square(value))))


def observed_order(sizes: Sequence[float] | NDArray, values: Sequence[NDArray]) -> float:
    """p with (h3^p - h2^p) / (h2^p - h1^p) = |q3 - q2| / |q2 - q1|, sizes ascending; nan when the values turn back."""
    h1, h2, h3 = sizes
    first, second = values[1] - values[0], values[2] - values[1]
    if float(np.dot(first, second)) <= 0.0:
        return math.nan
    wanted = norm(second) / norm(first)
    low, high = 0.02, 12.0
    for _ in range(60):
        p = 0.5 * (low + high)
        ratio = (h3**p - h2**p) / (h2**p - h1**p)
        low, high = (p, high) if ratio < wanted else (low, p)
    return 0.5 * (low + high)


def plausible(order: float, theory: float) -> bool:
    """True for an observed order that belongs to theory's. One above it is that of coarse levels: none is used."""
    return math.isfinite(order) and PLAUSIBLE[0] * theory < order < PLAUSIBLE[1] * theory


def spaced(sizes: NDArray) -> list[int]:
    """The ends and the level nearest to their geometric mean."""
    inner = np.abs(np.log(sizes[1:-1] ** 2 / (sizes[0] * sizes[-1])))
    return [0, 1 + int(np.argmin(inner)), len(sizes) - 1]


def fit(name: str, levels: Sequence[Level], here: float, theory: float, cost_theory: float, scale: float) -> ErrorModel:
    """The law of one knob; `here` is the case's own size, `scale` the quantity's norm.

    From three levels or more: the observed order, or theory's with Roache's factor for it. From two: theory's order,
    which a run is to check; what the reference is known to has the factor already.
    """
    levels = sorted(levels, key=lambda level: level.size)
    sizes, values = np.array([level.size for level in levels]), [level.value / scale for level in levels]
    case_level = int(np.argmin(np.abs(np.log(sizes / here))))
    spread = max(norm(value - values[0]) for value in values)
    cost = max(_slope(np.log(sizes), -np.log([level.seconds for level in levels])), 0.0)
    law = partial(ErrorModel, name, sizes, here=here, theory=theory, cost=cost, least_cost=LEAST_COST * cost_theory)
    if spread <= NO_EFFECT:
        nothing = np.zeros_like(values[0])
        return law(np.zeros_like(sizes), nothing, order=math.nan, used=theory, safety=SAFETY)
    if len(levels) == 2:
        parts = (sizes / sizes[0]) ** theory / ((sizes[1] / sizes[0]) ** theory - 1.0)  # errors over the difference
        signed = (values[1] - values[0]) * parts[case_level]
        doubt = (SAFETY_IMPLAUSIBLE - 1.0) * spread * float(parts[0])
        return law(spread * parts, signed, order=math.nan, used=theory, safety=SAFETY, doubt=doubt)
    three = [0, 1, 2] if spread > SMALL_SPREAD else spaced(sizes)
    order = observed_order(sizes[three], [values[k] for k in three])
    good = plausible(order, theory)
    used, safety = (min(order, theory), SAFETY) if good else (theory, SAFETY_IMPLAUSIBLE)
    finest_error = (values[1] - values[0]) / ((sizes[1] / sizes[0]) ** used - 1.0)
    all_signed = [value - values[0] + finest_error for value in values]
    errors = np.array([norm(value) for value in all_signed])
    if not good:  # the coarser pair may say more
        other = norm(values[2] - values[1]) / ((sizes[2] / sizes[0]) ** used - (sizes[1] / sizes[0]) ** used)
        errors = np.maximum(errors, other)
    errors = np.maximum.accumulate(errors)
    doubt = (safety - 1.0) * (norm(finest_error) if good else float(errors[0]))  # what was taken off the finest level
    return law(errors, all_signed[case_level], order=order, used=used, safety=safety, doubt=doubt)


def scattered(law: ErrorModel, levels: Sequence[Level], scale: float) -> ErrorModel:
    """The law of a knob whose error is drawn anew at every size, with a spread a size^p, p the theory's order.

    a from the differences of all pairs of levels; errors are what 95 % of draws keep, by Student's t of so many levels.
    """
    pairs = [(one, two) for k, one in enumerate(levels) for two in levels[:k]]
    square = np.mean(
        [
            (norm(one.value - two.value) / scale) ** 2 / (one.size ** (2 * law.theory) + two.size ** (2 * law.theory))
            for one, two in pairs
        ]
    )
    most = STUDENT.get(len(levels), 2.3) * math.sqrt(square)
    errors, doubt = most * law.sizes**law.theory, most * law.here**law.theory
    nothing = np.zeros_like(law.signed)
    return replace(law, errors=errors, signed=nothing, used=law.theory, safety=1.0, doubt=doubt)


def levelled(law: ErrorModel, levels: Sequence[Level], scale: float) -> ErrorModel:
    """The law of a knob whose errors scatter about a power law, as where walls lie otherwise among the nodes of every
    level: least squares of v0 + a h^p through the finest levels, p of theory (Eca & Hoekstra, J. Comput. Phys. 262
    (2014)). The doubt about v0 is by Student's t of the degrees of freedom of the fit.
    """
    near = sorted(levels, key=lambda level: level.size)[:MAX_FITTED_LEVELS]
    sizes, values = np.array([level.size for level in near]), np.array([level.value / scale for level in near])
    lines = np.stack([np.ones_like(sizes), (sizes / law.here) ** law.theory], axis=1)
    weight = (law.here / sizes)[:, None]
    found = np.linalg.lstsq(weight * lines, weight * values, rcond=None)[0]
    free = len(near) - 2
    scatter = math.sqrt(sum(norm(part) ** 2 for part in weight * (values - lines @ found)) / free)
    spread = scatter * math.sqrt(np.linalg.inv((weight * lines).T @ (weight * lines))[0, 0])
    slope, start = norm(found[1]), STUDENT[free + 1] * spread
    errors = np.maximum(slope * (law.sizes / law.here) ** law.theory + scatter, law.errors * (law.sizes > sizes[-1]))
    signed = next(level.value for level in levels if level.size == law.sizes[law.case_level]) / scale - found[0]
    doubt = (SAFETY - 1.0) * slope + start
    errors = np.maximum.accumulate(errors)
    return replace(law, errors=errors, signed=signed, used=law.theory, safety=SAFETY, doubt=doubt)


def hidden(law: ErrorModel, spread: float) -> ErrorModel:
    """The law of a knob whose effect is within the sampling noise of the levels: at the coarsest no more than that."""
    errors = spread * (law.sizes / law.sizes[-1]) ** law.theory
    doubt = spread * (law.here / float(law.sizes[-1])) ** law.theory
    return replace(law, errors=errors, signed=np.zeros_like(law.signed), used=law.theory, safety=1.0, doubt=doubt)


def _slope(x: NDArray, y: NDArray) -> float:
    return float(np.polyfit(x, y, 1)[0])


def weights(laws: Sequence[ErrorModel]) -> dict[str, float]:
    """c/p of each knob that has an effect; the share of the budget is this over their sum."""
    return {law.name: max(law.cost, law.least_cost) / law.used for law in laws if not law.idle}


def cheapest(laws: Sequence[ErrorModel], budget: float, most: Mapping[str, float]) -> dict[str, float]:
    """Sizes of least cost with the sum of the bounds within the budget: each gets the share (c/p) / sum(c/p).

    Lagrange's condition for cost prod s^-c and error sum A s^p. `most`: sizes not to exceed, such as 0.8 of a limit
    of stability; what a knob cannot use goes to the others.
    """
    fixed: dict[str, float] = {}
    shares = weights(laws)
    while True:
        free = [law for law in laws if law.name not in fixed]
        left = budget - sum(law.bound(fixed[law.name]) for law in laws if law.name in fixed)
        total = sum(shares.get(law.name, 0.0) for law in free) or 1.0
        sizes = {law.name: law.size(left * shares.get(law.name, 0.0) / total) for law in free}
        held = {
            law.name: cap
            for law in free
            if sizes[law.name] >= (cap := min(most.get(law.name, math.inf), EXTRAPOLATION * float(law.sizes[-1])))
        }
        if not held:
            return {law.name: fixed.get(law.name) or sizes[law.name] for law in laws}
        fixed |= held


def relative_cost(laws: Sequence[ErrorModel], sizes: Mapping[str, float]) -> float:
    """Cost of a run with these sizes, in units of that of the case itself."""
    factors = [(sizes[law.name] / law.here, law) for law in laws]
    return math.prod(f ** -(law.cost if f > 1.0 else max(law.cost, law.least_cost)) for f, law in factors)


def slope(laws: Sequence[ErrorModel]) -> float:
    """Theory's exponent of cost ~ error^-slope along the front: the sum of c/p."""
    return sum(law.cost / law.used for law in laws if not law.idle)
