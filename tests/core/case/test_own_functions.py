"""Mistakes in a function of the user's own are told in one line with file, line, name and what would be right."""

import math
import random

import numba
import numpy as np
import pytest
from numpy.random import normal

from hpcpic.core.case import accelerations
from hpcpic.core.case.own_functions import arithmetic_fault, formula_fault
from hpcpic.core.simd.formulas import fma, maximum, select

STIFFNESS = {"along x": 4.0}


def bare(q):
    return 2.0 * q


@numba.njit
def helper(q):
    return 2.0 * q


def two(x, v, t):
    return -x[0], 0.0


def one(x, v, t):
    return -x[0]


def array(x, v, t):
    return np.array([-x[0], 0.0, 0.0])


def listed(x, v, t):
    return [-x[0], 0.0, 0.0]


def forgotten(x, v, t):
    -x[0], 0.0, 0.0


def texts(x, v, t):
    return "0", 0.0, 0.0


def complexes(x, v, t):
    return 1j * x[0], 0.0, 0.0


def too_few(x, v):
    return 0.0, 0.0, 0.0


def undefined(x, v, t):
    return -stiffness * x[0], 0.0, 0.0  # noqa: F821


def no_vector(x, v, t):
    return -2.0 * x


def of_a_dict(x, v, t):
    return -STIFFNESS["along x"] * x[0], 0.0, 0.0


def no_such_function(x, v, t):
    return np.sine(t), 0.0, 0.0


def calls(x, v, t):
    return bare(x[0]), 0.0, 0.0


def beyond(x, v, t):
    return x[3], 0.0, 0.0


def branches(x, v, t):
    if t > 1.0:
        return 0.0, 0.0, 0.0
    return 0.0


def with_a_default(x, v, t, stiffness=4.0):
    return -stiffness * x[0], 0.0, 0.0


def noisy(x, v, t):
    return random.gauss(0.0, 1.0), 0.0, 0.0


@numba.njit
def numpy_noise():
    return np.random.normal()  # noqa: NPY002


def calls_noise(x, v, t):
    return numpy_noise(), 0.0, 0.0


def draws(x, v, t):
    return normal(0.0, 1.0), 0.0, 0.0  # noqa: NPY002


@pytest.mark.parametrize(
    ("function", "line", "told"),
    [
        (with_a_default, 0, "takes 'stiffness' besides (x, v, t): let a function make it"),
        (noisy, 0, "draws random numbers (random.gauss)"),
        (calls_noise, 0, "draws random numbers ("),
        (draws, 0, "draws random numbers (normal)"),
        (two, 0, "must return three numbers"),
        (one, 0, "must return three numbers, a_x, a_y, a_z (it returns float64)"),
        (array, 0, "must return three numbers"),
        (listed, 0, "must return three numbers"),
        (forgotten, 0, "it returns nothing"),
        (texts, 0, "must return three numbers"),
        (complexes, 0, "must return three numbers"),
        (too_few, 0, "is called with (x, v, t), but takes (x, v)"),
        (undefined, 1, "'stiffness' is not defined"),
        (no_vector, 1, "no such operation: mul(float64, UniTuple(float64 x 3))"),
        (of_a_dict, 1, "'STIFFNESS' is of the type dict"),
        (no_such_function, 0, "module 'numpy' has no attribute 'sine'"),
        (calls, 1, "write @numba.njit above that one"),
        (beyond, 1, "tuple index out of range"),
        (branches, 0, "Can't unify return type"),
    ],
)
def test_a_mistake_in_an_acceleration_is_one_line_with_its_place(monkeypatch, function, line, told):
    monkeypatch.setitem(accelerations.ACCELERATIONS, "mine", function)
    ((path, text),) = accelerations.faults("mine")
    place = f"{__file__}:{function.__code__.co_firstlineno + line}: {function.__name__}: "
    assert path == ("acceleration",) and text.startswith(place) and told in text and "\n" not in text


