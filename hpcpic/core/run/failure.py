"""A failure on any rank is reported once, and all ranks leave with one code; no rank is left waiting.

Three kinds of failure:
* an error all ranks know of (`share`, `Agreed`): rank 0 tells it, every rank returns its code;
* an error on one rank, or on several before they can talk: the first to take a token file tells it, in one
  write, and ends the others through MPI;
* an exception in a worker thread: as the second kind.
Errors of `hpcpic.core.errors`, and those in a function of the user's own, are one message; anything else is a bug and
shows its traceback.
"""

from __future__ import annotations

import faulthandler
import math
import os
import shutil
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from hpcpic.core.case.own_functions import failed_at
from hpcpic.core.comm.world import World
from hpcpic.core.errors import CheckFailed, ConfigError, Diverged, FileError, HpcpicError
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.files.together import explain
from hpcpic.core.run.log import write_error
from hpcpic.core.simd import own

NOWHERE = os.devnull  # a folder in which no file can be
PATIENCE_SECONDS = 600.0  # with a step that does not end; file systems that are shared stand still for minutes
REPORT_SECONDS = 5.0  # that a rank waits for the reporting one to end it
_BY_CODE = {error.exit_code: error for error in (ConfigError, CheckFailed, Diverged, FileError)}


class Agreed(Exception):
    """An error that every rank raises at the same place: no rank needs to be ended by another."""

    def __init__(self, error: HpcpicError) -> None:
        super().__init__(error.message)
        self.error = error


def share(world: World, make: Callable[[], bytes]) -> bytes:
    """Collective: rank 0 makes bytes, all get them; when it fails with a known error or at a file all raise Agreed."""
    message = None
    if world.rank == 0:
        try:
            message = b"\0" + make()
        except HpcpicError as error:
            message = bytes([error.exit_code]) + error.message.encode()
        except OSError as error:
            if error.filename is None:
                raise
            message = bytes([FileError.exit_code]) + explain(error).encode()
    world.wait_for_work()
    message = bytes(world.bcast(message))
    if message[0]:
        raise Agreed(_BY_CODE.get(message[0], HpcpicError)(message[1:].decode()))
    return message[1:]


@contextmanager
def everywhere() -> Iterator[None]:
    """The body is collective and raises a known error on all ranks or on none."""
    try:
        yield
    except HpcpicError as error:
        raise Agreed(error) from error


class Failure:
    """Reports failures once. The rank that first makes a token file in `folder`, which all ranks share, reports."""

    def __init__(self, world: World, tells: bool = True) -> None:
        """tells: print on standard error; not where the error is raised too, for its catcher to report."""
        self.world, self.tells = world, tells
        self._own = _new_folder() if world.rank == 0 else ""
        self.folder = Path(bytes(world.bcast(self._own.encode())).decode() or NOWHERE)
        self.on_failure: Callable[[str, int], None] | None = None  # text, code: the run folder notes it
        self._lock = threading.Lock()
        self._thread_hook = threading.excepthook
        threading.excepthook = self._thread_failed

    def close(self) -> None:
        threading.excepthook = self._thread_hook
        self._remove_own()

    def use(self, folder: Path) -> None:
        """Take the token in this folder from now on, and remove the temporary one, which a killed process would leave
        behind.
        """
        self.folder = folder
        self._remove_own()

    def _remove_own(self) -> None:
        if self._own:
            shutil.rmtree(self._own, ignore_errors=True)
            self._own = ""

    def fail(self, error: BaseException, where: str = "") -> int:
        """Report the failure and end all ranks. Returns the exit code where this is the only rank."""
        code = error.exit_code if isinstance(error, HpcpicError) else 1
        who = f"rank {self.world.rank} of {self.world.size}{where}"
        if isinstance(error, HpcpicError):
            text = f"{who}: {error.message}\n"
        elif isinstance(error, MemoryError):
            text = f"{who}: no memory: {error or 'the system gives no more'}; `estimate` tells what a run takes\n"
        elif isinstance(error, SystemExit):
            text, code = f"{who} left by sys.exit({error.code!r})\n", _exit_code(error)
        elif place := failed_at(error, own.files):
            text, code = f"{who}: {place}: {type(error).__name__}: {error}\n", ConfigError.exit_code
        else:
            text = f"{who} failed:\n" + "".join(traceback.format_exception(error))
        self.end(text, code)
        return code

    def end(self, text: str, code: int) -> None:
        """Write the text if nobody else has, then end all ranks; returns when this is the only rank."""
        if not self._lock.acquire(blocking=False):
            time.sleep(REPORT_SECONDS)  # another thread of this rank is telling
        if self._first():
            if self.tells:
                write_error(text)
            if self.on_failure:
                self.on_failure(text, code)
        else:
            time.sleep(REPORT_SECONDS)
        self._remove_own()
        if self.world.size > 1:
            self.world.abort(code)

    def stop_now(self, sentence: str) -> None:
        """End all ranks at once from any thread, also the only rank."""
        self.end(f"rank {self.world.rank} of {self.world.size}: {sentence}\n", 1)
        os._exit(1)

    def _first(self) -> bool:
        try:
            os.close(os.open(self.folder / ".failed", os.O_CREAT | os.O_EXCL | os.O_WRONLY | os.O_NOFOLLOW, 0o600))
        except FileExistsError:
            return False
        except OSError:
            return True  # no folder, or one that this node cannot see: better twice than never
        return True

    def _thread_failed(self, args: threading.ExceptHookArgs) -> None:
        if args.exc_value is not None:
            name = args.thread.name if args.thread else "?"
            code = self.fail(args.exc_value, f" (thread {name})")
            os._exit(code)


