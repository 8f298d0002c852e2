import dataclasses
import math
import runpy

import numpy as np
import pytest
from sph_scenes import by_id, engine, reference

from hpcpic.core.case import accelerations
from hpcpic.core.case.own_functions import formula_fault
from hpcpic.core.errors import ConfigError
from sph import Case
from sph.case.config import Numerics
from sph.kernels import cells, marks, motion, readings, runs, totals
from sph.physics.smoothing import SMOOTHING, Smoothing, register, wendland2_f, wendland2_w

Q = np.linspace(0.0, 3.0, 300001)


def integral(values):
    return np.sum(values[1:] + values[:-1]) / 2 * (Q[1] - Q[0])


def test_the_key_tells_all_of_them():
    told = Numerics.model_fields["kernel"].description
    assert [name for name in SMOOTHING if name not in told] == []


@pytest.mark.parametrize("name", SMOOTHING)
@pytest.mark.parametrize("d", [2, 3])
def test_kernels_are_normalised(name, d):
    shell = 2 * np.pi * Q if d == 2 else 4 * np.pi * Q**2
    assert integral(shell * SMOOTHING[name].value(Q, d)) == pytest.approx(1.0, abs=1e-9)  # of the trapezoidal rule


@pytest.mark.parametrize("name", SMOOTHING)
def test_the_gradient_is_that_of_the_kernel(name):
    kernel = SMOOTHING[name]
    slope = np.diff(kernel.value(Q, 3)) / np.diff(Q)
    middle = (Q[1:] + Q[:-1]) / 2
    error = slope - kernel.gradient(middle, 3) * middle
    assert np.abs(error).max() < 1e-9  # (Q step)^2 times a third derivative below 10


@pytest.mark.parametrize("name", SMOOTHING)
@pytest.mark.parametrize("d", [2, 3])
def test_a_linear_field_has_its_gradient(name, d):
    """- integral x F x_a^2 = 1: the gradient of x is 1."""
    kernel = SMOOTHING[name]
    shell = (2 * np.pi * Q if d == 2 else 4 * np.pi * Q**2) * Q**2 / d
    assert integral(-shell * kernel.gradient(Q, d)) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("name", SMOOTHING)
def test_nothing_beyond_the_support(name):
    kernel = SMOOTHING[name]
    assert np.all(kernel.value(Q[kernel.support <= Q], 3) == 0)
    assert np.all(kernel.gradient(Q[kernel.support <= Q], 3) == 0)


@pytest.mark.parametrize("n", [0, 1, 7, 500])
def test_readings_find_what_all_bodies_show(n):
    """Own fluid, images of it in wall 0, bodies of two walls, ghosts and empty slots; beyond the end is nobody."""
    rng = np.random.default_rng(n)
    flags, key = np.zeros(n + 16, np.int32), rng.integers(0, 3, n + 16) << 56 | rng.integers(0, 3, n + 16)
    flags[:n], x = rng.choice([0, 33, 97, 34, 98], n), rng.normal(size=n + 16)
    own, images, wanted = flags & 65 == 65, np.array([0, 1, 0]), np.array([True, False])
    for sign in (1.0, -1.0):
        assert readings.farthest(n, sign, flags, x) == (sign * x[own]).max(initial=-np.inf)
    wall = np.where(key % 64 > 0, images[key % 64], key >> 56) - 1
    right = np.flatnonzero((flags != 0) & ~own & (wall == 0))
    slots, walls = np.empty((2, len(right)), np.int64)
    assert readings.of_walls(n, flags, key, images, wanted, slots[:0], walls[:0]) == len(right)
    readings.of_walls(n, flags, key, images, wanted, slots, walls)
    assert slots.tolist() == right.tolist() and not walls.any()


@pytest.mark.parametrize("template", [cells, motion, runs, totals])
def test_templates_mean_the_same_flags_and_keys(template):
    same = [name for name in vars(marks) if isinstance(getattr(template, name, None), int)]
    assert same and all(getattr(template, name) == getattr(marks, name) for name in same)


WENDLAND6 = '''
import math

from hpcpic.core.simd.formulas import fma, maximum
from sph.physics.smoothing import Smoothing, register


def w(r, per_h):
    """(1 - q / 2)^8 (1 + 4 q + 25 / 4 q^2 + 4 q^3)."""
    far = maximum(fma(r, -0.5 * per_h, 1.0), 0.0)
    q, square = r * per_h, far * far
    return (square * square) * (square * square) * fma(q, fma(q, fma(q, 4.0, 6.25), 4.0), 1.0)


def f(r, per_h):
    """(1 - q / 2)^7 (1 + 7 / 2 q + 4 q^2)."""
    far = maximum(fma(r, -0.5 * per_h, 1.0), 0.0)
    q, square = r * per_h, far * far
    return (square * square) * (square * far) * fma(q, fma(q, 4.0, 3.5), 1.0)


register(Smoothing("wendland6", 2.0, {2: 78 / (28 * math.pi), 3: 1365 / (512 * math.pi)}, w, f, -5.5))
'''


