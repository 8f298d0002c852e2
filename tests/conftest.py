"""MPI under pytest: a world for the tests, and a failure on one rank that neither hangs nor escapes others.

After each mpi test all ranks agree on its outcome. A rank that failed waits for the others; if they do
not come, it prints its report and aborts all. A rank that passed fails with the others. At the end each rank
leaves its counts, "passed failed", in the folder $HPCPIC_MPI_REPORT.
"""

import gc
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from hpcpic.core.simd import own

# isort: split
from numba.core import event  # after hpcpic, which sets what numba reads when it is imported

gc.set_threshold(50_000)  # as programs do: what compiles makes many objects that stay
os.fsync = lambda descriptor: None  # no test cuts the power; each call would take milliseconds, a run has dozens
# A busy machine fails no test.
settings.register_profile("busy", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("busy")

PATIENCE_S = 3.0
TIMEOUT_S = 60
NAMESPACE = "HPCPIC_TEST_NAMESPACE"  # set in a test run within one
TEXT = "numba.cpython.unicode"
_REFEREES = pytest.StashKey()
_counts = {"passed": 0, "failed": 0}


def _parallel(config: pytest.Config) -> bool:
    return bool(config.getoption("--with-mpi", default=False))


class _Texts(event.Listener):
    """Functions of texts that numba has compiled since it was last asked."""

    def __init__(self) -> None:
        self.compiled: list[str] = []

    def on_start(self, one: event.Event) -> None:
        function = one.data["dispatcher"].py_func
        if function.__module__ == TEXT:
            self.compiled.append(function.__name__)

    def on_end(self, one: event.Event) -> None:
        """Nothing to do."""


_texts = _Texts()
event.register("numba:compile", _texts)


@pytest.fixture(autouse=True)
def runs_keep_no_file_of_another_test() -> Iterator[None]:
    """What a test registers for cases is kept by the runs of that test alone."""
    before = own.files.copy(), own.typed.copy()
    yield
    for noted, known in zip((own.files, own.typed), before):
        noted.intersection_update(known)


@pytest.fixture(autouse=True)
def no_texts_in_kernels() -> Iterator[None]:
    """What an array copied into a slice brings (a[:n] = b[:n]) to say that shapes differ takes four seconds to compile;
    a loop takes none. Seen where no cache has the kernel.
    """
    yield
    found, _texts.compiled = _texts.compiled, []
    assert not found, "a kernel formats text: " + ", ".join(found)


@pytest.fixture(scope="session")
def world():
    from hpcpic.core.comm.world import World

    return World.start()


@pytest.fixture(scope="module")
def pool():
    """One thread."""
    from hpcpic.core.tasks.graph import Pool

    made = Pool(1)
    yield made
    made.close()


def _mount(folder: Path) -> bool:
    """A file system of 3 MB, if this process may."""
    words = ["mount", "-t", "tmpfs", "-o", "size=3m", "tmpfs", str(folder)]
    return not subprocess.run(words, capture_output=True).returncode


@pytest.fixture
def hangups() -> Iterator[None]:
    """SIGHUP is heard, here and in programs that are started, also where `nohup` has it ignored."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 3 MB. Who may not mount one runs the test in a user namespace (see below)."""
    made = tmp_path / "disk"
    made.mkdir()
    mounted = _mount(made)
    yield made
    if mounted:
        subprocess.run(["umount", "-l", str(made)], check=True)


@pytest.fixture
def disk_order(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, str, int]]:
    """What is asked of the disk, in order: ("sync", name, bytes) of files and folders, ("rename", new name, bytes)."""
    order: list[tuple[str, str, int]] = []
    replace, fsync = os.replace, os.fsync

    def noted_replace(source, target, **folders) -> None:
        order.append(("rename", Path(target).name, os.path.getsize(source)))
        replace(source, target, **folders)

    def noted_fsync(descriptor) -> None:
        order.append(("sync", Path(os.readlink(f"/proc/self/fd/{descriptor}")).name, os.fstat(descriptor).st_size))
        fsync(descriptor)

    monkeypatch.setattr(os, "replace", noted_replace)
    monkeypatch.setattr(os, "fsync", noted_fsync)
    return order


def pytest_pyfunc_call(pyfuncitem):
    """A test with a disk that could not be mounted runs in a namespace whose root may: its outcome is that one's."""
    made = pyfuncitem.funcargs.get("disk")
    if made is None or made.is_mount():
        return None
    words = ["unshare", "--map-root-user", "--mount", sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
    inside = dict(os.environ, **{NAMESPACE: "1"})
    assert NAMESPACE not in os.environ, "root of a user namespace may not mount here: a full disk cannot be tried"
    done = subprocess.run(
        [*words, pyfuncitem.nodeid], cwd=pyfuncitem.config.rootpath, env=inside, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return True


def pytest_collection_modifyitems(config, items):
    """A rank that is stuck inside MPI hears no signal: the timeout of mpi tests comes from a thread."""
    if _parallel(config):
        from mpi4py import MPI

        config.stash[_REFEREES] = MPI.COMM_WORLD.Dup()  # apart from the messages of the tests
        for item in items:
            if item.get_closest_marker("mpi"):
                item.add_marker(pytest.mark.timeout(TIMEOUT_S, method="thread"))


def _agree(referees, failed: bool, report: str) -> bool:
    """Whether the test failed on any rank; ends the run if this rank failed and the others do not come."""
    from mpi4py import MPI

    mine, anybody = np.array([failed], np.int64), np.zeros(1, np.int64)
    request = referees.Iallreduce(mine, anybody, MPI.MAX)
    start = time.monotonic()
    while not request.Test():
        if failed and time.monotonic() - start > PATIENCE_S:
            os.write(2, f"\nrank {referees.Get_rank()} failed, the others still wait:\n{report}\n".encode())
            referees.Abort(1)
        time.sleep(0.0005)
    return bool(anybody[0])


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    report = yield
    if _parallel(item.config) and item.get_closest_marker("mpi") and call.when == "call":
        anywhere = _agree(item.config.stash[_REFEREES], report.failed, report.longreprtext)
        if anywhere and not report.failed:
            report.outcome, report.longrepr = "failed", "failed on another rank"
    if call.when == "call" and report.outcome in _counts:
        _counts[report.outcome] += 1
    elif report.failed:  # in set-up or tear-down
        _counts["failed"] += 1
    return report


def pytest_sessionfinish(session):
    folder = os.environ.get("HPCPIC_MPI_REPORT")
    if folder and _parallel(session.config):
        from mpi4py import MPI

        rank = MPI.COMM_WORLD.Get_rank()
        Path(folder, f"rank{rank}").write_text(f"{_counts['passed']} {_counts['failed']}\n")
