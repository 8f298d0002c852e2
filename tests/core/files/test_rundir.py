"""A run folder is made whole or not at all, is never overwritten unasked, and has one owner."""

import errno
import fcntl
import json
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from hpcpic.core.errors import FileError
from hpcpic.core.files import rundir as rundir_module
from hpcpic.core.files.atomic import temporary, write_atomic
from hpcpic.core.files.provenance import provenance
from hpcpic.core.files.rundir import RunDir

HOLD = """
import sys
from hpcpic.core.files.rundir import RunDir
rundir = RunDir(sys.argv[1]); rundir.lock(); print("held", flush=True); sys.stdin.read()
"""


def tree(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def dead_pid() -> int:
    child = subprocess.Popen([sys.executable, "-c", ""])
    child.wait()
    return child.pid


def test_a_new_folder_holds_what_the_run_was_given(tmp_path: Path) -> None:
    given = {"case.conf": "a = 1;", "parts/ions.conf": b"b = 2;", "../../escape.conf": "c = 3;"}
    rundir = RunDir.create(tmp_path / "runs" / "one", config="full", given=given, sets=["a=2"], facts={"ranks": 4})
    files = tree(rundir.path)
    assert files["config.conf"] == b"full"
    assert files["given/case.conf"] == b"a = 1;" and files["given/parts/ions.conf"] == b"b = 2;"
    assert files["given/escape.conf"] == b"c = 3;"
    assert files["given/set.txt"] == b"a=2\n"
    content = rundir.read_run()
    assert (content["status"], content["ranks"]) == ("running", 4)
    assert list(tmp_path.rglob("*escape*")) == [rundir.given / "escape.conf"]


def test_a_run_is_refused_without_replace_and_not_touched(tmp_path: Path) -> None:
    RunDir.create(tmp_path, config="first").unlock()
    before = tree(tmp_path)
    with pytest.raises(FileError, match=r"holds a run already \(run.json, config.conf.*--replace") as failure:
        RunDir.create(tmp_path, config="second")
    assert failure.value.exit_code == 6
    assert tree(tmp_path) == before


def test_replace_removes_what_the_run_made_and_nothing_else(tmp_path: Path) -> None:
    RunDir.create(tmp_path, config="first", given={"old.conf": "", "parts/ions.conf": ""}).unlock()
    own = ["series.h5", "STOP", "post-mortem.txt", "trace-rank-3.txt", "checkpoints/00000001.h5",
           "checkpoints/.00000002.h5.1.tmp", "openpmd/data00000001.h5"]  # fmt: skip
    others = ["checkpoints/notes.txt", "given/mine.txt", "given/deep/mine.txt", "notes.txt", "openpmd/mine.h5"]
    for name in own + others:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("x")
    RunDir.create(tmp_path, replace=True, config="second").unlock()
    assert sorted(tree(tmp_path)) == sorted(["config.conf", "given/set.txt", "run.json", *others])
    assert (tmp_path / "config.conf").read_text() == "second" and not (tmp_path / "given/parts").exists()


@pytest.mark.parametrize("run_json", [None, "mine", "[]", '{"scripts": {"start": "node"}}'])
@pytest.mark.parametrize("name", ["given/a.txt", "checkpoints/best.h5", "openpmd/x", "report.html", "log.txt"])
def test_replace_touches_nothing_where_there_is_no_run(tmp_path: Path, name: str, run_json: str | None) -> None:
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text("mine")
    if run_json is not None:
        (tmp_path / "run.json").write_text(run_json)
    before = tree(tmp_path)
    for replace in (False, True):
        with pytest.raises(FileError, match=r"no run\.json of a run: they are not touched"):
            RunDir.create(tmp_path, replace, config="second")
    assert tree(tmp_path) == before


def test_a_run_that_cannot_be_replaced_is_still_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    RunDir.create(tmp_path, config="first").unlock()
    before = tree(tmp_path)

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(FileError, match="No space left on device"):
        RunDir.create(tmp_path, replace=True, config="second")
    assert tree(tmp_path) == before


def test_a_folder_with_other_files_may_take_a_run(tmp_path: Path) -> None:
    (tmp_path / "case.conf").write_text("mine")
    RunDir.create(tmp_path, config="")
    assert (tmp_path / "case.conf").read_text() == "mine"


def test_a_failed_creation_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("x")
    before = tree(tmp_path)

    def fail(self: RunDir, **facts: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(RunDir, "update", fail)
    for folder in (tmp_path / "a" / "b", tmp_path / "mine"):
        with pytest.raises(FileError, match=r"cannot make the run folder .*No space left on device; free some space"):
            RunDir.create(folder, config="x")
    assert tree(tmp_path) == before and not (tmp_path / "a").exists()


def test_a_path_that_cannot_be_is_a_file_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(FileError, match="cannot make the run folder"):
        RunDir.create(tmp_path / "file" / "run", config="")
    with pytest.raises(FileError, match="cannot make the run folder"):
        RunDir.create(tmp_path / "file", config="")


def test_two_processes_cannot_hold_one_folder(tmp_path: Path) -> None:
    holder = subprocess.Popen([sys.executable, "-c", HOLD, tmp_path], stdin=-1, stdout=-1, text=True)
    assert holder.stdout is not None and holder.stdout.readline() == "held\n"
    with pytest.raises(FileError, match=rf"is in use by process {holder.pid} on "):
        RunDir.create(tmp_path, config="")
    with pytest.raises(FileError, match="is in use"):
        RunDir(tmp_path).lock()
    holder.kill()  # leaves the lock file behind
    holder.communicate()
    assert (tmp_path / ".lock").exists()
    rundir = RunDir.create(tmp_path, config="")
    with pytest.raises(FileError, match=f"process {os.getpid()}"):
        RunDir(tmp_path).lock()
    rundir.unlock()
    assert not (tmp_path / ".lock").exists()
    RunDir(tmp_path).lock()


def test_who_holds_a_folder_is_seen_as_far_as_it_can_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert RunDir(tmp_path).held() is False
    holder = subprocess.Popen([sys.executable, "-c", HOLD, tmp_path], stdin=-1, stdout=-1, text=True)
    assert holder.stdout is not None and holder.stdout.readline() == "held\n"
    assert RunDir(tmp_path).held() is True
    holder.kill()
    holder.communicate()
    assert RunDir(tmp_path).held() is False
    with monkeypatch.context() as elsewhere:  # where a free lock may be that of a process which this machine cannot see
        elsewhere.setattr(rundir_module.platform, "node", lambda: "another")
        assert RunDir(tmp_path).held() is None

    def none(*_: object) -> None:
        raise OSError(errno.ENOLCK, "no locks")

    monkeypatch.setattr(fcntl, "flock", none)
    assert RunDir(tmp_path).held() is None


def test_a_folder_that_is_only_being_looked_at_is_not_in_use(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / ".lock").touch()
    with open(tmp_path / ".lock", "rb") as reader:
        fcntl.flock(reader, fcntl.LOCK_SH)
        monkeypatch.setattr(rundir_module.time, "sleep", lambda _: reader.close())
        held = RunDir(tmp_path)
        held.lock()
        assert reader.closed and held.held()
    held.unlock()


def test_a_lock_that_its_holder_removes_is_taken_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The file that was opened has no name any more when it is locked: two could hold the folder."""
    flock, lock = fcntl.flock, tmp_path / ".lock"

    def late(*words) -> None:
        monkeypatch.setattr(fcntl, "flock", flock)
        lock.unlink()
        flock(*words)

    monkeypatch.setattr(fcntl, "flock", late)
    held = RunDir(tmp_path)
    held.lock()
    with pytest.raises(FileError, match="in use"):
        RunDir(tmp_path).lock()
    held.unlock()


@pytest.mark.parametrize("number", [errno.ENOSYS, errno.ENOLCK, errno.EIO])
def test_a_file_system_without_locks_takes_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    def refuse(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    told: list[str] = []
    monkeypatch.setattr(rundir_module.log, "warning", lambda text, *words: told.append(text % words))
    monkeypatch.setattr(fcntl, "flock", refuse)
    if number == errno.EIO:
        with pytest.raises(FileError, match=os.strerror(number)):
            RunDir.create(tmp_path / "run", config="")
        return
    RunDir.create(tmp_path / "run", config="").unlock()
    RunDir(tmp_path / "run").lock()
    assert len(told) == 2 and "no locks on this file system" in told[0]


def test_temporaries_of_dead_processes_are_removed(tmp_path: Path) -> None:
    (tmp_path / "checkpoints").mkdir()
    dead = dead_pid()
    old = [temporary(tmp_path / "run.json", dead), temporary(tmp_path / "checkpoints" / "00000001.h5", dead)]
    kept = [temporary(tmp_path / "run.json"), tmp_path / "notes.tmp"]
    for path in [*old, *kept]:
        path.write_text("x")
    RunDir(tmp_path).lock()
    assert not any(path.exists() for path in old) and all(path.exists() for path in kept)


def test_run_json_is_replaced_as_a_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rundir = RunDir.create(tmp_path / "run", config="")
    rundir.finish("finished", 0, steps=np.int64(7), energy=math.nan, spread=np.array([1.0, np.inf]), who=Path("x"))
    content = json.loads(rundir.run_json.read_text(), parse_constant=lambda name: pytest.fail(name))
    assert (content["status"], content["exit_code"], content["steps"]) == ("finished", 0, 7)
    assert content["energy"] is None and content["spread"] == [1.0, None] and content["who"] == "x"
    monkeypatch.setattr(os, "replace", lambda *paths: (_ for _ in ()).throw(OSError(5, "Input/output error")))
    with pytest.raises(FileError, match=r"cannot write .*run.json: Input/output error"):
        rundir.update(steps=8)
    assert rundir.read_run() == content
    assert sorted(p.name for p in rundir.path.iterdir()) == [".lock", "config.conf", "given", "run.json"]


def test_a_file_is_on_the_disk_before_its_name_and_its_name_before_we_go_on(tmp_path: Path, disk_order: list) -> None:
    """A loss of power leaves the old file or the new one, never an empty one of the new name."""
    write_atomic(tmp_path / "table.csv", "x" * 5000)
    made, size = temporary(tmp_path / "table.csv").name, 5000
    assert disk_order[:2] == [("sync", made, size), ("rename", "table.csv", size)]
    assert [what[:2] for what in disk_order[2:]] == [("sync", tmp_path.name)]


def test_of_two_starts_at_once_one_is_refused_and_takes_nothing_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The other made its run, and ended, after this one has seen that there is none."""
    lock = RunDir.lock

    def late(self: RunDir) -> None:
        monkeypatch.setattr(RunDir, "lock", lock)
        RunDir.create(tmp_path, config="first", given={"case.conf": "first"}).unlock()
        lock(self)

    monkeypatch.setattr(RunDir, "lock", late)
    with pytest.raises(FileError, match="holds a run already"):
        RunDir.create(tmp_path, config="second")
    assert (tmp_path / "config.conf").read_text() == "first" and (tmp_path / "given/case.conf").exists()
    assert RunDir(tmp_path).read_run()["status"] == "running"
    RunDir(tmp_path).lock()  # it is not held


def test_links_in_the_way_are_not_followed(tmp_path: Path) -> None:
    victim, target = tmp_path / "victim", tmp_path / "table.csv"
    victim.write_text("mine")
    temporary(target).symlink_to(victim)
    write_atomic(target, "new")
    assert (victim.read_text(), target.read_text()) == ("mine", "new")
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / ".lock").symlink_to(victim)
    with pytest.raises(FileError, match="links"):
        RunDir.create(tmp_path / "run", config="")
    assert victim.read_text() == "mine"


def test_open_wants_a_run(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="no such folder"):
        RunDir.open(tmp_path / "none")
    with pytest.raises(FileError, match="not a run folder"):
        RunDir.open(tmp_path)
    for content in ("{", "[]", "[" * 100_000):
        write_atomic(tmp_path / "run.json", content)
        with pytest.raises(FileError, match=r"run.json"):
            RunDir.open(tmp_path).read_run()


def test_timers_and_stop_file(tmp_path: Path) -> None:
    rundir = RunDir(tmp_path)
    rundir.write_timers({"push": {"min": 1.0, "max": 0.1 + 0.2}, "other": {"min": 2.0}})
    assert rundir.timers.read_text() == "section,min,max\npush,1.0,0.30000000000000004\nother,2.0,\n"
    assert not rundir.stop_asked()
    rundir.stop_file.touch()
    assert rundir.stop_asked()


def test_provenance_tells_the_machine_and_keeps_the_environment_to_itself(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("API_TOKEN", "do-not-tell")
    found = provenance("MPICH  Version: 5\n")
    assert found["mpi"] == "MPICH Version: 5" and found["cpu"] and found["host"]
    assert {"hpcpic", "python", "numpy", "h5py"} <= set(found["versions"])
    assert "do-not-tell" not in json.dumps(found)
    assert found["git"] is None or len(found["git"]["commit"]) == 40
