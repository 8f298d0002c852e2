"""export: a run folder's snapshots and series as files that other programs read."""

from __future__ import annotations

import csv
import math
import shutil
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import click

from hpcpic.core.app.app import AppLoader
from hpcpic.core.errors import ConfigError, FileError
from hpcpic.core.run.summary import several

if TYPE_CHECKING:
    from hpcpic.core.files.reader import Run, Snapshots


Column = tuple[str, Any]  # unit, values
SAFE = " +,=()[]"  # in a file name, beside letters and digits


def make_export_command(app_loader: AppLoader) -> click.Command:
    @click.command("export")
    @click.argument("folder", metavar="DIR")
    @click.option(
        "--to",
        "formats",
        default="csv",
        show_default=True,
        metavar="LIST",
        help="vtkhdf, openpmd, csv: one or more.",
    )
    @click.option("-o", "--output", metavar="DIR", help="Where to.  [default: DIR/export]")
    def export(folder: str, formats: str, output: str | None) -> None:
        """Write the snapshots and series of a run for other programs.

        vtkhdf: what ParaView opens. openpmd: openPMD-viewer and its kin. csv: a table per snapshot.
        """
        from hpcpic.core.files.reader import open_run

        makers: dict[str, Callable[[Run, Path], int]] = {
            "vtkhdf": _to_vtkhdf,
            "openpmd": _to_openpmd,
            "csv": to_csv,
        }
        asked = [name.strip().lower() for name in formats.split(",")]
        for name in asked:
            if name not in makers:
                raise ConfigError(f"--to {name}: must be of {', '.join(makers)}")
        run = open_run(folder)
        target = Path(output) if output else run.path / "export"
        written = 0
        for name in asked:
            target.joinpath(name).mkdir(parents=True, exist_ok=True)
            n = makers[name](run, target / name)
            click.echo(f"{name}: {several(n, 'file')} in {target / name}")
            written += n
        if not written:
            raise FileError(f"{folder}: holds nothing yet that {' or '.join(asked)} could take")

    return export


def _to_vtkhdf(run: Run, target: Path) -> int:
    from hpcpic.core.files.parts import parts_of

    files = [*parts_of(run.rundir.fields), *parts_of(run.rundir.particles)]
    for path in files:
        shutil.copy2(path, target / path.name)
    return len(files)


def to_csv(run: Run, target: Path) -> int:
    """Tables of names and numbers: the series, and at every snapshot the fields and each species; their units in tables
    beside them.
    """
    n = 0
    for path in (run.path / "series.csv", run.path / "series.units.csv"):
        if path.exists():
            shutil.copy2(path, target / path.name)
            n += 1
    if run.rundir.fields.exists():
        n += _write_tables(target, "fields", run.field_snapshots.steps, partial(_field_columns, run))
    if run.rundir.particles.exists():
        found = run.particle_snapshots
        for species in found.species:
            name = quote(species, safe=SAFE)
            n += _write_tables(target, name, found.steps, partial(_particle_columns, run, species))
    return n


def _field_columns(run: Run, step: int) -> dict[str, Column]:
    """Columns with a row for every grid point: its position, then the fields."""
    import numpy as np

    snapshots = run.field_snapshots
    axes = [low + spacing * np.arange(n) for low, n, spacing in zip(snapshots.origin, *snapshots.grid)]
    places = np.meshgrid(*axes, indexing="ij")
    names = "xyz"[: len(axes)][::-1]  # storage is slab axis first
    columns: dict[str, Any] = {name: place.ravel() for name, place in zip(names, places)}
    columns = dict(sorted(columns.items()))
    for name in snapshots.names_at(snapshots.index(step)):
        values = _values(run, name, step)
        columns[name] = values.reshape(columns["x"].size, *values.shape[len(axes) :])
    return _flat(columns, snapshots.units | dict.fromkeys(names, "m"))


def _particle_columns(run: Run, species: str, step: int) -> dict[str, Column]:
    return _flat(run.particles(species, step=step), run.particle_snapshots.units)


