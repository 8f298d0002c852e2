"""Who owns a grain, who has a copy, and what travels with it."""

import numpy as np
import pytest
from dem_scenes import HISTORY, RADIUS, Saved, box, cloud, dem, grains

from lbmdem.grains.contact_network import contact_count
from lbmdem.grains.dem import Dem


def everybody(scene):
    """Ids of all ranks' own grains."""
    found = scene.world.gather_rows(scene.grains.ids[: scene.grains.n])
    return np.frombuffer(scene.world.bcast(None if found is None else found.tobytes()), np.int64)


def check_owners(world):
    """Each grain has one owner, the rank of its slab, within half the skin after a list; ghosts are true copies."""
    lengths = (0.8, 0.7, 0.9)
    columns = cloud(125, 3, lengths, speed=2.0)
    columns["v"][3, 2] = 900.0  # several slabs per step
    scene = dem(world, columns, HISTORY, lengths)
    low, high = (row * scene.grains.domain.spacing[0] for row in scene.grains.domain.row_range(world.rank))
    for _ in range(30):
        scene.advance(2e-4, 7)
        g = scene.grains
        np.testing.assert_array_equal(np.sort(everybody(scene)), np.arange(125))
        outside = np.maximum(low - g.x[: g.n, 2], g.x[: g.n, 2] - high)
        outside = np.minimum(outside, lengths[2] - (high - low) - outside)
        slow = g.ids[: g.n] != 3
        assert np.all(outside[slow] <= 0.51 * scene.skin)
        assert not set(g.ids[: g.n]) & set(g.ids[g.n :])
        np.testing.assert_array_equal(g.rows[: len(g.ids)], Saved(scene)["row"][g.ids])


def test_rows_are_sorted_when_many_are_out_of_place_and_it_moves_no_bit(world, monkeypatch):
    """A list made in the order that is there, in one that lies together again, and in one that is always sorted."""
    lengths, columns = (0.8, 0.7, 0.9), cloud(125, 3, (0.8, 0.7, 0.9), speed=2.0)
    found, orders = [], []
    for disorder in (0, 32, 10**6):
        monkeypatch.setattr("lbmdem.grains.grains.MAX_DISORDER", disorder)
        scene = dem(world, columns, HISTORY, lengths)
        scene.advance(2e-4, 200)
        scene.rebuild()
        scene.advance(2e-4, 5)
        found.append(Saved(scene)["row"])
        orders.append(scene.version)
    np.testing.assert_array_equal(found[1], found[0])
    np.testing.assert_array_equal(found[2], found[0])
    assert 0 == orders[0] < orders[1] < orders[2] or world.size > 1


def test_one_rank_owns_all(world):
    check_owners(world)


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("together", [0, 512])
def test_every_grain_has_one_owner_and_true_copies(world, together, monkeypatch):
    monkeypatch.setattr("lbmdem.grains.grains.MAX_REPLICATED", together)
    check_owners(world)


@pytest.mark.mpi(min_size=2)
def test_ghosts_are_all_grains_within_reach(world, monkeypatch):
    monkeypatch.setattr("lbmdem.grains.grains.MAX_REPLICATED", 0)
    lengths, reach = (0.8, 0.7, 0.9), 0.03
    columns = cloud(125, 3, lengths)
    scene = Dem(world, dem(world, columns, HISTORY, lengths).pool, box(world, lengths), columns, HISTORY, reach=reach)
    g = scene.grains
    low, high = (row * g.domain.spacing[0] for row in g.domain.row_range(world.rank))
    z, near = columns["x"][:, 2], np.zeros(125, bool)
    for shift in (-0.9, 0.0, 0.9):
        near |= np.maximum(low - z - shift, z + shift - high) < columns["radius"] + reach
    assert set(np.flatnonzero(near)) <= set(g.ids)


