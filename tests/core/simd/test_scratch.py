"""Scratch arrays of kernels: those of numpy."""

import numpy as np
import pytest

from hpcpic.core import memory
from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.scratch import empty, zeros


@njit(cache=False)
def ramps(n, like):
    line, plane, block = empty(n, np.int64), empty((n, 2), like.dtype), empty((2, 3, n), np.float64)
    for i in range(n):
        line[i] = i
        for j in range(2):
            plane[i, j] = 10 * i + j
            for k in range(3):
                block[j, k, i] = 100 * j + 10 * k + i
    return line, plane, block


@njit(cache=False)
def filled(n):
    """The second array is where the first one was: the memory that was given back is used again."""
    first = empty(n, np.float64)
    first[:] = 1.0
    total = first.sum()
    return zeros(n, np.float64), zeros((2, n), np.bool_), total


def test_an_array_has_the_values_that_are_put_into_it():
    line, plane, block = ramps(5, np.zeros(1, np.float32))
    i, j, k = np.arange(5), np.arange(2), np.arange(3)
    for made, known in (
        (line, i),
        (plane, (10 * i[:, None] + j).astype(np.float32)),
        (block, 100.0 * j[:, None, None] + 10 * k[:, None] + i),
    ):
        assert made.dtype == known.dtype and made.flags.c_contiguous and made.ctypes.data % 32 == 0
        np.testing.assert_array_equal(made, known)


@pytest.mark.parametrize("n", [0, 1, 1000])
def test_zeros_are_zero_where_memory_was_used_before(n):
    for _ in range(3):
        numbers, marks, total = filled(n)
        assert total == n and numbers.shape == (n,) and marks.shape == (2, n) and marks.dtype == np.bool_
        assert not numbers.any() and not marks.any()


def test_an_array_that_nobody_holds_is_given_back():
    n, before = 2**17, memory.held()
    for _ in range(200):
        filled(n)
    assert memory.held() - before < 50 * 8 * n  # of 400 arrays
