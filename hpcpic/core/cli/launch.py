"""Start this program: in processes of its own, with or without MPI, or within this one."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
from pathlib import Path
from typing import IO

from hpcpic.core.app.app import App
from hpcpic.core.cli.main import build
from hpcpic.core.errors import ConfigError

ENDING = (signal.SIGTERM, signal.SIGHUP, signal.SIGUSR1, signal.SIGUSR2, signal.SIGXCPU)
LOOK_SECONDS = 0.2

Start = Callable[..., int]  # program, arguments, ranks; stdout, stderr -> exit code


def launcher() -> str | None:
    """The mpirun of this Python: another MPI's would start ranks that do not see each other."""
    beside = Path(sys.executable).with_name("mpirun")
    return str(beside) if beside.exists() else shutil.which("mpirun")


def refuse_launcher() -> None:
    """For verbs that start runs of their own: each rank of an mpirun would start all of them. Raises ConfigError."""
    from hpcpic.core.comm.world import launched_size

    if launched_size(os.environ) > 1:
        raise ConfigError("start this without mpirun; --ranks N gives every run N ranks")


def _environment() -> dict[str, str]:
    """Programs do not look into the current folder. Where this one was found there, and is not installed, they look
    into that of its packages.
    """
    packages = str(Path(__file__).resolve().parents[3])
    if packages in sys.path[1:] or packages not in sys.path:
        return dict(os.environ)
    before = os.environ.get("PYTHONPATH")
    return os.environ | {"PYTHONPATH": f"{packages}{os.pathsep}{before}" if before else packages}


def launch(program: Sequence[str], arguments: Sequence[str], ranks: int, **settings: object) -> int:
    """Run the program and wait; its exit code. Raises ConfigError without a launcher for several ranks.

    A Ctrl-C, which the program hears too, gives it the time to write its checkpoint; other signals that end a program
    are handed on as SIGUSR1, which every launcher hands on (after a SIGTERM Open MPI's kills its ranks).
    """
    words = [*program, *arguments]
    if ranks > 1:
        mpirun = launcher()
        if mpirun is None:
            raise ConfigError("there is no mpirun: install mpich or openmpi, or use --ranks 1")
        words = [mpirun, "-n", str(ranks), *words]
    with _hearing() as heard:
        process = subprocess.Popen(words, env=_environment(), **settings)  # type: ignore[call-overload]
        terminated = False
        while True:
            with suppress(subprocess.TimeoutExpired, KeyboardInterrupt):
                return process.wait(LOOK_SECONDS)
            if heard and not terminated:
                process.send_signal(signal.SIGTERM if ranks == 1 else signal.SIGUSR1)
                terminated = True


@contextmanager
def _hearing() -> Iterator[list[int]]:
    """Signals that would end this process, in the order in which they come; those that are ignored stay so."""
    heard: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield heard
        return
    before = {n: signal.getsignal(n) for n in ENDING}
    for number, handler in before.items():
        if handler != signal.SIG_IGN:
            signal.signal(number, lambda number, _: heard.append(number))
    try:
        yield heard
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def within(app: App) -> Start:
    """A `launch` on one rank in this process: what is loaded and compiled once serves all runs.

    Standard output goes to the file `stdout`, and errors too.
    """

    def start(program: Sequence[str], arguments: Sequence[str], ranks: int, *, stdout: IO[str], stderr: int) -> int:
        assert ranks == 1
        kept, argv = os.dup(1), sys.argv
        errors = os.dup(2)
        sys.stdout.flush(), sys.stderr.flush()
        sys.argv = [app.name, *arguments]
        try:
            os.dup2(stdout.fileno(), 1), os.dup2(stdout.fileno(), 2)
            with redirect_stdout(stdout):  # also where --json gathers what is printed
                build(lambda: app, app.name, app.title).main(arguments)
        except SystemExit as end:
            return end.code if isinstance(end.code, int) else int(end.code is not None)
        finally:
            stdout.flush(), sys.stderr.flush()
            for copy, descriptor in ((kept, 1), (errors, 2)):
                os.dup2(copy, descriptor)
                os.close(copy)
            sys.argv = argv
        return 0

    return start
