"""Measures the time of compiling kernels, apart from the sections that they are compiled in."""

import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from time import perf_counter

from numba.core import event

from hpcpic.core.simd import team
from hpcpic.core.timers import Timers

SECTION = "compiling"
KINDS = ("numba:compile", team.EVENT)


class Compiling(event.Listener):
    """Seconds that the main thread of this process compiles, or waits for who does, as a section of its own in the
    timers.
    """

    def __init__(self, timers: Timers) -> None:
        self.timers = timers
        self.seconds = 0.0
        self.depth = 0
        self._began = 0.0
        self._section = ExitStack()

    def on_start(self, _event: event.Event) -> None:
        if threading.current_thread() is not threading.main_thread():
            return
        self.depth += 1
        if self.depth == 1:  # a kernel compiles those that it calls
            self._began = perf_counter()
            self._section.enter_context(self.timers.section(SECTION))

    def on_end(self, _event: event.Event) -> None:
        if threading.current_thread() is not threading.main_thread() or not self.depth:
            return
        self.depth -= 1
        if self.depth == 0:
            self._section.close()
            self.seconds += perf_counter() - self._began

    @property
    def any(self) -> bool:
        """True if anything was compiled so far, or is being compiled."""
        return self.depth > 0 or self.seconds > 0.0


@contextmanager
def watched(timers: Timers) -> Iterator[Compiling]:
    compiling = Compiling(timers)
    for kind in KINDS:
        event.register(kind, compiling)
    try:
        yield compiling
    finally:
        for kind in KINDS:
            event.unregister(kind, compiling)
