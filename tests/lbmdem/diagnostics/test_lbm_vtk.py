"""ParaView's reader opens what a run of fluid and grains writes, with vectors and radii in place."""

import numpy as np
import pytest
from app_runner import running
from click.testing import CliRunner

import lbmdem
from hpcpic.core.cli.main import build
from hpcpic.core.comm.world import World
from lbmdem.__main__ import load_app

CASE = """
simulation = { end_time = 0.04; };
domain = { size = [0.0048, 0.006]; spacing = 0.0002; periodic = ["x"]; };
fluid = { viscosity = 1.0e-6; relaxation_time = 0.8; };
grains = (
  { name = "heavy"; diameter = 1.2e-3; position = ([0.0013, 0.003], [0.0031, 0.0042]); velocity = [1.0e-3, 2.0e-3]; },
  { name = "posts"; diameter = 1.6e-3; moving = false; position = [0.0022, 0.0012]; } );
gravity = [0.0, -0.02];
output = { period = { fields = 0.02; grains = 0.02; }; };
"""


def steps_of(path):
    """(time, data set, point arrays by name) of every step."""
    vtk = pytest.importorskip("vtk")
    from vtk.util.numpy_support import vtk_to_numpy

    reader = vtk.vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    for number in range(reader.GetNumberOfSteps()):
        reader.SetStep(number)
        reader.Update()
        seen = reader.GetOutputDataObject(0)
        data = seen.GetPointData()
        arrays = [data.GetArray(k) for k in range(data.GetNumberOfArrays())]
        yield reader.GetTimeValue(), seen, {array.GetName(): vtk_to_numpy(array) for array in arrays}


def test_vtk_opens_fields_and_grains(tmp_path):
    (tmp_path / "case.conf").write_text(CASE)
    run = tmp_path / "run"
    lbmdem.Case(tmp_path / "case.conf").run(run, threads=1, quiet=True)
    words = ["export", str(run), "--to", "csv,openpmd,vtkhdf"]
    exported = CliRunner().invoke(build(load_app, "lbmdem", "grains in a fluid"), words)
    assert exported.exit_code == 0, exported.output
    fields, grains = (sorted(run.rglob(name))[0] for name in ("fields.vtkhdf", "*rains.vtkhdf"))
    found = list(steps_of(fields))
    assert [time for time, *_ in found] == pytest.approx([0.0, 0.02, 0.04])
    for _, grid, arrays in found:
        assert grid.GetDimensions() == (24, 30, 1)
        assert grid.GetSpacing()[:2] == pytest.approx((2e-4, 2e-4))
        assert arrays["velocity"].shape[0] == arrays["pressure"].size == 720
    x, y = np.meshgrid((np.arange(24) + 0.5) * 2e-4, (np.arange(30) + 0.5) * 2e-4)
    covered = np.hypot(x - 0.0022, y - 0.0012) < 0.8e-3
    assert found[-1][2]["solid"].reshape(30, 24)[covered].all()
    assert np.abs(found[-1][2]["velocity"]).max() > 1e-4
    seen = list(steps_of(grains))
    assert len(seen) == 3
    for _, cloud, arrays in seen:
        assert cloud.GetNumberOfPoints() == 3
        assert sorted(arrays["radius"]) == [0.6e-3, 0.6e-3, 0.8e-3]
        assert arrays["velocity"].shape == arrays["angular_velocity"].shape == (3, 3)
        assert arrays["fluid_force"].shape == arrays["contact_force"].shape == (3, 3)
    assert np.abs(seen[-1][2]["fluid_force"][:, :2]).max() > 0.0 and not seen[-1][2]["fluid_force"][:, 2].any()
    start = seen[0][2]
    moving = start["radius"] == 0.6e-3
    assert (start["velocity"][moving] == [1e-3, 2e-3, 0.0]).all() and not start["velocity"][~moving].any()


def test_the_floor_carries_the_weight_of_a_grain_at_rest():
    case = """
    simulation = { end_time = 0.2; };
    domain = { size = [0.01, 0.01, 0.01]; };
    grains = ({ name = "ball"; diameter = 2.0e-3; density = 2000.0; position = [0.005, 0.005, 1.0e-3]; });
    contact = { normal_stiffness = 1.0; damping = 0.9; };
    gravity = [0.0, 0.0, -10.0];
    """
    with running(World.alone(), "lbmdem", case) as app:
        while app.iteration < app.n_steps:
            app.step()
        ball = app.particles()["ball"]
    weight = 2000.0 * np.pi / 6.0 * 8e-9 * 10.0
    assert ball.columns["contact_force"][0] == pytest.approx([0.0, 0.0, weight], rel=1e-6)  # e^-20 of it still swings
    assert ball.units["contact_force"] == "N"
