"""Arrays in time as openPMD 1.1.0 (https://github.com/openPMD/openPMD-standard): openpmd/dataNNNNNNNN.h5, one
per step.

Every file is laid out by rank 0, written by all ranks and put in place by a rename.

Particles have the records that openPMD-viewer and its kin look for: position, momentum, mass, charge and weighting, as
far as they are known. As the extension ED-PIC has it, charge, mass and momentum are those of one real particle, and
one in the file stands for `weighting` of them.
"""

import os
import re
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hpcpic.core.files import image
from hpcpic.core.files.arrays import PARTICLE_UNITS, FieldArray, ParticleArray, Shard
from hpcpic.core.files.atomic import temporary
from hpcpic.core.files.image import Slot
from hpcpic.core.files.together import Alone, together
from hpcpic.core.space.domain import Domain
from hpcpic.version import __version__

if TYPE_CHECKING:
    import h5py

    from hpcpic.core.comm.world import World

AXES = "xyz"
QUATERNION = "wxyz"  # components of a column four wide
OF_ONE_PARTICLE = ("charge", "mass", "momentum", "weighting")  # what a macro-particle has `weighting` times
BASE = ("m", "kg", "s", "A", "K", "mol", "cd")
# Exponents of BASE for the units our arrays come in.
UNITS: dict[str, tuple[int, ...]] = {
    **{unit: tuple(int(unit == base) for base in BASE) for unit in BASE},
    "C": (0, 0, 1, 1, 0, 0, 0),
    "N": (1, 1, -2, 0, 0, 0, 0),
    "J": (2, 1, -2, 0, 0, 0, 0),
    "V": (2, 1, -3, -1, 0, 0, 0),
    "T": (0, 1, -2, -1, 0, 0, 0),
    "Pa": (-1, 1, -2, 0, 0, 0, 0),
    "rad": (0,) * 7,
    "1": (0,) * 7,
    "": (0,) * 7,
}


def dimension(unit: str) -> tuple[float, ...]:
    """Exponents of m, kg, s, A, K, mol, cd in a unit such as "C/m2", "V/m", "kg m/s" or "m^-3".

    Raises ValueError for a unit that is not made of UNITS.
    """
    total = np.zeros(7)
    for k, part in enumerate(unit.split("/")):
        for factor in part.replace("*", " ").split():
            match = re.fullmatch(r"([A-Za-z]+|1)\^?(-?\d*)", factor)
            if match is None or match[1] not in UNITS:
                raise ValueError(f"unit {unit!r}: {factor!r} is not known")
            total += np.array(UNITS[match[1]]) * int(match[2] or 1) * (-1 if k else 1)
    return tuple(total.tolist())


class OpenPMDWriter:
    """Writes one file per step into a folder."""

    def __init__(self, world: "World | Alone", folder: Path, time_step: float, after: int | None = None) -> None:
        """At a restart the files of steps later than `after` are removed. Raises FileError on all ranks."""
        self.world = world
        self.path = folder
        self.time_step = time_step
        with together(world, f"cannot use {folder}"):
            if world.rank == 0:
                folder.mkdir(exist_ok=True)
                for path in folder.glob("data*.h5"):
                    if after is not None and path.stem[4:].isdigit() and int(path.stem[4:]) > after:
                        path.unlink()

    def append(
        self,
        step: int,
        time: float,
        domain: Domain,
        fields: Mapping[str, FieldArray],
        species: Mapping[str, ParticleArray],
    ) -> None:
        """Write a step, all ranks together. Raises FileError on all ranks; no file is left then."""
        final = self.path / f"data{step:08d}.h5"
        made = temporary(final, self.world.bcast(str(os.getpid()).encode()).decode())
        counts = np.zeros((self.world.size, len(species)), np.int64)
        counts[self.world.rank] = [len(particles.ids) for particles in species.values()]
        counts = self.world.sum_int(counts)
        offsets, totals = counts[: self.world.rank].sum(axis=0), counts.sum(axis=0)
        meshes = f"data/{step}/meshes"
        shards = {
            f"{meshes}/{name}": Shard(values, domain.row_range(self.world.rank)[0], domain.points[0])
            for name, values in _components(fields, domain.ndim)
        }
        for k, (name, particles) in enumerate(species.items()):
            for record, values in _records(particles):
                path = f"data/{step}/particles/{name}/{record}"
                shards[path] = Shard(values, int(offsets[k]), int(totals[k]))

        def build(file: "h5py.File") -> dict[str, Slot]:
            _describe(file, step, time, self.time_step)
            slots = {}
            for name, shard in shards.items():
                shape = (shard.total, *shard.local.shape[1:])
                slots[name] = image.contiguous(file, name, shape, shard.local.dtype)
                file[name].attrs["unitSI"] = 1.0
            for name, field in fields.items():
                _describe_mesh(file[f"{meshes}/{name}"], field.unit, domain)
            for k, (name, particles) in enumerate(species.items()):
                _describe_species(file[f"data/{step}/particles/{name}"], particles, int(totals[k]))
            return slots

        self._write(final, made, build, shards)

    def flush(self) -> None:
        """Nothing waits."""

    def _write(self, final: Path, made: Path, build: Any, shards: Mapping[str, Shard]) -> None:
        doing = f"cannot write {final}"
        try:
            slots: dict[str, Slot] | None = None
            with together(self.world, doing):
                if self.world.rank == 0:
                    made.unlink(missing_ok=True)
                    slots = image.create(made, build)
            slots = image.share_slots(self.world, slots)
            with together(self.world, doing):
                image.write_shards(made, slots, shards)
            with together(self.world, doing):
                if self.world.rank == 0:
                    os.replace(made, final)
        except Exception:
            if self.world.rank == 0:
                made.unlink(missing_ok=True)
            raise


