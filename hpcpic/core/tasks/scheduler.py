"""The compiled worker of task graphs: takes ready tasks, calls them, releases their successors.

Worker threads live in `serve`, one call without the GIL: they spin for a moment after a launch and sleep on a
semaphore afterwards. A launch never waits for a sleeper: whoever comes late finds it closed.

A graph is handed over as int64 words: [n_tasks, addresses of the arrays below].
  functions[n]     adapter address; 0 for a message, whose context is the record of its requests
  contexts[n]      argument of the adapter
  first[n] urgent[n]   number of predecessors; 1 for boundary tasks and messages
  successor_start[n + 1], successors[...]
  waiting[n]       predecessors not yet done
  queue[2 (n + 1)] ready tasks in order, normal then urgent, -1 where none is yet
  pending[n]       messages on their way
  counters         see below, one cache line each
"""

from typing import NamedTuple

import numpy as np

from hpcpic.core.simd.atomics import (
    atomic_add,
    atomic_cas,
    atomic_load,
    atomic_store,
    call_address,
    call_message,
    call_testall,
    cpu_pause,
    load_int32,
    load_word,
    nanoseconds,
    sched_yield,
    semaphore_post,
    semaphore_wait,
    store_word,
)
from hpcpic.core.simd.compile import njit

LINE = 8  # int64 words in a cache line

# counters of a graph
HEAD, TAIL = 0, 2 * LINE  # of the normal queue; + LINE of the urgent one
REMAINING = 4 * LINE
STOP = 5 * LINE  # 0 running, else one of the two below
N_PENDING = 6 * LINE
ERROR, ERROR_TASK = 7 * LINE, 8 * LINE
N_COUNTERS = 9 * LINE
FAILED, STUCK = 1, 2

# words of a set of messages: n; addresses of handles, statuses, flag, table and MPI_Testall; bytes of a handle; the
# iteration and what a start adds to it; the tag is (iteration % the first of the last two words) * the second + channel
MESSAGE_WORDS = 7  # a row of its table: MPI_Isend or MPI_Irecv, buffer, count, datatype, peer, channel, communicator

# words of a pool
GENERATION = 0  # launches so far, -1 at the end
OPEN = LINE  # whether workers may enter the launch
INSIDE = 2 * LINE  # workers in it, the caller not counted
MESSAGE_LOCK = 3 * LINE  # one thread at a time calls MPI
GRAPH = 4 * LINE  # address of the graph's words
THREADS, IDLE_ROUNDS, LINGER_NS, LIMIT_NS = 5 * LINE, 5 * LINE + 1, 5 * LINE + 2, 5 * LINE + 3
WORKERS = 6 * LINE  # a block for each worker:
RUNNING, ASLEEP, SEMAPHORE = 0, LINE, 2 * LINE
WORKER_WORDS = 4 * LINE

_CLOCK_ROUNDS = 1024  # idle rounds between two looks at the clock


class _Words(NamedTuple):
    """Tasks of a graph, and the addresses of its arrays: compiled three times as fast as with arrays."""

    n: int
    functions: int
    contexts: int
    first: int
    urgent: int
    successor_start: int
    successors: int
    waiting: int
    queue: int
    pending: int
    counters: int


@njit
def _words(w):
    return _Words(
        load_word(w, 0), load_word(w, 1), load_word(w, 2), load_word(w, 3), load_word(w, 4), load_word(w, 5),
        load_word(w, 6), load_word(w, 7), load_word(w, 8), load_word(w, 9), load_word(w, 10),
    )  # fmt: skip


@njit
def _push(g, task):
    lane = load_word(g.urgent, task)
    slot = atomic_add(g.counters, TAIL + LINE * lane, 1)
    atomic_store(g.queue, lane * (g.n + 1) + slot, task)


@njit
def _take(g, lane):
    """A ready task, or -1."""
    while True:
        slot = atomic_load(g.counters, HEAD + LINE * lane)
        task = atomic_load(g.queue, lane * (g.n + 1) + slot)
        if task < 0 or atomic_cas(g.counters, HEAD + LINE * lane, slot, slot + 1):
            return task


