"""Reasons to stop early, heard at once whatever the main thread is doing.

A Python signal handler runs only when the running C call returns: seconds late inside a kernel or a blocking
MPI call. The wakeup descriptor is written by the C handler itself, and a daemon thread reads it, so a signal
is heard in milliseconds. Hearing sets `reason`; the step loop agrees on it with the other ranks (`guard`), so
that all ranks stop after the same step.
"""

from __future__ import annotations

import logging
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import IntEnum

log = logging.getLogger("hpcpic.run")

GRACE_SECONDS = 60.0
ECHO_SECONDS = 0.5  # the launcher and the terminal may both deliver one Ctrl-C


class Reason(IntEnum):
    """Reasons to stop a run before its last step; when ranks differ, the largest is reported."""

    NONE = 0
    MEAN_KNOWN = 1  # the mean step time is known well enough (simulation.stop_SEM)
    STOP_FILE = 2
    WALL = 3
    SIGUSR1 = 4
    SIGUSR2 = 5
    SIGXCPU = 6
    SIGHUP = 7
    SIGTERM = 8
    SIGINT = 9

    @property
    def text(self) -> str:
        return _TEXTS.get(self, self.name)


_TEXTS = {
    Reason.NONE: "",
    Reason.MEAN_KNOWN: "the mean step time is known as well as simulation.stop_SEM asks",
    Reason.STOP_FILE: "a file STOP in the run folder",
    Reason.WALL: "the wall clock limit (--wall, or the end of the SLURM job)",
}
_SIGNALS = {number: Reason[number.name] for number in signal.Signals if number.name in Reason.__members__}


@contextmanager
def whole_steps() -> Iterator[None]:
    """Hear Ctrl-C only at the end, as a step that is broken off leaves a state that is of no time."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    heard: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _: heard.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if heard:
        raise KeyboardInterrupt


class Stop:
    """Listens from construction to `close`; outside of the main thread, to which signals come, to none.

    `abort(sentence)` is called, from the listening thread, when a second Ctrl-C arrives or when the run has
    not acknowledged a signal within the grace time: the larger of 60 s and 20 steps.
    """

    def __init__(self, abort: Callable[[str], None]) -> None:
        self.reason = Reason.NONE
        self.step_seconds = 0.0
        self._abort = abort
        self._interrupted = 0.0
        self._acknowledged = threading.Event()
        self._read, self._write = os.pipe()
        os.set_blocking(self._write, False)
        heard = [n for n in _SIGNALS if n != signal.SIGHUP or signal.getsignal(n) != signal.SIG_IGN]  # as nohup asks
        self._main = threading.current_thread() is threading.main_thread()
        self._before = {n: signal.signal(n, lambda *_: None) for n in heard} if self._main else {}
        self._fd_before = signal.set_wakeup_fd(self._write, warn_on_full_buffer=False) if self._main else -1
        self._thread = threading.Thread(target=self._listen, name="signals", daemon=True)
        self._thread.start()

    def acknowledge(self) -> None:
        """The ranks have agreed to stop (or the run is over): no abort by the grace time any more."""
        self._acknowledged.set()

    def close(self) -> None:
        self.acknowledge()
        if self._main:
            signal.set_wakeup_fd(self._fd_before)
        for number, handler in self._before.items():
            signal.signal(number, handler)
        os.write(self._write, b"\0")
        self._thread.join()
        os.close(self._read)
        os.close(self._write)

    def _listen(self) -> None:
        while True:
            for number in os.read(self._read, 64):
                if number == 0:
                    return
                if number in _SIGNALS:
                    self._hear(_SIGNALS[signal.Signals(number)])

    def _hear(self, reason: Reason) -> None:
        now = time.monotonic()
        if reason is Reason.SIGINT:
            if self._interrupted and now - self._interrupted > ECHO_SECONDS:
                self._abort("second interrupt: no checkpoint is written")
            self._interrupted = self._interrupted or now
        if self.reason is Reason.NONE:
            threading.Thread(target=self._lose_patience, name="grace", daemon=True).start()
        self.reason = max(self.reason, reason)

    def _lose_patience(self) -> None:
        grace = max(GRACE_SECONDS, 20 * self.step_seconds)
        if not self._acknowledged.wait(grace):
            self._abort(f"{self.reason.text}: a step, or compiling for it, did not end within {grace:.0f} s")


def process_start() -> float:
    """time.monotonic() when this process was made: what a batch system counts from. Now, where nothing tells."""
    try:
        with open("/proc/self/stat") as file:
            ticks = int(file.read().rpartition(")")[2].split()[19])
    except OSError:
        return time.monotonic()
    age = time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK")
    return time.monotonic() - age


def _end_of_job() -> list[float]:
    """When the SLURM job ends, as seconds since 1970; none where there is no job, or its end cannot be read."""
    text = os.environ.get("SLURM_JOB_END_TIME")
    if text is None:
        return []
    try:
        return [float(int(text))]
    except ValueError:
        log.warning("SLURM_JOB_END_TIME = %r is no number of seconds since 1970: the end of the job is not known", text)
        return []


class WallLimit:
    """Decides on rank 0 when to stop so that the checkpoint and the summary end before `limit` seconds are
    over.

    `limit` counts from `started` (time.monotonic() when the process was made). A SLURM job's own end counts
    too.
    """

    EXIT_SECONDS = 1.0  # summary and leaving, which on a machine with other work takes longer than alone

    def __init__(self, limit: float | None, started: float) -> None:
        ends = [] if limit is None else [started + limit]
        ends += [time.monotonic() + end - time.time() for end in _end_of_job()]
        self.end = min(ends, default=None)

    def over(self, interval: float, checkpoint: float) -> bool:
        """interval: longest time between two looks at the clock so far; checkpoint: what the last one took
        [s].
        """
        if self.end is None:
            return False
        return time.monotonic() + 2 * interval + 1.5 * checkpoint + self.EXIT_SECONDS > self.end
