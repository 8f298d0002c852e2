"""What a solid displaces at the start is its volume, wherever it lies between the particles."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from sph_scenes import config, tank

from hpcpic.core.case.config import loads
from sph.configure import configure
from sph.setup.scene import Scene
from sph.setup.signed_distance import signed_distance

ROUND = "sphere = {{ centre = {centre}; radius = {r}; }};"
SIDES = (16.0, 7.0)  # of a rectangle, spacings


def scene(shape, d=2, size=30.0, walls="", fill=None, free=True):
    """A fluid with spacing 1 and one solid in it, a body or fixed."""
    body = "body = { density = 500.0; };" if free else 'type = "extrapolated-free-slip";'
    body = f'{{ name = "b"; solid = true; shape = {{ {shape} }}; {body} }}'
    return Scene(config(d=d, size=size, fill=size if fill is None else fill, spacing=1.0, gravity=(0.0,) * d,
                        pressure="zero", more=f"wall = ( {walls}{body} );"))  # fmt: skip


def tilted(centre, degrees):
    """A rectangle about a centre[2]."""
    along = SIDES[0] / 2 * np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    base, top = (centre - along).tolist(), (centre + along).tolist()
    return f"cylinder = {{ base = {base}; top = {top}; radius = {SIDES[1] / 2}; }};"


def places(n, d, middle=15.0):
    return middle + np.random.default_rng(n).uniform(size=(n, d))


def displaced(shape, d=2, size=30.0, free=True):
    """Particles that the fluid lacks."""
    return size**d - scene(shape, d, size, free=free).n_fluid


@pytest.mark.parametrize("free", [True, False])
@pytest.mark.parametrize("r", [3.0, 3.6, 5.2, 8.0, 11.7])
def test_a_disc_displaces_its_area(r, free):
    """Within 1.5 particles at each place: 1 where some are as deep as each other, and rounding."""
    found = np.array([displaced(ROUND.format(centre=x.tolist(), r=r), free=free) for x in places(8, 2)])
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


@pytest.mark.parametrize("free", [True, False])
@pytest.mark.parametrize("shape", [ROUND.format(centre=[15.2, 14.7], r=6.3), tilted(np.array([15.2, 14.7]), 25.0)])
def test_particles_begin_half_a_spacing_off_both_sides_of_a_surface(shape, free):
    one = scene(shape, free=free)
    wall, x = one.walls[0], one.fluid(np.arange(one.n_fluid))["x"]
    ids, body, _ = wall.near(*wall.bounds)
    assert signed_distance(wall.shape, x).min() > 0.498 and signed_distance(wall.shape, body).max() < -0.498
    assert cKDTree(body).query(x)[0].min() > 0.99  # beyond the cores
    assert (wall.at(ids)[0] == body).all()


def test_no_particle_is_pressed_between_a_body_and_a_floor():
    one = scene(ROUND.format(centre=[15.0, 6.3], r=6.2), fill=(30.0, 16.0), walls=tank(size=30.0)[9:-3] + ", ")
    x = one.fluid(np.arange(one.n_fluid))["x"]
    assert x[:, 1].min() >= 0.4 and signed_distance(one.walls[1].shape, x).min() > 0.498


def filled(walls, low=(0.0, 0.0), high=(30.0, 30.0)):
    """A fluid with spacing 1 in a box, less what walls take; its places."""
    fluid = f"fluid = ( {{ shape = {{ box = {{ low = {list(low)}; high = {list(high)}; }}; }}; }} );"
    domain = "domain = { low = [-10.0, -10.0]; high = [40.0, 40.0]; };"
    head = "simulation = { dimensions = 2; end_time = 1.0; }; eos = { max_velocity = 1.0; };"
    one = Scene(configure(loads(f"{head} {domain} {fluid} numerics = {{ spacing = 1.0; }}; wall = ( {walls} );")))
    return one, one.fluid(np.arange(one.n_fluid))["x"]


@pytest.mark.parametrize("degrees", [0.0, 12.0, 30.0, 45.0])
def test_an_inclined_plane_takes_what_lies_behind_it(degrees):
    """Through (15, y), so that what the slope adds to a box of fluid on one side it takes on the other. Cells that are
    cut at 45 degrees count as cut along a side: 2.1 of 620 too many.
    """
    up = [float(-np.sin(np.radians(degrees))), float(np.cos(np.radians(degrees)))]
    counts = []
    for y in 15.0 + np.random.default_rng(3).uniform(size=8):
        one, x = filled(f"{{ shape = {{ plane = {{ point = [15.0, {y}]; normal = {up}; }}; }}; }}", (0, 0), (30, 36))
        counts.append(one.n_fluid - 30.0 * (36.0 - y))
        assert signed_distance(one.walls[0].shape, x).min() > 0.498
    assert np.abs(counts).max() < 3.0


def test_a_round_tank_holds_its_area_wherever_it_lies():
    counts = []
    for centre in places(8, 2):
        round_tank = ROUND.format(centre=centre.tolist(), r=9.3).replace("{{", "{").replace("}}", "}")
        one, x = filled(f"{{ shape = {{ {round_tank} }}; }}")
        counts.append(one.n_fluid - np.pi * 9.3**2)
        wall = one.walls[0]
        assert signed_distance(wall.shape, x).max() < -0.498
        assert signed_distance(wall.shape, wall.near(*wall.bounds)[1]).min() > 0.498
    assert np.abs(counts).max() < 1.5


@pytest.mark.parametrize("height", [9.6, 10.4])
def test_a_floor_takes_nothing_from_a_box_that_the_spacing_does_not_divide(height):
    """Its rows are nearer to each other than a spacing, or farther, and the lowest to the floor by half of that."""
    one, x = filled("{ shape = { plane = { point = [0.0, 0.0]; normal = [0.0, 1.0]; }; }; }", high=(30.0, height))
    assert one.n_fluid == 300 and x[:, 1].min() == pytest.approx(height / 20, rel=1e-9)
