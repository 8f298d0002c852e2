"""A full disk is a clear error: no signal, no half file, what was written before is as it was."""

import os
import resource
import signal
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from histogram_file import counted
from series_table import read_csv

from hpcpic.core.errors import FileError
from hpcpic.core.files.arrays import FieldArray, ParticleArray, Shard
from hpcpic.core.files.histograms import FILE, HistogramsWriter, read_histogram
from hpcpic.core.files.openpmd import OpenPMDWriter
from hpcpic.core.files.reader import Fields, Particles
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.files.series import SeriesWriter, read_series
from hpcpic.core.files.snapshot import FieldsWriter, ParticlesWriter
from hpcpic.core.files.together import ALONE
from hpcpic.core.run import checkpoint
from hpcpic.core.space.domain import Domain

FULL = "No space left on device.*free some space"


def fill(folder: Path, leave: int) -> Path:
    """A file that leaves so many bytes free."""
    free = os.statvfs(folder)
    ballast = folder / "ballast"
    with open(ballast, "wb") as file:
        os.posix_fallocate(file.fileno(), 0, max(4096, free.f_bavail * free.f_frsize - leave))
    return ballast


def state(step: int, n: int = 100_000) -> dict[str, Shard]:
    return {"x": Shard(np.full(n, float(step)), 0, n)}


@pytest.mark.parametrize("leave", [0, 4096, 100_000, 700_000, 802_816])
def test_checkpoint(disk: Path, leave: int) -> None:
    rundir = RunDir(disk)
    for step in (1, 2):
        checkpoint.write(ALONE, rundir, step, 0.0, state(step))
    ballast = fill(disk, leave)
    with pytest.raises(FileError, match=rf"cannot write the checkpoint .*00000003.h5: {FULL}") as failure:
        checkpoint.write(ALONE, rundir, 3, 0.0, state(3))
    assert failure.value.exit_code == 6
    assert sorted(path.name for path in rundir.checkpoints.iterdir()) == ["00000001.h5", "00000002.h5"]
    assert checkpoint.newest(rundir).read("x")[0] == 2
    ballast.unlink()
    checkpoint.write(ALONE, rundir, 3, 0.0, state(3))
    assert checkpoint.newest(rundir).step == 3


def until_full(append: Callable[[int], None], limit: int = 100_000) -> int:
    """Steps that were written before the disk was full."""
    for step in range(limit):
        try:
            append(step)
        except FileError as error:
            assert "No space left on device" in error.message
            return step
    raise AssertionError("the disk did not fill up")


def test_series(disk: Path) -> None:
    fill(disk, 300_000)
    writer = SeriesWriter(RunDir(disk), {"a": "m"})

    def append(step: int) -> None:
        for row in range(100 * step, 100 * step + 100):
            writer.append(row, row / 8, {"a": row / 3})
        writer.flush()

    written = 100 * until_full(append)
    assert written > 2000
    for found in (read_series(disk), read_csv(disk / "series.csv")):
        assert len(found.step) >= written and len(found.step) % 100 == 0
        assert np.array_equal(found.step, np.arange(len(found.step))) and np.array_equal(found["a"], found.step / 3)


def test_fields(disk: Path) -> None:
    box = Domain((1.0, 1.0), (100, 100), (True, True), (0, 100))
    writer = FieldsWriter(ALONE, disk / "fields.vtkhdf")

    def append(step: int) -> None:
        writer.append(step, 0.1 * step, box, {"rho": FieldArray(np.full((100, 100), float(step)))})

    written = until_full(append)
    assert written > 30
    found = Fields(disk / "fields.vtkhdf")
    assert found.steps.tolist() == list(range(written))
    assert all(np.all(found.read("rho", step) == step) for step in range(written))


def test_particles(disk: Path) -> None:
    writer = ParticlesWriter(ALONE, disk / "particles.vtkhdf")

    def cloud(step: int) -> ParticleArray:
        return ParticleArray(np.arange(1000), np.full((1000, 3), float(step)), {"q": np.full(1000, step / 3)})

    written = until_full(lambda step: writer.append(step, 0.1 * step, {"ions": cloud(step)}))
    assert written > 30
    found = Particles(disk / "particles.vtkhdf")
    assert found.steps.tolist() == list(range(written))
    for step in range(written):
        columns = found.read("ions", step)
        assert np.all(columns["position"] == step) and np.all(columns["q"] == step / 3)


def test_histograms(disk: Path) -> None:
    writer = HistogramsWriter(ALONE, disk / FILE)

    def append(step: int) -> None:
        writer.append(step, 0.1 * step, counted(step))
        writer.flush()

    written = until_full(append)
    found = read_histogram(disk, "fv")
    assert written > 30 and found.step.tolist() == list(range(written))
    assert all(np.all(row == step) for step, row in enumerate(found.density))


def test_openpmd(disk: Path) -> None:
    box = Domain((1.0,), (20_000,), (True,), (0, 20_000))
    writer = OpenPMDWriter(ALONE, disk / "openpmd", 0.1)
    written = until_full(lambda step: writer.append(step, 0.1, box, {"rho": FieldArray(np.ones(20_000))}, {}))
    assert len(list((disk / "openpmd").iterdir())) == written > 10


def test_run_folder(disk: Path) -> None:
    fill(disk, 8192)
    with pytest.raises(FileError, match=f"cannot make the run folder .*{FULL}"):
        RunDir.create(disk / "run", config="x")
    assert [path.name for path in disk.iterdir()] == ["ballast"]


def test_a_limit_on_file_size_is_the_same(tmp_path: Path) -> None:
    """RLIMIT_FSIZE: the signal SIGXFSZ is ignored, as Python does, and the call fails."""
    assert signal.getsignal(signal.SIGXFSZ) == signal.SIG_IGN
    rundir = RunDir(tmp_path)
    checkpoint.write(ALONE, rundir, 1, 0.0, state(1, 1000))
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, limits[1]))
    try:
        with pytest.raises(FileError, match=r"cannot write the checkpoint .*File too large"):
            checkpoint.write(ALONE, rundir, 2, 0.0, state(2))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert [path.name for path in rundir.checkpoints.iterdir()] == ["00000001.h5"]
    assert checkpoint.newest(rundir).step == 1
