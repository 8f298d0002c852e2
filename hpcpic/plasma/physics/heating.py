"""How fast the grid heats a plasma: rates measured with this scheme, and what they make of a run.

A plasma whose Debye length the grid does not resolve gains energy: by the noise of the particles, at a rate that falls
as one over their number per cell, and by the aliases of a cold plasma, at one that does not (Birdsall & Langdon,
chapter 8). The Debye length grows with the energy, as its root, and the rate falls as it does. Particles that cross
much of a short wave in a step are heated by it whatever their Debye length.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hpcpic.plasma.physics.shapes import SHAPES

MIN_PER_CELL = 1.0  # particles: with 1, 2 and 4 of them runs gain 0.5 to 1.3 of what is told, from lambda_D = dx/2 on
LOG_STEP = 0.01  # in ln(lambda_D/dx)
LN_STEP = 1.0  # of the integral over all waves, which it gives within 4e-3
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
# is to be counted to the Debye length that a run starts with; then growth above 2 % is given within 40 %, of NGP at
# 0.3 dx with 4096 per cell twice too much.
HEATING = {
    ("NGP", 1): (Heating(0.03, 0.87, 0.94), Heating(0.1, 0.84, 0.32), Heating(0.3, 0.51, 6.7e-4),
                 Heating(0.5, 0.17, 1.3e-8), Heating(0.7, 4.7e-2, 4e-9), Heating(1.0, 1.7e-2, 1e-9)),
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


# With spectral gradients these rates times so much: growth from lambda_D = 0.1 to 1 dx within a factor of two, 12 to 64
# points an axis, 8 to 1024 particles per cell, until wp t = 400 (1D: 800).
SPECTRAL = {("NGP", 1): 2.2, ("CIC", 1): 2.8, ("TSC", 1): 7.0, ("NGP", 2): 2.5, ("CIC", 2): 2.0, ("TSC", 2): 1.3,
            ("NGP", 3): 2.5, ("CIC", 3): 1.4, ("TSC", 3): 0.6}  # fmt: skip

# Across a magnetic field waves with k.B = 0 are not damped: their aliases heat at a rate that no number of particles
# changes. In 2D with B out of the plane, by shape and wc/wp: d ln W/d(wp t) at each lambda_D/dx of ACROSS_DEBYE,
# above that of B = 0. 32 x 32 points, 32 particles per cell, until wp t = 200 (scripts/heating.py across CIC).
ACROSS_DEBYE = (0.1, 0.2, 0.3, 0.5, 1.0, 2.0)
ACROSS = {
    "NGP": {
        0.25: (0.013, 0.0088, 0.0044, 0.00034, 1.1e-05, 3.9e-07),
        0.5: (0.009, 0.011, 0.0071, 0.0005, 2.4e-05, 1.5e-06),
        1.0: (0.0081, 0.026, 0.029, 0.0029, 0.00022, 3.9e-05),
        2.0: (1, 0.51, 0.18, 0.028, 0.0012, 0.00015),
        4.0: (1, 1, 0.7, 0.18, 0.0096, 0.00049),
        8.0: (1, 0.44, 0.18, 0.062, 0.013, 0.0011),
    },
    "CIC": {
        0.25: (0.0038, 0.00075, 8.4e-05, 7.9e-06, 8.6e-07, 1e-07),
        0.5: (0.013, 0.0064, 0.00083, 7.8e-05, 6.2e-06, 4.4e-07),
        1.0: (0.018, 0.013, 0.0075, 0.00099, 6.4e-05, 2.9e-06),
        2.0: (0.0086, 0.015, 0.0087, 0.004, 0.00034, 2.4e-05),
        4.0: (0.0065, 0.0058, 0.0047, 0.0035, 0.00097, 0.0001),
        8.0: (0.00018, 0.0013, 0.0012, 0.0011, 0.00065, 0.00016),
    },
    "TSC": {
        0.25: (0.003, 0.00026, 3.9e-05, 4.3e-06, 6.1e-07, 1e-07),
        0.5: (0.016, 0.0031, 0.00052, 6.3e-05, 8e-06, 1e-06),
        1.0: (0.013, 0.0085, 0.0038, 0.00056, 3.6e-05, 2e-06),
        2.0: (0.011, 0.0049, 0.0034, 0.0017, 0.00017, 1.3e-05),
        4.0: (0.0038, 0.002, 0.0014, 0.00087, 0.00033, 5.1e-05),
        8.0: (0.00075, 0.00047, 0.00034, 0.00027, 0.00018, 6.4e-05),
    },
}  # fmt: skip
ACROSS_SPECTRAL = {"NGP": 1.0, "CIC": 0.3, "TSC": 0.03}  # of that with spectral gradients, wc = 0.5 to 8 wp
ONSET = 60.0  # wp t: the energy grows as the square of time at first
SHARE_3D = 0.5  # of the rates of 2D, as runs on 16 x 16 x 16 points until wp t = 1600 have them
LEAST_CROSSED = 0.1  # spacings in a step at the thermal velocity, below which exp(-s^2/4) is nothing for any wave
ZONE = {1: 128, 2: 32, 3: 16}  # waves along an axis by number of axes, for the integral over the waves of a grid


def rates_of(shape: str, axes: int, spectral: bool) -> list[Heating]:
    """Rates of a scheme by rising lambda_D/dx."""
    times = SPECTRAL[shape, axes] if spectral else 1.0
    return [Heating(p.debye, times * p.noise, times * p.aliases) for p in HEATING[shape, axes]]


def rate_of_step(shape: str, axes: int, debye: float, step: float, spectral: bool = False) -> float:
    """d ln W/d(wp t) times the particles per cell that a step of wp dt = step adds where particles cross much of the
    short waves in it; debye: lambda_D/dx.

    Two particles deflect each other where k.(v - v') dt is a whole number of turns. Without a turn that costs no
    energy, the others heat (Birdsall & Langdon, chapter 12; Langdon 1979, Phys. Fluids 22, 163). In units of dx and
    wp, for a Maxwellian and waves that are too short to be shielded,

        rate = pi/(axes lambda_D^3) times the integral over k in the zone of the grid of

            F^2/k sum over p != 0 of s^2 exp(-s^2/4)/(2 sqrt(pi)),  s = 2 pi p/y,  y = k lambda_D wp dt,

    over (2 pi)^axes, F the force of a wave on the grid for the charge of one. The sum is y/pi for large y.
    """
    if debye * step < LEAST_CROSSED or debye > MAX_DEBYE:
        return 0.0
    share = (np.arange(ZONE[axes]) + 0.5) / ZONE[axes]
    waves = np.stack(np.meshgrid(*[math.pi * share**2] * axes))  # denser where they are long
    weights = np.prod(np.meshgrid(*[2 * share] * axes), axis=0)
    k = np.sqrt((waves**2).sum(axis=0))
    smooth = np.prod(np.sinc(waves / (2 * math.pi)), axis=0) ** (2 * SHAPES[shape].nodes)
    turned = (waves * np.sin(waves)).sum(axis=0) / (4 * np.sin(waves / 2) ** 2).sum(axis=0)
    force = smooth / k if spectral else smooth / k * turned
    y, p = k * (debye * step), np.arange(1, 5).reshape(-1, *[1] * axes)
    s_sq, swing_sq = (2 * math.pi * p / y) ** 2, np.minimum(p * y, 30.0) ** 2
    few_turns = (s_sq * np.exp(-s_sq / 4)).sum(axis=0) / math.sqrt(math.pi)
    few_steps = y / math.pi * (1 + 2 * ((1 - 2 * swing_sq) * np.exp(-swing_sq)).sum(axis=0))  # Poisson's sum of it
    mean = float(np.mean(weights * force**2 / k * np.where(y < 2, few_turns, few_steps)))
    return math.pi / (axes * debye**3) * mean


def field_of_random_places(shape: str, points: Sequence[int], spacing: Sequence[float], debye: float) -> float:
    """The sum over the waves of a grid, m^2, that is N q^2/(2 eps0 V) times the field energy which N random places have
    more than a plasma of this Debye length, m, keeps: in it a wave has (k lambda_D)^2/(1 + (k lambda_D)^2) of theirs.

    The sum of M/(K^2 (1 + (K lambda_D)^2)) is the integral over s of 1 - exp(-s/lambda_D^2) times that of
    M exp(-K^2 s), a product of sums along the axes.
    """
    cell, angles = min(spacing), [2 * np.pi * np.fft.fftfreq(n) for n in points]
    smooth = [SHAPES[shape].of_random_places(angle) for angle in angles]
    squares = [(2 * cell / dx * np.sin(0.5 * angle)) ** 2 for angle, dx in zip(angles, spacing)]
    s = np.exp(np.arange(math.log(1e-4), math.log(20 / min(square[1] for square in squares)), LN_STEP))
    all_waves = np.array([math.prod(m @ np.exp(-square * one) for m, square in zip(smooth, squares)) for one in s])
    left = -np.expm1(-s * (cell / debye) ** 2) if debye else 1.0
    return cell * cell * LN_STEP * float(np.sum(s * left * (all_waves - 1.0)))


def power(x: float, debye: Sequence[float], values: Sequence[float]) -> float:
    """A value at ln(lambda_D/dx) = x: powers between the points of rising lambda_D/dx and on, below them the first."""
    last = len(debye) - 1
    high = next((i for i in range(1, last) if x <= math.log(debye[i])), last)
    low = math.log(debye[high - 1])
    share = max(0.0, x - low) / (math.log(debye[high]) - low)
    return values[high - 1] * (values[high] / values[high - 1]) ** share


def rate(
    points: Sequence[Heating], x: float, per_cell: float, across: Sequence[float] = (), of_step: float = 0.0
) -> float:
    """d ln W/d(wp t) at ln(lambda_D/dx) = x; across: what a magnetic field adds at each of ACROSS_DEBYE; of_step:
    rate_of_step.
    """
    debye = [p.debye for p in points]
    noise = power(x, debye, [p.noise for p in points]) + of_step
    plain = noise / per_cell + power(x, debye, [p.aliases for p in points])
    return plain + (power(x, ACROSS_DEBYE, across) if across else 0.0)


def rates_across(shape: str, axes: int, turn: float, time: float, spectral: bool = False) -> list[float]:
    """What a magnetic field across the grid adds to the rate on 2 or 3 axes in a run of wp t = time, at each of
    ACROSS_DEBYE: none below the smallest turn = wc/wp that was measured, beyond the largest what that has. Within a
    factor of two in 2D, four in 3D.
    """
    turns = list(ACROSS[shape])
    if turn < turns[0]:
        return []
    share = (SHARE_3D if axes == 3 else 1.0) * time / (time + ONSET) * (ACROSS_SPECTRAL[shape] if spectral else 1.0)
    return [share * power(math.log(min(turn, turns[-1])), turns, column) for column in zip(*ACROSS[shape].values())]


def energy_ratio(
    points: Sequence[Heating],
    debye: float,
    per_cell: float,
    time: float,
    across: Sequence[float] = (),
    of_step: float = 0.0,
) -> float:
    """W(time)/W(0) of a plasma with debye = lambda_D/dx at the start; time in 1/wp; across, of_step: see `rate`."""
    first = x = math.log(debye)
    constant = math.log(min(points[0].debye, ACROSS_DEBYE[0]) if across else points[0].debye)
    while time > 0 and x < math.log(MAX_DEBYE):
        step = constant - x if x < constant - LOG_STEP else LOG_STEP
        needed = 2 * step / rate(points, x + 0.5 * step, per_cell, across, of_step)
        x += step * min(1.0, time / needed)
        time -= needed
    return math.exp(min(2 * (x - first), 700.0))
