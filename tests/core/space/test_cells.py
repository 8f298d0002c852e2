import numpy as np
import pytest

from hpcpic.core.space.cells import CellList

LOW, HIGH = np.array([-1.0, 0.0, 2.0]), np.array([1.0, 1.5, 3.0])


def brute_force(x, radius, lengths, periodic):
    d = x[:, None] - x[None]
    d -= np.where(periodic, lengths * np.rint(d / lengths), 0.0)
    close = (d**2).sum(-1) < radius**2
    np.fill_diagonal(close, False)
    return {tuple(pair) for pair in np.argwhere(close)}


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("wraps", [(False, False, False), (True, True, True), (True, False, True)])
@pytest.mark.parametrize("size", [0.05, 0.21, 0.33])
def test_pairs_are_those_of_brute_force(dim, wraps, size):
    rng = np.random.default_rng(dim)
    low, high, periodic = LOW[:dim], HIGH[:dim], np.array(wraps[:dim])
    x = rng.uniform(low, high, (300, dim))
    x[:4] = [low, low, np.nextafter(high, low), (low + high) / 2]  # corners, and two in one place
    cells = CellList(low, high, size, periodic)
    cells.build(x, np.arange(300))
    found = cells.pairs(size)
    assert len({tuple(pair) for pair in found}) == len(found)
    assert {tuple(pair) for pair in found} == brute_force(x, size, high - low, periodic)


def test_order_is_by_cell_then_id_however_points_come():
    rng = np.random.default_rng(0)
    x, ids = rng.uniform(0, 1, (500, 2)), rng.permutation(500)
    shuffle = rng.permutation(500)
    cells, again = (CellList((0, 0), (1, 1), 0.2, (False, False)) for _ in range(2))
    cells.build(x, ids)
    again.build(x[shuffle], ids[shuffle])
    np.testing.assert_array_equal(ids[cells.order], ids[shuffle][again.order])
    assert cells.start[0] == 0 and cells.start[-1] == 500 and len(cells.cells) == 25
    for cell, a, b in zip(cells.cells, cells.start[:-1], cells.start[1:]):
        members = cells.order[a:b]
        assert np.all(np.floor(x[members] * 5) @ [5, 1] == cell) and np.all(np.diff(ids[members]) > 0)


def test_empty_cells_cost_nothing():
    cells = CellList((0, 0, 0), (1e5, 1e5, 1e5), 0.1, (False,) * 3)  # 10^18 cells
    cells.build(np.array([[0.01, 0.01, 0.01], [0.05, 0.01, 0.01], [9e4, 9e4, 9e4]]), np.arange(3))
    assert len(cells.cells) == 2 and len(cells.pairs(0.1)) == 2


def test_limits_are_told():
    with pytest.raises(ValueError, match="periodic"):
        CellList((0, 0), (1, 1), 0.4, (True, False))
    cells = CellList((0, 0), (1, 1), 0.2, (True, False))
    cells.build(np.zeros((0, 2)), np.zeros(0, np.int64))
    assert cells.pairs(0.2).shape == (0, 2)
    with pytest.raises(ValueError, match="radius"):
        cells.pairs(0.3)
    with pytest.raises(ValueError, match="numbered"):
        CellList((0, 0, 0), (1e9,) * 3, 0.1, (False,) * 3)