def _flat(columns: Mapping[str, Any], units: Mapping[str, str]) -> dict[str, Column]:
    """name -> unit, values; vectors become name_x, name_y, name_z."""
    flat: dict[str, Column] = {}
    for name, values in columns.items():
        unit = units.get(name) or ("m" if name == "position" else "1")
        if values.ndim == 1:
            flat[name] = (unit, values)
        else:
            parts = values.reshape(len(values), math.prod(values.shape[1:])).T
            flat |= {f"{name}_{'xyz'[k] if len(parts) <= 3 else k}": (unit, part) for k, part in enumerate(parts)}
    return flat


def _write_tables(target: Path, name: str, steps: Any, columns_at: Callable[[int], dict[str, Column]]) -> int:
    """A table for each step and one of their units; how many."""
    from hpcpic.core.files.series import units_text

    columns: dict[str, Column] = {}
    for step in steps:
        columns = columns_at(int(step))
        with open(target / f"{name}-{step:08d}.csv", "w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(columns)
            writer.writerows(zip(*(values.tolist() for _, values in columns.values())))
    if columns:
        units = units_text({column: unit for column, (unit, _) in columns.items()})
        (target / f"{name}.units.csv").write_text(units, encoding="utf-8")
    return len(steps) + bool(columns)


def _to_openpmd(run: Run, target: Path) -> int:
    """A file per step. Readers want the same records in all files of a folder: fields and particles of different steps
    go to two.
    """
    from hpcpic.core.files.openpmd import OpenPMDWriter
    from hpcpic.core.files.together import ALONE

    fields = _times(run.field_snapshots) if run.rundir.fields.exists() else {}
    particles = _times(run.particle_snapshots) if run.rundir.particles.exists() else {}
    last = run.summary.get("steps") or 1
    time_step = float(run.summary.get("time") or 0.0) / last
    apart = bool(fields and particles) and fields.keys() != particles.keys()
    folders = {"fields": (fields, {}), "particles": ({}, particles)} if apart else {"": (fields, particles)}
    for name, (of_fields, of_particles) in folders.items():
        writer = OpenPMDWriter(ALONE, target / name, time_step)
        for step, time in (of_fields or of_particles).items():
            arrays = _field_arrays(run, step) if of_fields else {}
            species = _particle_arrays(run, step) if of_particles else {}
            writer.append(step, time, _domain(run), arrays, species)
    return sum(len(a or b) for a, b in folders.values())


def _times(snapshots: Snapshots) -> dict[int, float]:
    return {int(step): float(time) for step, time in zip(snapshots.steps, snapshots.times)}


def _domain(run: Run) -> Any:
    from hpcpic.core.space.domain import Domain

    if not run.rundir.fields.exists():
        return Domain((1.0,), (1,), (True,), (0, 1))
    points, spacing = run.field_snapshots.grid
    lengths = tuple(n * d for n, d in zip(points, spacing))
    offset = run.field_snapshots.origin[-1] / spacing[-1]
    return Domain(lengths, points, (True,) * len(lengths), (0, points[0]), offset)


def _values(run: Run, name: str, step: int) -> Any:
    """A field on all axes of the grid, the components of a vector last."""
    snapshots, values = run.field_snapshots, run.field(name, step=step)
    return values.reshape(*snapshots.grid[0], *values.shape[len(snapshots.points) :])


def _field_arrays(run: Run, step: int) -> dict[str, Any]:
    from hpcpic.core.files.arrays import FieldArray

    snapshots = run.field_snapshots
    names = snapshots.names_at(snapshots.index(step))
    return {name: FieldArray(_values(run, name, step), snapshots.units[name]) for name in names}


def _particle_arrays(run: Run, step: int) -> dict[str, Any]:
    from hpcpic.core.files.arrays import ParticleArray

    result = {}
    for species in run.particle_snapshots.species:
        columns = run.particles(species, step=step)
        ids, position = columns.pop("id"), columns.pop("position")
        known = run.particle_snapshots
        units, offsets, constants = known.units, known.time_offsets, known.constants[species]
        result[species] = ParticleArray(ids, position, columns, units, offsets, constants)
    return result
