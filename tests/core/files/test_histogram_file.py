"""histograms.h5 of a process that was killed."""

import subprocess
import sys
import time
from pathlib import Path

import histogram_file
import numpy as np
import pytest
from histogram_file import counted

from hpcpic.core.files.arrays import Counts
from hpcpic.core.files.histograms import FILE, HistogramsWriter, read_histogram
from hpcpic.core.files.together import ALONE


@pytest.mark.parametrize("more", [0.0, 0.013, 0.029, 0.041])
def test_a_kill_leaves_complete_rows_and_a_file_that_goes_on(tmp_path: Path, more: float) -> None:
    writing = subprocess.Popen([sys.executable, histogram_file.__file__, str(tmp_path)])
    path = tmp_path / FILE
    while not path.exists() or path.stat().st_size < 2_000_000:
        assert writing.poll() is None
        time.sleep(0.01)
    time.sleep(more)
    writing.kill()
    writing.wait()
    steps = len(read_histogram(tmp_path, "fv").step)
    assert steps > 10
    writer = HistogramsWriter(ALONE, path, after=steps - 3)
    writer.append(steps - 2, 0.1, counted(steps - 2))
    writer.flush()
    found = read_histogram(tmp_path, "fv")
    assert found.step.tolist() == list(range(steps - 1)) == found.beyond.tolist()
    assert all(np.all(row == step) for step, row in enumerate(found.density))


def test_other_bins_go_on_in_the_next_file_and_the_same_are_joined(tmp_path: Path) -> None:
    path = tmp_path / FILE
    other = {"gv": Counts(np.arange(4), 0, {"vx": np.arange(5.0)}, {"vx": "m/s"}, 1.0)}
    for step, found in enumerate([counted(0), {**counted(1), **other}, other, counted(3)]):
        writer = HistogramsWriter(ALONE, path, after=step - 1)
        writer.append(step, 0.1 * step, found)
        writer.flush()
    fv, gv = read_histogram(tmp_path, "fv"), read_histogram(tmp_path, "gv")
    assert fv.step.tolist() == [0, 1, 3] == fv.density[:, 0].tolist() and gv.step.tolist() == [1, 2]
    few = {"fv": Counts(np.full(3, 4), 4, {"vx": np.arange(4.0)}, {"vx": "m/s"}, 1.0)}
    writer = HistogramsWriter(ALONE, path, after=3)
    writer.append(4, 0.4, few)
    writer.flush()
    assert read_histogram(tmp_path, "fv").density.tolist() == [[4.0] * 3]
