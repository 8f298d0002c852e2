from functools import partial
from itertools import product

import numpy as np
import pytest

from hpcpic.core.comm.halo import Fill, Fold, halo_plan
from hpcpic.core.comm.tags import Channel
from hpcpic.core.space.domain import Domain, even_cuts
from hpcpic.core.space.fields import Field
from hpcpic.core.tasks.graph import Graph, Pool

WIDTHS = [(0, 0), (0, 1), (1, 0), (1, 2), (3, 3), (9, 10)]
SIZES = [7, 8, 9]


def all_cuts(rows, ranks):
    """Even cuts, all rows on the first or the last rank, and single rows with the rest in the middle."""
    lone = [
        0,
        *(min(k, rows) for k in range(1, ranks // 2 + 1)),
        *[rows - 1] * (ranks - 1 - ranks // 2),
        rows,
    ]
    return [even_cuts(rows, ranks), (0, *[rows] * ranks), (*[0] * ranks, rows), tuple(lone)]


@pytest.mark.parametrize("periodic", [True, False])
@pytest.mark.parametrize("below, above", WIDTHS)
def test_both_sides_of_a_plan_mean_the_same_rows(periodic, below, above):
    for n, ranks in product(SIZES, (1, 2, 3, 4)):
        for cuts in all_cuts(n, ranks):
            check_plan(cuts, periodic, below, above)


def check_plan(cuts, periodic, below, above):
    n, ranks = cuts[-1], len(cuts) - 1
    plans = [halo_plan(cuts, periodic, rank, below, above) for rank in range(ranks)]
    for rank, plan in enumerate(plans):
        height = cuts[rank + 1] - cuts[rank]
        ghosts = [int(layer) for share in plan.values() for layer in share.ghosts]
        every = [*range(below), *range(below + height, below + height + above)]
        rows = [cuts[rank] - below + layer for layer in every]
        wanted = [layer for layer, row in zip(every, rows) if periodic or 0 <= row < n]
        assert sorted(ghosts) == wanted  # each once, those beyond a wall never
        for peer, share in plan.items():
            other = plans[peer][rank]
            assert len(share.ghosts) + len(share.sources) > 0 and len(share.sources) == len(other.ghosts)
            here = share.ghosts - below + cuts[rank]
            there = other.sources - below + cuts[peer]
            np.testing.assert_array_equal(here % n, there)
            assert np.all((other.sources >= below) & (there < cuts[peer + 1]))


def padded(full, axis_widths, periodic):
    """Global values [n, m] with ghosts `axis_widths` around, zero beyond walls."""
    for axis, ((below, above), wraps) in enumerate(zip(axis_widths, periodic)):
        index = np.arange(-below, full.shape[axis] + above)
        inside = (index >= 0) & (index < full.shape[axis])
        full = np.take(full, index % full.shape[axis], axis)
        if not wraps:
            full[(slice(None),) * axis + (~inside,)] = 0
    return full


def domain_for(world, n, cuts, periodic, ndim=2):
    return Domain((1.0,) * ndim, (n, 5, 4)[:ndim], tuple(periodic)[:ndim], cuts)


def run_in_graphs(world, exchanges, iterations):
    """Replay iterations as a task graph; yields a launch of each."""
    graph = Graph()
    with world.first_on_node():  # adding tasks compiles
        for name, exchange in exchanges.items():
            exchange.add_to(graph, name, inner=[(name, "inner")], ghosts=[(name, "ghosts")])
        graph.freeze()
    pool = Pool(1)
    try:
        for iteration in iterations:
            for exchange in exchanges.values():
                exchange.at(iteration)
            yield partial(pool.run, graph)
    finally:
        pool.close()


def check_fill(world, n, which, periodic, width):
    cuts = all_cuts(n, world.size)[which]
    domain = domain_for(world, n, cuts, periodic)
    ghosts = (width, (2, 1))
    field = Field(domain, world.rank, ghosts=ghosts, dtype=np.int64)
    full = np.random.default_rng(n).integers(1, 1 << 60, (n, 5))
    low, high = field.rows
    expected = padded(full, ghosts, periodic)
    below, above = width
    expected = expected[low : high + below + above]
    fill = Fill(world, domain, field, Channel.FIELD)
    for iteration in (-2, -1, 0, 1):
        field.values[...] = 0
        field.inner[...] = full[low:high]
        fill.start(iteration)
        fill.finish()
        np.testing.assert_array_equal(field.values, expected)
    fill.free()


def check_adjoint(world, n, which, periodic, width, dtype):
    """<fill a, b> = <a, fold b>: sums over all ranks, exact in integers."""
    cuts = all_cuts(n, world.size)[which]
    domain = domain_for(world, n, cuts, periodic)
    a, b = (Field(domain, world.rank, ghosts=(width, (2, 1)), dtype=dtype) for _ in range(2))
    rng = np.random.default_rng(n + 100 * world.rank)
    a.inner[...] = rng.integers(-99, 99, a.inner.shape)
    b.values[...] = rng.integers(-99, 99, b.values.shape)
    before = a.inner.copy()
    b_before = b.values.copy()
    fill, fold = Fill(world, domain, a, Channel.FIELD), Fold(world, domain, b, Channel.CHARGE)
    for launch in run_in_graphs(world, {"a": fill, "b": fold}, [n]):
        launch()  # both under way at once
    sums = world.sum_int(np.array([(a.values * b_before).sum(), (before * b.inner).sum()]).astype(np.int64))
    assert sums[0] == sums[1]
    total = b.inner.sum()
    assert b.values.sum() == total and np.abs(b.values).sum() == np.abs(b.inner).sum()  # ghosts are zero
    fill.free()
    fold.free()


def every_case(check):
    """Run check(n, cuts, periodic, width) for all rows, cuts, walls and ghost widths."""
    for n, periodic in product(SIZES, [(True, True), (False, True), (True, False)]):
        for which, width in product(range(4), [(1, 2), (0, 1), (9, 10)]):
            check(n, which, periodic, width)


def test_fill_on_one_rank(world):
    every_case(partial(check_fill, world))


def test_fold_is_adjoint_of_fill_on_one_rank(world):
    every_case(partial(check_adjoint, world, dtype=np.float64))


@pytest.mark.mpi(min_size=2)
def test_fill_gives_ghosts_what_owners_have(world):
    every_case(partial(check_fill, world))


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("dtype", [np.int64, np.float64])
def test_fold_is_adjoint_of_fill(world, dtype):
    every_case(partial(check_adjoint, world, dtype=dtype))


def check_axes(world, ndim, leading, trailing):
    """Corners come right in three dimensions too, for fields with components before or behind."""
    domain = domain_for(world, 7, even_cuts(7, world.size), (True, True, True), ndim)
    ghosts = ((2, 1), (1, 1), (0, 2))[:ndim]
    field = Field(domain, world.rank, ghosts=ghosts, leading=leading, trailing=trailing, dtype=np.float32)
    full = np.random.default_rng(0).random((*leading, *domain.points, *trailing), np.float32)
    at = [slice(None)] * len(leading)
    low, high = field.rows
    field.inner[...] = full[(*at, slice(low, high))]
    fill = Fill(world, domain, field, Channel.FIELD)
    fill.start(3)
    fill.finish()
    pads = [(0, 0)] * len(leading) + list(ghosts) + [(0, 0)] * len(trailing)
    expected = np.pad(full, pads, mode="wrap")[(*at, slice(low, high + 3))]
    np.testing.assert_array_equal(field.values, expected)
    fill.free()


components = pytest.mark.parametrize(
    "ndim, leading, trailing",
    [(1, (), ()), (1, (2,), ()), (2, (9,), ()), (3, (), ()), (3, (19,), ()), (3, (), (3,))],
)


@components
def test_ghosts_of_all_axes_on_one_rank(world, ndim, leading, trailing):
    check_axes(world, ndim, leading, trailing)


@pytest.mark.mpi(min_size=2)
@components
def test_ghosts_of_all_axes(world, ndim, leading, trailing):
    check_axes(world, ndim, leading, trailing)


def test_one_rank_sends_nothing(world):
    cuts = even_cuts(7, world.size)
    domain = domain_for(world, 7, cuts, (True, True))
    fill = Fill(world, domain, Field(domain, world.rank, ghosts=((1, 2), (1, 1))), Channel.FIELD)
    assert (fill.sent == fill.bytes == 0) == (world.size == 1)


@pytest.mark.mpi(min_size=2)
def test_messages_are_counted(world):
    domain = domain_for(world, 9, even_cuts(9, world.size), (True, True))
    fill = Fill(world, domain, Field(domain, world.rank, ghosts=((1, 2), (1, 1))), Channel.FIELD)
    # one message to each neighbour, of three rows in all, each row with its ghosts
    assert fill.sent == min(2, world.size - 1)
    assert fill.bytes == 3 * 7 * 8
    fill.free()


def check_graph(world):
    """In a task graph Fill gives the bits that start and finish give, in any iteration."""
    domain = domain_for(world, 7, even_cuts(7, world.size), (True, True))
    fields = [Field(domain, world.rank, ghosts=((1, 2), (2, 1)), dtype=np.int64) for _ in range(2)]
    fill, plain = (Fill(world, domain, field, 2 + k) for k, field in enumerate(fields))
    rng, iterations = np.random.default_rng(1000 * world.rank), [-2, -1, 0, 1, 510, 511, 512]
    for iteration, launch in zip(iterations, run_in_graphs(world, {"phi": fill}, iterations)):
        values = rng.integers(-99, 99, fields[0].values.shape)
        for field in fields:
            field.values[...] = values
        plain.start(iteration)
        plain.finish()
        launch()
        np.testing.assert_array_equal(fields[0].values, fields[1].values)
    fill.free()
    plain.free()


def test_exchanges_in_a_task_graph_on_one_rank(world):
    check_graph(world)


@pytest.mark.mpi(min_size=2)
def test_exchanges_in_a_task_graph(world):
    check_graph(world)
