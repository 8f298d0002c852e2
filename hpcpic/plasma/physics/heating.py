"""How fast the grid heats a plasma: rates measured with this scheme, and what they make of a run.

A plasma whose Debye length the grid does not resolve gains energy: by the noise of the particles, at a rate that falls
as one over their number per cell, and by the aliases of a cold plasma, at one that does not (Birdsall & Langdon,
chapter 8). The Debye length grows with the energy, as its root, and the rate falls as it does.
"""

import itertools
import math

# Per shape (lambda_D/dx, particles per cell times the rate of the noise, rate of the aliases), rates in d ln W/d(wp t).
# 2D, centred differences, wp dt = 0.2, random starts, on 64 x 64 and 32 x 32 points: fitted to the energies after
# wp t = 875 with 16 and 64 particles per cell, of CIC at 0.3 and TSC at 1.0 also later, which they give within 8 %.
RATES = {
    "CIC": (
        (0.03, 4.3e-4, 1.4e-3),
        (0.1, 1.0e-2, 2.8e-3),
        (0.3, 8.6e-3, 6.6e-5),
        (0.5, 3.4e-3, 8e-7),
        (0.7, 8.9e-4, 1e-7),
        (1.0, 5.0e-4, 4e-8),
    ),
    "TSC": (
        (0.03, 3.2e-3, 3.9e-4),
        (0.1, 5.1e-3, 1.8e-4),
        (0.3, 1.9e-3, 5e-6),
        (0.5, 6.5e-4, 8e-7),
        (1.0, 1.1e-4, 4e-8),
    ),
}
FEWEST = 8.0  # particles per cell; with 4 the field of a random start has too much of the energy for the rates to hold
FINE = 0.01  # step in ln(lambda_D/dx)
HOTTEST = 1e3  # Debye lengths per spacing: nothing heats any more


def rate(shape: str, x: float, per_cell: float) -> float:
    """d ln W/d(wp t) at ln(lambda_D/dx) = x: between the measured points by powers, below them as at the first."""
    points = RATES[shape]
    x = max(x, math.log(points[0][0]))
    low, high = next((p for p in itertools.pairwise(points) if x <= math.log(p[1][0])), points[-2:])
    share = (x - math.log(low[0])) / math.log(high[0] / low[0])
    noise, aliases = (a * (b / a) ** share for a, b in zip(low[1:], high[1:]))
    return noise / per_cell + aliases


def energy_ratio(shape: str, debye: float, per_cell: float, time: float) -> float:
    """W(time)/W(0) of a plasma with debye = lambda_D/dx at the start; time in 1/wp."""
    first = x = math.log(debye)
    constant = math.log(RATES[shape][0][0])
    while time > 0 and x < math.log(HOTTEST):
        step = constant - x if x < constant - FINE else FINE
        needed = 2 * step / rate(shape, x + 0.5 * step, per_cell)
        x += step * min(1.0, time / needed)
        time -= needed
    return math.exp(min(2 * (x - first), 700.0))
