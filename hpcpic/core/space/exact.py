"""Sums of float64 whose bits do not depend on the order: integers are added, not floats.

A term x with |x| <= scale (a power of two) is split into three limbs,
x = scale (h 2^-31 + m 2^-63 + l 2^-95), integers of magnitude <= 2^31, each rounded to the nearest.
Up to 2^31 terms cannot overflow int64. A term is off by 2^-96 scale at most, so the sum of so many by less
than 2^-64 of the sum of magnitudes, when the largest magnitude is above scale / 2.
"""

import math

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.simd.compile import njit

LIMBS = 3
_FIRST, _NEXT = 2.0**31, 2.0**32
_LEAST_EXPONENT = -900  # 1 / scale and what it multiplies stay normal numbers
NOT_BOUNDED = 1  # code: a term is larger than the scale, or not a number


def power_of_two_above(magnitude: float) -> float:
    """The scale for terms up to `magnitude`: a power of two above it."""
    if not magnitude < 2.0**1023:
        raise OverflowError(f"no sum of terms up to {magnitude}")
    return math.ldexp(1.0, max(math.frexp(magnitude)[1], _LEAST_EXPONENT))


def exact_limbs(values: NDArray[np.float64], scale: float) -> NDArray[np.int64]:
    """Limbs int64[3] of the sum of all values. Add the limbs of parts to get those of the whole."""
    t = np.ravel(values) * (1.0 / scale)
    if not np.all(np.abs(t) <= 1.0):
        raise OverflowError(f"a term of the sum is larger than {scale}, or not a number")
    limbs = np.zeros(LIMBS, np.int64)
    t *= _FIRST
    for limb in range(LIMBS):
        whole = np.rint(t)
        limbs[limb] = np.sum(whole.astype(np.int64))
        t = (t - whole) * _NEXT
    return limbs


@njit
def add_limbs(limbs, values, inv_scale):
    """limbs[3] += those of values[n]; for tasks. Returns NOT_BOUNDED if a term is out of range."""
    high, middle, low = np.int64(0), np.int64(0), np.int64(0)
    bad = False
    for x in values:
        t = x * inv_scale
        bad |= not abs(t) <= 1.0
        t *= _FIRST
        h = np.rint(t)
        t = (t - h) * _NEXT
        m = np.rint(t)
        high += np.int64(h)
        middle += np.int64(m)
        low += np.int64(np.rint((t - m) * _NEXT))
    limbs[0] += high
    limbs[1] += middle
    limbs[2] += low
    return NOT_BOUNDED if bad else 0


def value(limbs: NDArray[np.int64], scale: float) -> float:
    """The sum that the limbs stand for, rounded once."""
    high, middle, low = (int(limb) for limb in limbs)
    return math.ldexp((high << 64) + (middle << 32) + low, -95) * scale
