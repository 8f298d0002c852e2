"""Arrays in time as temporal VTKHDF, which ParaView opens as it is: fields.vtkhdf (ImageData),
particles.vtkhdf (PolyData).

All ranks write their part of a step at its place (core.files.image); `NSteps`, which is what readers look at,
changes last, so a file is readable at any moment. A restart that writes other arrays leaves the file as it is, and
begins the next one (`parts.part_of`). Values are stored in the type they have. Vectors have three
components, without which VTK takes them for no vectors; the attribute `components` tells how many the run has. What is
flat lies at z = 0. `/step` holds the step numbers beside the times in `/VTKHDF/Steps/Values`.
https://docs.vtk.org/en/latest/vtk_file_formats/vtkhdf_file_format
"""

import math
import os
import time as clock
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hpcpic.core.errors import FileError
from hpcpic.core.files import image
from hpcpic.core.files.arrays import PARTICLE_UNITS, FieldArray, ParticleArray, Shard, spatial
from hpcpic.core.files.atomic import temporary
from hpcpic.core.files.image import Slot
from hpcpic.core.files.parts import part_of, parts_of
from hpcpic.core.files.safe_hdf5 import open_checked
from hpcpic.core.files.together import Alone, together
from hpcpic.core.space.domain import Domain

if TYPE_CHECKING:
    import h5py

    from hpcpic.core.comm.world import World

VERSION = (2, 2)
CHUNK_BYTES = 8 << 20
SMALL_CHUNK_BYTES = 128 << 10  # what is smaller shares a chunk with others: HDF5 finds a chunk by going through all
BUFFER_BYTES = 4 << 20  # of snapshots that wait for each other
STEPS_PER_CHUNK = 256
ROOT = "VTKHDF"
CELL_KINDS = ("Vertices", "Lines", "Polygons", "Strips")  # the last three are empty


@dataclass(frozen=True, slots=True)
class _Snapshot:
    """The arguments of one call of `append`; `attributes` of arrays, by their names."""

    step: int
    time: float
    shards: Mapping[str, Shard]
    attributes: Mapping[str, Mapping[str, Any]]
    facts: tuple[Any, ...]

    @property
    def described(self) -> dict[str, Any]:
        """Row shape and type of each array."""
        return {name: (shard.local.shape[1:], shard.local.dtype) for name, shard in self.shards.items()}

    @property
    def bytes(self) -> int:
        """Bytes of the arrays of all ranks."""
        return sum(s.total * math.prod(s.local.shape[1:]) * s.local.itemsize for s in self.shards.values())

    def kept(self) -> "_Snapshot":
        """With arrays of its own: the run goes on with those it was given."""
        copies = {name: Shard(np.array(s.local), s.offset, s.total) for name, s in self.shards.items()}
        return replace(self, shards=copies)


