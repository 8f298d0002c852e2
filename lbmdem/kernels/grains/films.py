"""Films between grains: their resistances, eight pairs at a time, and how fast they damp (see lbmdem.lubrication).

law[5..7]: cut-off gap, factor of the resistance, 1 for discs.
"""

import numpy as np

from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.vector import Vec, fma, maximum, minimum, select, splat, sqrt
from lbmdem.physics.lubrication import GROWTH, RESOLVED, ROUGHNESS, SHEAR_CUT_OFF, STABLE

F = Vec(8, np.float64)


@njit
def resistance(gap, radius, inverse_mass, law, dt):
    """Force over closing velocity of the fluid film in a gap below the cut-off.

    Never so large that films all round a grain would overshoot in a step; `fastest` tells the step that needs no limit.
    """
    cut, factor, planar = law[5], law[6], law[7]
    h = maximum(gap, radius * ROUGHNESS)
    if planar > 0.0:
        near, far = radius / h, radius / splat(F, cut)
        film = (near * sqrt(near) - far * sqrt(far)) * factor
    else:
        film = radius * radius * factor * (1.0 / h - minimum(RESOLVED + GROWTH / cut * h, splat(F, 1.0)) / cut)
    film = minimum(film, STABLE / (inverse_mass * dt))
    return select((gap >= 0.0) & (film > 0.0), film, splat(F, 0.0))


@njit
def shear_resistance(gap, radius, size, mobility, law, dt):
    """Force over velocity of sliding of a film below its own cut-off; radius: reduced; 0 between discs."""
    cut = SHEAR_CUT_OFF * law[5]
    if law[7] > 0.0:
        return splat(F, 0.0)
    film = size * (4.0 / 15.0 * law[6]) * logarithm(cut / maximum(gap, radius * ROUGHNESS))
    film = minimum(film, STABLE / (mobility * dt))
    return select((gap >= 0.0) & (film > 0.0), film, splat(F, 0.0))


@njit
def logarithm(x):
    """ln x to 1e-8 for 1 <= x <= 1000, below 0 for less: sixteen times that of the 16th root, by its odd series."""
    root = sqrt(sqrt(sqrt(sqrt(x))))
    t = (root - 1.0) / (root + 1.0)
    s = t * t
    series = splat(F, 1.0 / 9.0)
    for term in (1.0 / 7.0, 1.0 / 5.0, 1.0 / 3.0, 1.0):
        series = fma(s, series, splat(F, term))
    return 32.0 * t * series


@njit
def fastest(low, high, n_grain_slots, rows, walls, lengths, inverses, law, time):
    """The greatest resistance x mobility (1/s) of all films, at the least gaps that they come to within `time` if
    nothing slows the grains down. Slots as in kernels.contacts; rows of padding are NaN, which no comparison lets
    through."""
    most, d = 0.0, np.empty(3)
    for slot in range(low.size):
        a, other = rows[low[slot]], high[slot]
        pair = slot < n_grain_slots
        b = rows[other] if pair else walls[other]
        distance, opening = 0.0, 0.0
        if pair:
            for c in range(3):
                d[c] = b[c] - a[c]
                d[c] -= lengths[c] * np.rint(d[c] * inverses[c])
                distance += d[c] * d[c]
            distance = np.sqrt(distance)
            gap = distance - a[3] - b[3]
        else:
            for c in range(3):
                distance += (a[c] - b[c]) * b[8 + c]
            gap = distance - a[3]
        for c in range(3):
            opening += (b[4 + c] - a[4 + c]) * (d[c] / distance if pair else -b[8 + c])
        later = gap + opening * time
        if max(gap, later) < 0.0 or not min(gap, later) < law[5]:
            continue
        radius, size, inverse, turning = a[3], 2.0 * a[3], a[7], a[3] * a[3] * a[11]
        if pair:
            radius = a[3] * b[3] / (a[3] + b[3])
            size = 2.0 * radius * (1.0 - 1.5 * radius / (a[3] + b[3]))
            inverse, turning = inverse + b[7], turning + b[3] * b[3] * b[11]
        h = max(min(gap, later), radius * ROUGHNESS)
        if law[7] > 0.0:
            film, shear = law[6] * ((radius / h) ** 1.5 - (radius / law[5]) ** 1.5), 0.0
        else:
            film = law[6] * radius * radius * (1.0 / h - min(RESOLVED + GROWTH / law[5] * h, 1.0) / law[5])
            shear = 4.0 / 15.0 * law[6] * size * np.log(SHEAR_CUT_OFF * law[5] / h)
        most = max(most, film * inverse, shear * (inverse + turning))
    return most
