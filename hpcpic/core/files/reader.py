"""A run folder as arrays, for notebooks, plots and comparisons:

run = open_run("runs/two-stream")
run.series["energy_field"], run.series.time
run.field("rho", time=1.5), run.particles("electrons", step=100)["velocity"]
"""

import shlex
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.case.config import loads
from hpcpic.core.errors import FileError
from hpcpic.core.files.arrays import PARTICLE_UNITS
from hpcpic.core.files.histograms import FILE as HISTOGRAMS
from hpcpic.core.files.histograms import Histogram, read_histogram
from hpcpic.core.files.parts import parts_of
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.files.safe_hdf5 import Checked, open_checked
from hpcpic.core.files.series import Series, read_series

ROOT = "VTKHDF"


def open_run(path: Path | str, program: str = "") -> "Run":
    """A run folder, running or ended. Raises FileError when it is none, or not of the `program` that is named."""
    return Run(RunDir.open(path, program))


def _summary_of(rundir: RunDir) -> dict[str, Any]:
    """run.json, with the status "killed" where it says that a run goes on and no process holds the folder. Where that
    is not seen, `reason` says so.
    """
    facts = rundir.read_run()
    if facts.get("status") != "running" or rundir.held():
        return facts
    facts = rundir.read_run()  # it may have ended, or begun, meanwhile
    held = rundir.held()
    if facts.get("status") != "running" or held:
        return facts
    if held is None:
        host = facts.get("host") or "another machine"
        return facts | {"reason": f"as far as run.json tells: whether it goes on can be seen on {host} only"}
    kept = rundir.checkpoints.is_dir() and any(rundir.checkpoints.glob("*.h5"))
    way = f"go on with: {facts.get('program', 'PROGRAM')} restart {shlex.quote(str(rundir.path))}"
    reason = f"it left without a word; {way if kept else 'it left no checkpoint: start again'}"
    return facts | {"status": "killed", "reason": reason}


@dataclass(frozen=True, slots=True)
class _Part:
    """One file of snapshots, and the names of its arrays."""

    path: Path
    steps: NDArray[np.int64]
    times: NDArray[np.float64]
    names: tuple[str, ...]


