"""The time of compiling kernels, measured apart from the sections that they are compiled in, and reported."""

import logging
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from numba.core import event

from hpcpic.core.comm.world import World
from hpcpic.core.run.summary import several
from hpcpic.core.simd import team
from hpcpic.core.timers import Timers

log = logging.getLogger("hpcpic")

SECTION = "compiling"
KINDS = ("numba:compile", team.EVENT)
PATIENCE_SECONDS = 2.0  # of setting up, before a line says why it takes so long
REPORT_SECONDS = 4.0  # between two lines on compiling


class Compiling(event.Listener):
    """Counts the seconds that the main thread of this process compiles, or waits for another process that does, as a
    section of their own in the timers.
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
            self._began = time.perf_counter()
            self._section.enter_context(self.timers.section(SECTION))

    def on_end(self, _event: event.Event) -> None:
        if threading.current_thread() is not threading.main_thread() or not self.depth:
            return
        self.depth -= 1
        if self.depth == 0:
            self._section.close()
            self.seconds += time.perf_counter() - self._began

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


@contextmanager
def reported(world: World, compiling: Compiling) -> Iterator[threading.Event]:
    """On rank 0, log now and then how far compiling is, and once that setting up takes long: until the event is set."""
    over, set_up = threading.Event(), threading.Event()

    def report() -> None:
        next_report = time.monotonic()
        while not over.wait(PATIENCE_SECONDS):
            if compiling.depth and time.monotonic() >= next_report:
                next_report = time.monotonic() + REPORT_SECONDS
                log.info(
                    "compiling the kernels of this kind of scene, %d of %d so far, on %s; the next run finds them made",
                    team.team.n_done, team.team.n_asked, several(world.node_size * team.team.size, "core"),
                )  # fmt: skip
            elif not compiling.any and not set_up.is_set():
                log.info("setting up")
                set_up.set()

    if world.rank == 0:
        threading.Thread(target=report, name="compiling", daemon=True).start()
    try:
        yield set_up
    finally:
        over.set()
