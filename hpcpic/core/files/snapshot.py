"""Arrays in time as temporal VTKHDF, which ParaView opens as it is: fields.vtkhdf (ImageData),
particles.vtkhdf (PolyData).

All ranks write their part of a step at its place (core.files.image); `NSteps`, which is what readers look at,
changes last, so a file is readable at any moment. Values are stored in the type they have. `/step` holds the
step numbers beside the times in `/VTKHDF/Steps/Values`.
https://docs.vtk.org/en/latest/vtk_file_formats/vtkhdf_file_format
"""

import math
import os
from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hpcpic.core.errors import FileError
from hpcpic.core.files import image
from hpcpic.core.files.arrays import FieldArray, ParticleArray, Shard
from hpcpic.core.files.image import Slot
from hpcpic.core.files.rundir import temporary
from hpcpic.core.files.together import Alone, together
from hpcpic.core.space.domain import Domain

if TYPE_CHECKING:
    import h5py

    from hpcpic.core.comm.world import World

VERSION = (2, 2)
CHUNK_BYTES = 8 << 20
STEPS_PER_CHUNK = 256
ROOT = "VTKHDF"
CELL_KINDS = ("Vertices", "Lines", "Polygons", "Strips")  # the last three are empty


class _Temporal(ABC):
    """A temporal file: made at the first step, or taken up again at a restart."""

    def __init__(self, world: "World | Alone", path: Path, after: int | None = None) -> None:
        """At a restart the steps up to `after` are kept. Raises FileError on all ranks."""
        self.world = world
        self.path = path
        self._exists = False
        with together(world, f"cannot take up {path}"):
            if world.rank == 0 and path.exists() and after is not None:
                _take_up(path, after)
        self._exists = world.any(world.rank == 0 and after is not None and path.exists())

    def _append(
        self, step: int, time: float, shards: Mapping[str, Shard], told: Mapping[str, Mapping[str, Any]], *facts: Any
    ) -> None:
        """Add a step; `told`: attributes of arrays. Raises FileError on all ranks; the file is then as before."""
        described = {name: (shard.local.shape[1:], shard.local.dtype) for name, shard in shards.items()}

        def build(file: "h5py.File") -> dict[str, Slot]:
            root = file.create_group(ROOT)
            root.attrs["Version"] = np.array(VERSION, np.int64)
            steps = root.create_group("Steps")
            steps.attrs["NSteps"] = np.int64(0)
            image.growing(file, "step", (), np.int64, (STEPS_PER_CHUNK,))
            image.growing(steps, "Values", (), np.float64, (STEPS_PER_CHUNK,)).attrs["units"] = "s"
            self._build(root, steps, described, *facts)
            for name in shards:
                root[name].attrs.update({"units": "", **told.get(name, {})})
            return {}

        def grow(file: "h5py.File") -> dict[str, Slot]:
            self._check_names(file, shards)
            n = int(file[ROOT]["Steps"].attrs["NSteps"])
            _set(file["step"], n, step)
            _set(file[ROOT]["Steps/Values"], n, time)
            return self._grow(file[ROOT], n, shards, *facts)

        def announce(file: "h5py.File") -> None:
            file[ROOT]["Steps"].attrs.modify("NSteps", file[ROOT]["Steps"].attrs["NSteps"] + 1)

        if not self._exists:
            with together(self.world, f"cannot make {self.path}"):
                if self.world.rank == 0:
                    _create(self.path, build)
            self._exists = True
        image.append(self.world, self.path, grow, shards, announce)

    def _check_names(self, file: "h5py.File", shards: Mapping[str, Shard]) -> None:
        present = {f"PointData/{name}" for name in file[ROOT]["PointData"]}
        asked = {name for name in shards if name.startswith("PointData/")}
        for name in present ^ asked:
            raise FileError(f"it has other arrays than this run writes ({name}); move it away")
        for name, shard in shards.items():
            if file[ROOT][name].dtype != shard.local.dtype:
                raise FileError(
                    f"{name} has type {file[ROOT][name].dtype} there and {shard.local.dtype} in this run"
                )

    @abstractmethod
    def _build(self, root: Any, steps: Any, described: Mapping[str, Any], *facts: Any) -> None:
        """Lay out the file for its first step."""

    @abstractmethod
    def _grow(self, root: Any, n: int, shards: Mapping[str, Shard], *facts: Any) -> dict[str, Slot]:
        """Make room for a step: where each shard goes."""


