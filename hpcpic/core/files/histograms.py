"""Histograms in time: histograms.h5, written by rank 0.

/step [rows] and /time [rows] s are those of all histograms; each is a group of its name: `counts` [rows, bins, ...] of
the axes that its attribute `axes` lists, with `scale_factor`, the density of a count, in the unit `units`; `beyond`
[rows], particles in no bin; and by the name of each axis the edges [bins + 1] of its bins. As in series.h5, `step`
grows last and tells how many rows are valid. A restart that counts others, or in other bins, begins the next file
(`parts.part_of`).
"""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.errors import FileError
from hpcpic.core.files import image
from hpcpic.core.files.arrays import Counts
from hpcpic.core.files.atomic import temporary
from hpcpic.core.files.parts import part_of, parts_of
from hpcpic.core.files.safe_hdf5 import Checked, open_checked
from hpcpic.core.files.series import CHUNK_ROWS, STEP, TIME, announce, extend
from hpcpic.core.files.together import Alone, together

if TYPE_CHECKING:
    import h5py

    from hpcpic.core.comm.world import World

FILE = "histograms.h5"
BUFFER_BYTES = 4 << 20  # of counts that wait for the file
CHUNK_BYTES = 128 << 10


class HistogramsWriter:
    """Appends to the histograms of a run; at a restart the rows up to step `after` are kept. Every method is collective
    and raises FileError on all ranks; the file is then as before.
    """

    def __init__(
        self,
        world: "World | Alone",
        path: Path,
        after: int | None = None,
        before: Callable[[], None] = lambda: None,
    ) -> None:
        """At a restart the rows up to `after` are kept; `before()` is called when the file is about to change."""
        self.world, self.path, self._bytes = world, path, 0
        self.before = before
        self._rows: list[tuple[int, float, Mapping[str, Counts]]] = []

        def keep(file: "h5py.File") -> None:
            file[STEP].resize(int(np.count_nonzero(file[STEP][:] <= after)), axis=0)

        with together(world, f"cannot take up {path}"):
            if world.rank == 0 and after is not None:
                for self.path in parts_of(path):
                    image.settle(self.path)
                    image.change(self.path, keep)

    def append(self, step: int, time: float, found: Mapping[str, Counts]) -> None:
        self._rows.append((step, time, found))
        self._bytes += sum(one.counts.nbytes for one in found.values())
        if self._bytes >= BUFFER_BYTES:
            self.flush()

    def flush(self) -> None:
        rows, self._rows, self._bytes = self._rows, [], 0
        if not rows:
            return
        self.before()
        with together(self.world, f"cannot append to {self.path}"):
            if self.world.rank == 0:
                self._write(rows)

    def _write(self, rows: list[tuple[int, float, Mapping[str, Counts]]]) -> None:
        first = rows[0][2]
        if self.path.exists() and not _fits(self.path, first):
            whole = self.path.with_name(FILE)
            self.path = part_of(whole, len(parts_of(whole)) + 1)
        if not self.path.exists():
            made = temporary(self.path)
            made.unlink(missing_ok=True)
            image.create(made, lambda file: _lay_out(file, first))
            os.replace(made, self.path)
        columns = {TIME: np.array([time for _, time, _ in rows])}
        for name in first:
            columns[f"{name}/counts"] = np.array([found[name].counts for *_, found in rows])
            columns[f"{name}/beyond"] = np.array([found[name].beyond for *_, found in rows])

        def add(file: "h5py.File") -> None:
            extend(file, columns)

        image.change(self.path, add)
        image.change(self.path, lambda file: announce(file, np.array([step for step, *_ in rows])))


def _lay_out(file: "h5py.File", first: Mapping[str, Counts]) -> dict[str, image.Slot]:
    image.growing(file, STEP, (), np.int64, (CHUNK_ROWS,))
    image.growing(file, TIME, (), np.float64, (CHUNK_ROWS,)).attrs["units"] = "s"
    for name, one in first.items():
        rows = max(1, min(CHUNK_ROWS, CHUNK_BYTES // one.counts.nbytes))
        shape = one.counts.shape
        counts = image.growing(file, f"{name}/counts", shape, np.int64, (rows, *shape))
        counts.attrs.update({"units": one.unit, "scale_factor": one.density, "axes": [*one.edges]})
        image.growing(file, f"{name}/beyond", (), np.int64, (CHUNK_ROWS,))
        for axis, edges in one.edges.items():
            dataset = image.growing(file, f"{name}/{axis}", (), np.float64, (len(edges),))
            image.extend(dataset, len(edges))
            dataset[:] = edges
            dataset.attrs["units"] = one.units[axis]
    return {}


def _fits(path: Path, found: Mapping[str, Counts]) -> bool:
    """True if the file has these histograms and no others, with the same bins. Raises FileError."""
    with open_checked(path) as file:
        return _names(file) == {*found} and all(
            _same_bins(_edges(file, name), one.edges) for name, one in found.items()
        )


def _names(file: Checked) -> set[str]:
    return {*file.names()} - {STEP, TIME}


def _edges(file: Checked, name: str) -> dict[str, NDArray[np.float64]]:
    axes = file.attribute(f"{name}/counts", "axes")
    return {axis: file.dataset(f"{name}/{axis}", np.float64, (None,))[:] for axis in axes}


def _same_bins(one: Mapping[str, NDArray], other: Mapping[str, NDArray]) -> bool:
    return [*one] == [*other] and all(np.array_equal(edges, other[axis]) for axis, edges in one.items())


@dataclass(frozen=True, slots=True)
class Histogram:
    """One histogram of a run: density[rows, bins, ...] in `unit` of the axes whose bins have `edges` in `units`, and
    how many particles lay in no bin.
    """

    step: NDArray[np.int64]
    time: NDArray[np.float64]
    density: NDArray[np.float64]
    unit: str
    beyond: NDArray[np.int64]
    edges: Mapping[str, NDArray[np.float64]]
    units: Mapping[str, str]


def read_histogram(folder: Path, name: str) -> Histogram:
    """A histogram of a run folder, up to the last complete row: the rows in the bins that it was counted in last.
    Raises FileError.
    """
    found: list[Histogram] = []
    there: set[str] = set()
    for path in parts_of(folder / FILE) or [folder / FILE]:
        with open_checked(path) as file:
            there |= _names(file)
            if name in _names(file):
                found.append(_read(file, name))
    if not found:
        raise FileError(f"{folder / FILE}: no histogram {name}; there are {', '.join(sorted(there))}")
    found = [one for one in found if len(one.step)] or found[-1:]
    same = [one for one in found if _same_bins(one.edges, found[-1].edges)]
    return replace(
        found[-1],
        step=np.concatenate([one.step for one in same]),
        time=np.concatenate([one.time for one in same]),
        density=np.concatenate([one.density for one in same]),
        beyond=np.concatenate([one.beyond for one in same]),
    )


def _read(file: Checked, name: str) -> Histogram:
    step, edges = file.dataset(STEP, np.int64, (None,))[:], _edges(file, name)
    rows = len(step)
    counts = file.dataset(f"{name}/counts", np.int64, (None,) * (1 + len(edges)))[:rows]
    return Histogram(
        step,
        file.dataset(TIME, np.float64, (None,))[:rows],
        counts * float(file.attribute(f"{name}/counts", "scale_factor")),
        str(file.attribute(f"{name}/counts", "units")),
        file.dataset(f"{name}/beyond", np.int64, (None,))[:rows],
        edges,
        {axis: str(file.attribute(f"{name}/{axis}", "units")) for axis in edges},
    )
