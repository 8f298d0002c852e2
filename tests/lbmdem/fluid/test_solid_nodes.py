"""Nodes inside grains: marked at once or kept up to date, the same."""

import numpy as np
import pytest

from hpcpic.core.space.domain import Domain
from hpcpic.core.tasks.graph import Pool
from lbmdem.fluid.solid_nodes import Solid, Table, Window, kernel_axes

N = 24


def window(dimensions, rank, periodic=True):
    box = Domain((1.0,) * dimensions, (N,) * dimensions, (periodic,) * dimensions, (0, 7, 7, N))
    return Window.of(box, rank, ((1, 1),) * dimensions)


def table(ids, x, radii):
    return Table(ids, kernel_axes(x), radii, np.zeros((len(ids), 6)))


def inner(place):
    mask = np.zeros(place.shape[::-1], bool)
    mask[tuple(slice(*place.inner[axis]) for axis in (2, 1, 0))] = True
    return mask


def some_grains(dimensions, count=40):
    """Many of them overlap, some are at the seams; ids with gaps."""
    rng = np.random.default_rng(dimensions)
    x, v = rng.uniform(0, N, (count, dimensions)), rng.normal(0, 0.4, (count, dimensions))
    return 3 * np.arange(count), x, rng.uniform(0.3, 4.5, count), v, rng


@pytest.mark.parametrize("periodic", [True, False])
@pytest.mark.parametrize("rank", [0, 1, 2])
@pytest.mark.parametrize("dimensions", [2, 3])
def test_an_update_gives_what_marking_anew_gives(dimensions, rank, periodic):
    place = window(dimensions, rank, periodic)
    nodes = np.full(place.shape[::-1], -1, np.int32)
    nodes[..., 5] = -2  # a wall, which stays
    fresh = nodes.copy()
    kept, marked = Solid(place, nodes, Pool(1)), Solid(place, fresh, Pool(1))
    ids, x, radii, v, rng = some_grains(dimensions)
    kept.rebuild(table(ids, x, radii))
    for _ in range(25):
        before = nodes.copy()
        x = (x + v) % N
        here = rng.random(len(ids)) < 0.95  # grains come and go
        change = kept.update(table(ids[here], x[here], radii[here]))
        kept.settle()
        marked.rebuild(table(ids[here], x[here], radii[here]))
        assert np.array_equal(nodes, fresh)
        own = inner(place)
        assert np.array_equal(np.sort(change.uncovered), np.flatnonzero((before >= 0) & (nodes == -1) & own))
        assert np.array_equal(np.sort(change.covered), np.flatnonzero((before == -1) & (nodes >= 0) & own))
        assert np.array_equal(before.reshape(-1)[change.uncovered], change.left_by)
        assert np.array_equal(nodes.reshape(-1)[change.covered], change.taken_by)


@pytest.mark.parametrize("dimensions", [2, 3])
def test_slabs_see_what_the_whole_box_sees(dimensions):
    """Nodes are inside or not by the same arithmetic on every rank; the lowest id has a node that several claim."""
    ids, x, radii, _, _ = some_grains(dimensions)
    parts = []
    for rank in range(3):
        place = window(dimensions, rank)
        nodes = np.full(place.shape[::-1], -1, np.int32)
        Solid(place, nodes, Pool(1)).rebuild(table(ids, x, radii))
        parts.append(nodes[inner(place)].reshape(-1, *(N,) * (dimensions - 1)))
    grid = np.stack(np.meshgrid(*[np.arange(N)] * dimensions, indexing="ij"), axis=-1)[..., ::-1]
    wanted = np.full((N,) * dimensions, -1)
    for number, centre, radius in list(zip(ids, x, radii))[::-1]:
        d = grid - centre
        d -= N * np.rint(d / N)
        wanted[np.sum(d * d, axis=-1) <= radius**2] = number
    assert np.array_equal(np.concatenate(parts), wanted)