class Snapshots:
    """The steps of a temporal VTKHDF file and of its further parts. `steps` and `times` [n]; `names` of the arrays of
    the last one; of each array of any `units` and `time_offsets`, by how many seconds it is of a later time than its
    step.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.units: dict[str, str] = {}
        self.time_offsets: dict[str, float] = {}
        self._parts = [self._part(part) for part in parts_of(path) or [path]]
        self.steps = np.concatenate([part.steps for part in self._parts])
        self.times = np.concatenate([part.times for part in self._parts])
        self._part_of = np.repeat(np.arange(len(self._parts)), [len(part.steps) for part in self._parts])
        self.names = self.names_at(-1) if len(self.steps) else self._parts[-1].names

    def _part(self, path: Path) -> _Part:
        with open_checked(path) as file:
            count = int(file.attribute(f"{ROOT}/Steps", "NSteps"))
            steps = file.dataset("step", np.int64, (None,))[:count]
            times = file.dataset(f"{ROOT}/Steps/Values", np.float64, (None,))[:count]
            names = tuple(file.names(f"{ROOT}/PointData"))
            for name in names:
                self.units[name] = str(file.attribute(f"{ROOT}/PointData/{name}", "units"))
                self.time_offsets[name] = float(file.attribute(f"{ROOT}/PointData/{name}", "time_offset", 0.0))
            return _Part(path, steps, times, names)

    @contextmanager
    def _open(self, index: int) -> Iterator[tuple[Checked, int]]:
        """The file that holds a snapshot, and the number of the snapshot in it."""
        number = int(self._part_of[index])
        with open_checked(self._parts[number].path) as file:
            yield file, index - int(np.searchsorted(self._part_of, number))

    def names_at(self, index: int) -> tuple[str, ...]:
        """The arrays of a snapshot: a restart may have written others from its step on."""
        return self._parts[int(self._part_of[index])].names

    def index(self, step: int | None = None, time: float | None = None, name: str | None = None) -> int:
        """Number of the snapshot at `step`, or nearest to `time`; the last one when neither is asked for. name: of an
        array, so that only snapshots count that hold it. Raises FileError.
        """
        if not len(self.steps):
            raise FileError(f"{self.path}: holds no step yet")
        if name is not None:
            self._require(name)
        holds = np.array([name is None or name in part.names for part in self._parts])[self._part_of]
        if step is not None:
            holds &= self.steps == step
        found = np.flatnonzero(holds)
        if not len(found):
            there = self.steps if name is None else self.steps_of(name)
            asked = f"{name} at step {step}" if len(there) < len(self.steps) else f"step {step}"
            raise FileError(f"{self.path}: no {asked}; there are {_listed(there) or 'none'}")
        return int(found[np.argmin(np.abs(self.times[found] - time))] if time is not None else found[-1])

    def steps_of(self, name: str) -> NDArray[np.int64]:
        """The steps of the snapshots that hold an array."""
        return self.steps[[name in self.names_at(k) for k in range(len(self.steps))]]

    def _require(self, name: str) -> None:
        if name not in self.units:
            raise FileError(f"{self.path}: no array {name}; there are {', '.join(self.units)}")


class Fields(Snapshots):
    """fields.vtkhdf. `points`, `spacing` and `first`, the place of the first point [m], in the order of the array axes,
    slab axis first, without axes of one point; those of `grid` and `origin` with them, up to the last axis that has
    several.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        with open_checked(path) as file:
            extent = np.asarray(file.attribute(ROOT, "WholeExtent"))
            points = [int(n) for n in (extent[1::2] - extent[::2] + 1)[::-1]]
            spacing = [float(d) for d in np.asarray(file.attribute(ROOT, "Spacing"))[::-1]]
            origin = [float(x) for x in np.asarray(file.attribute(ROOT, "Origin"))[::-1]]
            first = next((k for k, n in enumerate(points) if n > 1), len(points) - 1)
            self.grid = tuple(points[first:]), tuple(spacing[first:])
            self.origin = tuple(origin[first:])
            self.points = tuple(n for n in points if n > 1)
            self.spacing = tuple(d for n, d in zip(points, spacing) if n > 1)
            self.first = tuple(x for n, x in zip(points, origin) if n > 1)

    def read(self, name: str, index: int) -> NDArray:
        """values[rows, ...] of a snapshot; axes with one point are left out. A vector has the components of the run."""
        self._require(name)
        with self._open(index) as (file, own):
            vector = len(file.file[ROOT]["PointData"][name].shape) - 1 - len(self.points)
            values = file.dataset(f"{ROOT}/PointData/{name}", None, (None, *self.points, *(None,) * vector))
            offsets = file.dataset(f"{ROOT}/Steps/PointDataOffsets/{name}", np.int64, (None,))
            return _run_components(file, name, values[int(offsets[own])])


