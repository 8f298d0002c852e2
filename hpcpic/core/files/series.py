"""Scalars in time: series.h5 and series.csv, written by rank 0.

The table has a row of names and then numbers only, so that any reader of tables takes it as it is; the units of its
columns stand in series.units.csv, and in the attributes of series.h5.

Rows are buffered, and appended by a short open-write-close when `flush` is called, so a process killed at any moment
leaves readable files. In the HDF5 file `step` grows last and tells how many rows are valid.
"""

import os
import time as clock
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.case.gauge import STEP, TIME
from hpcpic.core.errors import FileError
from hpcpic.core.files import image
from hpcpic.core.files.atomic import discard, temporary, write_atomic
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.files.safe_hdf5 import open_checked
from hpcpic.core.files.together import explain

if TYPE_CHECKING:
    import h5py

CHUNK_ROWS = 512
FLUSH_SECONDS = 5.0


class Series(dict[str, NDArray]):
    """name -> values[rows], with `units` of each name and `step`, `time` of the rows."""

    def __init__(self, values: Mapping[str, NDArray], units: Mapping[str, str], step: NDArray, time: NDArray) -> None:
        super().__init__(values)
        self.units = dict(units)
        self.step = step
        self.time = time


class SeriesWriter:
    """Appends rows to the series of a run. For rank 0."""

    def __init__(self, rundir: RunDir, units: Mapping[str, str], after: int | None = None) -> None:
        """A new series; at a restart the rows up to step `after` of the present one are kept, later ones
        dropped.

        A scalar that one part of the run lacks is NaN there. Raises FileError.
        """
        self._rundir = rundir
        self._units = dict(units)
        self._rows: list[tuple[int, float, list[float]]] = []
        self._flushed = clock.monotonic()
        kept = Series({}, {}, np.empty(0, np.int64), np.empty(0))
        if after is not None and self._h5.exists():
            kept = _cut(read_series(rundir.path), after)
        self._start(kept)

    @property
    def _h5(self) -> Path:
        return self._rundir.path / "series.h5"

    @property
    def _csv(self) -> Path:
        return self._rundir.path / "series.csv"

    def _start(self, kept: Series) -> None:
        """Put both files in place, with the rows that are kept."""
        self._units = {**self._units, **kept.units, **self._units}
        nothing = np.full(len(kept.step), np.nan)
        columns = {TIME: kept.time, **{name: kept.get(name, nothing) for name in self._units}}

        def build(file: "h5py.File") -> dict[str, image.Slot]:
            for name, unit in {STEP: "1", TIME: "s", **self._units}.items():
                dtype = np.int64 if name == STEP else np.float64
                image.growing(file, name, (), dtype, (CHUNK_ROWS,)).attrs["units"] = unit
            extend(file, columns)
            announce(file, kept.step)
            return {}

        made = temporary(self._h5)
        try:
            made.unlink(missing_ok=True)
            image.create(made, build)
            os.replace(made, self._h5)
        except OSError as error:
            discard(made)
            raise FileError(f"cannot make {self._h5}: {explain(error)}") from error
        write_atomic(units_path(self._csv), units_text({STEP: "1", TIME: "s", **self._units}))
        write_atomic(self._csv, _lines([[STEP, TIME, *self._units]]) + _lines(_texts(kept.step, columns)))

    def append(self, step: int, time: float, values: Mapping[str, float]) -> None:
        """Add a row; a missing value is NaN."""
        self._rows.append((int(step), float(time), [float(values.get(name, np.nan)) for name in self._units]))

    @property
    def due(self) -> bool:
        """True if rows have waited for FLUSH_SECONDS."""
        return bool(self._rows) and clock.monotonic() - self._flushed > FLUSH_SECONDS

    def flush(self) -> None:
        """Bring the buffered rows to the files. Raises FileError; the files keep the rows they had."""
        if not self._rows:
            return
        rows, self._rows = self._rows, []
        self._flushed = clock.monotonic()
        steps = np.array([row[0] for row in rows], np.int64)
        columns = {
            TIME: np.array([row[1] for row in rows]),
            **{name: np.array([row[2][k] for row in rows]) for k, name in enumerate(self._units)},
        }
        try:
            image.change(self._h5, lambda file: extend(file, columns))
            image.change(self._h5, lambda file: announce(file, steps))
        except OSError as error:
            raise FileError(f"cannot append to {self._h5}: {explain(error)}") from error
        self._append_csv(_lines(_texts(steps, columns)))

    def _append_csv(self, text: str) -> None:
        try:
            with open(self._csv, "r+b", buffering=0) as file:
                old = file.seek(0, os.SEEK_END)
                try:
                    image.write_all(file.fileno(), text.encode(), old)
                except OSError:
                    file.truncate(old)
                    raise
        except OSError as error:
            raise FileError(f"cannot append to {self._csv}: {explain(error)}") from error


def extend(file: "h5py.File", columns: Mapping[str, NDArray]) -> None:
    first = len(file[STEP])
    for name, values in columns.items():
        image.extend(file[name], first + len(values))
        file[name][first : first + len(values)] = values


def announce(file: "h5py.File", steps: NDArray[np.int64]) -> None:
    first = len(file[STEP])
    image.extend(file[STEP], first + len(steps))
    file[STEP][first:] = steps


def _texts(steps: NDArray[np.int64], columns: Mapping[str, NDArray]) -> list[list[str]]:
    """The rows as texts from which the same numbers are read back."""
    table = [steps.tolist(), *(values.tolist() for values in columns.values())]
    return [[repr(value) for value in row] for row in zip(*table, strict=True)]


def units_path(table: Path) -> Path:
    """The table of units that belongs to a table."""
    return table.with_suffix(".units.csv")


def units_text(units: Mapping[str, str]) -> str:
    """A table of units: a row for each column of the table it belongs to."""
    return _lines([["name", "unit"], *([name, unit or "1"] for name, unit in units.items())])


def _lines(rows: list[list[str]]) -> str:
    return "".join(",".join(row) + "\n" for row in rows)


def _cut(series: Series, after: int) -> Series:
    keep = series.step <= after
    return Series(
        {name: values[keep] for name, values in series.items()},
        series.units,
        series.step[keep],
        series.time[keep],
    )


def read_series(folder: Path | str) -> Series:
    """The series of a run folder, up to the last complete row. Raises FileError."""
    with open_checked(Path(folder) / "series.h5") as file:
        step = file.dataset(STEP, np.int64, (None,))[:]
        rows = len(step)
        time = file.dataset(TIME, np.float64, (None,))[:rows]
        values, units = {}, {}
        for name in file.names():
            if name in (STEP, TIME):
                continue
            values[name] = file.dataset(name, np.float64, (None,))[:rows]
            units[name] = str(file.attribute(name, "units"))
        return Series(values, units, step, time)
