import numpy as np
import pytest

from hpcpic.core.comm.sharding import by_id
from hpcpic.core.errors import Diverged
from hpcpic.core.space.domain import block_ranges


def rows(ids):
    return {"x": np.stack([ids / 3, ids / 7], 1), "cell": (ids % 11).astype(np.int16)}


LAYOUT = {"x": (np.float64, (2,)), "cell": (np.int16, ())}


def chunks(ids):
    """Of another length on each rank and for each number of ids."""
    for first in range(0, len(ids), 17):
        part = ids[first : first + 17]
        yield part, rows(part)


def check(world, total):
    everything = np.random.default_rng(total).permutation(total)
    owner = np.random.default_rng(total + 1).integers(0, world.size, total)
    ids = everything[owner == world.rank]
    result = by_id(world, chunks(ids), LAYOUT, total)
    for name, expected in rows(np.arange(*block_ranges(total, world.size)[world.rank])).items():
        np.testing.assert_array_equal(result[name], expected)
        assert result[name].dtype == expected.dtype


def check_faults(world):
    ids = np.arange(world.rank, 20, world.size)
    faults = {"lost": ids[ids != 7], "doubled": np.append(ids, 7), "no ids": np.append(ids, [20, -1])}
    for what, wrong in faults.items():
        with pytest.raises(Diverged, match=rf"[1-9]\d* (are )?{what}"):
            mine = wrong if world.rank == 7 % world.size else ids
            by_id(world, chunks(mine), LAYOUT, 20)
            # rank 7 % size alone has the fault, and all ranks are told


@pytest.mark.parametrize("total", [0, 1, 3, 7, 100])
def test_rows_come_in_id_order_on_one_rank(world, total):
    check(world, total)
    check_faults(world)


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("total", [0, 1, 3, 7, 100])
def test_rows_come_in_id_order_whoever_has_them(world, total):
    check(world, total)


@pytest.mark.mpi(min_size=2)
def test_a_lost_or_doubled_id_is_told_on_all_ranks(world):
    check_faults(world)
