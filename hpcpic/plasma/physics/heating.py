"""How fast the grid heats a plasma: rates measured with this scheme (see shapes), and what they make of a run.

A plasma whose Debye length the grid does not resolve gains energy: by the noise of the particles, at a rate that falls
as one over their number per cell, and by the aliases of a cold plasma, at one that does not (Birdsall & Langdon,
chapter 8). The Debye length grows with the energy, as its root, and the rate falls as it does.
"""

import itertools
import math

from hpcpic.plasma.physics.shapes import Shape

MIN_PER_CELL = 8.0  # particles; with 4 the field of a random start has too much of the energy for the rates to hold
LOG_STEP = 0.01  # in ln(lambda_D/dx)
MAX_DEBYE = 1e3  # Debye lengths per spacing: nothing heats any more


def rate(shape: Shape, x: float, per_cell: float) -> float:
    """d ln W/d(wp t) at ln(lambda_D/dx) = x: powers between the measured points, below them the rate of the first."""
    points = shape.heating
    x = max(x, math.log(points[0].debye))
    low, high = next((p for p in itertools.pairwise(points) if x <= math.log(p[1].debye)), points[-2:])
    share = (x - math.log(low.debye)) / math.log(high.debye / low.debye)
    noise = low.noise * (high.noise / low.noise) ** share
    return noise / per_cell + low.aliases * (high.aliases / low.aliases) ** share


def energy_ratio(shape: Shape, debye: float, per_cell: float, time: float) -> float:
    """W(time)/W(0) of a plasma with debye = lambda_D/dx at the start; time in 1/wp."""
    first = x = math.log(debye)
    constant = math.log(shape.heating[0].debye)
    while time > 0 and x < math.log(MAX_DEBYE):
        step = constant - x if x < constant - LOG_STEP else LOG_STEP
        needed = 2 * step / rate(shape, x + 0.5 * step, per_cell)
        x += step * min(1.0, time / needed)
        time -= needed
    return math.exp(min(2 * (x - first), 700.0))