class FieldsWriter(_Temporal):
    """fields.vtkhdf: fields on the grid points, x fastest; a 1D or 2D grid has one point along other axes."""

    def append(self, step: int, time: float, domain: Domain, fields: Mapping[str, FieldArray]) -> None:
        """Add a step, all ranks together. Raises FileError on all ranks; the file is then as before."""
        low, _ = domain.row_range(self.world.rank)
        shards = {
            f"PointData/{name}": Shard(field.values, low, domain.points[0]) for name, field in fields.items()
        }
        units = {f"PointData/{name}": {"units": field.unit} for name, field in fields.items()}
        self._append(step, time, shards, units, domain)

    def _build(self, root: Any, steps: Any, described: Mapping[str, Any], domain: Domain) -> None:
        unused = (1,) * (3 - domain.ndim)
        points = (*unused, *domain.points)
        root.attrs["Type"] = np.bytes_("ImageData")
        root.attrs["WholeExtent"] = np.array([edge for n in points[::-1] for edge in (0, n - 1)], np.int64)
        spacing = np.array((*unused, *domain.spacing)[::-1])
        root.attrs["Origin"] = domain.offset * spacing
        root.attrs["Spacing"] = spacing
        root.attrs["Direction"] = np.eye(3).ravel()
        root.create_group("PointData")
        for name, (shape, dtype) in described.items():
            layer = _used(domain.points) + shape[domain.ndim - 1 :]
            axis = _slab_axis(domain)
            rows = CHUNK_BYTES // (math.prod(layer[axis:]) * dtype.itemsize)
            chunk = (1, *layer) if axis == 0 else (1, max(1, min(layer[0], rows)), *layer[1:])
            image.growing(root, name, layer, dtype, chunk)
        _counts(steps, "Layer")
        _link(steps, "Layer", [_offset_name(name) for name in described])

    def _grow(self, root: Any, n: int, shards: Mapping[str, Shard], domain: Domain) -> dict[str, Slot]:
        slots = {}
        points = _used(domain.points)
        for name in shards:
            present = root[name].shape[1 : 1 + len(points)]
            if present != points:
                raise FileError(f"it holds a grid of {present} points, this run has {points}")
            slots[name] = image.layer_slot(root[name], n, _slab_axis(domain))
        _set(root["Steps/Layer"], n, n)
        return slots


def _used(points: tuple[int, ...]) -> tuple[int, ...]:
    """VTK leaves out the axes that have one point."""
    return tuple(n for n in points if n > 1)


def _slab_axis(domain: Domain) -> int:
    """Axis of the data set that is cut among the ranks; 0, the steps, when there is only one row."""
    return 1 if domain.points[0] > 1 else 0


class ParticlesWriter(_Temporal):
    """particles.vtkhdf: a point and a vertex per particle, all species in one set, told apart by `species`.

    `species` numbers the species in the order of the dict; their names are its attribute `names`.
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
        told: dict[str, dict[str, Any]] = {"Points": {"units": "m"}}
        for particles in species.values():
            for name in particles.columns:
                offset_s = float(particles.time_offsets.get(name, 0.0))
                told[f"PointData/{name}"] = {"units": particles.units.get(name, ""), "time_offset": offset_s}
        self._append(step, time, shards, told, list(species), total)
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

    def _build(
        self, root: Any, steps: Any, described: Mapping[str, Any], names: list[str], total: int
    ) -> None:
        root.attrs["Type"] = np.bytes_("PolyData")
        for name, (shape, dtype) in described.items():
            rows = max(1, min(max(total, 1024), CHUNK_BYTES // (math.prod(shape) * dtype.itemsize)))
            image.growing(root, name, shape, dtype, (rows, *shape))
        root["PointData/species"].attrs["names"] = names
        for name in ("PartOffsets", "NumberOfParts", "PointOffsets"):
            _counts(steps, name)
        _link(
            steps, "PointOffsets", [_offset_name(name) for name in described if name.startswith("PointData/")]
        )
        _counts(steps, "CellOffsets", (len(CELL_KINDS),))
        _link(steps, "CellOffsets", ["ConnectivityIdOffsets"])
        _counts(root, "NumberOfPoints")
        _link(root, "NumberOfPoints", ["Vertices/NumberOfCells", "Vertices/NumberOfConnectivityIds"])
        _counts(root, "Lines/NumberOfCells")
        _link(root, "Lines/NumberOfCells", ["Lines/NumberOfConnectivityIds"])
        _counts(root, "Lines/Connectivity")
        _counts(root, "Lines/Offsets")
        _set(root["Lines/Offsets"], 0, 0)
        _link(root, "Lines", ["Polygons", "Strips"])

    def _grow(
        self, root: Any, n: int, shards: Mapping[str, Shard], names: list[str], total: int
    ) -> dict[str, Slot]:
        steps = root["Steps"]
        first = int(steps["PointOffsets"][n - 1] + root["NumberOfPoints"][n - 1]) if n else 0
        _set(root["NumberOfPoints"], n, total)
        _set(root["Lines/NumberOfCells"], n, 0)
        _set(steps["PartOffsets"], n, n)
        _set(steps["NumberOfParts"], n, 1)
        _set(steps["PointOffsets"], n, first)
        _set(steps["CellOffsets"], n, 0)
        return {
            name: image.rows_slot(root[name], 0 if name.startswith("Vertices/") else first, shard.total)
            for name, shard in shards.items()
        }


def _joined(species: Mapping[str, ParticleArray]) -> dict[str, Any]:
    """The columns of all species one after the other. Raises FileError when their columns differ."""
    columns = {name: set(particles.columns) for name, particles in species.items()}
    for name, found in columns.items():
        if found != next(iter(columns.values())):
            raise FileError(
                f"species {name} has the columns {sorted(found)}, {next(iter(columns))} has others"
            )
    sets = list(species.values())
    parts = {
        "Points": [particles.position for particles in sets],
        "PointData/id": [np.asarray(particles.ids, np.int64) for particles in sets],
        "PointData/species": [np.full(len(particles.ids), k, np.int32) for k, particles in enumerate(sets)],
    }
    for name in sets[0].columns:
        parts[f"PointData/{name}"] = [particles.columns[name] for particles in sets]
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


def _set(dataset: "h5py.Dataset", n: int, value: Any) -> None:
    image.extend(dataset, n + 1)
    dataset[n] = value


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
