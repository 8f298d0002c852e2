"""Loads and stores under a mask: what is meant and nothing else, by instructions with masks and lane by lane."""

import numba
import numpy as np
import pytest

from hpcpic.core.simd.masks import expand_at, load_where, mask_of_bits, store_where
from hpcpic.core.simd.vector import Vec, address_of, lanes, load_at, splat, store_at


@pytest.fixture(params=[True, False], ids=["masks", "lane by lane"])
def ways(request, monkeypatch):
    monkeypatch.setattr("hpcpic.core.simd.masks.has_masks", lambda: request.param)


def some_masks(n):
    """None, all, each lane alone, runs from either end, and others."""
    runs = [(1 << k) - 1 for k in range(n + 1)]
    own = np.random.default_rng(1).integers(0, 1 << n, 20).tolist()
    return sorted({*runs, *(runs[-1] ^ run for run in runs), *(1 << k for k in range(n)), *own})


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_lanes_of_the_mask_are_written_and_read_and_no_others(ways, dtype):
    n, size = lanes(dtype), np.dtype(dtype).itemsize
    kind = Vec(n, dtype)

    @numba.njit
    def move(source, target, read, expanded, bits):
        mask, value = mask_of_bits(kind, bits), load_at(kind, address_of(source, 0), size)
        store_where(address_of(target, 1), value, mask, size)
        store_at(address_of(read, 0), load_where(address_of(source, 0), mask, splat(kind, -1.0), size), size)
        store_at(address_of(expanded, 0), expand_at(address_of(source, 0), mask, splat(kind, -1.0)), size)

    source = np.arange(1, n + 1).astype(dtype)
    for bits in some_masks(n):
        meant = (bits >> np.arange(n)) & 1 == 1
        target, read, expanded = np.zeros(n + 2, dtype), np.zeros(n, dtype), np.zeros(n, dtype)
        move(source, target, read, expanded, bits)
        assert target.tolist() == [0.0, *np.where(meant, source, 0.0), 0.0]
        assert read.tolist() == np.where(meant, source, -1.0).tolist()
        packed = np.full(n, -1.0)
        packed[meant] = source[: meant.sum()]
        assert expanded.tolist() == packed.tolist()
