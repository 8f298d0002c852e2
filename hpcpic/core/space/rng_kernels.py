"""The compiled loops of core.space.rng."""

import math

import numpy as np

from hpcpic.core.simd.compile import njit

LOW = np.uint64(0xFFFFFFFF)
HALF, SPLIT = np.uint64(32), np.uint64(6)
FIRST, SECOND = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
STEP_0, STEP_1 = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
ROUNDS = 10


@njit
def philox(c0, c1, c2, c3, k0, k1):
    """Philox4x32-10 of one counter; all words 32 bits in uint64."""
    for _ in range(ROUNDS):
        product_0, product_1 = FIRST * c0, SECOND * c2
        c0, c1 = (product_1 >> HALF) ^ c1 ^ k0, product_1 & LOW
        c2, c3 = (product_0 >> HALF) ^ c3 ^ k1, product_0 & LOW
        k0, k1 = (k0 + STEP_0) & LOW, (k1 + STEP_1) & LOW
    return c0, c1, c2, c3


@njit
def open_unit(high, low):
    """An odd multiple of 2^-53 from the upper 26 bits of two words."""
    bits = ((high >> SPLIT) << np.uint64(27)) + ((low >> SPLIT) << np.uint64(1)) + np.uint64(1)
    return np.int64(bits) * 2.0**-53


@njit
def uniforms(ids, stream, k0, k1, result):
    """result[k, draws] in (0, 1) for ids[k]."""
    for k in range(ids.size):
        word = np.uint64(ids[k])
        for draw in range(0, result.shape[1], 2):
            words = philox(word & LOW, word >> HALF, np.uint64(draw // 2), np.uint64(stream), k0, k1)
            result[k, draw] = open_unit(words[0], words[1])
            if draw + 1 < result.shape[1]:
                result[k, draw + 1] = open_unit(words[2], words[3])


@njit
def polynomial(c, r):
    total = c[7]
    for k in range(6, -1, -1):
        total = total * r + c[k]
    return total


@njit
def central(u, x, above, below):
    """x[n] where |u[n] - 1/2| <= 0.425; elsewhere no quantiles."""
    for k in range(u.size):
        q = u[k] - 0.5
        r = 0.180625 - q * q
        x[k] = q * (polynomial(above, r) / polynomial(below, r))


@njit
def tails(u, x, above, below, far_above, far_below):
    """x[n] where |u[n] - 1/2| > 0.425."""
    for k in range(u.size):
        q = u[k] - 0.5
        if abs(q) > 0.425:
            r = math.sqrt(-math.log(min(u[k], 1.0 - u[k])))
            if r <= 5.0:
                magnitude = polynomial(above, r - 1.6) / polynomial(below, r - 1.6)
            else:
                magnitude = polynomial(far_above, r - 5.0) / polynomial(far_below, r - 5.0)
            x[k] = math.copysign(magnitude, q)
