import gc
import os
import time
import weakref

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hpcpic.core.simd.compile import njit
from hpcpic.core.tasks.graph import RAISED, Graph, Pool, TaskError, bind

N_CELLS = 5


@njit
def mix(cells, reads, writes, number, work):
    """cells[w] = 3 cells[w] + sum of what is read + number: another order of conflicting tasks shows."""
    total = number
    for k in range(reads.size):
        total += cells[reads[k]]
    for k in range(work):  # give other threads the time to come between
        total += (total >> 63) & k
    for k in range(writes.size):
        cells[writes[k]] = 3 * cells[writes[k]] + total


@njit
def set_item(log, count, value):
    """Append the value to the log; for one thread."""
    log[count[0]] = value
    count[0] += 1


@njit
def answer(code, ran):
    ran[0] += 1
    return code


@njit
def refuse(x):
    if x[0] >= 0.0:
        raise ValueError
    return 0


@pytest.fixture(scope="module", params=[1, 2, 3])
def pool(request):
    pool = Pool(request.param, spin_limit_s=5.0)
    yield pool
    pool.close()


# ---- dependences

subsets = st.sets(st.integers(0, N_CELLS - 1), max_size=3)
accesses = st.lists(st.tuples(subsets, subsets, subsets, st.sampled_from([0, 0, 1])), min_size=1, max_size=25)


def build(tasks, cells, work):
    graph = Graph()
    for number, (ins, outs, inouts, priority) in enumerate(tasks):
        reads, writes = (np.array(sorted(cells_), np.int64) for cells_ in (ins | inouts, outs | inouts))
        bound = bind(mix, cells=cells, reads=reads, writes=writes, number=number, work=work)
        graph.task(bound, ins=ins, outs=outs, inouts=inouts, priority=priority)
    return graph.freeze()


@np.errstate(over="ignore")
def serially(tasks, cells):
    for number, (ins, outs, inouts, _) in enumerate(tasks):
        total = number + sum(cells[k] for k in ins | inouts)
        for k in outs | inouts:
            cells[k] = 3 * cells[k] + total
    return cells


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(accesses, st.sampled_from([0, 300]))
def test_every_schedule_gives_the_serial_result(pool, tasks, work):
    cells = np.zeros(N_CELLS, np.int64)
    graph = build(tasks, cells, work)
    expected = serially(tasks, np.arange(N_CELLS))
    for _ in range(3):
        cells[:] = np.arange(N_CELLS)
        pool.run(graph)
        np.testing.assert_array_equal(cells, expected)


@settings(max_examples=100)
@given(accesses)
def test_conflicting_tasks_are_ordered_and_others_are_not(tasks):
    graph = build(tasks, np.zeros(N_CELLS, np.int64), 0)
    n = len(tasks)
    reach = np.zeros((n, n), bool)
    for a in reversed(range(n)):
        for b in graph._successors[a]:
            reach[a, b] = True
            reach[a] |= reach[b]
    wanted = np.zeros((n, n), bool)
    for b in range(n):
        for a in range(b):
            reads, writes = ([t[k] | t[2] for t in (tasks[a], tasks[b])] for k in (0, 1))
            wanted[a, b] = bool(writes[0] & (reads[1] | writes[1]) or reads[0] & writes[1])
    for middle in range(n):  # transitive closure
        wanted |= np.outer(wanted[:, middle], wanted[middle])
    np.testing.assert_array_equal(reach, wanted)


def test_long_chain_and_wide_graph_many_launches(pool):
    cells = np.zeros(N_CELLS, np.int64)
    rng = np.random.default_rng(1)
    tasks = [(set(rng.integers(0, 5, 2)), set(), {int(rng.integers(5))}, 0) for _ in range(300)]
    graph = build(tasks, cells, 0)
    expected = serially(tasks, np.zeros(N_CELLS, np.int64))
    for _ in range(200):
        cells[:] = 0
        pool.run(graph)
        np.testing.assert_array_equal(cells, expected)


