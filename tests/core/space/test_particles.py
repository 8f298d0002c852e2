import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hpcpic.core.space.particles import Particles

KINDS = {"x": (np.float32, (2,)), "v": (np.float64, (3,)), "cell": (np.int16, ())}


def some(ids):
    """Columns that are functions of the id, so that a row mixed up with another is seen."""
    ids = np.asarray(ids, np.int64)
    x, v = np.stack([ids, -ids], 1), np.stack([ids, ids + 1, ids + 2], 1)
    return {"id": ids, "x": x.astype(np.float32), "v": v / 7, "cell": (ids % 100).astype(np.int16)}


def check(particles, ids):
    for name, values in some(ids).items():
        np.testing.assert_array_equal(particles.columns[name], values)
        assert particles.columns[name].dtype == values.dtype


@given(st.lists(st.integers(0, 20), max_size=6))
def test_append_grows_and_keeps_order(sizes):
    particles, ids = Particles(KINDS), []
    for size in sizes:
        new = range(len(ids), len(ids) + size)
        particles.append(some(new))
        ids.extend(new)
    assert particles.n == len(ids) <= particles.capacity
    check(particles, ids)


@given(st.sets(st.integers(0, 19)))
def test_take_splits_without_loss(chosen):
    index = np.array(sorted(chosen), np.int64)
    mask = np.isin(np.arange(20), index)
    for which in (index, mask):
        particles = Particles(KINDS, capacity=30)
        particles.append(some(range(20)))
        taken = particles.take(which)
        check(particles, np.flatnonzero(~mask))
        np.testing.assert_array_equal(taken["id"], index)
        particles.append(taken)
        particles.sort(np.argsort(particles.columns["id"]))
        check(particles, range(20))


def test_records_carry_every_bit():
    particles = Particles(KINDS)
    particles.append(some(range(10)))
    particles.columns["v"][3] = [np.nan, -0.0, np.inf]
    records = particles.pack(np.array([7, 3]))
    assert records.shape == (2, particles.record_bytes) and records.dtype == np.uint8
    assert particles.record_bytes == 8 + 2 * 4 + 3 * 8 + 2
    other = Particles(KINDS)
    other.append(other.unpack(records))
    for name, column in particles.columns.items():
        assert other.columns[name].tobytes() == column[[7, 3]].tobytes()
    assert particles.pack(np.zeros(0, np.int64)).shape == (0, particles.record_bytes)


def test_append_wants_all_columns():
    with pytest.raises(ValueError, match="columns"):
        Particles(KINDS).append({"id": np.arange(3)})
