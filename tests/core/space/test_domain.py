from itertools import combinations_with_replacement, pairwise

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from hpcpic.core.space.domain import Domain, balanced_cuts, block_ranges, even_cuts, fullest, ring_neighbours, wrap


@pytest.mark.parametrize("n", [0, 1, 7, 8, 9])
@pytest.mark.parametrize("parts", [1, 2, 3, 4, 12])
def test_block_ranges_cover_everything_once_and_differ_by_one(n, parts):
    ranges = block_ranges(n, parts)
    assert [item for low, high in ranges for item in range(low, high)] == list(range(n))
    sizes = [high - low for low, high in ranges]
    assert len(sizes) == parts and sizes == sorted(sizes, reverse=True) and sizes[0] - sizes[-1] <= 1
    assert even_cuts(n, parts) == (*(low for low, _ in ranges), n)


costs = st.lists(st.integers(0, 1000), min_size=1, max_size=40)


@given(costs, st.integers(1, 8))
def test_balanced_cuts_exceed_the_mean_by_no_more_than_one_row(cost, ranks):
    cuts = balanced_cuts(cost, ranks)
    loads = [sum(cost[low:high]) for low, high in pairwise(cuts)]
    assert sum(loads) == sum(cost) and len(cuts) == ranks + 1
    assert max(loads) <= sum(cost) / ranks + max(cost) + 1e-9 or not any(cost)


@given(st.lists(st.integers(0, 50), min_size=1, max_size=9), st.integers(1, 5), st.integers(0, 1))
def test_no_cuts_give_the_fullest_rank_less(cost, ranks, minimum):
    rows = len(cost)
    assume(any(cost) and rows >= ranks * minimum)
    inner = combinations_with_replacement(range(rows + 1), ranks - 1)
    all_cuts = [cuts for cuts in ((0, *some, rows) for some in inner) if np.diff(cuts).min() >= minimum]
    assert fullest(cost, balanced_cuts(cost, ranks, minimum)) == min(fullest(cost, cuts) for cuts in all_cuts)


@given(costs, st.integers(1, 8), st.integers(0, 4))
def test_balanced_cuts_keep_the_minimum(cost, ranks, minimum):
    if len(cost) < ranks * minimum:
        with pytest.raises(ValueError, match="rows"):
            balanced_cuts(cost, ranks, minimum)
    else:
        assert np.diff(balanced_cuts(cost, ranks, minimum)).min() >= minimum


def test_balanced_cuts_of_equal_rows_are_even_and_of_a_peak_surround_it():
    assert balanced_cuts(np.ones(12), 4) == even_cuts(12, 4)
    assert balanced_cuts(np.zeros(7), 3) == even_cuts(7, 3)
    assert balanced_cuts([0, 0, 0, 5, 5, 0, 0], 2) == (0, 4, 7)


@given(st.floats(-1e6, 1e6), st.sampled_from([1.0, 0.1, 64.0, 7.3]), st.sampled_from([np.float64, np.float32]))
def test_wrap_stays_below_the_length(x, length, dtype):
    y = wrap(np.array([x], dtype), dtype(length))
    assert y.dtype == dtype and 0 <= y[0] < dtype(length)
    turns = (float(dtype(x)) - float(y[0])) / float(dtype(length))
    # x - y is a whole number of lengths, to the rounding of y
    assert abs(turns - round(turns)) < 4 * np.finfo(dtype).eps * max(1, abs(turns))


def test_wrap_of_a_tiny_negative_is_zero():
    assert wrap(-1e-20, 64.0) == 0.0 and wrap(64.0, 64.0) == 0.0 and wrap(-1, 7) == 6
    np.testing.assert_array_equal(wrap(np.array([-1e-20, 63.5, 64.5]), 64.0), [0.0, 63.5, 0.5])


@given(st.lists(st.integers(0, 9), min_size=0, max_size=5))
def test_owner_has_the_row_in_its_range_and_is_never_empty(inner_cuts):
    domain = Domain((1.0,), (9,), (True,), (0, *sorted(inner_cuts), 9))
    owners = domain.owner(np.arange(9))
    for row in range(9):
        low, high = domain.row_range(owners[row])
        assert low <= row < high and domain.owner(row) == owners[row]


def test_domain_describes_its_slabs():
    domain = Domain((2.0, 3.0), (8, 6), (True, False), (0, 3, 3, 8))
    assert (domain.ndim, domain.ranks, domain.spacing) == (2, 3, (0.25, 0.5))
    assert [domain.shape(rank) for rank in range(3)] == [(3, 6), (0, 6), (5, 6)]
    assert domain.with_cuts([0, 8]).cuts == (0, 8)
    for wrong in [(0, 7), (1, 8), (0, 5, 3, 8)]:
        with pytest.raises(ValueError, match="cuts"):
            domain.with_cuts(wrong)


@given(st.lists(st.integers(0, 9), min_size=0, max_size=5))
def test_ring_neighbourhood_is_mutual_and_leaves_out_empty_slabs(inner_cuts):
    cuts = (0, *sorted(inner_cuts), 9)
    ranks = range(len(cuts) - 1)
    neighbours = [ring_neighbours(cuts, rank) for rank in ranks]
    for rank in ranks:
        assert rank not in neighbours[rank] and len(neighbours[rank]) <= 2
        assert all(rank in neighbours[peer] for peer in neighbours[rank])
    full = [rank for rank in ranks if cuts[rank] < cuts[rank + 1]]
    assert all(bool(neighbours[rank]) == (rank in full and len(full) > 1) for rank in ranks)
