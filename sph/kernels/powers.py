"""((1 + e)^n - 1) / n of a vector: pressures and energies of the equation of state (MP 14)."""

import numpy as np

from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.scratch import empty
from hpcpic.core.simd.vector import Vec, lanes, load, splat, store

N = lanes(np.float64)
F = Vec(N, np.float64)


@njit
def power(e, n, coefficients):
    """The polynomial with these coefficients (see physics.equation_of_state); without any, number by number."""
    found = splat(F, 0.0)
    for k in range(coefficients.size - 1, -1, -1):
        found = e * (found + coefficients[k])
    if coefficients.size > 0:
        return found
    line = empty(N, np.float64)
    store(line, 0, e)
    for k in range(N):
        stretch = np.log1p(line[k])
        line[k] = np.expm1(n * stretch) / n if n != 0.0 else stretch
    return load(F, line, 0)
