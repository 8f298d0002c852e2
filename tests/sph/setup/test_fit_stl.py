"""Fluid is fitted to surfaces from STL files as to the shapes of the program."""

import numpy as np
import pytest

import sph
from hpcpic.core.case.config import loads
from sph.case import geometry
from sph.configure import configure
from sph.setup.rigid.fit import Fitted
from sph.setup.scene import Scene
from sph.setup.signed_distance import normals, signed_distance

trimesh = pytest.importorskip("trimesh")

HEAD = """simulation = { dimensions = 3; end_time = 1.0; }; eos = { max_velocity = 1.0; };
numerics = { spacing = 1.0; }; domain = { low = [-16.0, -16.0, -16.0]; high = [32.0, 32.0, 32.0]; };
fluid = ( { shape = { box = { low = [0.0, 0.0, 0.0]; high = [16.0, 16.0, 16.0]; }; }; } );"""


def scene(folder, mesh, solid, builtin):
    """The scenes of a fluid and a wall from an STL file and from a shape of the program."""
    mesh.export(folder / "a.stl")
    found = []
    for shape in (f'stl = {{ file = "{folder / "a.stl"}"; }};', builtin):
        wall = f"wall = ( {{ solid = {solid}; shape = {{ {shape} }}; }} );"
        found.append(Scene(configure(loads(HEAD + wall))))
    return found


def started(one):
    return one.fluid(np.arange(one.n_fluid))["x"]


@pytest.mark.parametrize("solid", ["true", "false"])
@pytest.mark.parametrize("r", [4.3, 6.0])
def test_fluid_around_and_in_a_ball_of_triangles_is_as_around_a_ball(tmp_path, solid, r):
    """Numbers by the volume of the triangles, within 0.5 % of it and the two that rounding of both takes; those of
    the wall as on a lattice, which a ball that holds fluid does not have.
    """
    ball = trimesh.creation.icosphere(subdivisions=4, radius=r)
    ball.apply_translation([8.2, 7.9, 7.6])
    one, other = scene(tmp_path, ball, solid, f"sphere = {{ centre = [8.2, 7.9, 7.6]; radius = {r}; }};")
    side, volume = (1.0 if solid == "true" else -1.0), geometry.volume(one.walls[0].shape)
    less = volume - geometry.volume(other.walls[0].shape)
    assert one.n_fluid - other.n_fluid == pytest.approx(-side * less, abs=2.0 + 0.005 * volume)
    wall, x = one.walls[0], started(one)
    assert (side * signed_distance(wall.shape, x)).min() > 0.498
    ids, body, _ = wall.near(*wall.bounds)
    assert (side * signed_distance(wall.shape, body)).max() < -0.498
    near = other.walls[0]
    lattice = Fitted(near.shape, near.scene.spacing, near.layers, near.section.solid, near._grid(ends=1))
    assert len(ids) == pytest.approx(len(lattice.near(*near.bounds)[0]), rel=0.01)


def test_a_block_of_triangles_along_the_axes_takes_as_a_box_does(tmp_path):
    block = trimesh.creation.box(bounds=[[4.0, 5.0, 3.0], [10.0, 9.0, 12.0]])
    one, other = scene(tmp_path, block, "true", "box = { low = [4.0, 5.0, 3.0]; high = [10.0, 9.0, 12.0]; };")
    assert (started(one) == started(other)).all()
    assert (one.walls[0].near(*one.walls[0].bounds)[1] == other.walls[0].near(*other.walls[0].bounds)[1]).all()


def test_water_that_the_spacing_does_not_divide_lies_off_a_floor_as_that_of_a_box_does(tmp_path):
    """That of files had up to a tenth more than its volume, and lay on the floor; so did that of upright cylinders."""
    size = [16.26, 7.75, 5.3]
    trimesh.creation.box(bounds=[[0.0, 0.0, 0.0], size]).export(tmp_path / "water.stl")
    shapes = ({"box": {"low": [0.0, 0.0, 0.0], "high": size}}, {"stl": {"file": str(tmp_path / "water.stl")}},
              {"cylinder": {"base": [0.0, 0.0, 0.0], "top": [0.0, 0.0, 5.3], "radius": 7.5}})  # fmt: skip
    box, stl, cylinder = (
        Scene(sph.Case(simulation={"end_time": 1.0}, eos={"max_velocity": 1.0}, fluid=[{"shape": shape}],
                       numerics={"spacing": 1.0}).config)
        for shape in shapes
    )  # fmt: skip
    np.testing.assert_allclose(started(stl), started(box), atol=1e-5)
    np.testing.assert_allclose(stl.masses, box.masses, rtol=1e-5)
    assert started(cylinder)[:, 2].min() == pytest.approx(5.3 / 5 / 2)
    exact = 1000.0 * geometry.volume(cylinder.config.fluid[0].shape)
    assert cylinder.n_fluid * cylinder.masses[0] == pytest.approx(exact, rel=0.02)


@pytest.mark.parametrize("degrees", [12.0, 30.0])
def test_a_slope_of_triangles_takes_as_a_plane_does(tmp_path, degrees):
    """A block whose upper face lies in the plane."""
    block = trimesh.creation.box(bounds=[[-60.0, -60.0, -60.0], [60.0, 60.0, 0.0]])
    block.apply_transform(trimesh.transformations.rotation_matrix(-np.radians(degrees), [0, 1, 0]))
    block.apply_translation([8.0, 8.0, 7.7])
    up = [float(-np.sin(np.radians(degrees))), 0.0, float(np.cos(np.radians(degrees)))]
    one, other = scene(tmp_path, block, "true", f"plane = {{ point = [8.0, 8.0, 7.7]; normal = {up}; }};")
    assert one.n_fluid == pytest.approx(other.n_fluid, abs=1)
    assert signed_distance(one.walls[0].shape, started(one)).min() > 0.498


def test_every_part_of_a_wall_and_of_the_fluid_has_the_bits_of_the_whole(tmp_path):
    """So that ranks agree, whatever part each asks for."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=5.3)
    ball.apply_translation([8.2, 7.9, 7.6])
    one, _ = scene(tmp_path, ball, "true", "sphere = { centre = [8.2, 7.9, 7.6]; radius = 5.3; };")
    wall, all_ids = one.walls[0], np.arange(one.n_fluid)
    ids, x, normal = wall.near(*wall.bounds)
    whole = {key: (place, n) for key, place, n in zip(ids.tolist(), x.tolist(), normal.tolist())}
    (low, high), cut, found = wall.bounds, 7.123, {}
    for a, b in ((low[0], cut), (cut, high[0])):
        part = wall.near([a, *low[1:]], [b, *high[1:]])
        found |= {key: (place, n) for key, place, n in zip(*(values.tolist() for values in part))}
    assert found == whole
    assert (one.fluid(all_ids[37::3])["x"] == one.fluid(all_ids)["x"][37::3]).all()
    at = normals(wall.shape, x[5:9], 1e-3)
    assert (at == normals(wall.shape, x, 1e-3)[5:9]).all()
