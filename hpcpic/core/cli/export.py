"""export: a run folder's snapshots and series as files that other programs read."""

from __future__ import annotations

import csv
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import click

from hpcpic.core.cli.app import AppLoader
from hpcpic.core.errors import ConfigError

if TYPE_CHECKING:
    from hpcpic.core.files.reader import Run


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
        for name in asked:
            target.joinpath(name).mkdir(parents=True, exist_ok=True)
            n = makers[name](run, target / name)
            click.echo(f"{name}: {n} file{'s' if n != 1 else ''} in {target / name}")

    return export


def _to_vtkhdf(run: Run, target: Path) -> int:
    files = [path for path in (run.rundir.fields, run.rundir.particles) if path.exists()]
    for path in files:
        shutil.copy2(path, target / path.name)
    return len(files)


def to_csv(run: Run, target: Path) -> int:
    n = 0
    if (run.path / "series.csv").exists():
        shutil.copy2(run.path / "series.csv", target / "series.csv")
        n += 1
    for step in run.field_snapshots.steps if run.rundir.fields.exists() else ():
        _write_field_csv(run, int(step), target / f"fields-{step:08d}.csv")
        n += 1
    for step in run.particle_snapshots.steps if run.rundir.particles.exists() else ():
        for species in run.particle_snapshots.species:
            columns = run.particles(species, step=int(step))
            name = quote(species, safe=SAFE)
            _write_columns(target / f"{name}-{step:08d}.csv", columns, run.particle_snapshots.units)
            n += 1
    return n


def _write_field_csv(run: Run, step: int, path: Path) -> None:
    """A row per grid point: its place, then the fields."""
    import numpy as np

    snapshots = run.field_snapshots
    axes = [spacing * np.arange(n) for n, spacing in zip(*snapshots.grid)]
    places = np.meshgrid(*axes, indexing="ij")
    names = "xyz"[: len(axes)][::-1]  # storage is slab axis first
    columns: dict[str, Any] = {name: place.ravel() for name, place in zip(names, places)}
    columns = dict(sorted(columns.items()))
    for name in snapshots.names:
        values = _values(run, name, step)
        columns[name] = values.reshape(-1, *values.shape[len(axes) :])
    _write_columns(path, columns, snapshots.units | dict.fromkeys(names, "m"))


def _write_columns(path: Path, columns: dict[str, Any], units: Any) -> None:
    """CSV with a row of names and a row of units; vectors become name_x, name_y, name_z."""
    flat: dict[str, tuple[str, Any]] = {}
    for name, values in columns.items():
        unit = units.get(name) or ("m" if name == "position" else "1")
        if values.ndim == 1:
            flat[name] = (unit, values)
        else:
            parts = values.reshape(len(values), -1).T
            flat |= {
                f"{name}_{'xyz'[k] if len(parts) <= 3 else k}": (unit, part) for k, part in enumerate(parts)
            }
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(flat)
        writer.writerow(unit for unit, _ in flat.values())
        writer.writerows(zip(*(values.tolist() for _, values in flat.values())))


def _to_openpmd(run: Run, target: Path) -> int:
    """A file per step that has a snapshot of fields or particles."""
    from hpcpic.core.files.openpmd import OpenPMDWriter
    from hpcpic.core.files.together import ALONE

    fields = run.field_snapshots if run.rundir.fields.exists() else None
    particles = run.particle_snapshots if run.rundir.particles.exists() else None
    times = {int(s): float(t) for kind in (fields, particles) if kind for s, t in zip(kind.steps, kind.times)}
    last = run.summary.get("steps") or 1
    writer = OpenPMDWriter(ALONE, target, time_step=float(run.summary.get("time") or 0.0) / last)
    for step, time in times.items():
        writer.append(step, time, _domain(run), _field_arrays(run, step), _particle_arrays(run, step))
    return len(times)


def _domain(run: Run) -> Any:
    from hpcpic.core.space.domain import Domain

    if not run.rundir.fields.exists():
        return Domain((1.0,), (1,), (True,), (0, 1))
    points, spacing = run.field_snapshots.grid
    lengths = tuple(n * d for n, d in zip(points, spacing))
    return Domain(lengths, points, (True,) * len(lengths), (0, points[0]))


def _values(run: Run, name: str, step: int) -> Any:
    """A field on all axes of the grid, the components of a vector last."""
    snapshots, values = run.field_snapshots, run.field(name, step=step)
    return values.reshape(*snapshots.grid[0], *values.shape[len(snapshots.points) :])


def _field_arrays(run: Run, step: int) -> dict[str, Any]:
    from hpcpic.core.files.arrays import FieldArray

    if not run.rundir.fields.exists() or step not in run.field_snapshots.steps:
        return {}
    snapshots = run.field_snapshots
    return {name: FieldArray(_values(run, name, step), snapshots.units[name]) for name in snapshots.names}


def _particle_arrays(run: Run, step: int) -> dict[str, Any]:
    from hpcpic.core.files.arrays import ParticleArray

    if not run.rundir.particles.exists() or step not in run.particle_snapshots.steps:
        return {}
    result = {}
    for species in run.particle_snapshots.species:
        columns = run.particles(species, step=step)
        ids, position = columns.pop("id"), columns.pop("position")
        snapshots = run.particle_snapshots
        result[species] = ParticleArray(ids, position, columns, snapshots.units, snapshots.time_offsets)
    return result