def test_sleeping_workers_come_back():
    pool = Pool(2, cpus=range(2) if len(os.sched_getaffinity(0)) > 1 else None)
    cells = np.zeros(N_CELLS, np.int64)
    graph = build([(set(), set(), {k % N_CELLS}, 0) for k in range(40)], cells, 20000)
    for pause in (0.0, 1e-5, 1e-4, 1e-3, 1e-2):
        cells[:] = 1
        time.sleep(pause)
        pool.run(graph)
        np.testing.assert_array_equal(cells, serially([(set(), set(), {k % N_CELLS}, 0) for k in range(40)], [1] * 5))
    pool.close()


def test_urgent_tasks_come_first():
    pool, log, count = Pool(1), np.zeros(6, np.int64), np.zeros(1, np.int64)
    graph = Graph()
    for value, priority in enumerate([0, 0, 1, 0, 1, 0]):
        graph.task(bind(set_item, log=log, count=count, value=value), priority=priority)
    pool.run(graph.freeze())
    assert list(log) == [2, 4, 0, 1, 3, 5]


def test_empty_graph_runs(pool):
    pool.run(Graph().freeze())


def test_frozen_graph_takes_no_more_tasks(pool):
    ran = np.zeros(1, np.int64)
    graph = Graph()
    graph.task(bind(answer, code=0, ran=ran))
    with pytest.raises(ValueError, match="freeze"):
        pool.run(graph)
    graph.freeze()
    with pytest.raises(ValueError, match="frozen"):
        graph.task(bind(answer, code=0, ran=ran))


def test_each_runs_all_and_keeps_the_graph(pool):
    ran = np.zeros((20, 1), np.int64)
    bounds = [bind(answer, code=0, ran=row) for row in ran]
    for _ in range(5):
        pool.each(bounds)
    assert (ran == 5).all()
    assert len(bounds[0].graphs) == 1
    pool.each([])


def test_a_pool_keeps_nothing_of_tasks_that_are_gone(pool):
    ran = np.zeros(2, np.int64)
    bounds = [bind(answer, code=0, ran=ran[k:]) for k in range(2)]
    pool.each(bounds)
    gone = [weakref.ref(bound) for bound in bounds]
    del bounds
    gc.collect()
    assert [bound() for bound in gone] == [None, None] and list(ran) == [1, 1]


# ---- failures


def test_first_code_is_told_and_the_rest_skipped(pool):
    ran = np.zeros(3, np.int64)
    graph = Graph()
    for place, code in enumerate((0, 7, 0)):
        graph.task(bind(answer, code=code, ran=ran[place:]), inouts=["chain"], name=f"link {place}")
    graph.freeze()
    for launch in (1, 2):
        with pytest.raises(TaskError, match="link 1 returned the error code 7") as error:
            pool.run(graph)
        assert (error.value.name, error.value.code) == ("link 1", 7)
        assert list(ran) == [launch, launch, 0]


def test_an_exception_in_a_kernel_is_not_lost(pool):
    bound = bind(refuse, x=np.zeros(1))
    with pytest.raises(TaskError, match="refuse raised an exception") as error:
        pool.each([bound])
    assert error.value.code == RAISED


@njit
def sometimes_nothing(x):
    if x > 0:
        return 1


@njit
def a_float(x):
    return 1.5


@pytest.mark.parametrize(
    "kernel, argument, match",
    [
        (answer, np.zeros((4, 4))[:, 1], "contiguous"),
        (answer, "text", "not str"),
        (answer, 1j, "not complex"),
        (a_float, 1, "integer code or nothing"),
        (sometimes_nothing, 1, "integer code or nothing"),
    ],
)
def test_unfit_kernels_and_arguments_are_refused(kernel, argument, match):
    arguments = {"code": 0, "ran": argument} if kernel is answer else {"x": argument}
    with pytest.raises(TypeError, match=match):
        assert bind(kernel, **arguments).address


@pytest.mark.parametrize("names", ["code", "code run", "code ran x"])
def test_arguments_go_by_name_and_none_is_left_out(names):
    with pytest.raises(TypeError, match="answer takes code, ran, not"):
        bind(answer, **dict.fromkeys(names.split(), 0))


# ---- arguments


@njit
def accept(array, out):
    """Sum of the elements, each times its place, as float64."""
    total = 0.0
    for place, value in enumerate(array.flat):
        total += (place + 1) * value
    out[0] = total