class _Temporal(ABC):
    """A temporal file: made at the first step, or taken up again at a restart.

    To change a file takes milliseconds, however little it gets. Small snapshots wait for each other, up to BUFFER_BYTES
    or until `flush`, while the writing would take more than `time_share` of the time; with 1, none waits.
    """

    def __init__(
        self,
        world: "World | Alone",
        path: Path,
        after: int | None = None,
        time_share: float = 1.0,
        before: Callable[[], None] = lambda: None,
    ) -> None:
        """At a restart the steps up to `after` are kept; `before()` is called when the file is about to change.
        Raises FileError on all ranks.
        """
        self.world = world
        self.time_share = time_share
        self.before = before
        self._waiting: list[_Snapshot] = []
        self._waiting_bytes = 0
        self._next_flush = 0.0  # by the clock of rank 0
        self._described: dict[str, Any] = {}  # what the steps so far of this writer hold
        parts: list[Path] = []
        with together(world, f"cannot take up {path}"):
            if world.rank == 0 and after is not None:
                parts = parts_of(path)
                for part in parts:
                    _take_up(part, after)
        self._name, self._number = path.name, int(world.max(float(len(parts))))
        self._exists = self._number > 0
        self.path = part_of(path, max(1, self._number))

    def _append(self, new: _Snapshot) -> None:
        """Add a step, now or with later ones. Raises FileError on all ranks; the file is then as before."""
        if self._waiting and new.described != self._waiting[0].described:
            self.flush()
        self._waiting.append(new)
        self._waiting_bytes += new.bytes
        due = self.time_share == 1.0 or self._waiting_bytes >= BUFFER_BYTES
        if due or self.world.any(self.world.rank == 0 and clock.monotonic() >= self._next_flush):
            self.flush()
        else:
            self._waiting[-1] = new.kept()

    def flush(self) -> None:
        """Bring what waits to the file, all ranks together. Raises FileError on all ranks; the file is as before."""
        batch, self._waiting, self._waiting_bytes = self._waiting, [], 0
        if not batch:
            return
        self.before()
        began = clock.monotonic()
        self._begin_part(batch[0])
        shards = {f"{name} {k}": shard for k, new in enumerate(batch) for name, shard in new.shards.items()}

        def build(file: "h5py.File") -> dict[str, Slot]:
            root = file.create_group(ROOT)
            root.attrs["Version"] = np.array(VERSION, np.int64)
            steps = root.create_group("Steps")
            steps.attrs["NSteps"] = np.int64(0)
            image.growing(file, "step", (), np.int64, (STEPS_PER_CHUNK,))
            image.growing(steps, "Values", (), np.float64, (STEPS_PER_CHUNK,)).attrs["units"] = "s"
            self._build(root, steps, batch[0])
            for name in batch[0].shards:
                root[name].attrs.update({"units": "", **batch[0].attributes.get(name, {})})
            return {}

        def grow(file: "h5py.File") -> dict[str, Slot]:
            n = int(file[ROOT]["Steps"].attrs["NSteps"])
            _put(file["step"], n, [new.step for new in batch])
            _put(file[ROOT]["Steps/Values"], n, [new.time for new in batch])
            return self._grow(file[ROOT], n, batch)

        def announce(file: "h5py.File") -> None:
            file[ROOT]["Steps"].attrs.modify("NSteps", file[ROOT]["Steps"].attrs["NSteps"] + len(batch))

        if not self._exists:
            with together(self.world, f"cannot make {self.path}"):
                if self.world.rank == 0:
                    _create(self.path, build)
            self._exists = True
        image.append(self.world, self.path, grow, shards, announce)
        now = clock.monotonic()
        self._next_flush = now + (now - began) / self.time_share

    def _begin_part(self, new: _Snapshot) -> None:
        """Go on in the next file where the present one holds other arrays. Raises FileError on all ranks."""
        described, self._described = self._described, new.described
        if not self._exists or new.described == described:
            return
        other = False
        with together(self.world, f"cannot append to {self.path}"):
            if self.world.rank == 0:
                with open_checked(self.path) as checked:
                    other = not _fits(checked.file, new)
        if self.world.any(other):
            self._number, self._exists = self._number + 1, False
            self.path = part_of(self.path.with_name(self._name), self._number)

    @abstractmethod
    def _build(self, root: Any, steps: Any, first: _Snapshot) -> None:
        """Lay out the file for its first step."""

    @abstractmethod
    def _grow(self, root: Any, n: int, batch: Sequence[_Snapshot]) -> dict[str, Slot]:
        """Make room for steps n, n + 1, ...: where each shard goes, by name and place in the batch."""


