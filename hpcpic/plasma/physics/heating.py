"""How fast the grid heats a plasma: rates measured with this scheme, and what they make of a run.

A plasma whose Debye length the grid does not resolve gains energy: by the noise of the particles, at a rate that falls
as one over their number per cell, and by the aliases of a cold plasma, at one that does not (Birdsall & Langdon,
chapter 8). The Debye length grows with the energy, as its root, and the rate falls as it does.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

MIN_PER_CELL = 8.0  # particles; with 4 the field of a random start has too much of the energy for the rates to hold
LOG_STEP = 0.01  # in ln(lambda_D/dx)
MAX_DEBYE = 1e3  # Debye lengths per spacing: nothing heats any more


@dataclass(frozen=True, slots=True)
class Heating:
    """Rates at which the grid heats a plasma of Debye length lambda_D, in d ln W / d(wp t).

    debye: lambda_D/dx. noise: rate of the particles' noise times their number per cell. aliases: rate of the aliases.
    """

    debye: float
    noise: float
    aliases: float


# By shape and dimensions, by rising lambda_D/dx: centred differences, wp dt = 0.2, random starts, 16 and 64 particles
# per cell until wp t = 875 (scripts/heating.py), whose growth they give within 8 %, that of NGP within 22 %. Those of
# CIC and TSC in 2D are also fitted to longer runs, of CIC at 0.3 and TSC at 1.0.
# 1D: 64 and 256 points, 16 to 12288 per cell, up to three seeds. There the field of a random start, which becomes heat,
# is to be counted to the Debye length that a run starts with; then growth above 2 % is given within 40 %.
HEATING = {
    ("CIC", 1): (Heating(0.08, 20.0, 3.3e-2), Heating(0.1, 0.64, 3.2e-5), Heating(0.2, 7.2e-2, 7e-9),
                 Heating(0.3, 2.2e-2, 1e-9), Heating(0.5, 4.0e-3, 1e-9), Heating(0.7, 1.6e-3, 1e-9),
                 Heating(1.0, 5.4e-4, 1e-9)),
    ("TSC", 1): (Heating(0.04, 6.8e-2, 1.1e-4), Heating(0.06, 0.58, 6.3e-5), Heating(0.1, 5.7e-2, 1.4e-8),
                 Heating(0.2, 3.1e-3, 1e-9), Heating(0.3, 8.8e-4, 1e-9), Heating(0.5, 1.9e-4, 1e-9),
                 Heating(1.0, 1e-7, 1e-9)),
    ("NGP", 2): (Heating(0.03, 2.3e-6, 5.7e-3), Heating(0.1, 1.2e-4, 3.4e-3), Heating(0.3, 6.0e-3, 5.1e-3),
                 Heating(0.5, 3.9e-2, 3.3e-4), Heating(0.7, 1.9e-2, 1.9e-5), Heating(1.0, 7.7e-3, 4.5e-6)),
    ("CIC", 2): (Heating(0.03, 4.3e-4, 1.4e-3), Heating(0.1, 1.0e-2, 2.8e-3), Heating(0.3, 8.6e-3, 6.6e-5),
                 Heating(0.5, 3.4e-3, 8e-7), Heating(0.7, 8.9e-4, 1e-7), Heating(1.0, 5.0e-4, 4e-8)),
    ("TSC", 2): (Heating(0.03, 3.2e-3, 3.9e-4), Heating(0.1, 5.1e-3, 1.8e-4), Heating(0.3, 1.9e-3, 5e-6),
                 Heating(0.5, 6.5e-4, 8e-7), Heating(1.0, 1.1e-4, 4e-8)),
    ("NGP", 3): (Heating(0.03, 1.1e-4, 1.7e-3), Heating(0.1, 1.2e-3, 1.3e-2), Heating(0.3, 2.7e-2, 3.5e-3),
                 Heating(0.5, 2.8e-2, 4.7e-5), Heating(0.7, 1.1e-2, 3.7e-7), Heating(1.0, 4.2e-3, 2.0e-9)),
    ("CIC", 3): (Heating(0.03, 5.6e-3, 2.2e-3), Heating(0.1, 5.1e-2, 1.3e-3), Heating(0.3, 5.7e-3, 1.3e-5),
                 Heating(0.5, 1.7e-3, 3.4e-7), Heating(0.7, 6.7e-4, 1.6e-8), Heating(1.0, 2.2e-4, 1.1e-9)),
    ("TSC", 3): (Heating(0.03, 1.8e-2, 4.5e-4), Heating(0.1, 8.8e-3, 4.2e-5), Heating(0.3, 1.2e-3, 6.8e-7),
                 Heating(0.5, 3.7e-4, 1.7e-8), Heating(1.0, 5.6e-5, 2.2e-9)),
}  # fmt: skip


def rate(points: Sequence[Heating], x: float, per_cell: float) -> float:
    """d ln W/d(wp t) at ln(lambda_D/dx) = x: powers between the measured points, below them the rate of the first."""
    x = max(x, math.log(points[0].debye))
    low, high = next((p for p in itertools.pairwise(points) if x <= math.log(p[1].debye)), points[-2:])
    share = (x - math.log(low.debye)) / math.log(high.debye / low.debye)
    noise = low.noise * (high.noise / low.noise) ** share
    return noise / per_cell + low.aliases * (high.aliases / low.aliases) ** share


def energy_ratio(points: Sequence[Heating], debye: float, per_cell: float, time: float) -> float:
    """W(time)/W(0) of a plasma with debye = lambda_D/dx at the start; time in 1/wp."""
    first = x = math.log(debye)
    constant = math.log(points[0].debye)
    while time > 0 and x < math.log(MAX_DEBYE):
        step = constant - x if x < constant - LOG_STEP else LOG_STEP
        needed = 2 * step / rate(points, x + 0.5 * step, per_cell)
        x += step * min(1.0, time / needed)
        time -= needed
    return math.exp(min(2 * (x - first), 700.0))
