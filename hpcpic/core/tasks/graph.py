"""Tasks with data dependences (the rule of OmpSs-2), run by pinned threads that stay outside the GIL.

A step is a graph built once and replayed. Kernels are compiled functions that return an error code; messages
are nodes of the same graph that hold no core (the idea of TAMPI: Sala et al. 2019). The order of execution is
free within the dependences, so a graph must not let results depend on it.
"""

import ctypes
import inspect
import os
import threading
import weakref
from collections.abc import Callable, Collection, Hashable, Iterable, Sequence
from contextlib import suppress
from functools import cache
from itertools import chain
from typing import Any, Protocol

import numpy as np
from numba import typeof, types
from numba.core.registry import cpu_target
from numba.np.numpy_support import as_dtype, from_dtype
from numpy.typing import NDArray

from hpcpic.core.errors import HpcpicError
from hpcpic.core.simd.team import Job, team
from hpcpic.core.tasks import scheduler
from hpcpic.core.tasks.adapter import RAISED, adapter

__all__ = ["RAISED", "Bound", "Graph", "Pool", "Stuck", "TaskError", "bind"]

# How long a worker spins between launches: longer than a step is in Python, samples of the series included. To wake
# one takes 20 to 60 us, on a virtual machine up to the time of a small step.
_LINGER_S = 2e-3
_ALONE_ROUNDS = 4000  # idle rounds before a worker with its own core offers it to others


class TaskError(HpcpicError):
    """A task returned a code other than 0, or raised (`code == RAISED`); the rest was skipped."""

    def __init__(self, name: str, code: int) -> None:
        what = "raised an exception" if code == RAISED else f"returned the error code {code}"
        super().__init__(f"task {name} {what}")
        self.name = name
        self.code = code


class Stuck(HpcpicError):
    """Nothing has happened for the spin limit: `pending` names the messages that did not complete."""

    def __init__(self, pending: list[str], limit_s: float) -> None:
        super().__init__(f"no progress for {limit_s:g} s; waiting for: {', '.join(pending)}")
        self.pending = pending


class Requests(Protocol):
    """A set of persistent messages: what a graph needs to start and test it."""

    record: NDArray[np.int64]
    """[n, address of n request handles, of n statuses, of the int32 flag, of MPI_Startall, of MPI_Testall]"""


def _words(argument: Any, numba_type: types.Type) -> list[int]:
    """The argument as int64 words, in the order in which compiled code takes its parts."""
    if isinstance(numba_type, types.Array):
        head = [0, 0, argument.size, argument.itemsize, argument.ctypes.data]
        return [*head, *argument.shape, *argument.strides]
    if isinstance(numba_type, types.BaseTuple):
        return [word for part in argument for word in _words(part, type_of(part))]
    raw = np.asarray(argument).tobytes()
    return [int.from_bytes(raw.ljust(8, b"\0"), "little", signed=True)]


def type_of(argument: Any) -> types.Type:
    """The type for which a kernel with this argument is compiled."""
    if isinstance(argument, np.ndarray):
        if not argument.flags.c_contiguous:
            raise TypeError("arrays of a task must be C-contiguous")
        return _array_type(argument.dtype, argument.ndim, argument.flags.writeable)
    if isinstance(argument, tuple):
        return types.BaseTuple.from_types([type_of(part) for part in argument], type(argument))
    numba_type = typeof(argument)
    if not isinstance(numba_type, types.Integer | types.Float | types.Boolean):
        raise TypeError(f"a task takes arrays, numbers, bools and tuples of them, not {type(argument).__name__}")
    return numba_type


@cache
def _array_type(dtype: np.dtype, n_dimensions: int, writeable: bool) -> types.Array:
    """numba's own look at an array, thousands at the start of a run, takes thirty times as long."""
    return types.Array(from_dtype(dtype), n_dimensions, "C", readonly=not writeable)


