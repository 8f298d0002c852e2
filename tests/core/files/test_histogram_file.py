"""histograms.h5 of a process that was killed."""

import subprocess
import sys
import time
from pathlib import Path

import histogram_file
import numpy as np
import pytest
from histogram_file import counted

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
