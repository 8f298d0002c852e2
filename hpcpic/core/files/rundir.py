"""The folder of a run: made once, never overwritten unasked, held by one run at a time."""

import csv
import errno
import fcntl
import io
import json
import logging
import os
import platform
import re
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Any

from hpcpic.core.errors import FileError
from hpcpic.core.files.atomic import create_anew, temporary, write_atomic, write_json
from hpcpic.core.files.parts import parts_of
from hpcpic.core.files.together import explain

IN_PARTS = ("fields.vtkhdf", "particles.vtkhdf", "grains.vtkhdf", "histograms.h5")  # see files.parts
RUN_FILES = (
    *("run.json", "config.conf", "log.txt", "timers.csv", "series.h5", "series.csv", "series.units.csv"),
    *IN_PARTS,
    *("post-mortem.txt", "report.html", "STOP"),
)
RUN_FOLDERS = {"checkpoints": r"\d{8,}\.h5", "openpmd": r"data\d*\.h5"}  # and what a run calls its files there
LOCK = ".lock"
NO_LOCKS = (errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOLCK)  # what parallel file systems say that are mounted without
LOOKS, LOOK_SECONDS = 5, 0.02  # before a folder counts as in use: who reads it holds its lock for a moment
log = logging.getLogger(__name__)