class Bound:
    """A compiled kernel with its arguments: what a task calls. Made by `bind`.

    With `parts`, it stands for so many tasks that differ in the first argument alone: 0 .. parts - 1.
    """

    def __init__(self, kernel: Any, arguments: Sequence[Any], parts: int | None = None) -> None:
        self.name: str = kernel.py_func.__name__
        self._types = tuple(type_of(argument) for argument in arguments)
        wide = types.Array, types.BaseTuple
        self._numbers = [None if isinstance(kind, wide) else as_dtype(kind).type for kind in self._types]
        self.job = Job(kernel, self._types)
        team.ask(self.job)
        self._address = 0
        self._kept = [kernel, *arguments]  # the context holds their bare addresses
        words = [_words(argument, numba_type) for argument, numba_type in zip(arguments, self._types)]
        self._starts = np.cumsum([1, *map(len, words)])
        self.graphs: dict[tuple[int, ...], Graph] = {}  # that Pool.each has made, by the ids of their tasks
        self.contexts = np.tile(np.array([0, *chain.from_iterable(words)], np.int64), (parts or 1, 1))
        if parts is not None:
            self.contexts[:, 1] = np.arange(parts)

    @property
    def ready(self) -> bool:
        """Whether the kernel has been compiled, and called for."""
        return self._address != 0

    @property
    def address(self) -> int:
        """Address of the adapter that calls the kernel, which is compiled now if it is not yet."""
        if not self._address:
            team.want([self.job])
            compiled = self.job.kernel.overloads[self._types]
            result = compiled.signature.return_type
            if not isinstance(result, types.Integer | types.NoneType):
                raise TypeError(f"kernel {self.name} returns {result}: an integer code or nothing on every path wanted")
            self.contexts[:, 0] = compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name)
            call_conv = cpu_target.target_context.call_conv
            self._address, self._library = adapter(
                call_conv.get_function_type(result, self._types), getattr(result, "bitwidth", 0)
            )
        return self._address

    def update(self, index: int, value: Any) -> None:
        """Replace argument `index` for the launches to come: a number, or an array or a tuple of the same type."""
        numba_type, number = self._types[index], self._numbers[index]
        if number is not None:
            value = number(value)
        elif type_of(value) != numba_type:
            raise TypeError(f"argument {index} of {self.name} is {numba_type}, not {typeof(value)}")
        self.contexts[:, self._starts[index] : self._starts[index + 1]] = _words(value, numba_type)
        self._kept[1 + index] = value

    @property
    def context(self) -> NDArray[np.int64]:
        """The words of the first task."""
        return self.contexts[0]


@cache
def parameters(function: Callable) -> tuple[str, ...]:
    """Names of its parameters; kept, as looking takes 30 us."""
    return tuple(inspect.signature(function).parameters)


def bind(kernel: Any, /, **arguments: Any) -> Bound:
    """Fix the arguments of a compiled kernel by the names of its parameters: C-contiguous arrays (data and shape),
    numbers, bools, tuples of them.

    The kernel returns an integer error code (0 is good) or nothing; an exception gives the code RAISED.
    The kernel is compiled for these types before a task first runs it, if need be.
    """
    names = parameters(kernel.py_func)
    if sorted(names) != sorted(arguments):
        raise TypeError(f"{kernel.py_func.__name__} takes {', '.join(names)}, not {', '.join(arguments)}")
    return Bound(kernel, [arguments[name] for name in names])