def test_pairs_are_those_of_the_definition(world):
    """Neighbours within the margin against all distances; each pair has one slot, in both grains' lists."""
    for d, periodic in ((2, (True, False)), (3, (False, True, True))):
        lengths = (0.4,) * d
        columns = cloud(60, d, lengths, spread=0.9)
        columns["fixed"][:20] = True
        scene = dem(world, columns, HISTORY, lengths, periodic=periodic)
        g, pairs = scene.grains, scene.list
        delta = g.x[:, None] - g.x[None]
        delta -= np.where(periodic, 0.4 * np.rint(delta / 0.4), 0.0)
        gap = np.sqrt(np.square(delta).sum(-1)) - g.radius[:, None] - g.radius[None]
        close = (gap < scene.skin) & ~(g.fixed[:, None] & g.fixed[None])
        np.fill_diagonal(close, False)
        listed = np.zeros_like(close)
        for k in range(g.n):
            begins, entries = scene.arena["begins"], scene.arena["entries"]
            entries = entries[begins[k] : begins[k + 1]]
            others = np.where(entries % 2, pairs.low[entries // 2], pairs.high[entries // 2])
            assert np.all(np.where(entries % 2, pairs.high[entries // 2], pairs.low[entries // 2]) == k)
            assert np.all(np.diff(g.ids[others]) > 0)
            listed[k, others] = True
        np.testing.assert_array_equal(listed, close)
        assert close.sum() > 30


@pytest.mark.parametrize("n", [2, 3, 4, 5])
def test_few_grains_in_a_long_box_are_listed_once(world, n):
    """A row across a periodic side, whatever the number of cells: the search has few buckets for them."""
    for side in range(n, 40):  # diameters
        x = np.full((n, 3), 0.2)
        x[:, 0] = (1.9 * RADIUS * (np.arange(n) - n // 2)) % (2.2 * RADIUS * side)
        scene = dem(world, grains(x), HISTORY, (2.2 * RADIUS * side, 0.4, 0.4))
        assert contact_count(scene) == n - 1
        assert scene.arena["begins"][scene.grains.held] == 2 * contact_count(scene)


def test_springs_find_their_pair_again(world):
    """A new list keeps every spring, whatever the order of grains."""
    scene = dem(world, cloud(64, 3, (0.4,) * 3), HISTORY, (0.4,) * 3)
    scene.advance(2e-4, 200)
    before = scene.list.stretched()
    scene.skin *= 1.7
    scene.rebuild()
    after = scene.list.stretched()
    assert contact_count(scene) > 3 or len(before[0]) > 3
    known = {tuple(key): value for key, value in zip(before[0].tolist(), before[1].tolist())}
    assert known == {tuple(key): value for key, value in zip(after[0].tolist(), after[1].tolist())}


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("together", [0, 512])
def test_state_comes_back_on_another_division(world, together, monkeypatch):
    monkeypatch.setattr("lbmdem.grains.grains.MAX_REPLICATED", together)
    """What two ranks saved goes on in halves of other sizes; no grain and no spring is lost."""
    lengths = (0.5, 0.5, 0.5)
    columns = cloud(64, 3, lengths)
    scene = dem(world, columns, HISTORY, lengths)
    scene.advance(2e-4, 150)
    saved = Saved(scene)
    uneven = box(world, lengths).with_cuts((*range(0, 2 * world.size, 2), 12))
    again = Dem(world, scene.pool, uneven, columns, HISTORY)
    again.restore(saved)
    for run in (scene, again):
        run.advance(2e-4, 100)
    assert Saved(scene).digest == Saved(again).digest


@pytest.mark.mpi(min_size=2)
def test_a_spring_between_two_ranks_comes_back_at_both(world, monkeypatch):
    """Either rank computes the contact, and a state has the spring at one of the grains."""
    monkeypatch.setattr("lbmdem.grains.grains.MAX_REPLICATED", 0)
    lengths, middle = (1.0, 1.0, 1.0), round(12 / world.size) / 12
    x = [[0.5, 0.5, middle - 0.99 * RADIUS], [0.5, 0.5, middle + 0.99 * RADIUS]]
    columns = grains(x, v=[[0.3, 0.0, 0.0], [-0.3, 0.0, 0.0]])
    scene, again = (dem(world, columns, HISTORY, lengths) for _ in range(2))
    scene.advance(2e-4, 5)
    again.restore(Saved(scene))
    for run in (scene, again):
        run.advance(2e-4, 5)
    assert np.any(Saved(scene)["spring"])
    assert Saved(scene).digest == Saved(again).digest


def test_no_grain_and_one_grain(world):
    for n in (0, 1):
        columns = grains(np.full((n, 3), 0.5)) if n else {k: v[:0] for k, v in grains(np.full((1, 3), 0.5)).items()}
        scene = dem(world, columns, HISTORY, (2.5 * RADIUS,) * 3)
        scene.advance(1e-3, 3)
        assert scene.world.sum_int(np.array([scene.grains.n]))[0] == n
        assert contact_count(scene) == 0
