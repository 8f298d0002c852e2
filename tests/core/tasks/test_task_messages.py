"""Messages as nodes of a graph: with a message-passing library of three lines, and with MPI."""

import ctypes
import os
import signal
import time

import numpy as np
import pytest

from hpcpic.core.simd.compile import njit
from hpcpic.core.tasks.graph import Graph, Pool, Stuck, TaskError, bind


@njit
def put(value, out):
    out[0] = value


@njit
def copy_first(a, out):
    out[0] = a[0]


@njit
def take_over(mine, left, turn):
    mine[0] = 3 * mine[0] + left[0] + turn


@pytest.fixture(scope="module", params=[1, 2, 3])
def pool(request):
    pool = Pool(request.param, spin_limit_s=5.0)
    yield pool
    pool.close()


class FakeRequests:
    """n requests that complete at the `polls`-th test of each start, after copying source to target."""

    def __init__(self, n=1, polls=1, code=0, source=None, target=None):
        self.n_started = self.n_tests = 0

        @ctypes.CFUNCTYPE(ctypes.c_int, *[ctypes.c_int64] * 7)
        def isend(buffer, count, datatype, peer, tag, comm, handle):
            self.tags.append(tag)
            if handle == self.handles.ctypes.data:
                self.n_started += 1
                self.left = polls
            return 0

        @ctypes.CFUNCTYPE(ctypes.c_int, *[ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p])
        def testall(count, handles, flag, statuses):
            self.n_tests += 1
            self.left -= 1
            if self.left == 0 and source is not None:
                target[:] = source
            self.flag[0] = self.left == 0
            return code

        self.handles, self.flag, self.tags = np.zeros(n + 1, np.int32), np.zeros(1, np.int32), []
        self.kept = [isend, testall]
        send, test = (ctypes.cast(f, ctypes.c_void_p).value for f in self.kept)
        self.table = np.array([[send, 0, 0, 0, 0, channel, 0] for channel in range(n)], np.int64)
        places = [a.ctypes.data for a in (self.handles, self.handles, self.flag, self.table)]
        self.record = np.array([n, *places, test, 4, 0, 1, 512, 64], np.int64)


@pytest.mark.parametrize("polls", [1, 5, 200])
def test_a_message_waits_for_its_data_and_releases_readers(pool, polls):
    a, b, c = (np.zeros(1) for _ in range(3))
    requests = FakeRequests(polls=polls, source=a, target=b)
    store_a, copy = bind(put, value=5.0, out=a), bind(copy_first, a=b, out=c)
    graph = Graph()
    graph.task(store_a, outs=["a"])
    graph.message(requests, ins=["a"], outs=["b"])
    graph.task(copy, ins=["b"], outs=["c"])
    graph.freeze()
    for value in (5.0, 6.0, 7.0):
        store_a.update(0, value)
        pool.run(graph)
        assert c[0] == value
    assert (requests.n_started, requests.n_tests) == (3, 3 * polls)


def test_no_requests_are_complete_at_once(pool):
    requests, out = FakeRequests(n=0), np.zeros(1)
    graph = Graph()
    graph.message(requests, outs=["b"])
    graph.task(bind(put, value=1.0, out=out), ins=["b"])
    pool.run(graph.freeze())
    assert out[0] == 1.0
    assert requests.n_started == 0


def test_tasks_run_while_a_message_is_on_its_way(pool):
    cells = np.zeros(1)
    requests = FakeRequests(polls=30, source=np.ones(1), target=cells)
    seen = np.zeros(1)
    graph = Graph()
    graph.message(requests, outs=["b"])
    graph.task(bind(copy_first, a=cells, out=seen))  # asks for nothing, so it need not wait
    pool.run(graph.freeze())
    assert requests.n_tests == 30
    assert seen[0] == 0.0


def test_an_error_of_the_library_is_told(pool):
    graph = Graph()
    graph.message(FakeRequests(code=15), name="halo up")
    with pytest.raises(TaskError, match="halo up returned the error code 15"):
        pool.run(graph.freeze())


@pytest.mark.parametrize("threads", [1, 2])
def test_a_message_that_never_comes_is_reported(threads):
    pool, out = Pool(threads, spin_limit_s=0.1), np.zeros(1)
    graph = Graph()
    graph.message(FakeRequests(polls=10**9), outs=["b"], name="from rank 3")
    graph.message(FakeRequests(polls=2), name="from rank 2")
    graph.task(bind(put, value=1.0, out=out), ins=["b"])
    pool.run(Graph().freeze())
    assert graph.freeze().address  # all is compiled
    begin = time.monotonic()
    with pytest.raises(Stuck, match="from rank 3") as stuck:
        pool.run(graph)
    assert stuck.value.pending == ["from rank 3"]
    assert 0.1 <= time.monotonic() - begin < 5.0
    assert out[0] == 0.0
    pool.close()


def test_a_process_that_was_suspended_has_not_waited():
    """The time until it goes on counts for nothing, and what comes after it does."""
    pool, graph = Pool(1, spin_limit_s=1.0), Graph()
    graph.message(FakeRequests(polls=10**9), name="from rank 3")
    graph.freeze()
    child = os.fork()
    if child == 0:
        try:
            pool.run(graph)
        except Stuck:
            os._exit(7)
        os._exit(0)
    time.sleep(0.3)
    os.kill(child, signal.SIGSTOP)
    time.sleep(2.0)
    begin = time.monotonic()
    os.kill(child, signal.SIGCONT)
    _, status = os.waitpid(child, 0)
    assert os.waitstatus_to_exitcode(status) == 7
    assert time.monotonic() - begin > 0.3
    pool.close()


@pytest.mark.mpi(min_size=2)
def test_a_ring_of_messages_in_a_graph():
    from mpi4py import MPI

    from hpcpic.core.comm.messages import Message, Messages
    from hpcpic.core.comm.world import World

    world, rounds = World.start(), 40
    mine, left = np.full(1, world.rank, np.int64), np.zeros(1, np.int64)
    right_rank, left_rank = (world.rank + 1) % world.size, (world.rank - 1) % world.size
    messages = Messages(world.comm, sends=[Message(right_rank, 5, mine)], receives=[Message(left_rank, 5, left)])
    own, copies = np.zeros(1), np.zeros(1)
    graph = Graph()
    for turn in range(rounds):
        graph.message(messages, ins=["mine"], outs=["left"], name=f"ring {turn}")
        graph.task(bind(take_over, mine=mine, left=left, turn=turn), ins=["left"], inouts=["mine"])
        for _ in range(3):  # work that needs no message
            graph.task(bind(copy_first, a=own, out=copies), inouts=["own"])
    graph.freeze()
    pool = Pool(2, spin_limit_s=30.0)
    expected = np.arange(world.size)
    for _ in range(20):
        pool.run(graph)
        for turn in range(rounds):
            expected = 3 * expected + np.roll(expected, 1) + turn
        wrong = world.comm.allreduce(int(mine[0] != expected[world.rank]), MPI.SUM)
        assert wrong == 0
    pool.close()
