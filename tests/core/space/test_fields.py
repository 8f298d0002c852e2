import numpy as np
import pytest

from hpcpic.core.space.domain import Domain, even_cuts
from hpcpic.core.space.fields import Field


@pytest.mark.parametrize("ndim", [1, 2, 3])
@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.int64, np.complex128])
@pytest.mark.parametrize("leading, trailing", [((), ()), ((19,), ()), ((), (3,))])
def test_inner_is_the_values_without_ghosts(ndim, dtype, leading, trailing):
    points = (7, 5, 4)[:ndim]
    domain = Domain((1.0,) * ndim, points, (True,) * ndim, even_cuts(7, 3))
    ghosts = ((1, 2), (0, 1), (2, 0))[:ndim]
    field = Field(domain, 0, dtype=dtype, leading=leading, trailing=trailing, ghosts=ghosts)
    field.inner[...] = 1
    assert field.rows == (0, 3) and field.inner.shape == (*leading, *domain.shape(0), *trailing)
    assert field.values.sum() == field.inner.size  # a view, and nothing else was touched
    assert field.values.shape[len(leading)] == 6
    assert field.values.flags.c_contiguous and field.values.ctypes.data % 64 == 0 and field.dtype == dtype


def test_layers_of_an_axis_are_a_view_of_the_values():
    domain = Domain((1.0, 1.0), (4, 5), (True, True), (0, 4))
    field = Field(domain, 0, leading=(2,), trailing=(3,), ghosts=((1, 1), (0, 1)))
    field.layers(0)[:, 0] = 1.0
    field.layers(1)[:, 5] += 2.0
    assert np.all(field.values[:, 0, :5] == 1.0) and np.all(field.values[:, 0, 5] == 3.0)
    assert np.all(field.values[:, 1:, 5] == 2.0) and not field.values[:, 1:, :5].any()


def test_empty_slabs_have_ghosts_and_wrong_ghosts_are_refused():
    domain = Domain((1.0, 1.0), (4, 5), (True, True), (0, 4, 4))
    assert Field(domain, 1, ghosts=((1, 1), (0, 0))).inner.shape == (0, 5)
    with pytest.raises(ValueError, match="axes"):
        Field(domain, 0, ghosts=((1, 1),))
