import os
import subprocess
import sys
from pathlib import Path

import mpi4py
import numpy as np
import pytest

from hpcpic.core.comm.world import LauncherMismatch, NoMpi, World, check_launcher, launched_size

LAUNCHERS = ("PMI", "PMIX", "OMPI", "MPI", "HYDRA", "SLURM")


def alone():
    """The environment without what a launcher put there."""
    return {name: text for name, text in os.environ.items() if not name.startswith(LAUNCHERS)}


def test_a_launcher_of_another_mpi_is_told():
    assert launched_size({}) == 1
    assert launched_size({"PMI_SIZE": "4"}) == launched_size({"OMPI_COMM_WORLD_SIZE": "4"}) == 4
    assert launched_size({"PMIX_RANK": "2"}) == 3
    check_launcher({"PMI_SIZE": "2"}, 2, "MPICH")
    with pytest.raises(LauncherMismatch, match=r"started 2 processes, but MPICH sees 1.*Use .*mpirun") as caught:
        check_launcher({"OMPI_COMM_WORLD_SIZE": "2"}, 1, "MPICH")
    assert caught.value.exit_code == 2


def test_start_refuses_to_be_one_of_many_singletons():
    program = "from hpcpic.core.comm.world import World\nWorld.start()"
    environment = alone() | {"OMPI_COMM_WORLD_SIZE": "3", "PYTHONPATH": str(Path(__file__).parents[3])}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, timeout=50)
    assert done.returncode == 1 and "LauncherMismatch: mpirun started 3 processes" in done.stderr


@pytest.mark.parametrize("start", [World.start, World.alone])
def test_where_there_is_no_mpi_library_that_is_said(monkeypatch, start):
    monkeypatch.delattr(mpi4py, "MPI", raising=False)
    monkeypatch.setitem(sys.modules, "mpi4py.MPI", None)  # its import fails
    with pytest.raises(NoMpi, match=r"no MPI: .*pip install mpich") as caught:
        start()
    assert caught.value.exit_code == 2


@pytest.mark.skipif(launched_size(os.environ) > 1, reason="for one rank")
def test_one_rank_needs_no_communication():
    class Silent:
        """A communicator of one rank that fails when it is used."""

        def Get_rank(self):
            return 0

        def Get_size(self):
            return 1

    world = World(Silent(), Silent())
    rows = np.arange(6).reshape(3, 2)
    assert world.bcast(b"abc") == b"abc" and world.max(2.5) == 2.5 and world.any(True) and not world.any(False)
    assert np.array_equal(world.sum_int(rows), rows) and np.array_equal(world.max_array(rows), rows)
    assert np.array_equal(world.gather_rows(rows), rows)
    world.barrier()
    with world.first_on_node():
        pass
    assert world.default_threads() >= 1
    cores = sorted(os.sched_getaffinity(0))
    assert world.cpus(1) == world.cpus(len(cores)) == cores and world.cpus(len(cores) + 1) == []


def test_an_abort_ends_with_its_code_and_loses_no_text():
    program = "from hpcpic.core.comm.world import World\nw = World.start()\nprint('last words', end='')\nw.abort(4)"
    environment = alone() | {"PYTHONPATH": str(Path(__file__).parents[3])}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, timeout=50)
    assert done.returncode == 4 and "last words" in done.stdout


@pytest.mark.mpi(min_size=2)
def test_collectives_agree_on_all_ranks(world):
    for content in (b"", b"x", bytes(range(256)) * 500):
        assert world.bcast(content if world.rank == 0 else None) == content
    assert world.max(-1.0 - world.rank) == -1.0
    assert world.any(world.rank == world.size - 1) and not world.any(False)
    big = np.array([(1 << 53) + 1, world.rank], np.int64)
    total = world.sum_int(big)
    assert total.tolist() == [world.size * ((1 << 53) + 1), world.size * (world.size - 1) // 2]
    assert big[1] == world.rank  # the argument is not changed
    np.testing.assert_array_equal(world.max_array(np.array([world.rank, -world.rank])), [world.size - 1, 0])
    world.barrier()


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("shape, dtype", [((), np.float64), ((3,), np.int32), ((2, 2), np.float32), ((0,), np.int8)])
def test_gather_joins_rows_of_uneven_ranks_in_rank_order(world, shape, dtype):
    rows = np.full((world.rank, *shape), world.rank, dtype)  # rank 0 has none
    whole = world.gather_rows(rows)
    if world.rank == 0:
        expected = np.repeat(np.arange(world.size), np.arange(world.size))
        assert whole.shape == (len(expected), *shape) and whole.dtype == dtype
        assert np.all(whole == expected.reshape(-1, *(1 for _ in shape)))
    else:
        assert whole is None


@pytest.mark.mpi(min_size=2)
def test_first_on_node_comes_before_the_others(world, tmp_path):
    path = Path(world.bcast(str(tmp_path).encode()).decode(), "order")
    with world.first_on_node(), path.open("a") as file:
        file.write(f"{world.node_rank}\n")
    world.barrier()
    if world.node_size == world.size:
        assert path.read_text().startswith("0\n") and len(path.read_text().split()) == world.size


@pytest.mark.mpi(min_size=2)
def test_an_error_of_the_first_leaves_nobody_waiting(world):
    try:
        with world.first_on_node():
            if world.node_rank == 0:
                raise KeyError("compilation")
    except KeyError:
        assert world.node_rank == 0
    world.barrier()


@pytest.mark.mpi(min_size=2)
def test_ranks_of_a_node_take_different_cores_while_there_are_enough(world):
    cores = np.zeros(4096, np.int64)
    threads = world.default_threads()
    mine = world.cpus(threads)
    n_cores = len(os.sched_getaffinity(0))  # of the node, if the launcher binds no ranks
    if world.node_size * threads > n_cores:
        assert mine == []  # more workers than cores share them, unpinned
        return
    if world.node_size * threads < n_cores:
        assert set(mine) == os.sched_getaffinity(0)  # nobody is pinned
        return
    assert len(mine) == threads and set(mine) <= os.sched_getaffinity(0)
    cores[mine] += 1
    world.node.Allreduce(cores.copy(), cores)
    assert cores.sum() == world.node_size * threads and cores.max() == 1
    assert world.cpus(n_cores) == []