class RunDir:
    """Paths of the files of a run folder. `RunDir(path)` touches nothing; `create` and `open` look at the folder, and
    `create` and `lock` hold it.

    Written by rank 0; the other ranks use RunDir(path) for the names.
    """

    def __init__(self, path: Path | str) -> None:
        self.rename(path)
        self._lock: IO[bytes] | None = None

    def rename(self, path: Path | str) -> None:
        """Give the folder another path, as it was moved."""
        self.path = Path(path)
        self.run_json = self.path / "run.json"
        self.config = self.path / "config.conf"
        self.given = self.path / "given"
        self.log = self.path / "log.txt"
        self.timers = self.path / "timers.csv"
        self.fields = self.path / "fields.vtkhdf"
        self.openpmd = self.path / "openpmd"
        self.checkpoints = self.path / "checkpoints"
        self.stop_file = self.path / "STOP"

    def moved_to(self) -> str:
        """The name that the held folder has now, if it was moved away from its name; "" if not."""
        if self._lock is None:
            return ""
        with suppress(OSError):
            if os.path.samestat(os.fstat(self._lock.fileno()), os.stat(self.path / LOCK)):
                return ""
        try:
            folder = os.path.dirname(os.readlink(f"/proc/self/fd/{self._lock.fileno()}"))
            here = os.path.samestat(os.fstat(self._lock.fileno()), os.stat(os.path.join(folder, LOCK)))
        except OSError:  # removed, or no /proc
            return ""
        return folder if here else ""

    @property
    def particles(self) -> Path:
        """The one file of particles of a run, which a simulator of grains calls after them."""
        grains = self.path / "grains.vtkhdf"
        return grains if grains.exists() else self.path / "particles.vtkhdf"

    @classmethod
    def create(
        cls,
        path: Path | str,
        replace: bool = False,
        *,
        config: str,
        given: Mapping[str, str | bytes] | None = None,
        sets: Sequence[str] = (),
        facts: Mapping[str, Any] | None = None,
    ) -> "RunDir":
        """Make the folder with config.conf, given/ and run.json (status "running" and `facts`), and hold its
        lock.

        `given` maps file names (paths relative to the case's folder) to contents. A folder that holds a run
        is refused unless `replace`, which removes what that run has made and nothing else; a folder with files of other
        origin that are called as those of a run is always refused. Raises FileError; nothing is left behind then.
        """
        rundir = cls(path)
        made, begun = _missing_parents(rundir.path), False
        try:
            rundir.path.mkdir(parents=True, exist_ok=True)
            rundir._refuse_run(replace)
            rundir.lock()
            rundir._refuse_run(replace)  # who held the lock before may have made one
            _probe(rundir.path)
            begun = True
            rundir._remove_run()
            names = rundir._names_in_given(given or {})
            facts = {"status": "running", "started": _now(), "given": sorted(names), **(facts or {})}
            rundir.update(**facts)  # first: from now on the folder is known as that of a run
            rundir._fill(config, names, sets)
        except BaseException as error:
            rundir._undo(made, begun)
            if isinstance(error, OSError):
                raise FileError(f"cannot make the run folder {rundir.path}: {explain(error)}") from error
            raise
        return rundir

    @classmethod
    def open(cls, path: Path | str, program: str = "", damaged: bool = False) -> "RunDir":
        """A folder that holds a run, of this `program` if one is named. FileError when it does not, and where run.json
        cannot be read, unless it may be `damaged`.
        """
        rundir = cls(path)
        if not os.path.isdir(path):  # which takes a name that is too long for none
            raise FileError(f"{path}: no such folder; `run` makes one")
        if not rundir.run_json.is_file():
            raise FileError(f"{path}: not a run folder (no run.json in it)")
        try:
            made_by = rundir.read_run().get("program", program) if program else program
        except FileError:
            if not damaged:
                raise
            made_by = program
        if made_by != program:
            raise FileError(f"{path}: a run of {made_by}, not of {program}: say `{made_by}` instead of `{program}`")
        return rundir

    def _refuse_run(self, replace: bool) -> None:
        names = [*RUN_FILES, "given", *RUN_FOLDERS]
        found = [name for name in names if os.path.lexists(self.path / name) and name != "STOP"]
        if not found:
            return
        named = f"({', '.join(found[:4])}{', ...' if found[4:] else ''})"
        if not self._is_ours():
            raise FileError(
                f"{self.path} holds files that a run would write {named}, and no run.json of a run: they are not "
                "touched; choose another folder, or take them away yourself"
            )
        if not replace:
            raise FileError(
                f"{self.path} holds a run already {named}; choose another folder (-o), go on with `restart`, or "
                "replace that run: --replace, in Python replace=True (force is for limits alone)"
            )

    def _is_ours(self) -> bool:
        """True if run.json is what `create` makes."""
        try:
            return not self.run_json.is_symlink() and {"status", "started"} <= self.read_run().keys()
        except FileError:
            return False

    def _remove_run(self) -> None:
        """Remove what a run has made here; files of other origin beside or among it stay."""
        given = self.read_run().get("given") if self.run_json.exists() else []
        if not self.given.is_symlink():
            for name in given if isinstance(given, list) else []:
                path = self.given / str(name)
                if path.parent.resolve().is_relative_to(self.given.resolve()):
                    path.unlink(missing_ok=True)
            (self.given / "set.txt").unlink(missing_ok=True)
        for name, pattern in RUN_FOLDERS.items():
            folder = self.path / name
            for path in [] if folder.is_symlink() or not folder.is_dir() else list(folder.iterdir()):
                if re.fullmatch(rf"{pattern}|\..*\.tmp", path.name):
                    path.unlink()
        for name in ("given", *RUN_FOLDERS):
            _remove_if_empty(self.path / name)
        later = [part.name for name in IN_PARTS for part in parts_of(self.path / name)[1:]]
        for name in (*RUN_FILES, *later):
            with suppress(IsADirectoryError):
                (self.path / name).unlink(missing_ok=True)
        for path in self.path.glob("trace-rank-*.txt"):
            path.unlink()

    def _names_in_given(self, given: Mapping[str, str | bytes]) -> dict[str, str | bytes]:
        """The files with their places in given/: those that would lead out of it lie in it under their last name."""
        inside = {}
        for name, content in given.items():
            place = os.path.normpath(name)
            leads_out = os.path.isabs(place) or place.split(os.sep)[0] == os.pardir
            inside[Path(place).name if leads_out else place] = content
        return inside

    def _fill(self, config: str, given: Mapping[str, str | bytes], sets: Sequence[str]) -> None:
        self.given.mkdir(exist_ok=True)
        for name, content in given.items():
            target = self.given / name
            target.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(target, content)
        write_atomic(self.given / "set.txt", "".join(f"{line}\n" for line in sets))
        write_atomic(self.config, config)

    def _undo(self, made: list[Path], begun: bool) -> None:
        """Remove what `create` made, if it had begun: before that it is another's run, or one to be replaced."""
        if begun:
            with suppress(OSError, FileError):
                self._remove_run()
        self.unlock()
        for folder in made:
            if os.path.isdir(folder) and not any(folder.iterdir()):
                folder.rmdir()

    def lock(self) -> None:
        """Hold the folder until `unlock` or the end of the process; clean up after dead ones. FileError."""
        path, looks = self.path / LOCK, 0
        while True:
            flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC
            file = os.fdopen(os.open(path, flags, 0o644), "r+b")  # stays open as long as the lock is held
            looks += 1
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                if looks < LOOKS:
                    file.close()
                    time.sleep(LOOK_SECONDS)
                    continue
                file.seek(0)
                owner = file.read(200).decode(errors="replace").strip() or "another process"
                file.close()
                raise FileError(f"{self.path} is in use by {owner}; wait for it or choose another folder") from None
            except OSError as error:
                if error.errno not in NO_LOCKS:
                    raise
                log.warning("%s: no locks on this file system (%s): run there once at a time", path, error.strerror)
            if path.exists() and os.path.samestat(os.fstat(file.fileno()), os.stat(path)):
                break
            file.close()  # its holder has just removed it
        file.truncate(0)
        file.write(f"process {os.getpid()} on {platform.node()}\n".encode())
        file.flush()
        self._lock = file
        self._sweep()

    def held(self) -> bool | None:
        """True if a process holds the folder. None where that is not seen: a free lock of a process of another machine,
        as not all file systems share locks, or a lock that cannot be tried.
        """
        try:
            with open(self.path / LOCK, "rb") as file:
                owner = file.read(200).decode(errors="replace").strip()
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        except FileNotFoundError:  # who leaves in order removes it
            return False
        except OSError:
            return None
        return False if owner.endswith(f" on {platform.node()}") else None

    def unlock(self) -> None:
        if self._lock is not None:
            (self.path / LOCK).unlink(missing_ok=True)
            self._lock.close()
            self._lock = None

    def _sweep(self) -> None:
        """Remove temporary files of processes that are gone."""
        for path in [*self.path.glob(".*.tmp"), *self.path.glob("*/.*.tmp")]:
            pid = path.name.split(".")[-2]
            if pid.isdigit() and not _alive(int(pid)):
                path.unlink(missing_ok=True)

    def read_run(self) -> dict[str, Any]:
        """Content of run.json. Raises FileError."""
        try:
            content = json.loads(self.run_json.read_bytes())
        except FileNotFoundError as error:
            raise FileError(f"{self.path}: not a run folder (no run.json in it)") from error
        except (OSError, ValueError, RecursionError) as error:
            raise FileError(f"{self.run_json}: cannot be read ({error})") from error
        if not isinstance(content, dict):
            raise FileError(f"{self.run_json}: not a JSON object")
        return content

    def mend(self) -> list[str]:
        """Put a run.json that cannot be read aside, and replace it; warnings of that. Raises FileError."""
        try:
            self.read_run()
        except FileError as error:
            kept = self.path / "run.json.damaged"
            try:
                os.replace(self.run_json, kept)
            except OSError as refused:
                raise FileError(f"cannot put {self.run_json} aside: {explain(refused)}") from refused
            self.update(status="unknown", started=_now())
            return [f"{error.message}: kept as {kept.name}; what it said of the run so far is missing in the new one"]
        return []

    def update(self, **facts: Any) -> None:
        """Set keys of run.json; the file is replaced as a whole. Numbers that are not finite become null."""
        content = self.read_run() if self.run_json.exists() else {}
        write_json(self.run_json, content | facts)

    def finish(self, status: str, exit_code: int, **facts: Any) -> None:
        """Last entry in run.json: how the run ended."""
        self.update(status=status, exit_code=exit_code, finished=_now(), **facts)

    def write_timers(self, sections: Mapping[str, Mapping[str, float]]) -> None:
        """timers.csv: a row per section; the columns are the keys (min, avg, max in seconds, share, ...)."""
        columns = list(dict.fromkeys(key for row in sections.values() for key in row))
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(["section", *columns])
        writer.writerows([name, *(row.get(key, "") for key in columns)] for name, row in sections.items())
        write_atomic(self.timers, text.getvalue())

    def stop_asked(self) -> bool:
        """True if the user has put a file STOP there."""
        return self.stop_file.exists()


def _missing_parents(path: Path) -> list[Path]:
    """The folders that do not exist yet, innermost first."""
    return [folder for folder in (path, *path.parents) if not os.path.exists(folder)]


def _probe(folder: Path) -> None:
    """Fail now rather than at the first output: no permission, read-only, full. Raises OSError."""
    probe = temporary(folder / "probe")
    try:
        with create_anew(probe) as file:
            os.posix_fallocate(file.fileno(), 0, 65536)
    finally:
        probe.unlink(missing_ok=True)


def _remove_if_empty(folder: Path) -> None:
    """A folder in which there are only empty folders; a link to one goes, and what it leads to stays."""
    if folder.is_symlink():
        folder.unlink()
    elif folder.is_dir():
        for path in folder.iterdir():
            if path.is_dir() and not path.is_symlink():
                _remove_if_empty(path)
        if not any(folder.iterdir()):
            folder.rmdir()


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
