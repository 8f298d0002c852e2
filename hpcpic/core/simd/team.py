"""Processes that compile together: the ranks of a machine and, where a rank has more cores, helpers of it.

A kernel is asked for when it is bound and wanted when a task first runs it. Whoever has time in between compiles what
nobody has claimed (see compile.KernelCache); what is kept then is loaded. Threads would not do: numba holds the GIL.
A helper is a program of its own, as a fork of a process with threads and MPI is none. It knows nothing of the run but
the kernels asked for, and whatever becomes of it, a kernel that is not there when it is wanted is compiled then.
"""

import _thread
import importlib
import linecache
import os
import pickle
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Iterable
from contextlib import suppress
from typing import IO, Any, NamedTuple

from numba.core import event

from hpcpic.core import memory
from hpcpic.core.simd import compile
from hpcpic.core.simd.caches import private_path
from hpcpic.core.simd.compile import NAP_SECONDS, PATIENCE_SECONDS, KernelCache, compiled, generated
from hpcpic.core.simd.generate import module_from_source

EVENT = "hpcpic:wait"  # for kernels that are compiled here or elsewhere
MOST = 4  # processes of a rank: the longest kernel takes a fourth of all compiling
MEMORY = 1 << 30  # bytes that are free where there is a helper
IDLE_SECONDS = 10.0  # after which a helper leaves
_LAUNCHERS = ("PMI", "OMPI_", "MPI", "HYDRA_", "HYDI_")  # begin the names of variables by which MPI knows its ranks


class Job(NamedTuple):
    """A kernel, the types of its arguments, and whether Python calls it."""

    kernel: Any
    types: tuple
    called: bool = False

    def done(self, patience: float) -> bool:
        """See `compiled`."""
        return compiled(self.kernel, self.types, patience, self.called)


class Team:
    """The processes that compile for this one, which has `size` cores for it."""

    def __init__(self) -> None:
        self.size = 1
        self.n_asked = 0
        self._cores = os.sched_getaffinity(0)  # before a pool pins this thread
        self._left: dict[Job, None] = {}  # oldest first
        self._helpers: list[_Helper] = []

    def grow(self, size: int) -> None:
        """So many threads of this process run, and may compile before that."""
        self.size = max(self.size, min(size, len(self._cores), MOST))

    @property
    def n_done(self) -> int:
        """How many of the kernels that were asked for are there, by this process or another."""
        return self.n_asked - sum(not _kept(job) for job in list(self._left))

    def ask(self, job: Job) -> None:
        """Load a kernel that is kept; another one is compiled by who has time, and here when it is `want`ed."""
        if job in self._left or job.done(patience=-1):
            return
        self._left[job] = None
        self.n_asked += 1
        if isinstance(job.kernel._cache, KernelCache) and job.kernel._cache.keeps and not compile._own:
            self._tell(job)

    def want(self, jobs: Iterable[Job]) -> None:
        """Returns when these kernels are there. What others compile now is waited for last, and others asked for are
        compiled meanwhile.
        """
        wanted = [job for job in dict.fromkeys(jobs) if job in self._left or not job.done(patience=-1)]
        if not wanted:
            return
        since = time.monotonic()
        with event.trigger_event(EVENT):
            while wanted := [job for job in wanted if not self._do(job, patience=0)]:
                if any(self._do(job, patience=0) for job in list(self._left) if job not in wanted):
                    since = time.monotonic()
                elif time.monotonic() - since > PATIENCE_SECONDS:
                    self._do(wanted[0], patience=PATIENCE_SECONDS)
                else:
                    time.sleep(NAP_SECONDS)

    def _do(self, job: Job, patience: float) -> bool:
        done = job.done(patience)
        if done:
            self._left.pop(job, None)
        return done

    def _tell(self, job: Job) -> None:
        self._helpers = [helper for helper in self._helpers if helper.process.poll() is None]
        while len(self._helpers) < self.size - 1 and memory.free() > MEMORY:
            try:
                self._helpers.append(_Helper(self._cores))
            except OSError:  # no more processes
                break
            for left in self._left:
                self._helpers[-1].tell(left)
        for helper in self._helpers:
            helper.tell(job)

    def close(self) -> None:
        """The helpers end, as they do with this process, however that ends. New ones want threads again."""
        for helper in self._helpers:
            helper.close()
        self._helpers = []
        self.size = 1


team = Team()


def _kept(job: Job) -> bool:
    return isinstance(job.kernel._cache, KernelCache) and job.kernel._cache.kept(job.types)


class _Helper:
    """A helper, as this process sees it."""

    def __init__(self, cores: Iterable[int]) -> None:
        root = private_path().parent
        environment = {name: value for name, value in os.environ.items() if not name.startswith(_LAUNCHERS)}
        environment |= {"HPCPIC_CACHE_DIR": str(root), "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        environment["MPI4PY_RC_INITIALIZE"] = "0"
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-c", f"from {__name__} import serve; serve({sorted(cores)})"],
            stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment,
        )  # fmt: skip
        threading.Thread(target=self.process.wait, daemon=True, name="helper").start()  # who has ended is no zombie
        self._modules: set[str] = set()  # that it has

    def tell(self, job: Job) -> None:
        """The helper hears of a kernel, with the generated modules that it may call."""
        modules = [name for name in generated if name not in self._modules]
        texts = [("".join(linecache.getlines(f"<{name}>")), name.rpartition("_")[0]) for name in modules]
        function = job.kernel.py_func
        with suppress(OSError, pickle.PicklingError, AttributeError, TypeError):
            named = pickle.dumps((function.__module__, function.__qualname__, job.types, job.called))
            pickle.dump((texts, named), self._pipe)
            self._pipe.flush()
            self._modules.update(modules)

    @property
    def _pipe(self) -> IO[bytes]:
        assert self.process.stdin is not None
        return self.process.stdin

    def close(self) -> None:
        with suppress(OSError):
            self._pipe.close()


def serve(cores: Iterable[int]) -> None:
    """Life of a helper: compile what it is told of and nobody has claimed, until the pipe is closed or idle."""
    os.sched_setaffinity(0, cores)
    told: queue.SimpleQueue = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(told,), daemon=True).start()
    try:
        with suppress(BaseException):  # who wants the kernel will see an error; not all that it has compiled is kept
            while (one := told.get(timeout=IDLE_SECONDS)) is not None:
                _compile(*one)
    finally:  # also where one more interrupt comes while this one is suppressed
        os._exit(0)


def _listen(told: queue.SimpleQueue) -> None:
    with suppress(Exception):
        while True:
            told.put(pickle.load(sys.stdin.buffer))
    with suppress(queue.Empty):
        while True:
            told.get_nowait()
    told.put(None)
    while True:  # in the middle of a kernel: whoever asked is gone. LLVM swallows an interrupt of what it calls back
        _thread.interrupt_main()
        time.sleep(1.0)


def _compile(texts: Iterable[tuple[str, str]], named: bytes) -> None:
    for text, stem in texts:
        module_from_source(text, stem)
    module, name, types, called = pickle.loads(named)
    Job(getattr(importlib.import_module(module), name), types, called).done(patience=0)