@njit
def _complete(g, task):
    for k in range(load_word(g.successor_start, task), load_word(g.successor_start, task + 1)):
        successor = load_word(g.successors, k)
        if atomic_add(g.waiting, successor, -1) == 1:
            _push(g, successor)
    atomic_add(g.counters, REMAINING, -1)


@njit
def _fail(g, task, code):
    if atomic_cas(g.counters, ERROR, 0, code):
        atomic_store(g.counters, ERROR_TASK, task)
    atomic_cas(g.counters, STOP, 0, FAILED)


@njit
def _poll(g):
    """Complete the messages that have arrived; the caller holds the message lock."""
    k = 0
    while k < load_word(g.counters, N_PENDING):
        task = load_word(g.pending, k)
        record = load_word(g.contexts, task)
        flag = load_word(record, 3)
        n, requests, statuses = load_word(record, 0), load_word(record, 1), load_word(record, 2)
        code = call_testall(load_word(record, 5), n, requests, flag, statuses)
        if code != 0:
            _fail(g, task, np.int64(code))
            return
        if load_int32(flag) == 0:
            k += 1
            continue
        last = load_word(g.counters, N_PENDING) - 1
        store_word(g.pending, k, load_word(g.pending, last))
        atomic_store(g.counters, N_PENDING, last)
        _complete(g, task)


@njit
def _idle(pool, rounds):
    """Wait for a moment; give the core away when it has been long. The rounds so far."""
    if rounds < load_word(pool, IDLE_ROUNDS):
        cpu_pause()
    else:
        sched_yield()
    return rounds + 1


@njit
def start_messages(record):
    """Start the messages of the set at an address under the tag of its iteration, and go on to the next; the first
    error code, or 0.
    """
    iteration = load_word(record, 7)
    first = (iteration % load_word(record, 9)) * load_word(record, 10)
    store_word(record, 7, iteration + load_word(record, 8))
    for k in range(load_word(record, 0)):
        row = load_word(record, 4) + 8 * MESSAGE_WORDS * k
        request = load_word(record, 1) + load_word(record, 6) * k
        code = call_message(
            load_word(row, 0), load_word(row, 1), load_word(row, 2), load_word(row, 3), load_word(row, 4),
            first + load_word(row, 5), load_word(row, 6), request,
        )  # fmt: skip
        if code != 0:
            return code
    return 0


@njit
def _start(g, task, pool):
    record = load_word(g.contexts, task)
    if load_word(record, 0) == 0:
        _complete(g, task)
        return
    rounds = 0
    while not atomic_cas(pool, MESSAGE_LOCK, 0, 1):
        rounds = _idle(pool, rounds)
    code = start_messages(record)
    if code != 0:
        _fail(g, task, code)
    else:
        n = load_word(g.counters, N_PENDING)
        store_word(g.pending, n, task)
        atomic_store(g.counters, N_PENDING, n + 1)
    atomic_store(pool, MESSAGE_LOCK, 0)


@njit
def _anybody_running(pool):
    for worker in range(load_word(pool, THREADS)):
        if atomic_load(pool, WORKERS + WORKER_WORDS * worker + RUNNING):
            return True
    return False


@njit
def _look(g, pool, remaining, since, seen):
    """At the clock: end the launch when nothing has happened for too long. For the next look: how many tasks remain,
    since when, and the time.
    """
    now = nanoseconds()
    left = atomic_load(g.counters, REMAINING)
    if left != remaining or _anybody_running(pool):
        since = now
    elif now - seen > load_word(pool, LIMIT_NS) // 2:
        since += now - seen  # the process was suspended
    elif now - since > load_word(pool, LIMIT_NS):
        atomic_cas(g.counters, STOP, 0, STUCK)
    return left, since, now


