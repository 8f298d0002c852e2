"""What the rows of the matrix work with: the program under test, its processes, and the folder of its runs."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil

from hpcpic.core.cli.launch import launcher

HERE = Path(__file__).resolve().parent
TIMEOUT_S = 480.0  # kernels of a new scene are compiled in the first run
BEGUN = re.compile(r"hpcpic.run: (steps|from step) [0-9]")  # the log says that the steps begin
PAUSE_S = 0.02  # slept in every step of a run that is to be caught in the middle


class Wrong(Exception):
    """What was got instead of what was expected."""


class Skipped(Exception):
    """Why this row cannot be tried here."""


def crowd() -> float:
    """How many processes there are for each core, at least one: so many times longer all may take."""
    return max(1.0, os.getloadavg()[0] / len(os.sched_getaffinity(0)))


def expect(holds: bool, got: object) -> None:
    if not holds:
        raise Wrong(str(got))


@dataclass(frozen=True, slots=True)
class Done:
    """A process that has ended: its exit code, what it said, how long it took [s]."""

    code: int
    out: str
    err: str
    seconds: float

    def __str__(self) -> str:
        return f"exit {self.code} after {self.seconds:.1f} s: {self.err.strip()[-300:]}"


@dataclass(slots=True)
class Bench:
    """One program and a case of some hundred short steps; every row gets a folder of its own."""

    program: str
    case: Path
    runaway: tuple[str, ...]  # settings with which the scheme is unstable
    sparse: tuple[str, ...]  # settings that leave a rank of three without a particle or grain
    flat: tuple[str, ...]  # settings with fewer rows than FLAT_RANKS
    work: Path  # of the whole matrix
    folder: Path = field(default=Path())  # of this row
    _digests: dict[tuple[str, ...], str] = field(default_factory=dict)

    @property
    def run_folder(self) -> Path:
        return self.folder / "run"

    def words(self, arguments: tuple[str, ...], ranks: int, fault: dict[str, Any]) -> list[str]:
        module = ("fault_matrix.faulty", self.program) if fault else (self.program,)
        mpirun = [str(launcher()), "-n", str(ranks)] if ranks > 1 else []
        return [*mpirun, sys.executable, "-P", "-m", *module, *arguments]

    def environment(self, fault: dict[str, Any], more: dict[str, str]) -> dict[str, str]:
        places = [str(HERE.parent), str(HERE.parents[1]), *sys.path]
        told = {"FAULT": json.dumps(fault), "PYTHONPATH": os.pathsep.join(filter(None, places))}
        return dict(os.environ) | told | more

    def run_words(self, *more: str) -> tuple[str, ...]:
        return ("run", str(self.case), "-o", str(self.run_folder), "--threads", "1", *more)

    def restart_words(self, *more: str) -> tuple[str, ...]:
        return ("restart", str(self.run_folder), "--threads", "1", *more)

    def call(
        self,
        arguments: tuple[str, ...],
        ranks: int = 1,
        env: dict[str, str] | None = None,
        before: Callable[[], None] | None = None,
        **fault: Any,
    ) -> Done:
        """To the end. `before` is called in the new process; keywords are those of FAULT."""
        begin = time.monotonic()
        done = subprocess.run(
            self.words(arguments, ranks, fault), env=self.environment(fault, env or {}), cwd=self.folder,
            capture_output=True, text=True, errors="replace", timeout=TIMEOUT_S, preexec_fn=before,
        )  # fmt: skip
        return Done(done.returncode, done.stdout, done.stderr, time.monotonic() - begin)

    def run(self, *more: str, ranks: int = 2, **settings: Any) -> Done:
        return self.call(self.run_words(*more), ranks, **settings)

    def restart(self, *more: str, ranks: int = 2, **settings: Any) -> Done:
        return self.call(self.restart_words(*more), ranks, **settings)

    @contextmanager
    def started(
        self,
        *more: str,
        ranks: int = 2,
        wait: bool = True,
        env: dict[str, str] | None = None,
        words: tuple[str, ...] = (),
        **fault: Any,
    ) -> Iterator[Running]:
        """A run, or what `words` say, that has got into its step loop (`wait`), in a process group of its own; killed
        at the end.
        """
        fault = {"pause": PAUSE_S} | fault
        process = subprocess.Popen(
            self.words(words or self.run_words(*more), ranks, fault), env=self.environment(fault, env or {}),
            cwd=self.folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        )  # fmt: skip
        running = Running(process, ranks, self.run_folder)
        try:
            if wait:
                running.wait_for(lambda: BEGUN.search(running.log()))
                time.sleep(0.3)
            yield running
        finally:
            for one in [*running.ranks(), process.pid]:
                _kill(one)
            process.communicate()

    def facts(self, folder: str = "run") -> dict[str, Any]:
        return json.loads((self.folder / folder / "run.json").read_text())

    def checkpoints(self) -> list[Path]:
        """Oldest first."""
        return sorted((self.run_folder / "checkpoints").glob("*.h5"), key=lambda path: int(path.stem))

    def digest(self, *sets: str) -> str:
        """The digest of the run that nothing befalls."""
        if sets not in self._digests:
            here, self.folder = self.folder, self.work / f"quiet-{len(self._digests)}"
            self.folder.mkdir()
            done = self.run(*(word for assignment in sets for word in ("--set", assignment)))
            expect(done.code == 0, done)
            self._digests[sets] = self.facts()["state_digest"]
            self.folder = here
        return self._digests[sets]

    def usual_warnings(self) -> list[str]:
        """What a run of this case warns of when nothing befalls it."""
        self.digest()
        return json.loads((self.work / "quiet-0/run/run.json").read_text())["warnings"]

    def goes_on(self, *more: str, ranks: int = 2) -> None:
        """A restart ends in the state of the run that nothing befell."""
        done = self.restart(*more, ranks=ranks)
        expect(done.code == 0, f"restart: {done}")
        expect(self.facts()["state_digest"] == self.digest(), "restart: another state than without the fault")


@dataclass(slots=True)
class Running:
    process: subprocess.Popen[str]
    n_ranks: int
    folder: Path

    def log(self) -> str:
        log = self.folder / "log.txt"
        return log.read_text() if log.exists() else ""

    def wait_for(self, condition: Callable[[], Any]) -> None:
        end = time.monotonic() + TIMEOUT_S
        while not condition():
            expect(self.process.poll() is None, f"ended before its time with {self.process.poll()}")
            expect(time.monotonic() < end, "waited too long")
            time.sleep(0.02)

    def ranks(self) -> list[int]:
        """Process ids of the ranks."""
        if self.n_ranks == 1:
            return [self.process.pid]
        try:
            below = psutil.Process(self.process.pid).children(recursive=True)
            return [one.pid for one in below if "python" in one.name()]
        except psutil.NoSuchProcess:
            return []

    def send(self, name: str) -> None:
        """To the launcher, as a batch system does."""
        self.process.send_signal(signal.Signals[name])

    def end(self, within: float = 60.0) -> Done:
        """Wait for so long, on a quiet machine."""
        begin, within = time.monotonic(), within * crowd()
        try:
            out, err = self.process.communicate(timeout=within)
        except subprocess.TimeoutExpired:
            raise Wrong(f"still there after {within:g} s") from None
        return Done(self.process.returncode, out, err, time.monotonic() - begin)


def _kill(pid: int) -> None:
    with suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)