DTYPES = ["bool", "int8", "uint8", "int16", "int32", "uint32", "int64", "uint64", "float32", "float64"]


SHAPES = [(7,), (2, 3, 2), (0,), ()]


@pytest.mark.parametrize("dtype, shape", [(d, (3, 4)) for d in DTYPES] + [("float64", s) for s in SHAPES])
def test_arrays_of_every_dtype_arrive(dtype, shape):
    array = np.arange(np.prod(shape, dtype=int)).reshape(shape).astype(dtype)
    out = np.full(1, np.nan)
    with_threads(lambda pool: pool.each([bind(accept, array=array, out=out)]))
    assert out[0] == (np.arange(1, array.size + 1) * array.ravel().astype(float)).sum()


def with_threads(action):
    pool = Pool(1)
    action(pool)
    pool.close()


@njit
def echo(value, out):
    out[0] = value


@pytest.mark.parametrize(
    "value",
    [3, -3, 2**62, 1.5, True, False, *(np.dtype(d).type(v) for d in DTYPES for v in (0, 1, 100))],
    ids=lambda v: f"{type(v).__name__}-{v}",
)
def test_scalars_of_every_dtype_arrive(value):
    out = np.zeros(1, np.asarray(value).dtype)
    with_threads(lambda pool: pool.each([bind(echo, value=value, out=out)]))
    assert out[0] == value


def test_many_arguments_of_mixed_kinds_arrive():
    @njit(cache=False)
    def all_kinds(a, i, x, b, s, f, c, j, y):
        a[0] = i + x + b + s[1, 2] + f + c[0] + j + y

    pool, a, s, c = Pool(1), np.zeros(2), np.arange(6).reshape(2, 3), np.array([7], np.uint8)
    pool.each([bind(all_kinds, a=a, i=1, x=2.5, b=True, s=s, f=np.float32(0.25), c=c, j=np.int32(-3), y=100.0)])
    assert a[0] == 1 + 2.5 + 1 + 5 + 0.25 + 7 - 3 + 100


def test_update_replaces_scalars_and_arrays_between_launches():
    pool, first, second = Pool(1), np.zeros(1), np.zeros(1)
    bound = bind(echo, value=1.0, out=first)
    bounds = [bound]
    bound.update(0, 7)  # becomes float64, as bound
    pool.each(bounds)
    bound.update(0, 2.5)
    bound.update(1, second)
    pool.each(bounds)
    assert (first[0], second[0]) == (7.0, 2.5)
    with pytest.raises(TypeError, match="argument 1"):
        bound.update(1, np.zeros(1, np.int64))


@njit
def busy(rounds, out):
    for _ in range(rounds):
        out[0] += 1.0
    return 0


def test_a_long_task_is_not_stuck():
    pool, out = Pool(2, spin_limit_s=0.02), np.zeros(1)
    graph = Graph()
    graph.task(bind(busy, rounds=300_000_000, out=out), inouts=["a"])  # about 0.3 s
    graph.task(bind(busy, rounds=1, out=out), inouts=["a"])
    pool.run(graph.freeze())
    assert out[0] == 300_000_001
    pool.close()


# ---- threads and cores


def test_workers_are_pinned_and_the_caller_is_released():
    before = os.sched_getaffinity(0)
    cores = sorted(before)[:2]
    pool = Pool(len(cores), cpus=cores)
    pool.run(Graph().freeze())
    assert os.sched_getaffinity(0) == {cores[0]}
    pool.close()
    assert os.sched_getaffinity(0) == before
    pool.close()


def test_shared_cores_are_not_pinned_nor_more_than_are_needed():
    before = os.sched_getaffinity(0)
    for cpus in (None, [], [0, 0], [0, 1, 2]):
        pool = Pool(2, cpus=cpus)
        pool.run(Graph().freeze())
        assert os.sched_getaffinity(0) == before
        pool.close()


def test_a_system_that_refuses_to_pin_threads_ends_no_run(monkeypatch):
    def refuse(*_):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setaffinity", refuse)
    Pool(2, cpus=[0, 1]).close()
