"""A formula that stands once, in Python, in numpy, and compiled for numbers and for vectors."""

import types

import numpy as np

from hpcpic.core.simd.compile import formulas, njit
from hpcpic.core.simd.formulas import fma, maximum, minimum, select, sqrt
from hpcpic.core.simd.vector import Vec, load, store

F = Vec(4, np.float64)


def half(x):
    return 0.5 * x


def bent(x, a):
    """The root of a x / 2 + 1 below 1/2, else of its half, from 0.6 to 1.25."""
    line = fma(a, half(x), 1.0)
    return sqrt(maximum(minimum(select(x < 0.5, line, half(line)), 1.25), 0.6))


module = types.ModuleType(__name__)
module.half, module.bent = half, bent
formulas(module)


@njit(cache=False)
def number(x, a):
    return bent(x, a)


@njit(cache=False)
def vector(x, a, y):
    for k in range(0, x.size, 4):
        store(y, k, bent(load(F, x, k), a))


def test_a_formula_is_the_same_in_python_in_numpy_and_compiled():
    x, y = np.linspace(0.0, 1.0, 8), np.empty(8)
    vector(x, 2.0, y)
    plain = np.array([bent(float(value), 2.0) for value in x])
    np.testing.assert_array_equal(bent(x, 2.0), plain)
    np.testing.assert_array_equal([number(value, 2.0) for value in x], y)
    np.testing.assert_allclose(y, plain, rtol=1e-15)  # but for the rounding that fma saves
