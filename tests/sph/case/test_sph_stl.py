"""Solids from STL files: filled, measured, refused with the reason."""

import os

import numpy as np
import pytest

from hpcpic.core.case.config import load
from hpcpic.core.errors import ConfigError
from hpcpic.core.files import given
from hpcpic.core.files.rundir import RunDir
from sph.case import geometry
from sph.configure import configure
from sph.forecast.derived import derived
from sph.forecast.estimate import TRIMESH_MIB, estimate
from sph.forecast.plan import MIB
from sph.setup.rigid.mass import rigid_of
from sph.setup.scene import Scene

trimesh = pytest.importorskip("trimesh")

CASE = """
simulation = { dimensions = 3; end_time = 1.0; };
domain = { low = [0.0, 0.0, 0.0]; high = [1.6, 0.8, 0.8]; };
gravity = [0.0, 0.0, -9.81];
fluid = ( { name = "ball"; shape = { stl = { file = "ball.stl"; SCALE }; }; } );
numerics = { spacing = 0.04; };
wall = ( { name = "post"; solid = true; shape = { stl = { file = "post.stl"; }; }; } );
"""


@pytest.fixture
def case(tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.3)
    ball.apply_translation([0.5, 0.4, 0.3])
    ball.export(tmp_path / "ball.stl")
    post = trimesh.creation.box(extents=[0.24, 0.24, 0.4])
    post.apply_translation([1.2, 0.4, 0.2])
    post.export(tmp_path / "post.stl")

    def make(scale=""):
        path = tmp_path / "case.conf"
        path.write_text(CASE.replace("SCALE", scale))
        return configure(load(str(path)))

    make.folder = tmp_path
    return make


def test_a_closed_surface_is_filled(case):
    scene = Scene(case())
    state = scene.fluid(np.arange(scene.n_fluid))
    assert np.linalg.norm(state["x"] - [0.5, 0.4, 0.3], axis=1).max() < 0.3
    assert state["m"].sum() == pytest.approx(1000 * 4 / 3 * np.pi * 0.027, rel=0.02)  # facets and lattice
    assert all(number.verdict != "fail" for number in derived(case()))


def test_a_solid_has_layers_inside_its_surface_with_normals_outwards(case):
    wall = Scene(case()).walls[0]
    ids, x, normal = wall.near(*wall.bounds)
    inside = np.abs(x - [1.2, 0.4, 0.2]) <= [0.12, 0.12, 0.2]
    assert inside.all() and len(ids) == 6 * 6 * 10  # three layers of 0.04 m fill 0.24 m
    assert np.allclose(np.abs(normal).max(axis=1), 1.0)
    side = np.abs(x[:, 2] - 0.2) < 0.05
    assert np.all(np.sum((x - [1.2, 0.4, 0.2])[side] * normal[side], axis=1) > 0)


def test_a_body_has_the_inertia_of_its_triangles(case):
    mass = 700.0 * 0.24 * 0.24 * 0.4
    found = rigid_of(case().wall[0].shape, 700.0)
    assert found.mass == pytest.approx(mass, rel=1e-6) and found.centre == pytest.approx([1.2, 0.4, 0.2])
    across = mass / 12 * (0.24**2 + 0.4**2)
    np.testing.assert_allclose(found.inertia, np.diag([across, across, mass / 6 * 0.24**2]), rtol=1e-5, atol=1e-6)


def test_scale_and_shift(case):
    scene = Scene(case("scale = 0.5; shift = [0.25, 0.2, 0.15];"))
    state = scene.fluid(np.arange(scene.n_fluid))
    assert np.allclose(state["x"].mean(axis=0), [0.5, 0.4, 0.3], atol=0.01)
    assert state["m"].sum() == pytest.approx(1000 * 4 / 3 * np.pi * 0.027 / 8, rel=0.1)


@pytest.mark.parametrize("content, words", [(b"solid x", "triangles"), (b"", "triangles"), (None, "No such file")])
def test_what_is_no_solid_is_refused_at_its_place(case, content, words):
    path = case.folder / "ball.stl"
    path.unlink()
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConfigError) as error:
        case()
    assert "case.conf:5:" in error.value.message and "fluid[0].shape.stl.file" in error.value.message
    assert words in error.value.message


def test_a_pipe_a_device_and_a_large_file_are_refused_at_once(case, monkeypatch):
    path, sound = case.folder / "ball.stl", (case.folder / "ball.stl").read_bytes()
    path.unlink()
    os.mkfifo(path)
    with pytest.raises(ConfigError, match=r"ball.stl: cannot be read as STL \(not a regular file"):
        case()
    path.unlink()
    path.symlink_to("/dev/zero")
    with pytest.raises(ConfigError, match="not a regular file"):
        case()
    path.unlink()
    path.write_bytes(sound)
    monkeypatch.setattr(given, "MOST", 0)
    with pytest.raises(ConfigError, match="larger than 0 MiB"):
        case()


def test_a_run_keeps_its_surfaces_and_knows_them(case, tmp_path):
    """Two files of one name; the originals go, the folder is moved, and config.conf gives the same scene."""
    (case.folder / "other").mkdir()
    (case.folder / "ball.stl").rename(case.folder / "other/post.stl")
    path = case.folder / "case.conf"
    path.write_text(CASE.replace("SCALE", "").replace("ball.stl", "other/post.stl"))
    tree = load(str(path))
    config = configure(tree)
    bounds = [geometry.bounds(body.shape) for body in (*config.fluid, *config.wall)]
    text, files = given.config_text(config, tree), given.contents(tree)
    RunDir.create(tmp_path / "run", config=text, given=files).unlock()
    (case.folder / "post.stl").unlink()
    (case.folder / "other/post.stl").unlink()
    moved = (tmp_path / "run").rename(tmp_path / "moved")
    again = load(str(moved / "config.conf"))
    kept = configure(again)
    assert np.array_equal([geometry.bounds(body.shape) for body in (*kept.fluid, *kept.wall)], bounds)
    assert given.kept_text(kept, again, moved) == text
    (moved / "given/post.stl").write_bytes((moved / "given/1-post.stl").read_bytes())
    with pytest.raises(ConfigError, match=r"fluid\[0\].shape.stl.file: not the file of this case"):
        configure(load(str(moved / "config.conf")))


def test_an_open_surface_is_refused(case):
    surface = trimesh.load(case.folder / "ball.stl")
    surface.update_faces(np.arange(len(surface.faces)) > 0)
    surface.export(case.folder / "ball.stl")
    with pytest.raises(ConfigError, match="not closed"):
        case()


def test_a_surface_whose_triangles_look_both_ways_is_refused(case):
    surface = trimesh.load(case.folder / "ball.stl")
    surface.faces[:100] = surface.faces[:100, ::-1]
    surface.export(case.folder / "ball.stl")
    with pytest.raises(ConfigError, match="look different ways"):
        case()


def test_memory_grows_with_the_triangles(case):
    """Also where two files hold the same."""
    ball, post = (len(trimesh.load(case.folder / name).faces) for name in ("ball.stl", "post.stl"))
    few = estimate(case(), 1, 1, {}).memory["surfaces of triangles"]
    (case.folder / "post.stl").write_bytes((case.folder / "ball.stl").read_bytes())
    many = estimate(case(), 1, 1, {}).memory["surfaces of triangles"]
    of_each = (few - TRIMESH_MIB * MIB) / (ball + post)
    assert of_each > 1000 and many - few == pytest.approx(of_each * (ball - post))
