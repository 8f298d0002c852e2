"""What series.csv and series.units.csv hold, as spreadsheets read them."""

import csv
from pathlib import Path

import numpy as np

from hpcpic.core.files.series import STEP, TIME, Series


def read_csv(path: Path) -> Series:
    names, *rows = csv.reader(path.read_text().splitlines())
    columns = dict(zip(names, np.array(rows, np.float64).reshape(len(rows), len(names)).T, strict=True))
    units = dict(csv.reader(path.with_suffix(".units.csv").read_text().splitlines()))
    step, time = columns.pop(STEP).astype(np.int64), columns.pop(TIME)
    return Series(columns, {name: units[name] for name in columns}, step, time)