@pytest.fixture
def wendland6(tmp_path):
    """A kernel of a user's own file."""
    file = tmp_path / "wendland6.py"
    file.write_text(WENDLAND6)
    runpy.run_path(str(file))
    yield "wendland6"
    del SMOOTHING["wendland6"]


def test_a_kernel_of_ones_own_is_one_like_the_others(wendland6):
    for d in (2, 3):
        test_kernels_are_normalised(wendland6, d)
        test_a_linear_field_has_its_gradient(wendland6, d)
    test_the_gradient_is_that_of_the_kernel(wendland6)
    test_nothing_beyond_the_support(wendland6)


def test_pair_sums_of_a_kernel_of_ones_own_are_those_of_the_reference(wendland6):
    """And their error in the gradient of a linear pressure falls with h / dp: particles are spread evenly."""
    errors = []
    for smoothing in (1.3, 2.0):
        sph = engine(
            kernel=wendland6, smoothing=smoothing, flux="none", alpha=0.0, integrator="euler", gravity=(0.0, 0.0),
            pressure="zero", fill=1.0, periodic=("x",),
        )  # fmt: skip
        sph.storage.set_own_values("drho", 0.1 * sph.storage.own_values("x")[1])
        expected = reference(sph).acceleration()
        sph.evolution.evaluate()
        a, x = by_id(sph, "a", "x")
        assert np.abs(a - expected).max() <= 1e-12 * np.abs(expected).max()  # rounding
        inside = np.abs(x[1] - 0.5) < 0.5 - 2.5 * sph.scene.h
        errors.append(np.abs(a[1, inside] / (-0.1 * sph.scene.c0**2 / sph.scene.rho0) - 1).max())
    assert errors[1] < 0.2 * errors[0]


def test_an_unknown_kernel_is_told_with_those_that_there_are():
    with pytest.raises(ConfigError, match=r"must be 'cubic', .* or 'quintic' .*did you mean 'wendland2'"):
        engine(kernel="wendland22")


def test_a_name_belongs_to_one_kernel():
    with pytest.raises(ValueError, match="another kernel 'cubic'"):
        register(dataclasses.replace(SMOOTHING["cubic"], support=3.0))


@pytest.mark.parametrize(
    ("norm", "slope", "told"),
    [(6 / (4 * np.pi), -5.0, r"integral 0\.857143 in 2 dimensions"), (7 / (4 * np.pi), 5.0, "slope f is not dW/dq")],
)
def test_a_kernel_that_is_none_is_refused(norm, slope, told):
    wrong = Smoothing("wrong", 2.0, {2: norm}, wendland2_w, wendland2_f, slope)
    with pytest.raises(ValueError, match=told):
        register(wrong)
    assert "wrong" not in SMOOTHING


def with_if(r, per_h):
    q = r * per_h
    if q > 2.0:
        return 0.0
    return 1.0 - 0.5 * q


def with_max(r, per_h):
    return max(1.0 - 0.5 * r * per_h, 0.0)


def with_math(r, per_h):
    return math.exp(-r * per_h)


@pytest.mark.parametrize("formula", [with_if, with_max, with_math])
def test_a_formula_of_single_numbers_is_told_what_to_write(formula):
    """In place of numpy's words on a.any(), and with the line of the formula."""
    with pytest.raises((TypeError, ValueError), match=r"no `if`, .* max\(\) or math; .* select \(for if\)$") as told:
        register(dataclasses.replace(SMOOTHING["wendland2"], name="mine", w=formula))
    assert told.traceback[-1].name == formula.__name__ and "mine" not in SMOOTHING


def test_a_function_may_be_defined_again_but_not_its_name_be_taken():
    """As a cell of a notebook that is run twice."""

    def made():
        def spring(x, v, t):
            return -x[0], 0.0, 0.0

        return spring

    try:
        accelerations.register("spring of the test", made())
        accelerations.register("spring of the test", made())
        with pytest.raises(ValueError, match="another acceleration"):
            accelerations.register("spring of the test", wendland2_w)
    finally:
        accelerations.ACCELERATIONS.pop("spring of the test")


@pytest.mark.parametrize("name", sorted(SMOOTHING))
def test_the_shipped_formulas_pass_what_those_of_users_must(name):
    for formula in (SMOOTHING[name].w, SMOOTHING[name].f):
        assert formula_fault(formula, ("r",), ("per_h",)) == ""


def numpys_slope(r, per_h):
    far = np.maximum(1.0 - 0.5 * r * per_h, 0.0)
    return (far * far) * far


def test_a_kernel_that_vectors_cannot_be_summed_by_is_refused_with_its_place(monkeypatch):
    mine = dataclasses.replace(SMOOTHING["wendland2"], name="mine", f=numpys_slope)
    mine.require_sound()
    monkeypatch.setitem(SMOOTHING, "mine", mine)
    with pytest.raises(ConfigError, match=r"numerics.kernel: .*test_smoothing.py:\d+: numpys_slope: .*maximum\(Vec"):
        Case("water-column").changed({"numerics.kernel": "mine"})
