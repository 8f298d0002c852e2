"""Counts for tests of histograms.h5; as a program it writes them until it is killed."""

import sys
from pathlib import Path

import numpy as np

from hpcpic.core.files.arrays import Counts
from hpcpic.core.files.histograms import FILE, HistogramsWriter
from hpcpic.core.files.together import ALONE

BINS = 5000


def counted(step: int) -> dict[str, Counts]:
    """A histogram whose density is `step` in every bin."""
    edges = {"vx": np.arange(BINS + 1.0)}
    return {"fv": Counts(np.full(BINS, step), step, edges, {"vx": "m/s"}, 1.0)}


if __name__ == "__main__":
    writer = HistogramsWriter(ALONE, Path(sys.argv[1]) / FILE)
    for step in range(10**6):
        writer.append(step, 0.1 * step, counted(step))
        writer.flush()
