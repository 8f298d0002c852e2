import math

import numba
import numpy as np
import pytest

from hpcpic.core.space import elementary


@pytest.mark.parametrize("name", elementary.__all__)
def test_arrays_have_the_bits_of_single_numbers(name):
    """Those of the C library, wherever a number stands: no code for several numbers at once."""
    x = np.random.default_rng(1).uniform(-0.9, 3.0, (40, 25))
    of_arrays, of_numbers = getattr(elementary, name), np.vectorize(getattr(math, name), [float])
    np.testing.assert_array_equal(of_arrays(x), of_numbers(x))
    np.testing.assert_array_equal(of_arrays(x.T[::3]), of_numbers(x.T[::3]))
    assert of_arrays(x[:0]).shape == (0, 25) and of_arrays(0.5) == getattr(math, name)(0.5)


def test_beyond_their_domain_there_are_no_numbers():
    assert np.isnan(elementary.log1p([-2.0])) and elementary.expm1([1e3]) == np.inf


def test_functions_of_intel_are_left_alone():
    numba.config.reload_config()  # as every compilation does
    assert numba.config.DISABLE_INTEL_SVML and not numba.config.USING_SVML
