"""What a body displaces at the start is its volume, wherever it lies between the particles."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from sph_scenes import config, tank

from sph.setup.scene import Scene
from sph.setup.signed_distance import signed_distance

ROUND = "sphere = {{ centre = {centre}; radius = {r}; }};"
SIDES = (16.0, 7.0)  # of a rectangle, spacings


def scene(shape, d=2, size=30.0, walls="", fill=None):
    """A fluid with spacing 1 and one body in it."""
    body = f'{{ name = "b"; solid = true; shape = {{ {shape} }}; body = {{ density = 500.0; }}; }}'
    return Scene(config(d=d, size=size, fill=size if fill is None else fill, spacing=1.0, gravity=(0.0,) * d,
                        pressure="zero", more=f"wall = ( {walls}{body} );"))  # fmt: skip


def tilted(centre, degrees):
    """A rectangle about a centre[2]."""
    along = SIDES[0] / 2 * np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    base, top = (centre - along).tolist(), (centre + along).tolist()
    return f"cylinder = {{ base = {base}; top = {top}; radius = {SIDES[1] / 2}; }};"


def places(n, d, middle=15.0):
    return middle + np.random.default_rng(n).uniform(size=(n, d))


def displaced(shape, d=2, size=30.0):
    """Particles that the fluid lacks."""
    return size**d - scene(shape, d, size).n_fluid


@pytest.mark.parametrize("r", [3.0, 3.6, 5.2, 8.0, 11.7])
def test_a_disc_displaces_its_area(r):
    """Within 1.5 particles at each place: 1 where some are as deep as each other, and rounding."""
    found = np.array([displaced(ROUND.format(centre=x.tolist(), r=r)) for x in places(8, 2)])
    assert np.abs(found - np.pi * r**2).max() < 1.5 and abs(found.mean() - np.pi * r**2) < 0.8


@pytest.mark.parametrize("r", [3.6, 5.0])
def test_a_ball_displaces_its_volume(r):
    """More by (dp / R)^2 / 4, for cells that the surface cuts count by the depth of their middle."""
    found = np.mean([displaced(ROUND.format(centre=x.tolist(), r=r), 3, 18.0) for x in places(4, 3, 8.5)])
    assert found == pytest.approx(4 / 3 * np.pi * r**3 * (1 + 0.25 / r**2), rel=0.005)


@pytest.mark.parametrize("degrees", [0.0, 10.0, 20.0, 30.0, 60.0])
def test_a_tilted_box_displaces_its_area(degrees):
    found = np.mean([displaced(tilted(x, degrees)) for x in places(8, 2)])
    assert found == pytest.approx(SIDES[0] * SIDES[1], rel=0.01)


def test_a_box_between_the_particles_moves_none_and_others_displace_their_area():
    box = "box = {{ low = [{0}, {0}]; high = [{1}, {2}]; }};"
    aligned = scene(box.format(8.0, 24.0, 15.0))
    x = aligned.fluid(np.arange(aligned.n_fluid))["x"]
    assert aligned.n_fluid == 900 - 16 * 7 and (x % 1.0 == 0.5).all()
    assert displaced(box.format(8.3, 24.3, 15.3)) == pytest.approx(16 * 7, abs=1)


@pytest.mark.parametrize("shape", [ROUND.format(centre=[15.2, 14.7], r=6.3), tilted(np.array([15.2, 14.7]), 25.0)])
def test_particles_begin_half_a_spacing_off_both_sides_of_a_surface(shape):
    one = scene(shape)
    wall, x = one.walls[0], one.fluid(np.arange(one.n_fluid))["x"]
    ids, body, _ = wall.near(*wall.bounds)
    assert signed_distance(wall.shape, x).min() > 0.498 and signed_distance(wall.shape, body).max() < -0.498
    assert cKDTree(body).query(x)[0].min() > 0.99  # beyond the cores
    assert (wall.at(ids)[0] == body).all()


def test_no_particle_is_pressed_between_a_body_and_a_floor():
    one = scene(ROUND.format(centre=[15.0, 6.3], r=6.2), fill=(30.0, 16.0), walls=tank(size=30.0)[9:-3] + ", ")
    x = one.fluid(np.arange(one.n_fluid))["x"]
    assert x[:, 1].min() >= 0.4 and signed_distance(one.walls[1].shape, x).min() > 0.498