class Graph:
    """Tasks and messages with the dependences that follow from what they read and write.

    Handles are any hashables naming pieces of data. A reader waits for the last writer before it; a writer
    for the last writer and all readers since. Add nodes in the order a serial program would run them, then
    `freeze`; a frozen graph runs any number of times.
    """

    def __init__(self) -> None:
        self.names: list[str] = []
        self._bounds: list[Bound | None] = []  # None of messages
        self._contexts: list[NDArray[np.int64]] = []
        self._urgent: list[bool] = []
        self._kept: list[Any] = []
        self._successors: list[list[int]] = []
        self._n_before: list[int] = []
        self._writer: dict[Hashable, int] = {}
        self._readers: dict[Hashable, list[int]] = {}
        self._arrays: list[NDArray[np.int64]] = []
        self._address = 0  # of the words, once all tasks are compiled

    def task(
        self,
        bound: Bound,
        *,
        ins: Iterable[Hashable] = (),
        outs: Iterable[Hashable] = (),
        inouts: Iterable[Hashable] = (),
        priority: int = 0,
        name: str = "",
        part: int = 0,
    ) -> int:
        """Add a kernel call (of its tasks the one of this part); its number. Tasks of positive priority (boundaries)
        are taken before others.
        """
        self._kept.append(bound)
        accesses = (ins, outs, inouts)
        return self._add(bound, bound.contexts[part], priority > 0, name or bound.name, accesses)

    def message(
        self,
        requests: Requests,
        *,
        ins: Iterable[Hashable] = (),
        outs: Iterable[Hashable] = (),
        inouts: Iterable[Hashable] = (),
        name: str = "",
    ) -> int:
        """Add a set of messages; its number. Started when ready, done when all of them are; ins are sent."""
        self._kept.append(requests)
        return self._add(None, requests.record, True, name or "message", (ins, outs, inouts))

    def _add(self, bound: Bound | None, context: NDArray, urgent: bool, name: str, accesses: tuple) -> int:
        if self._arrays:
            raise ValueError("the graph is frozen")
        ins, outs, inouts = map(set, accesses)
        node = len(self.names)
        self.names.append(name)
        self._bounds.append(bound)
        self._contexts.append(context)
        self._urgent.append(urgent)
        before = self._before(ins | inouts, outs | inouts, node)
        self._n_before.append(len(before))
        self._successors.append([])
        for earlier in before:
            self._successors[earlier].append(node)
        return node

    def _before(self, reads: set, writes: set, node: int) -> set[int]:
        """Nodes this one waits for; enters it as reader and writer."""
        before: set[int] = set()
        for handle in reads | writes:
            if handle in self._writer:
                before.add(self._writer[handle])
        for handle in writes:
            before.update(self._readers.pop(handle, ()))
            self._writer[handle] = node
        for handle in reads - writes:
            self._readers.setdefault(handle, []).append(node)
        return before

    def freeze(self) -> "Graph":
        """Lay the graph out for the compiled worker; no node can be added afterwards."""
        n = len(self.names)
        successors = [node for nodes in self._successors for node in nodes]
        starts = np.cumsum([0, *map(len, self._successors)])
        contexts = [context.ctypes.data for context in self._contexts]
        filled = [np.zeros(n), contexts, self._n_before, self._urgent, starts, successors]
        scratch = [n, 2 * (n + 1), n, scheduler.N_COUNTERS]  # waiting, queue, pending, counters
        self._arrays = [np.array(part, np.int64) for part in filled]
        self._arrays += [_aligned(size) for size in scratch]
        self._words = np.array([n, *(array.ctypes.data for array in self._arrays)], np.int64)
        return self

    @property
    def address(self) -> int:
        """Address of the frozen graph's words. Its kernels are compiled now, if they are not yet."""
        if not self._address:
            if not self._arrays:
                raise ValueError("freeze the graph before running it")
            team.want(bound.job for bound in self._bounds if bound)
            self._arrays[0][:] = [bound.address if bound else 0 for bound in self._bounds]
            self._address = self._words.ctypes.data
        return self._address

    def failure(self) -> TaskError:
        """The first task that failed in the last run."""
        counters = self._arrays[-1]
        return TaskError(self.names[counters[scheduler.ERROR_TASK]], int(counters[scheduler.ERROR]))

    def unfinished(self) -> list[str]:
        """Names of the messages on their way when the last run ended."""
        *_, pending, counters = self._arrays
        return [self.names[node] for node in pending[: counters[scheduler.N_PENDING]]]


def _aligned(n: int) -> NDArray[np.int64]:
    """n zero words at the start of a cache line."""
    raw = np.zeros(n + scheduler.LINE, np.int64)
    skip = -raw.ctypes.data % 64 // 8
    return raw[skip : skip + n]