class FieldsWriter(_Temporal):
    """fields.vtkhdf: fields on the grid points, x fastest; a 1D or 2D grid has one point along other axes."""

    def append(self, step: int, time: float, domain: Domain, fields: Mapping[str, FieldArray]) -> None:
        """Add a step, all ranks together. Raises FileError on all ranks; the file is then as before."""
        low, _ = domain.row_range(self.world.rank)
        shards, attributes = {}, {}
        for name, field in fields.items():
            key, values = f"PointData/{name}", field.values
            attributes[key] = {"units": field.unit}
            if values.ndim > domain.ndim:
                attributes[key]["components"] = values.shape[-1]
                values = spatial(values)
            shards[key] = Shard(values, low, domain.points[0])
        self._append(_Snapshot(step, time, shards, attributes, (domain,)))

    def _build(self, root: Any, steps: Any, first: _Snapshot) -> None:
        domain: Domain = first.facts[0]
        described = first.described
        unused = (1,) * (3 - domain.ndim)
        points = (*unused, *domain.points)
        root.attrs["Type"] = np.bytes_("ImageData")
        root.attrs["WholeExtent"] = np.array([edge for n in points[::-1] for edge in (0, n - 1)], np.int64)
        spacing = np.array((*unused, *domain.spacing)[::-1])
        root.attrs["Origin"] = np.array((*(0.0 for _ in unused), *(domain.offset * d for d in domain.spacing))[::-1])
        root.attrs["Spacing"] = spacing
        root.attrs["Direction"] = np.eye(3).ravel()
        root.create_group("PointData")
        for name, (shape, dtype) in described.items():
            layer = _used(domain.points) + shape[domain.ndim - 1 :]
            axis = _slab_axis(domain)
            rows = CHUNK_BYTES // (math.prod(layer[axis:]) * dtype.itemsize)
            layers = max(1, min(CHUNK_BYTES, SMALL_CHUNK_BYTES) // (math.prod(layer) * dtype.itemsize))
            chunk = (layers, *layer) if axis == 0 else (layers, max(1, min(layer[0], rows)), *layer[1:])
            image.growing(root, name, layer, dtype, chunk)
        _counts(steps, "Layer")
        _link(steps, "Layer", [_offset_name(name) for name in described])

    def _grow(self, root: Any, n: int, batch: Sequence[_Snapshot]) -> dict[str, Slot]:
        slots: dict[str, Slot] = {}
        domain: Domain = batch[0].facts[0]
        points = _used(domain.points)
        for name in batch[0].shards:
            present = root[name].shape[1 : 1 + len(points)]
            if present != points:
                raise FileError(f"it holds a grid of {present} points, this run has {points}")
            layers = image.layer_slots(root[name], n, len(batch), _slab_axis(domain))
            slots |= {f"{name} {k}": slot for k, slot in enumerate(layers)}
        _put(root["Steps/Layer"], n, range(n, n + len(batch)))
        return slots


def _fits(file: "h5py.File", new: _Snapshot) -> bool:
    """True if the arrays of the file are those of the snapshot, of the same type, with as many components."""
    asked = {name for name in new.shards if name.startswith("PointData/")}
    return {f"PointData/{name}" for name in file[ROOT]["PointData"]} == asked and all(
        file[ROOT][name].dtype == shard.local.dtype
        and ("components" not in new.attributes.get(name, {}) or file[ROOT][name].shape[-1] == shard.local.shape[-1])
        for name, shard in new.shards.items()
    )


def _used(points: tuple[int, ...]) -> tuple[int, ...]:
    """VTK leaves out the axes that have one point."""
    return tuple(n for n in points if n > 1)


def _slab_axis(domain: Domain) -> int:
    """Axis of the data set that is cut among the ranks; 0, the steps, when there is only one row."""
    return 1 if domain.points[0] > 1 else 0


class ParticlesWriter(_Temporal):
    """particles.vtkhdf: a point and a vertex per particle, all species in one set, told apart by `species`.

    `species` numbers the species in the order of the dict; their names are its attribute `names`, what the particles of
    each have in common are the attributes `charge`, `mass` and `weighting`.
    The order of particles is that of ranks, then species; `id` identifies them.
    """

    _edges = 0  # numbers 0, 1, 2, ... in Vertices/Offsets

    def append(self, step: int, time: float, species: Mapping[str, ParticleArray]) -> None:
        """Add a step, all ranks together. The species must have the same columns.

        Raises FileError on all ranks; the file is then as before.
        """
        counts = np.zeros(self.world.size, np.int64)
        counts[self.world.rank] = sum(len(particles.ids) for particles in species.values())
        counts = self.world.sum_int(counts)
        offset, total = int(counts[: self.world.rank].sum()), int(counts.sum())
        with together(self.world, f"cannot append to {self.path}"):
            shards = {name: Shard(values, offset, total) for name, values in _joined(species).items()}
        shards |= self._vertices(offset, int(counts[self.world.rank]), total)
        attributes: dict[str, dict[str, Any]] = {"Points": {"units": "m"}}
        for particles in species.values():
            for name, values in particles.columns.items():
                offset_s = float(particles.time_offsets.get(name, 0.0))
                of_name = attributes[f"PointData/{name}"] = {
                    "units": particles.units.get(name, ""),
                    "time_offset": offset_s,
                }
                if values.ndim == 2:
                    of_name["components"] = values.shape[1]
        constants = {name: particles.constants for name, particles in species.items()}
        self._append(_Snapshot(step, time, shards, attributes, (constants, total)))
        self._edges = max(self._edges, total + 1)

    def _vertices(self, offset: int, count: int, total: int) -> dict[str, Shard]:
        """Vertex k is point k: 0, 1, 2, ... for the largest step so far, whose beginning every step uses."""
        end = offset + count
        behind_all = int(self.world.rank == self.world.size - 1)
        points = np.arange(max(offset, self._edges - 1), end)
        edges = np.arange(max(offset, self._edges), end + behind_all)
        return {
            "Vertices/Connectivity": Shard(points, int(points[0]) if len(points) else 0, total),
            "Vertices/Offsets": Shard(edges, int(edges[0]) if len(edges) else 0, total + 1),
        }

    def _build(self, root: Any, steps: Any, first: _Snapshot) -> None:
        constants, total = first.facts
        described = first.described
        root.attrs["Type"] = np.bytes_("PolyData")
        for name, (shape, dtype) in described.items():
            rows = max(1, min(max(total, 1024), CHUNK_BYTES // (math.prod(shape) * dtype.itemsize)))
            image.growing(root, name, shape, dtype, (rows, *shape))
        root["PointData/species"].attrs["names"] = list(constants) or [""]
        for name in PARTICLE_UNITS:
            if any(name in of_species for of_species in constants.values()):
                values = [of_species.get(name, 0.0) for of_species in constants.values()]
                root["PointData/species"].attrs[name] = np.array(values)
        for name in ("PartOffsets", "NumberOfParts", "PointOffsets"):
            _counts(steps, name)
        _link(steps, "PointOffsets", [_offset_name(name) for name in described if name.startswith("PointData/")])
        _counts(steps, "CellOffsets", (len(CELL_KINDS),))
        _link(steps, "CellOffsets", ["ConnectivityIdOffsets"])
        _counts(root, "NumberOfPoints")
        _link(root, "NumberOfPoints", ["Vertices/NumberOfCells", "Vertices/NumberOfConnectivityIds"])
        _counts(root, "Lines/NumberOfCells")
        _link(root, "Lines/NumberOfCells", ["Lines/NumberOfConnectivityIds"])
        _counts(root, "Lines/Connectivity")
        _counts(root, "Lines/Offsets")
        _put(root["Lines/Offsets"], 0, [0])
        _link(root, "Lines", ["Polygons", "Strips"])

    def _grow(self, root: Any, n: int, batch: Sequence[_Snapshot]) -> dict[str, Slot]:
        steps, count = root["Steps"], len(batch)
        totals = np.array([new.facts[1] for new in batch])
        before = int(steps["PointOffsets"][n - 1] + root["NumberOfPoints"][n - 1]) if n else 0
        first = before + np.concatenate([[0], np.cumsum(totals)[:-1]])
        _put(root["NumberOfPoints"], n, totals)
        _put(root["Lines/NumberOfCells"], n, np.zeros(count))
        _put(steps["PartOffsets"], n, range(n, n + count))
        _put(steps["NumberOfParts"], n, np.ones(count))
        _put(steps["PointOffsets"], n, first)
        _put(steps["CellOffsets"], n, np.zeros((count, len(CELL_KINDS))))
        slots = {}
        for name in batch[0].shards:
            dataset = root[name]
            for k, new in enumerate(batch):
                row = 0 if name.startswith("Vertices/") else int(first[k])
                slots[f"{name} {k}"] = image.rows_slot(dataset, row, new.shards[name].total)
        return slots


def _joined(species: Mapping[str, ParticleArray]) -> dict[str, Any]:
    """The columns of all species one after the other. Raises FileError when their columns differ."""
    names = {name: set(particles.columns) for name, particles in species.items()}
    for name, found in names.items():
        if found != next(iter(names.values())):
            raise FileError(f"species {name} has the columns {sorted(found)}, {next(iter(names))} has others")
    sets = list(species.values())
    if not sets:
        sets = [ParticleArray(np.zeros(0, np.int64), np.zeros((0, 3)))]
    parts = {
        "Points": [spatial(particles.position) for particles in sets],
        "PointData/id": [np.asarray(particles.ids, np.int64) for particles in sets],
        "PointData/species": [np.full(len(particles.ids), k, np.int32) for k, particles in enumerate(sets)],
    }
    for name, first in sets[0].columns.items():
        columns = [particles.columns[name] for particles in sets]
        parts[f"PointData/{name}"] = [*map(spatial, columns)] if first.ndim == 2 else columns
    return {name: np.concatenate(values) for name, values in parts.items()}


def _counts(group: Any, name: str, row: tuple[int, ...] = ()) -> None:
    image.growing(group, name, row, np.int64, (STEPS_PER_CHUNK, *row))


def _offset_name(name: str) -> str:
    """PointData/rho -> PointDataOffsets/rho."""
    return name.replace("PointData/", "PointDataOffsets/")


def _link(group: Any, name: str, others: list[str]) -> None:
    """VTK wants the same numbers under several names: they are stored once."""
    for other in others:
        parent, _, last = other.rpartition("/")
        image.subgroup(group, parent)[last] = group[name]


def _put(dataset: "h5py.Dataset", n: int, values: Any) -> None:
    """Rows n, n + 1, ... of a data set, which are made to exist."""
    image.extend(dataset, n + len(values))
    dataset[n : n + len(values)] = np.asarray(values)


def _create(path: Path, build: Any) -> None:
    """A file without steps, put in place at once."""
    made = temporary(path)
    made.unlink(missing_ok=True)
    image.create(made, build)
    os.replace(made, path)


def _take_up(path: Path, after: int) -> None:
    """Make readers see the steps up to `after` only; what lies behind is written over by the next ones."""

    def keep(file: "h5py.File") -> None:
        n = int(file[ROOT]["Steps"].attrs["NSteps"])
        file[ROOT]["Steps"].attrs.modify("NSteps", np.int64(np.count_nonzero(file["step"][:n] <= after)))

    image.settle(path)
    try:
        image.change(path, keep)
    except (KeyError, ValueError, RuntimeError) as error:
        raise FileError(f"it is damaged or not one of ours ({error}); move it away") from error