class Particles(Snapshots):
    """particles.vtkhdf. `species`: the names. `constants`: of each species what its particles have in common."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        with open_checked(path) as file:
            number = f"{ROOT}/PointData/species"
            self.species = [name for name in file.attribute(number, "names") if name]
            known = {name: file.attribute(number, name, ()) for name in PARTICLE_UNITS}
            self.constants = {
                species: {name: float(values[k]) for name, values in known.items() if k < len(values)}
                for k, species in enumerate(self.species)
            }

    def positions(self, species: Collection[str], index: int) -> NDArray:
        """position[n, 3] of these species together, in no order: where all else is not asked for it is not read."""
        with self._open(index) as (file, own):
            rows, number = _rows_of(file, own)
            wanted = [k for k, name in enumerate(self.species) if name in species]
            return _rows(file, f"{ROOT}/Points", rows)[np.isin(number, wanted)]

    def read(self, species: str, index: int) -> dict[str, NDArray]:
        """position[n, 3], id[n] and the other columns of one species, in the order of the ids."""
        if species not in self.species:
            raise FileError(f"{self.path}: no species {species}; there are {', '.join(self.species)}")
        with self._open(index) as (file, place):
            rows, number = _rows_of(file, place)
            ids = file.dataset(f"{ROOT}/PointData/id", np.int64, (None,))[rows]
            own = np.flatnonzero(number == self.species.index(species))
            own = own[np.argsort(ids[own], kind="stable")]
            result = {"id": ids[own], "position": _rows(file, f"{ROOT}/Points", rows)[own]}
            for name in self.names_at(index):
                if name not in ("id", "species"):
                    result[name] = _run_components(file, name, _rows(file, f"{ROOT}/PointData/{name}", rows)[own])
            return result


def _rows_of(file: Checked, index: int) -> tuple[slice, NDArray]:
    """The rows of a snapshot of particles, and the number of the species of each."""
    first = int(file.dataset(f"{ROOT}/Steps/PointOffsets", np.int64, (None,))[index])
    rows = slice(first, first + int(file.dataset(f"{ROOT}/NumberOfPoints", np.int64, (None,))[index]))
    return rows, file.dataset(f"{ROOT}/PointData/species", np.int32, (None,))[rows]


def _run_components(file: Checked, name: str, values: NDArray) -> NDArray:
    """The components that the run has of those in the file."""
    components = int(file.attribute(f"{ROOT}/PointData/{name}", "components", -1))
    return values[..., :components] if components >= 0 else values


def _rows(file: Checked, name: str, rows: slice) -> NDArray:
    shape = file.file[name].shape
    return file.dataset(name, None, (None,) * len(shape))[rows]


def _listed(steps: NDArray) -> str:
    shown = [str(step) for step in steps]
    return ", ".join(shown if len(shown) <= 8 else [*shown[:4], "...", *shown[-3:]])


class Run:
    """One run folder. Read when asked for, and then kept."""

    def __init__(self, rundir: RunDir) -> None:
        self.rundir = rundir
        self.path = rundir.path

    @cached_property
    def summary(self) -> dict[str, Any]:
        """run.json; what it cannot tell of a process that was killed, the lock of the folder tells."""
        return _summary_of(self.rundir)

    @cached_property
    def config(self) -> str:
        """config.conf, as used."""
        try:
            return self.rundir.config.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise FileError(f"{self.rundir.config}: cannot be read ({error})") from error

    @property
    def config_file(self) -> str:
        """The path of config.conf: the files that it names are relative to its folder."""
        return str(self.rundir.config)

    @cached_property
    def series(self) -> Series:
        table = self.path / "series.h5"
        if not table.exists() and self.summary.get("status") == "running":
            raise FileError(f"{table}: no such file yet: the run has not come to its first sample")
        return read_series(self.path)

    @cached_property
    def field_snapshots(self) -> Fields:
        if not self.rundir.fields.exists():
            raise self._without("fields.vtkhdf", "fields", "fields")
        return Fields(self.rundir.fields)

    @cached_property
    def particle_snapshots(self) -> Particles:
        if not self.rundir.particles.exists():
            raise self._without("particles.vtkhdf or grains.vtkhdf", "particles", "particles", "grains")
        return Particles(self.rundir.particles)

    def _without(self, file: str, what: str, *words: str) -> FileError:
        """That the run has no such snapshots, and the setting that asks for them: that of its case with such a word."""
        output = loads(self.config, self.config_file).data.get("output", {})
        names = [(group, word) for group in ("period", "every") for word in words if word in output.get(group, {})]
        way = "; {}.{}.{} asks for them".format("output", *names[0]) if names else ""
        return FileError(f"{self.path}: no {file}: the run has no snapshots of {what}{way}")

    def histogram(self, name: str) -> Histogram:
        """A histogram in time, by the name that the case gives it."""
        if not (self.path / HISTOGRAMS).exists():
            raise FileError(f"{self.path}: no {HISTOGRAMS}: the run has none; `histogram` of its case asks for them")
        return read_histogram(self.path, name)

    def field(self, name: str, step: int | None = None, time: float | None = None) -> NDArray:
        """One field at a step, at the snapshot nearest to a time, or at the last one."""
        return self.field_snapshots.read(name, self.field_snapshots.index(step, time, name))

    def fields(self, names: Iterable[str] | None = None, steps: Iterable[int] | None = None) -> dict[str, NDArray]:
        """name -> values[snapshots, rows, ...]; all names, and all steps that hold each, by default."""
        snapshots = self.field_snapshots
        those = None if steps is None else list(steps)
        asked = {
            name: snapshots.steps_of(name).tolist() if those is None else those
            for name in (snapshots.units if names is None else names)
        }
        return {name: np.array([self.field(name, step) for step in at]) for name, at in asked.items()}

    def particles(self, species: str, step: int | None = None, time: float | None = None) -> dict[str, NDArray]:
        """Columns of one species, in the order of the ids."""
        return self.particle_snapshots.read(species, self.particle_snapshots.index(step, time))
