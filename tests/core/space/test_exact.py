import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hpcpic.core.space.exact import (
    NOT_BOUNDED,
    add_limbs,
    exact_limbs,
    power_of_two_above,
    value,
)

numbers = st.lists(
    st.floats(allow_nan=False, allow_infinity=False, min_value=-1e300, max_value=1e300),
    min_size=1,
    max_size=60,
)


@given(numbers, st.randoms())
def test_bits_do_not_depend_on_order_or_chunks_and_error_is_tiny(terms, random):
    x = np.array(terms)
    scale = power_of_two_above(float(np.abs(x).max()))
    total = value(exact_limbs(x, scale), scale)
    shuffled = list(terms)
    random.shuffle(shuffled)
    parts = [exact_limbs(chunk, scale) for chunk in np.array_split(np.array(shuffled), 3)]
    assert value(sum(parts), scale) == total
    # besides its one rounding, an error of 2^-96 of the scale per term; below 1e-270 limbs end at 2^-995
    lost = len(terms) * max(Fraction(scale) / 2**96, Fraction(1, 2**995))
    assert abs(Fraction(total) - sum(map(Fraction, terms))) <= lost + Fraction(math.ulp(total)) / 2


@pytest.mark.parametrize("n", [0, 1, 7, 100_003])
def test_compiled_limbs_are_the_same(n):
    rng = np.random.default_rng(n)
    x = rng.standard_normal(n) * 10.0 ** rng.integers(-25, 5, n)
    scale = power_of_two_above(float(np.abs(x).max(initial=0.0)))
    limbs = np.zeros(3, np.int64)
    half = n // 2
    assert add_limbs(limbs, x[half:], 1 / scale) == add_limbs(limbs, x[:half], 1 / scale) == 0
    np.testing.assert_array_equal(limbs, exact_limbs(x, scale))
    assert value(limbs, scale) == math.fsum(x)  # all terms are multiples of 2^-95 of the scale, nearly


def test_many_equal_terms_cannot_overflow():
    """2^31 terms of the largest size, added as limbs."""
    limbs = exact_limbs(np.array([1.0]), 1.0) * (1 << 31)
    assert value(limbs, 1.0) == 2.0**31 and value(-limbs, 1.0) == -(2.0**31)
    limbs = exact_limbs(np.array([1.0 - 2.0**-32 - 2.0**-53]), 1.0)
    assert all(abs(int(limb)) * 2**31 < 2**63 for limb in limbs)


@pytest.mark.parametrize("bad", [np.nan, np.inf, 2.5])
def test_terms_beyond_the_scale_are_refused(bad):
    x = np.array([0.5, bad])
    with pytest.raises(OverflowError):
        exact_limbs(x, 2.0)
    assert add_limbs(np.zeros(3, np.int64), x, 0.5) == NOT_BOUNDED


@given(st.integers(-1000, 1000))
def test_power_of_two_units_change_no_bit(shift):
    x = np.random.default_rng(5).standard_normal(50)
    unit = 2.0 ** (shift / 2 // 1)
    scale = power_of_two_above(float(np.abs(x).max()))
    assert value(exact_limbs(x * unit, scale * unit), scale * unit) == value(exact_limbs(x, scale), scale) * unit


def test_scale_is_above():
    for magnitude in (0.0, 1e-320, 0.5, 1.0, 1.5, 1e300):
        scale = power_of_two_above(magnitude)
        assert scale > magnitude and math.frexp(scale)[0] == 0.5
    with pytest.raises(OverflowError):
        power_of_two_above(math.nan)
