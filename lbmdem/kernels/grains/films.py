"""Films between grains: their resistances, eight pairs at a time, and how fast they damp (see physics.lubrication)."""

import numpy as np

from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.scratch import empty
from hpcpic.core.simd.vector import Vec, fma, maximum, minimum, splat, sqrt
from lbmdem.physics.lubrication import (
    PUMPED,
    ROUGHNESS,
    SHEAR_CUT_OFF,
    STABLE,
    shear_mobility,
    sheared_discs,
    sheared_spheres,
    squeeze_resistance,
)

F = Vec(8, np.float64)
DISCS, SPHERES = PUMPED[2], PUMPED[3]


@njit
def resistance(gap, radius, inverse_mass, film, dt):
    """Force over closing velocity of the fluid film in a gap below the cut-off.

    Never so large that films all round a grain would overshoot in a step; `fastest` tells the step that needs no limit.
    """
    return minimum(squeeze_resistance(film, gap, radius), STABLE / (inverse_mass * dt))


@njit
def pumped(film):
    """c: resistance to the sum of both surfaces' velocities, over that to their difference."""
    return DISCS if film.dimensions == 2 else SPHERES


@njit
def shear_resistance(gap, radius, d, inverse_mass, turning, film, dt):
    """Force over velocity of sliding of a film below its own cut-off, while grains touch that of the least gap; radius:
    the reduced one; d, turning: see `shear_mobility`."""
    h = maximum(gap, radius * ROUGHNESS)
    if film.dimensions == 2:
        found = sheared_discs(film, h, radius)
    else:
        found = sheared_spheres(film, radius, logarithm(SHEAR_CUT_OFF * film.cut_off / h))
    found = minimum(found, STABLE / (shear_mobility(pumped(film), d, inverse_mass, turning) * dt))
    return maximum(found, splat(F, 0.0))


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
def fastest(contacts, n_slots, n_grain_slots, rows, walls, box, film, time):
    """The greatest resistance x mobility (1/s) of all films, at the least gaps that they come to within `time` if
    nothing slows the grains down. Rows of padding are NaN, which no comparison lets through.
    """
    most, d = 0.0, empty(3, np.float64)
    for slot in range(n_slots):
        a, other = rows[contacts.low[slot]], contacts.high[slot]
        pair = slot < n_grain_slots
        b = rows[other] if pair else walls[other]
        distance, opening = 0.0, 0.0
        if pair:
            for c in range(3):
                d[c] = b[c] - a[c]
                d[c] -= box.lengths[c] * np.rint(d[c] * box.inverses[c])
                distance += d[c] * d[c]
            distance = np.sqrt(distance)
            gap = distance - a[3] - b[3]
        elif b[3] == 1.0:  # a plane without films
            continue
        else:
            for c in range(3):
                distance += (a[c] - b[c]) * b[8 + c]
            gap = distance - a[3]
        for c in range(3):
            opening += (b[4 + c] - a[4 + c]) * (d[c] / distance if pair else -b[8 + c])
        later = gap + opening * time
        if not min(gap, later) < film.cut_off:
            continue
        radius, differ, inverse, turning = a[3], 1.0, a[7], a[3] * a[3] * a[11]
        if pair:
            radius, differ = a[3] * b[3] / (a[3] + b[3]), (b[3] - a[3]) / (a[3] + b[3])
            inverse, turning = inverse + b[7], turning + b[3] * b[3] * b[11]
        h = max(min(gap, later), radius * ROUGHNESS)
        if film.dimensions == 2:
            shear = sheared_discs(film, h, radius)
        else:
            shear = sheared_spheres(film, radius, np.log(SHEAR_CUT_OFF * film.cut_off / h))
        touch = max(gap, later) < 0.0  # all the time
        squeezing = 0.0 if touch else squeeze_resistance(film, h, radius)
        most = max(most, max(squeezing * inverse, shear * shear_mobility(pumped(film), differ, inverse, turning)))
    return most