def _components(fields: Mapping[str, FieldArray], ndim: int) -> Iterator[tuple[str, Any]]:
    """A scalar field is one data set, a vector field one per component."""
    for name, field in fields.items():
        if field.values.ndim == ndim:
            yield name, field.values
        else:
            yield from ((f"{name}/{AXES[c]}", field.values[..., c]) for c in range(field.values.shape[-1]))


def _constants(particles: ParticleArray) -> dict[str, float]:
    """The values that all particles share. Without a weighting each stands for one particle."""
    return {"weighting": 1.0, **particles.constants}


def _momentum(particles: ParticleArray) -> dict[str, Any]:
    """Momentum of one real particle, kg m/s; {} where no mass is known."""
    mass, velocity = particles.columns.get("mass", particles.constants.get("mass")), particles.columns.get("velocity")
    if mass is None or velocity is None:
        return {}
    return {"momentum": np.reshape(mass, (-1, 1)) * velocity}


def _records(particles: ParticleArray) -> Iterator[tuple[str, Any]]:
    yield "id", np.asarray(particles.ids, np.uint64)
    for name, values in {"position": particles.position, **particles.columns, **_momentum(particles)}.items():
        if values.ndim == 1:
            yield name, values
        else:
            letters = QUATERNION if values.shape[1] == 4 else AXES
            yield from ((f"{name}/{letters[c]}", values[:, c]) for c in range(values.shape[1]))


def _describe(file: "h5py.File", step: int, time: float, time_step: float) -> None:
    file.attrs.update(
        {
            "openPMD": np.bytes_("1.1.0"),
            "openPMDextension": np.uint32(0),
            "basePath": np.bytes_("/data/%T/"),
            "meshesPath": np.bytes_("meshes/"),
            "particlesPath": np.bytes_("particles/"),
            "iterationEncoding": np.bytes_("fileBased"),
            "iterationFormat": np.bytes_("data%08T.h5"),
            "software": np.bytes_("hpcpic"),
            "softwareVersion": np.bytes_(__version__),
            "date": np.bytes_(datetime.now(UTC).strftime("%Y-%m-%d %H:%M:%S +0000")),
        }
    )
    iteration = file.create_group(f"data/{step}")
    iteration.attrs.update({"time": float(time), "dt": float(time_step), "timeUnitSI": 1.0})
    iteration.create_group("meshes")
    iteration.create_group("particles")


def _describe_mesh(record: Any, unit: str, domain: Domain) -> None:
    record.attrs.update(
        {
            "geometry": np.bytes_("cartesian"),
            "dataOrder": np.bytes_("C"),
            "axisLabels": np.array([axis.encode() for axis in AXES[: domain.ndim][::-1]]),
            "gridSpacing": np.array(domain.spacing),
            "gridGlobalOffset": np.zeros(domain.ndim),  # of the corner of the box; points lie at `position` in cells
            "gridUnitSI": 1.0,
            "unitDimension": np.array(dimension(unit)),
            "timeOffset": 0.0,
        }
    )
    for component in [record] if hasattr(record, "dtype") else record.values():
        component.attrs["position"] = np.full(domain.ndim, domain.offset)


def _describe_species(group: Any, particles: ParticleArray, total: int) -> None:
    for name, value in _constants(particles).items():
        _describe_constant(group.create_group(name), value, total)
    for axis in AXES[: particles.position.shape[1]]:
        _describe_constant(group.require_group("positionOffset").create_group(axis), 0.0, total)
    units = PARTICLE_UNITS | {"position": "m", "positionOffset": "m"} | dict(particles.units)
    dimensions = {name: np.array(dimension(units.get(name, ""))) for name in group}
    dimensions["momentum"] = np.array(dimension(units["mass"])) + dimension("m/s")
    offsets = {"momentum": particles.time_offsets.get("velocity", 0.0), **particles.time_offsets}
    for name in list(group):
        group[name].attrs.update(
            {
                "unitDimension": dimensions[name],
                "timeOffset": float(offsets.get(name, 0.0)),
                "macroWeighted": np.uint32(name == "weighting"),
                "weightingPower": float(name in OF_ONE_PARTICLE),
            }
        )


def _describe_constant(group: Any, value: float, total: int) -> None:
    group.attrs.update({"unitSI": 1.0, "value": float(value), "shape": np.array([total], np.uint64)})