@njit
def _work(g, pool, worker):
    """Run tasks until none remains, one failed, or nothing has happened for too long."""
    running = WORKERS + WORKER_WORDS * worker + RUNNING
    idle = 0
    due = True  # a poll: not straight after another poll or a start, while there are tasks
    remaining, since, seen = -1, 0, 0  # see `_look`
    while atomic_load(g.counters, REMAINING) > 0 and atomic_load(g.counters, STOP) == 0:
        task = _take(g, 1)
        if task < 0 and due and atomic_load(g.counters, N_PENDING) > 0 and atomic_cas(pool, MESSAGE_LOCK, 0, 1):
            _poll(g)
            atomic_store(pool, MESSAGE_LOCK, 0)
            due = False
            task = _take(g, 1)
        if task < 0:
            task = _take(g, 0)
        if task >= 0:
            idle, remaining = 0, -1
            function = load_word(g.functions, task)
            if function == 0:
                _start(g, task, pool)
                due = False
                continue
            due = True
            atomic_store(pool, running, 1)
            code = call_address(function, load_word(g.contexts, task))
            atomic_store(pool, running, 0)
            if code != 0:
                _fail(g, task, code)
            else:
                _complete(g, task)
            continue
        due = True
        idle = _idle(pool, idle)
        if idle % _CLOCK_ROUNDS == 0:
            remaining, since, seen = _look(g, pool, remaining, since, seen)


@njit
def _reset(g):
    for k in range(N_COUNTERS):
        store_word(g.counters, k, 0)
    for k in range(2 * (g.n + 1)):
        store_word(g.queue, k, -1)
    for task in range(g.n):
        before = load_word(g.first, task)
        store_word(g.waiting, task, before)
        if before == 0:
            _push(g, task)
    store_word(g.counters, REMAINING, g.n)


@njit
def _wake(pool, generation, others):
    """Announce a generation; the workers that spin see it, the sleepers are woken."""
    atomic_store(pool, GENERATION, generation)
    for worker in range(1, others + 1):
        mine = WORKERS + WORKER_WORDS * worker
        if atomic_cas(pool, mine + ASLEEP, 1, 0):
            semaphore_post(pool + 8 * (mine + SEMAPHORE))


@njit
def _next_generation(pool, worker, seen):
    """Wait for a generation other than the one seen: spin for a while, then sleep."""
    asleep = WORKERS + WORKER_WORDS * worker + ASLEEP
    semaphore = pool + 8 * (WORKERS + WORKER_WORDS * worker + SEMAPHORE)
    since = nanoseconds()
    while atomic_load(pool, GENERATION) == seen:
        if nanoseconds() - since < load_word(pool, LINGER_NS):
            cpu_pause()
            continue
        atomic_store(pool, asleep, 1)
        if atomic_load(pool, GENERATION) != seen and atomic_cas(pool, asleep, 1, 0):
            break
        while semaphore_wait(semaphore) != 0:  # interrupted by a signal
            pass
    return atomic_load(pool, GENERATION)


@njit
def launch(pool, graph):
    """Run the graph with worker 0 (the caller) and the others that come in time; 0, FAILED or STUCK. Addresses."""
    g = _words(graph)
    _reset(g)
    store_word(pool, GRAPH, graph)
    others = min(load_word(pool, THREADS), g.n) - 1
    if others > 0:
        atomic_store(pool, OPEN, 1)
        _wake(pool, load_word(pool, GENERATION) + 1, others)
    _work(g, pool, 0)
    if others > 0:
        atomic_store(pool, OPEN, 0)
        rounds = 0
        while atomic_load(pool, INSIDE) > 0:
            rounds = _idle(pool, rounds)
    return load_word(g.counters, STOP)


@njit
def serve(pool, worker):
    """Life of a worker but the caller: enter each launch that is open, linger, sleep; ends at a negative generation."""
    seen = 0
    while True:
        seen = _next_generation(pool, worker, seen)
        if seen < 0:
            return
        atomic_add(pool, INSIDE, 1)
        if atomic_load(pool, OPEN):  # after INSIDE: the launcher waits for us, or we see it closed
            _work(_words(load_word(pool, GRAPH)), pool, worker)
        atomic_add(pool, INSIDE, -1)


@njit
def dismiss(pool):
    """Tell all workers to leave `serve`."""
    _wake(pool, -1, load_word(pool, THREADS) - 1)
