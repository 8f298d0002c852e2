"""kill -9 at any moment leaves complete files: what was there before the last write, or after it."""

import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from series_table import read_csv

from hpcpic.core.errors import FileError
from hpcpic.core.files import image
from hpcpic.core.files.arrays import FieldArray, ParticleArray, Shard
from hpcpic.core.files.reader import Fields, Particles
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.files.series import SeriesWriter, read_series
from hpcpic.core.files.snapshot import FieldsWriter, ParticlesWriter
from hpcpic.core.files.together import ALONE
from hpcpic.core.run import checkpoint
from hpcpic.core.space.domain import Domain

KILLS = 20
LONGEST = 0.01  # s; a write takes 1 to 10 ms


def killed(write: Callable[[], Iterator[None]], delay: float) -> None:
    """Let a child process write, and kill it this long after its second write was complete."""
    told, tell = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            for _ in write():
                os.write(tell, b".")
        finally:
            os._exit(1)
    os.close(tell)
    for _ in range(2):
        assert os.read(told, 1) == b".", "the writer ended by itself"
    time.sleep(delay)
    os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    os.close(told)
    assert os.WTERMSIG(status) == signal.SIGKILL, "the writer ended by itself"


def delays(seed: int) -> list[float]:
    return np.random.default_rng(seed).uniform(0, LONGEST, KILLS).tolist()


def state(step: int) -> np.ndarray:
    return np.full((40_000, 2), float(step))


def write_checkpoints(rundir: RunDir, first: int) -> Iterator[None]:
    step = first
    while True:
        checkpoint.write(ALONE, rundir, step, float(step), {"x": Shard(state(step), 0, 40_000)})
        yield
        step += 1


