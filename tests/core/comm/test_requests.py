import ctypes

import numpy as np
import pytest

from hpcpic.core.comm.requests import RequestSet
from hpcpic.core.comm.tags import tag


def ring(world, iteration=0):
    """A message to the next rank, one from the previous, as one set; with the two buffers."""
    out, into = np.zeros(1000), np.zeros(1000)
    label = tag(iteration, 40)
    following, previous = (world.rank + 1) % world.size, (world.rank - 1) % world.size
    requests = [world.comm.Recv_init(into, previous, label), world.comm.Send_init(out, following, label)]
    return RequestSet(requests), out, into


def test_no_requests_are_always_complete():
    requests = RequestSet([])
    assert requests.record.dtype == np.int64 and requests.record.shape == (6,) and requests.record[0] == 0
    assert np.all(requests.record[1:] != 0) and len(requests) == 0
    requests.start()
    assert requests.test()
    requests.wait()
    requests.free()


def test_a_rank_can_send_to_itself(world):
    """With one rank too: persistent messages through MPI_COMM_SELF, started and tested by address."""
    from mpi4py import MPI

    out, into = np.arange(5.0), np.zeros(5)
    requests = RequestSet([MPI.COMM_SELF.Recv_init(into, 0, 3), MPI.COMM_SELF.Send_init(out, 0, 3)])
    start_and_test_by_address(requests)
    np.testing.assert_array_equal(into, out)
    requests.free()
    assert requests.record[0] == 0


def start_and_test_by_address(requests):
    """What compiled code does with the record."""
    n, handles, statuses, flag, start_all, test_all = map(int, requests.record)
    start = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_int, ctypes.c_void_p)(start_all)
    test = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_int, *[ctypes.c_void_p] * 3)(test_all)
    assert start(n, handles) == 0
    done = ctypes.c_int32.from_address(flag)
    done.value = 0
    while not done.value:
        assert test(n, handles, flag, statuses) == 0


@pytest.mark.mpi(min_size=2)
def test_sets_are_replayed_from_python_and_by_address(world):
    requests, out, into = ring(world)
    for turn in range(6):
        out[:] = 100 * turn + world.rank
        if turn % 2:
            requests.start()
            requests.wait()
        else:
            start_and_test_by_address(requests)
        assert np.all(into == 100 * turn + (world.rank - 1) % world.size)
    requests.start()
    while not requests.test():
        pass
    requests.free()