class Pool:
    """Threads that run graphs, from the first one on; the caller is worker 0.

    With `cpus`, one core per worker that nobody else uses: workers are pinned (with more cores than workers they
    are not: the system knows better which are free) and wait busily for a while, which makes launches cheap.
    Without, the cores are shared: nothing is pinned, and who has nothing to do yields. `spin_limit_s`: a run in
    which no task runs and no message arrives for that long ends as Stuck.
    """

    def __init__(self, threads: int, cpus: Sequence[int] | None = None, spin_limit_s: float = 60.0) -> None:
        alone = cpus is not None and len(set(cpus)) >= threads
        words = _aligned(scheduler.WORKERS + scheduler.WORKER_WORDS * threads)
        words[scheduler.THREADS] = threads
        words[scheduler.IDLE_ROUNDS] = _ALONE_ROUNDS if alone else 0
        words[scheduler.LINGER_NS] = int(_LINGER_S * 1e9) if alone else 0
        words[scheduler.LIMIT_NS] = int(spin_limit_s * 1e9)
        for worker in range(threads):
            block = scheduler.WORKERS + scheduler.WORKER_WORDS * worker
            ctypes.CDLL(None).sem_init(ctypes.c_void_p(words[block + scheduler.SEMAPHORE :].ctypes.data), 0, 0)
        self.threads = threads
        self._limit_s = spin_limit_s
        self._words = words
        self._address: int = words.ctypes.data
        self._affinity = os.sched_getaffinity(0)
        self._pins = list(cpus) if alone and cpus is not None and len(cpus) == threads else [None] * threads
        self._others = [
            threading.Thread(target=_live, args=(words, worker, pin), daemon=True, name=f"worker {worker}")
            for worker, pin in enumerate(self._pins[1:], start=1)
        ]
        self._begun = False
        self._end = weakref.finalize(self, _dismiss, words, self._others)
        team.grow(threads)
        for job in self._jobs():
            team.ask(job)

    def _jobs(self) -> list[Job]:
        """The kernels of the threads."""
        word = types.int64
        launch = Job(scheduler.launch, (word, word), called=True)
        return [launch, Job(scheduler.serve, (word, word), called=True)] if self.threads > 1 else [launch]

    def _begin(self) -> None:
        team.want(self._jobs())
        for other in self._others:
            other.start()
        if self._pins[0] is not None:
            _pin({self._pins[0]})
        self._begun = True

    def run(self, graph: Graph) -> None:
        """Run a frozen graph to its end. TaskError when a task failed, Stuck at the spin limit."""
        address = graph.address  # all compiling is done before threads spin
        if not self._begun:
            self._begin()
        outcome = scheduler.launch(self._address, address)
        if outcome == scheduler.FAILED:
            raise graph.failure()
        if outcome == scheduler.STUCK:
            raise Stuck(graph.unfinished(), self._limit_s)

    def each(self, bounds: Sequence[Bound]) -> None:
        """Run independent tasks. The first keeps the graph for the next call with the same ones."""
        if not bounds:
            return
        key, graphs = tuple(map(id, bounds)), bounds[0].graphs
        graph = graphs.get(key)
        if graph is None:
            graph = Graph()
            for bound in bounds:
                graph.task(bound)
            graphs[key] = graph.freeze()
        self.run(graph)

    def close(self) -> None:
        """End the threads and unpin the caller."""
        team.close()
        if self._end.alive:
            self._end()
            _pin(self._affinity)


def _pin(cpus: Collection[int]) -> None:
    """The calling thread runs on these cores, where the system lets us say so; it is as right elsewhere."""
    with suppress(OSError):
        os.sched_setaffinity(0, cpus)


def _live(words: NDArray[np.int64], worker: int, cpu: int | None) -> None:
    if cpu is not None:
        _pin({cpu})
    scheduler.serve(words.ctypes.data, worker)


def _dismiss(words: NDArray[np.int64], others: list[threading.Thread]) -> None:
    begun = [other for other in others if other.ident is not None]
    if begun:
        scheduler.dismiss(words.ctypes.data)
    for other in begun:
        other.join()