def _new_folder() -> str:
    """A new temporary folder; "" where none can be made."""
    try:
        return tempfile.mkdtemp(prefix="hpcpic-")
    except OSError:
        return ""


def _exit_code(error: SystemExit) -> int:
    return error.code if isinstance(error.code, int) else int(error.code is not None)


def guarded(world: World, main: Callable[[Failure], int], raises: bool = False) -> int:
    """Run `main` on all ranks; return the exit code that every rank leaves with.

    A failure of one rank of several does not return: all ranks are ended with its code. raises: what all ranks know of,
    or the only one, is raised and not printed.
    """
    failure = Failure(world, tells=not (raises and world.size == 1))
    try:
        return main(failure)
    except Agreed as agreed:
        if raises:
            raise agreed.error from None
        if world.rank == 0:
            write_error(agreed.error.message + "\n")
        return agreed.error.exit_code
    except BaseException as error:  # also SystemExit and KeyboardInterrupt: the others must not wait for this rank
        code = failure.fail(error)
        if raises:
            raise
        return code
    finally:
        failure.close()


class Watchdog:
    """Ends a run that stands still, with the Python stack of every thread in a file of each rank.

    Its thread works while the main thread is blocked in MPI or in compiled code. It counts its own beats, so that the
    time for which a process was suspended (Ctrl-Z, a batch system, a machine that slept) does not count. The file is
    removed where nothing was written.
    """

    def __init__(self, rundir: RunDir, rank: int, least: float = PATIENCE_SECONDS) -> None:
        self.rank, self.rundir = rank, rundir
        self._file = open(self.path, "wb", buffering=0)  # noqa: SIM115  (lives as long as the run)
        self._least, self._beat = least, min(1.0, least / 8)
        self.patience = math.inf
        self._waited = 0.0
        self._over = threading.Event()
        faulthandler.enable(self._file)
        self._thread = threading.Thread(target=self._watch, name="watchdog", daemon=True)
        self._thread.start()

    @property
    def path(self) -> Path:
        return self.rundir.path / f"trace-rank-{self.rank}.txt"

    def feed(self, step_seconds: float) -> None:
        """The run goes on; the next step may take twenty times as long as the longest."""
        self._waited, self.patience = 0.0, max(self._least, 20 * step_seconds)

    def step(self) -> None:
        """A step is done: slow as it may be on a machine with other work, the run goes on."""
        self._waited = 0.0

    def rest(self) -> None:
        """Not watching: writing files may take any time."""
        self.patience = math.inf

    def _watch(self) -> None:
        while not self._over.wait(self._beat):
            self._waited += self._beat
            if self._waited > self.patience:
                what = f"nothing went on for {self._waited:.0f} s"
                self._file.write(f"Timeout: {what}\n".encode())
                faulthandler.dump_traceback(self._file)
                write_error(f"rank {self.rank}: {what}; what it was doing stands in {self.path}\n")
                os._exit(1)

    def close(self) -> None:
        self._over.set()
        self._thread.join()
        faulthandler.enable()
        self._file.close()
        if self.path.exists() and self.path.stat().st_size == 0:
            self.path.unlink()