def test_what_is_no_function_is_told(monkeypatch):
    monkeypatch.setitem(accelerations.ACCELERATIONS, "mine", 3.0)
    assert next(accelerations.faults("mine"))[1] == "a function is wanted (got 3.0)"


def whole_numbers(x, v, t):
    return -1, 0, helper(t)


@pytest.mark.parametrize("function", [whole_numbers, numba.njit(whole_numbers)], ids=["plain", "compiled already"])
@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_kernels_get_three_reals_whatever_they_give(monkeypatch, function, real):
    """Also where positions are in single precision, and the function names whole numbers or is compiled already."""
    monkeypatch.delitem(accelerations.ACCELERATIONS, "mine", raising=False)
    accelerations.register("mine", function)
    assert not list(accelerations.faults("mine"))
    a = numba.njit(accelerations.compiled("mine"))((real(0), real(0), 0.0), (real(0), real(0), 0.0), math.pi)
    assert a == (-1.0, 0.0, 2 * math.pi) and all(isinstance(each, float) for each in a)
    del accelerations.ACCELERATIONS["mine"]


def linear(r, per_h):
    return maximum(fma(r, -0.5 * per_h, 1.0), 0.0)


def chosen(r, per_h):
    return select(r * per_h < 1.0, 1.0, 0.0 * r)


def with_a_helper(r, per_h):
    return helper(r * per_h)


def numpys(r, per_h):
    return np.maximum(r * per_h, 0.0)


def with_if(r, per_h):
    return 1.0 if r * per_h < 1.0 else 0.0


def power(r, per_h):
    return (r * per_h) ** 2.5


def bare_call(r, per_h):
    return bare(r * per_h)


def pair(r, per_h):
    return r, per_h


def of_one(r):
    return r


@pytest.mark.parametrize("formula", [linear, chosen, with_a_helper])
def test_a_formula_of_vectors_and_numbers_is_sound(formula):
    assert formula_fault(formula, ("r",), ("per_h",)) == formula_fault(formula, (), ("r", "per_h")) == ""


@pytest.mark.parametrize(
    ("formula", "line", "told"),
    [
        (numpys, 1, "no such operation: maximum(Vec(8, float64), float64); vectors have + - * /, and from hpcpic"),
        (with_if, 1, "no such operation: bool(Vec(8, bool)); vectors have"),
        (power, 1, "no such operation: pow(Vec(8, float64), float64); vectors have"),
        (bare_call, 1, "write @numba.njit above that one"),
        (pair, 0, "must return one value"),
        (of_one, 0, "is called with (r, per_h), but takes (r)"),
    ],
)
def test_a_mistake_in_a_formula_is_one_line_with_its_place(formula, line, told):
    said = formula_fault(formula, ("r",), ("per_h",))
    place = f"{__file__}:{formula.__code__.co_firstlineno + line}: {formula.__name__}: "
    assert said.startswith(place) and told in said and "\n" not in said


def test_what_numbers_can_and_vectors_cannot_is_told_of_vectors_alone():
    assert formula_fault(with_if, (), ("r", "per_h")) == formula_fault(numpys, (), ("r", "per_h")) == ""


def test_a_formula_of_several_values_returns_as_many():
    assert formula_fault(pair, ("r", "per_h"), (), 2) == ""
    assert "must return 3 values" in formula_fault(pair, ("r", "per_h"), (), 3)


def scaled(k):
    def square(vx, vy, vz, v_sq):
        return k * v_sq

    return square


def test_a_function_whose_text_is_taken_over_reads_nothing_beside_its_arguments():
    """Of one that another function makes numba told in pages that there is no such name."""
    assert arithmetic_fault(one) == arithmetic_fault(bare) == ""
    assert "arithmetic of its arguments alone (it uses 'k')" in arithmetic_fault(scaled(3.0))
    assert "(it uses 'stiffness')" in arithmetic_fault(undefined)
