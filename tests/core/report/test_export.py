"""`export`: what other programs read lies where it lay in the run, whatever a run holds or lacks."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from click.testing import CliRunner
from series_table import read_csv

from hpcpic.core.api.results import Run
from hpcpic.core.cli.main import build
from hpcpic.core.errors import FileError
from hpcpic.core.files.arrays import FieldArray, ParticleArray
from hpcpic.core.files.reader import open_run
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.files.series import SeriesWriter
from hpcpic.core.files.snapshot import FieldsWriter, ParticlesWriter
from hpcpic.core.files.together import ALONE
from hpcpic.core.space.domain import Domain

ALL = "csv,openpmd,vtkhdf"
BOX = Domain((0.3, 0.4), (6, 8), (True, True), (0, 6), 0.5)  # 0.4 m along x, 0.3 m along y, nodes half a cell inside
NODES_X, NODES_Y = 0.025 + 0.05 * np.arange(8), 0.025 + 0.05 * np.arange(6)


def export(folder: Path, formats: str = ALL):
    done = CliRunner().invoke(build(lambda: None, "toy", ""), ["export", str(folder), "--to", formats])
    if done.exception and not isinstance(done.exception, (SystemExit, FileError)):
        raise done.exception
    return done


def species(n: int, first: int = 0) -> ParticleArray:
    rng = np.random.default_rng(n)
    columns = {"velocity": rng.standard_normal((n, 2)), "charge_state": rng.random(n)}
    position = np.column_stack([rng.random((n, 2)), np.zeros(n)])
    of_one = {"charge": -2.0, "mass": 3.0, "weighting": 5.0}
    return ParticleArray(np.arange(first, first + n), position, columns, {"velocity": "m/s"}, {}, of_one)


def make_run(folder: Path, *, fields=(0, 10, 20), particles=(0, 20), sets=None) -> Path:
    rundir = RunDir.create(folder, config="a = 1;", facts={"steps": 20, "time": 2.0})
    series = SeriesWriter(rundir, {"energy": "J"})
    for step in range(0, 21, 10):
        series.append(step, 0.1 * step, {"energy": 2.0 + step})
    series.flush()
    y, x = np.meshgrid(NODES_Y, NODES_X, indexing="ij")
    writer = FieldsWriter(ALONE, rundir.fields) if fields else None
    for step in fields:
        swirl = np.stack([-(y - 0.15), x - 0.2], axis=-1)
        writer.append(step, 0.1 * step, BOX, {"u": FieldArray(swirl, "m/s"), "c": FieldArray(x + step, "m")})
    writer = ParticlesWriter(ALONE, rundir.particles)
    for step in particles:
        writer.append(step, 0.1 * step, {"ions": species(5), "none": species(0)} if sets is None else sets)
    rundir.unlock()
    return folder


def test_nodes_lie_where_the_run_has_them_in_every_format(tmp_path):
    folder = make_run(tmp_path / "run")
    assert export(folder).exit_code == 0
    table = np.genfromtxt(folder / "export/csv/fields-00000010.csv", delimiter=",", names=True)
    assert np.allclose(table["x"], np.tile(NODES_X, 6)) and np.allclose(table["c"], table["x"] + 10)
    assert open_run(folder).field_snapshots.origin == pytest.approx((0.025, 0.025))
    assert np.allclose(np.unique(table["y"]), NODES_Y)
    in_python = Run(open_run(folder), None).fields("c", step=10)
    assert np.allclose(in_python.x, NODES_X) and np.allclose(in_python.y, NODES_Y)
    assert np.allclose(in_python, in_python.x + 10)
    with h5py.File(folder / "export/openpmd/fields/data00000010.h5") as file:
        for component in (file["data/10/meshes/c"], file["data/10/meshes/u/x"], file["data/10/meshes/u/y"]):
            assert component.attrs["position"].tolist() == [0.5, 0.5]
        assert np.allclose(file["data/10/meshes/u"].attrs["gridSpacing"], 0.05)


def vtk_output(path: Path):
    vtk = pytest.importorskip("vtk")
    reader = vtk.vtkHDFReader()
    reader.SetFileName(str(path))
    reader.Update()
    return reader.GetOutputDataObject(0)


def test_vtk_traces_streams_in_the_plane_of_the_particles(tmp_path):
    vtk = pytest.importorskip("vtk")
    folder = make_run(tmp_path / "run")
    assert export(folder, "vtkhdf").exit_code == 0
    grid = vtk_output(folder / "export/vtkhdf/fields.vtkhdf")
    assert grid.GetBounds() == pytest.approx((0.025, 0.375, 0.025, 0.275, 0.0, 0.0))
    assert grid.GetPointData().GetArray("u").GetNumberOfComponents() == 3
    cloud = vtk_output(folder / "export/vtkhdf/particles.vtkhdf")
    assert cloud.GetBounds()[4:] == (0.0, 0.0)
    assert cloud.GetPointData().GetArray("velocity").GetNumberOfComponents() == 3
    grid.GetPointData().SetActiveVectors("u")
    tracer = vtk.vtkStreamTracer()
    tracer.SetInputData(grid)
    tracer.SetStartPosition(0.3, 0.15, 0.0)
    tracer.SetIntegratorTypeToRungeKutta4()
    tracer.SetMaximumPropagation(0.5)
    tracer.SetInitialIntegrationStep(0.1)
    tracer.Update()
    line = tracer.GetOutput()
    points = np.array([line.GetPoint(k) for k in range(line.GetNumberOfPoints())])
    assert np.ptp(points[:, 1]) > 0.05  # it turns about the middle of the box, at its distance
    assert np.allclose(np.hypot(points[:, 0] - 0.2, points[:, 1] - 0.15), 0.1, rtol=0.02)


def test_particles_have_the_records_that_viewers_look_for(tmp_path):
    folder = make_run(tmp_path / "run", fields=(0, 20))
    assert export(folder, "openpmd").exit_code == 0
    path = folder / "export/openpmd/data00000020.h5"  # fields and particles of the same steps: one folder
    given = species(5)
    with h5py.File(path) as file:
        ions = file["data/20/particles/ions"]
        assert np.allclose(ions["momentum/x"], 3.0 * given.columns["velocity"][:, 0])
        assert ions["momentum"].attrs["unitDimension"].tolist() == [1, 1, -1, 0, 0, 0, 0]
        assert {name: ions[name].attrs["value"] for name in given.constants} == dict(given.constants)
        weights = {name: ions[name].attrs["weightingPower"] for name in ("position", "mass", "charge", "momentum")}
        assert weights == {"position": 0.0, "mass": 1.0, "charge": 1.0, "momentum": 1.0}
        assert all(ions[name].attrs["macroWeighted"] == (name == "weighting") for name in ions)
        assert file["data/20/particles/none/mass"].attrs["shape"].tolist() == [0]
    program = Path(sys.executable).with_name("openPMD_check_h5")
    check = subprocess.run([program, "-i", path], capture_output=True, text=True, timeout=60)
    assert check.returncode == 0 and "Result: 0 Errors" in check.stdout, check.stdout


def test_the_files_of_a_folder_hold_the_same_records(tmp_path):
    """A viewer takes those of the first file for those of all."""
    folder = make_run(tmp_path / "run")
    assert export(folder, "openpmd").exit_code == 0
    target = folder / "export/openpmd"
    names = {path.relative_to(target).as_posix() for path in target.rglob("*.h5")}
    steps = {"fields": (0, 10, 20), "particles": (0, 20)}
    assert names == {f"{kind}/data{step:08d}.h5" for kind, listed in steps.items() for step in listed}


def test_openpmd_viewer_reads_positions_momenta_and_weights(tmp_path, capsys):
    viewer = pytest.importorskip("openpmd_viewer")
    folder = make_run(tmp_path / "run", fields=(0, 20), sets={"ions": species(5)})
    assert export(folder, "openpmd").exit_code == 0
    series = viewer.OpenPMDTimeSeries(str(folder / "export/openpmd"), check_all_files=True)
    assert "Warning" not in capsys.readouterr().out
    x, ux, w = series.get_particle(["x", "ux", "w"], species="ions", iteration=20)
    given = species(5)
    assert np.allclose(x, given.position[:, 0]) and np.all(w == 5.0)
    assert np.allclose(ux * 299792458.0, given.columns["velocity"][:, 0])
    _, info = series.get_field("u", coord="x", iteration=20)
    assert np.allclose(info.x, NODES_X) and np.allclose(info.y, NODES_Y)


@pytest.mark.parametrize("sets", [{"none": species(0)}, {}], ids=["empty", "no species"])
def test_a_run_without_particles_is_exported_in_every_format(tmp_path, sets):
    folder = make_run(tmp_path / "run", sets=sets)
    for formats in (ALL, *ALL.split(",")):
        done = export(folder, formats)
        assert done.exit_code == 0, done.output
    tables = sorted(path.name for path in (folder / "export/csv").glob("none*"))
    assert tables == (["none-00000000.csv", "none-00000020.csv", "none.units.csv"] if sets else [])
    if sets:
        heads = (folder / "export/csv/none-00000020.csv").read_text().splitlines()
        assert heads == ["id,position_x,position_y,position_z,charge_state,velocity_x,velocity_y"]


def test_a_run_that_has_written_nothing_yet_is_a_file_error(tmp_path):
    rundir = RunDir.create(tmp_path / "run", config="a = 1;")
    rundir.unlock()
    done = export(tmp_path / "run")
    assert done.exit_code == 6 and "holds nothing yet" in done.output
    assert export(make_run(tmp_path / "other", fields=(), particles=())).exit_code == 0  # its series


def test_tables_are_numbers_under_names_with_units_beside_them(tmp_path):
    folder = make_run(tmp_path / "run")
    assert export(folder, "csv").exit_code == 0
    target = folder / "export/csv"
    for path in target.glob("*.csv"):
        if path.name.endswith(".units.csv"):
            continue
        table = np.genfromtxt(path, delimiter=",", names=True)
        assert all(np.isfinite(table[name]).all() for name in table.dtype.names), path
    assert "velocity_x,m/s" in (target / "ions.units.csv").read_text().splitlines()
    assert read_csv(target / "series.csv").units == {"energy": "J"}
