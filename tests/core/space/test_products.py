import numpy as np
import pytest

from hpcpic.core.space.products import product


@pytest.mark.parametrize("order", "CF")
@pytest.mark.parametrize("shape", [(2,), (3,), (2, 2), (3, 3), (3, 2)])
def test_bits_of_a_row_do_not_depend_on_the_others(shape, order):
    rng = np.random.default_rng(0)
    x, m = np.asarray(rng.standard_normal((1000, shape[0])), order=order), rng.standard_normal(shape)
    whole = product(x, m)
    assert np.allclose(whole, x @ m, rtol=0, atol=1e-14)
    for n in (1, 2, 3, 7, 37):
        for part in (x[5 : 5 + n], np.ascontiguousarray(x[5 : 5 + n]), x[5 : 5 + n].copy("F")):
            assert np.array_equal(product(part, m), whole[5 : 5 + n])
