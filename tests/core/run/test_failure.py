"""One rank here, or several that fail together; tests/cli plays failures of one rank among several."""

import os
import signal
import tempfile
import threading
import time

import pytest

from hpcpic.core.comm.world import World
from hpcpic.core.errors import ConfigError, Diverged, FileError
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.run.failure import Agreed, Failure, Watchdog, everywhere, guarded, share


@pytest.fixture(scope="module")
def world():
    return World.start()


@pytest.mark.parametrize(
    "error, code, traces",
    [
        (ValueError("bug"), 1, 1),
        (ConfigError("bad key"), 2, 0),
        (Diverged("not finite"), 4, 0),
        (FileError("disk full"), 6, 0),
    ],
)
def test_code_and_traceback_follow_from_the_kind_of_error(world, capfd, error, code, traces):
    def main(failure):
        raise error

    assert guarded(world, main) == code
    told = capfd.readouterr().err
    assert told.count("Traceback") == traces and told.count(str(error)) >= 1


def test_sys_exit_and_interrupts_are_failures_too(world, capfd):
    def leave(failure):
        raise SystemExit(3)

    def interrupt(failure):
        raise KeyboardInterrupt

    assert guarded(world, leave) == 3 and "sys.exit(3)" in capfd.readouterr().err
    assert guarded(world, interrupt) == 1


def test_what_goes_well_returns_its_own_code(world):
    assert guarded(world, lambda failure: 5) == 5


def test_the_thread_hook_and_the_folder_are_put_back(world):
    hook = threading.excepthook
    folders = []

    def main(failure):
        folders.append(failure.folder)
        assert threading.excepthook is not hook and failure.folder.is_dir()
        return 0

    guarded(world, main)
    assert threading.excepthook is hook and not folders[0].exists()


def test_only_the_first_to_take_the_token_tells(world, tmp_path, capfd, monkeypatch):
    monkeypatch.setattr("hpcpic.core.run.failure.REPORT_SECONDS", 0.0)
    told = []
    for _ in range(3):
        failure = Failure(world)
        failure.folder = tmp_path
        failure.on_failure = lambda text, code: told.append(code)
        failure.fail(FileError("disk full"))
        failure.close()
    assert capfd.readouterr().err.count("disk full") == 1 and told == [6]


def check_shared(world, capfd):
    assert share(world, lambda: b"text" if world.rank == 0 else b"other") == b"text"

    def fail():
        raise ConfigError(["line 1", "line 2"])

    with pytest.raises(Agreed) as caught:
        share(world, fail)
    assert isinstance(caught.value.error, ConfigError) and caught.value.error.message == "line 1\nline 2"
    capfd.readouterr()
    assert guarded(world, lambda failure: len(share(world, fail))) == 2
    assert capfd.readouterr().err.count("line 1\nline 2") == (world.rank == 0)

    def collective(failure):
        with everywhere():
            raise FileError("damaged")

    assert guarded(world, collective) == 6
    assert capfd.readouterr().err.count("damaged") == (world.rank == 0)


def test_what_all_know_is_told_once(world, capfd):
    check_shared(world, capfd)


@pytest.mark.mpi(min_size=2)
def test_what_all_ranks_know_is_told_by_rank_0_and_ends_nobody(capfd):
    check_shared(World.start(), capfd)


def test_the_watchdog_ends_a_process_that_stands_still(tmp_path, capfd):
    child = os.fork()
    if child == 0:
        Watchdog(RunDir(tmp_path), 3, least=0.2).feed(0.0)
        time.sleep(30)
        os._exit(0)
    begin = time.monotonic()
    _, status = os.waitpid(child, 0)
    assert os.waitstatus_to_exitcode(status) == 1 and time.monotonic() - begin < 5
    assert "Timeout" in (tmp_path / "trace-rank-3.txt").read_text()
    told = capfd.readouterr().err
    assert told.startswith("rank 3: nothing went on for") and "trace-rank-3.txt" in told


def test_a_run_whose_steps_got_slow_goes_on(tmp_path):
    """What it was fed with is long over, but each step is shorter than the patience."""
    watchdog = Watchdog(RunDir(tmp_path), 0, least=1.2)
    watchdog.feed(0.0)
    for _ in range(20):
        time.sleep(0.1)
        watchdog.step()
    watchdog.close()
    assert list(tmp_path.iterdir()) == []


def test_a_suspended_process_goes_on(tmp_path):
    """Time for which it was stopped is not time in which it stood still."""
    child = os.fork()
    if child == 0:
        Watchdog(RunDir(tmp_path), 0, least=2.0).feed(0.0)
        for _ in range(10):  # before it is stopped, and after
            time.sleep(0.05)
        os._exit(0)
    os.kill(child, signal.SIGSTOP)
    time.sleep(3.0)
    os.kill(child, signal.SIGCONT)
    _, status = os.waitpid(child, 0)
    assert os.waitstatus_to_exitcode(status) == 0


def test_a_fed_or_resting_watchdog_leaves_nothing(tmp_path):
    watchdog = Watchdog(RunDir(tmp_path), 0, least=1.2)
    for _ in range(16):
        watchdog.feed(0.0)
        time.sleep(0.1)
    watchdog.rest()
    time.sleep(1.5)
    watchdog.close()
    assert list(tmp_path.iterdir()) == []


def test_long_steps_have_twenty_of_themselves_and_only_as_long_as_they_are_feared(tmp_path):
    watchdog = Watchdog(RunDir(tmp_path), 0)
    for seconds, patience in ((60.0, 1200.0), (0.01, 600.0), (100.0, 2000.0)):
        watchdog.feed(seconds)
        assert watchdog.patience == patience
    watchdog.close()


def test_without_a_temporary_folder_a_failure_is_told_all_the_same(world, capfd, monkeypatch):
    def refuse(**_):
        raise FileNotFoundError(2, "No usable temporary directory found")

    def main(failure):
        raise ConfigError("bad key")

    monkeypatch.setattr(tempfile, "mkdtemp", refuse)
    assert guarded(world, main) == 2
    assert capfd.readouterr().err == "rank 0 of 1: bad key\n"


def test_no_memory_is_told_in_one_line(world, capfd):
    def main(failure):
        raise MemoryError("Unable to allocate 7 TiB")

    assert guarded(world, main) == 1
    told = capfd.readouterr().err
    assert "no memory: Unable to allocate 7 TiB" in told and "Traceback" not in told


def test_a_file_that_rank_0_cannot_reach_is_a_file_error_on_all_ranks(world, tmp_path):
    for reach in ((tmp_path / "none" / "file").read_bytes, RunDir("/proc/self").lock):
        with pytest.raises(Agreed) as caught:
            share(world, reach)
        assert isinstance(caught.value.error, FileError) and "No such file" in str(caught.value)