def test_checkpoints(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    rundir = RunDir(tmp_path)
    last = 0
    checkpoint.write(ALONE, rundir, 0, 0.0, {"x": Shard(state(0), 0, 40_000)})
    for delay in delays(1):
        killed(lambda: write_checkpoints(rundir, last + 1), delay)  # noqa: B023 - runs within this round
        reader = checkpoint.newest(rundir)
        assert caplog.text == "", "a checkpoint was not complete"
        assert reader.step >= last and np.array_equal(reader.read("x"), state(reader.step))
        last = reader.step
    assert last >= 2 * KILLS
    checkpoint.write(ALONE, rundir, last + 1, 0.0, {"x": Shard(state(0), 0, 40_000)})
    assert sorted(path.suffix for path in rundir.checkpoints.iterdir()) == [".h5", ".h5"]


def write_series(rundir: RunDir, after: int | None) -> Iterator[None]:
    writer = SeriesWriter(rundir, {"a": "m"}, after=after)
    step = -1 if after is None else after
    while True:
        step += 1
        writer.append(step, step / 8, {"a": step / 3})
        if step % 3 == 0:
            writer.flush()
            yield


def test_series(tmp_path: Path) -> None:
    rundir = RunDir(tmp_path)
    SeriesWriter(rundir, {"a": "m"})
    after: int | None = None
    for delay in delays(2):
        killed(lambda: write_series(rundir, after), delay)  # noqa: B023
        for found in (read_series(tmp_path), read_csv(tmp_path / "series.csv")):
            n = len(found.step)
            assert n == 0 or found.step[-1] == n - 1
            assert np.array_equal(found.step, np.arange(n)) and np.array_equal(found["a"], found.step / 3)
        steps = read_series(tmp_path).step
        after = int(steps[-1]) if len(steps) else None
    assert after is not None and after >= 3 * KILLS


def test_series_at_a_restart(tmp_path: Path) -> None:
    rundir = RunDir(tmp_path)
    writer = SeriesWriter(rundir, {"a": "m"})
    for step in range(100):
        writer.append(step, step / 8, {"a": step / 3})
    writer.flush()

    def restart() -> Iterator[None]:
        while True:
            SeriesWriter(rundir, {"a": "m"}, after=99)
            yield

    for delay in delays(6)[:10]:
        killed(restart, delay)
        for found in (read_series(tmp_path), read_csv(tmp_path / "series.csv")):
            assert np.array_equal(found.step, np.arange(100)) and np.array_equal(found["a"], found.step / 3)


BOX = Domain((1.0, 1.0), (30, 20), (True, True), (0, 30))


def write_fields(path: Path, first: int) -> Iterator[None]:
    writer = FieldsWriter(ALONE, path, after=first - 1)
    step = first
    while True:
        writer.append(step, float(step), BOX, {"rho": FieldArray(np.full((30, 20), float(step)))})
        yield
        step += 1


def test_fields(tmp_path: Path) -> None:
    path = tmp_path / "fields.vtkhdf"
    count = 0
    for delay in delays(3):
        killed(lambda: write_fields(path, count), delay)  # noqa: B023
        found = Fields(path)
        assert len(found.steps) >= count and found.steps.tolist() == list(range(len(found.steps)))
        count = len(found.steps)
        for step in range(max(0, count - 20), count):
            assert np.all(found.read("rho", step) == step)
    assert count >= 2 * KILLS
    assert all(np.all(Fields(path).read("rho", step) == step) for step in range(count))


def cloud(step: int) -> ParticleArray:
    n = 50 * (step % 7)
    return ParticleArray(np.arange(n), np.full((n, 3), float(step)), {"q": np.full(n, step / 3)})


def write_particles(path: Path, first: int) -> Iterator[None]:
    writer = ParticlesWriter(ALONE, path, after=first - 1)
    step = first
    while True:
        writer.append(step, float(step), {"ions": cloud(step)})
        yield
        step += 1


def test_particles(tmp_path: Path) -> None:
    path = tmp_path / "particles.vtkhdf"
    count = 0
    for delay in delays(4):
        killed(lambda: write_particles(path, count), delay)  # noqa: B023
        found = Particles(path)
        assert len(found.steps) >= count
        count = len(found.steps)
        for step in range(max(0, count - 8), count):
            columns = found.read("ions", step)
            assert np.array_equal(columns["id"], cloud(step).ids)
            assert np.all(columns["position"] == step) and np.all(columns["q"] == step / 3)
    assert count >= 2 * KILLS


class Killed(BaseException):
    """What no handler of errors takes for its own, like kill -9."""


@pytest.mark.parametrize("share", [0.0, 0.5], ids=["before a write", "in a write"])
def test_after_any_write_of_a_step(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, share: float) -> None:
    """A file whose writer ended after any number of its writes can grow; between two of them it can be read too."""
    path = tmp_path / "fields.vtkhdf"
    write_all, left, count = image.write_all, 0, 1

    def last_writes(descriptor: int, content: bytes, address: int) -> None:
        nonlocal left
        left -= 1
        if left < 0:
            write_all(descriptor, memoryview(content)[: int(share * len(content))], address)
            raise Killed
        write_all(descriptor, content, address)

    def steps() -> int:
        found = Fields(path)
        assert all(np.all(found.read("rho", k) == k) for k in range(len(found.steps)))
        return len(found.steps)

    next(write_fields(path, 0))
    monkeypatch.setattr(image, "write_all", last_writes)
    while True:
        left = writes = count - 1
        try:
            next(write_fields(path, count))
            break
        except Killed:
            assert share or steps() in (count, count + 1)
        left = 1000
        next(write_fields(path, count))
        count += 1
        assert steps() == count
    assert writes > 10, "the writes of a step"


def test_run_json(tmp_path: Path) -> None:
    rundir = RunDir.create(tmp_path / "run", config="")

    def write() -> Iterator[None]:
        while True:
            rundir.update(filler="x" * 10_000)
            yield

    for delay in delays(5)[:10]:
        killed(write, delay)
        assert rundir.read_run()["status"] == "running"
    with pytest.raises(FileError, match="is in use"):
        RunDir(rundir.path).lock()
    rundir.unlock()
    RunDir(rundir.path).lock()  # removes the temporaries of the dead
    assert not list(rundir.path.glob(".*.tmp"))
