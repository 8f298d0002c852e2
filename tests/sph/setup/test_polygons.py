"""Polygons of 2D scenes: sizes and distances, what is refused, and water at rest around them."""

import numpy as np
import pytest

import sph
from hpcpic.core.errors import ConfigError
from sph.case import geometry
from sph.case.shapes import Box, Cylinder, Polygon, Shape
from sph.forecast.derived import derived
from sph.setup.rigid.mass import rigid_of
from sph.setup.scene import Scene
from sph.setup.signed_distance import signed_distance, thickness

ANVIL = ((0.0, 0.0), (1.0, 0.0), (0.7, 0.4), (1.2, 0.8), (-0.2, 0.9), (0.3, 0.4))  # which is hollow on both sides
WATER = {"box": {"low": [0.0, 0.0], "high": [1.2, 0.6]}}
BOX = {"low": [0.0, 0.0], "high": [1.2, 1.0], "open": ["y+"]}
TANK = {"name": "tank", "shape": {"box": BOX}, "measure_force": True}


def polygon(corners):
    return Shape(polygon=Polygon(corners=tuple(map(tuple, corners))))


def test_a_rectangle_is_a_box():
    box, corners = Shape(box=Box(low=(1.0, 2.0), high=(3.0, 2.5))), [(1.0, 2.0), (3.0, 2.0), (3.0, 2.5), (1.0, 2.5)]
    x = np.random.default_rng(1).uniform(0.0, 4.0, (4000, 2))
    for shape in (polygon(corners), polygon(corners[::-1])):
        np.testing.assert_allclose(signed_distance(shape, x), signed_distance(box, x), atol=1e-15)
        for one, other in zip(vars(rigid_of(shape, 700.0)).values(), vars(rigid_of(box, 700.0)).values()):
            np.testing.assert_allclose(one, other, rtol=1e-14, atol=1e-13 * np.abs(other).max())


def test_the_mass_of_a_polygon_is_that_of_the_points_in_it():
    shape, n = polygon(ANVIL), 1500
    low, high = map(np.array, geometry.bounds(shape))
    parts = np.stack(np.meshgrid(*[(np.arange(n) + 0.5) / n] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    x = parts * (high - low) + low
    inside = x[signed_distance(shape, x) < 0.0]
    found, share = rigid_of(shape, 2.0), np.prod(high - low) / n**2
    near = 1e-4  # of the cells that the sides cut
    assert 2.0 * share * len(inside) == pytest.approx(found.mass, rel=near)
    np.testing.assert_allclose(inside.mean(axis=0), found.centre[:2], atol=near)
    about = inside - found.centre[:2]
    assert 2.0 * share * np.sum(about**2) == pytest.approx(found.inertia[2, 2], rel=3 * near)


def moved(corners, shift):
    return [(x + shift, y - shift) for x, y in corners]


def test_sizes_do_not_depend_on_the_place_the_first_corner_and_the_sense_of_rotation():
    there = rigid_of(polygon(ANVIL), 1.0)
    for corners in (ANVIL[::-1], ANVIL[2:] + ANVIL[:2], moved(ANVIL, 64.0)):
        here = rigid_of(polygon(corners), 1.0)
        assert here.mass == pytest.approx(there.mass, rel=1e-12)
        np.testing.assert_allclose(here.inertia, there.inertia, atol=1e-12)
    np.testing.assert_allclose(here.centre - there.centre, [64.0, -64.0, 0.0], atol=1e-12)


def test_a_plate_is_as_thick_as_it_is_in_any_place_and_at_any_angle():
    """What is thinner than a spacing holds no water: `check` told of boxes alone, by the box around a shape."""
    turn = np.array([[0.8, 0.6], [-0.6, 0.8]])
    plate = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.01], [0.0, 0.01]])
    bent = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.01], [0.01, 0.01], [0.01, 1.0], [0.0, 1.0]])
    angle = np.linspace(0.0, 2 * np.pi, 24, endpoint=False)
    for corners, thick, near in (
        (plate, 0.01, 1e-4),
        (bent, 0.01 * (2 * 2**0.5 / (1 + 2**0.5)), 0.2),  # in its corner
        (np.array([[0.0, 0.0], [0.4, 0.0], [0.4, 0.3]]), 0.2, 1e-4),
        (np.stack([np.cos(angle), np.sin(angle)], axis=1), 2 * np.cos(np.pi / 24), 1e-4),
    ):
        for one in (corners, corners @ turn + 3.0, corners[::-1]):
            assert thickness(polygon(one.tolist())) == pytest.approx(thick, rel=near)
    strip = Shape(cylinder=Cylinder(base=(0.0, 0.0), top=(1.0, 1.0), radius=0.005))
    assert thickness(strip) == pytest.approx(0.01)
    found = {row.name: row for row in derived(case([[0.5, 0.0], [0.51, 0.0], [0.81, 0.6], [0.8, 0.6]]).config)}
    assert found["thickness of w"].verdict == "fail"


def case(corners, water=WATER, walls=(TANK,), dimensions=2, **wall):
    solid = {"name": "w", "solid": True, "measure_force": True, "shape": {"polygon": {"corners": corners}}, **wall}
    return sph.Case(
        simulation={"dimensions": dimensions, "end_time": 0.2}, gravity=[0.0, -9.81, 0.0][:dimensions],
        fluid=[{"name": "water", "shape": water}], numerics={"spacing": 0.02}, wall=[*walls, solid],
    )  # fmt: skip


@pytest.mark.parametrize(
    "corners, told",
    [
        ([[0.1, 0.1], [0.4, 0.1]], "three corners or more are needed (got 2)"),
        ([[0.1, 0.1], [0.4, 0.1, 0.0], [0.4, 0.4]], "a corner has two numbers"),
        ([[0.1, 0.1], [0.4, 0.1], [0.4, 0.4], [0.1, 0.1]], "the last is joined to the first (got [0.1, 0.1] twice)"),
        ([[0.1, 0.1], [0.4, 0.4], [0.4, 0.1], [0.1, 0.4]], "those from [0.1, 0.1] and [0.4, 0.1] do"),
        ([[0.1, 0.1], [0.4, 0.1], [0.2, 0.1]], "sides must not meet"),
        ([[0.1, 0.1], [0.4, 0.1], [0.3, 0.2], [0.25, 0.1], [0.2, 0.3]], "sides must not meet"),
    ],
)
def test_what_has_no_inside_is_refused(corners, told):
    with pytest.raises(ConfigError) as error:
        case(corners)
    assert told in str(error.value) and "shape.polygon.corners" in str(error.value)


def test_in_three_dimensions_a_file_gives_the_surface():
    water = {"box": {"low": [0.0, 0.0, 0.0], "high": [0.4, 0.4, 0.4]}}
    with pytest.raises(ConfigError, match="polygons are for 2D; in 3D an STL file"):
        case([[0.1, 0.1], [0.4, 0.1], [0.4, 0.4]], water, (), dimensions=3)


def test_water_at_rest_lifts_a_wedge_by_the_weight_of_what_it_displaces():
    """At t = 0, off the lattice; 5 % are those of boxes there (test_sph_packing)."""
    corners = [[0.607, 0.153], [0.807, 0.353], [0.407, 0.353]]
    with case(corners).simulation(threads=1) as sim:
        found = sim.scalars()
        mass = float(sim.particles("water")["mass"].sum())
    lift = 9810.0 * 0.04
    assert mass == pytest.approx(1000.0 * (1.2 * 0.6 - 0.04), rel=1e-4)
    assert found["force_w_y"] == pytest.approx(lift, rel=0.05) and abs(found["force_w_x"]) < 0.03 * lift


def test_a_tank_with_sloping_sides_holds_its_water():
    """Water in a trough, and a ramp on the floor of a tank: the walls bear the weight, and nothing goes to a side."""
    trough = {"name": "t", "shape": {"polygon": {"corners": [[0.1, 0.05], [1.1, 0.05], [1.2, 1.0], [0.0, 1.0]]}}}
    below = {"polygon": {"corners": [[0.1, 0.05], [1.1, 0.05], [1.15, 0.525], [0.05, 0.525]]}}
    ramp = [[0.5, 0.0], [0.9, 0.0], [0.9, 0.3]]
    hollow = {**trough, "measure_force": True}
    for made, area in (
        (case(ramp), 0.66),
        (case([[2.0, 0.0], [2.1, 0.0], [2.0, 0.1]], below, (hollow,)), 0.49875),
    ):
        names = [wall.name for wall in made.config.wall]
        with made.simulation(threads=1) as sim:
            assert float(sim.particles("water")["mass"].sum()) == pytest.approx(1000.0 * area, rel=1e-4)
            sim.advance(until=0.2)
            found = sim.scalars()
        down, aside = (sum(found[f"force_{name}_{axis}"] for name in names) for axis in "yx")
        weight = 9810.0 * area
        assert down == pytest.approx(-weight, rel=0.03) and abs(aside) < 0.02 * weight and not found["strays"]


def start(corners=None, walls=(TANK,), spacing=0.02, **fluid):
    """Places, pressures over rho g and mass of water at t = 0, of a shape in a tank."""
    shape = {"shape": {"polygon": {"corners": corners}}} if corners else {}
    made = sph.Case(
        simulation={"end_time": 0.1}, gravity=[0.0, -9.81], numerics={"spacing": spacing},
        fluid=[{"name": "water", **shape, **fluid}], wall=list(walls),
    )  # fmt: skip
    scene = Scene(made.config)
    found = scene.fluid(np.arange(scene.n_fluid))
    return found["x"], scene.eos.pressure(found["drho"]) / 9810.0, found["m"]


@pytest.mark.parametrize("high", [(1.2, 0.6), (1.19, 0.533)])
def test_a_rectangle_of_water_starts_as_a_box_does(high):
    """On the lattice that divides it, so that its first layer lies half a spacing over the floor."""
    a, b = high
    box = start(shape={"box": {"low": [0.0, 0.0], "high": list(high)}})
    for one, other in zip(start([[0.0, 0.0], [a, 0.0], [a, b], [0.0, b]]), box):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12)


def test_under_a_slope_water_starts_with_the_pressure_of_what_lies_over_it():
    """It had that of its highest point everywhere, and rang by a third of it."""
    x, head, mass = start([[0.0, 0.0], [1.2, 0.0], [1.2, 0.23], [0.0, 0.37]])
    assert mass.sum() == pytest.approx(1000.0 * 1.2 * 0.3, rel=3e-3)
    over = 0.37 - 0.14 / 1.2 * x[:, 0] - x[:, 1]
    np.testing.assert_allclose(head, np.maximum(over, 0.0), rtol=4e-3, atol=1e-9)  # its weight compresses it


def test_water_that_walls_cover_is_level_or_has_the_pressure_between_two_levels():
    ceiling = [[0.0, 0.3], [0.0, 0.7], [1.2, 0.7], [1.2, 0.5]]
    lid = {"name": "lid", "solid": True, "shape": {"polygon": {"corners": ceiling}}}
    x, head, _ = start([[0.0, 0.0], [1.2, 0.0], [1.2, 0.5], [0.0, 0.3]], (TANK, lid))
    np.testing.assert_allclose(head, 0.5 - x[:, 1], rtol=4e-3)  # full, so that it rests
    core = {"name": "core", "solid": True, "shape": {"box": {"low": [0.2, 0.2], "high": [1.0, 1.0]}}}
    legs = [[0.0, 0.0], [1.2, 0.0], [1.2, 0.4], [1.0, 0.4], [1.0, 0.2], [0.2, 0.2], [0.2, 0.6], [0.0, 0.6]]
    x, head, _ = start(legs, (TANK, core))
    left, right = x[:, 0] < 0.2, x[:, 0] > 1.0
    level = np.select([left, right], [0.6, 0.4], 0.6 - 0.2 * (x[:, 0] - 0.2) / 0.8)
    np.testing.assert_allclose(head, level - x[:, 1], rtol=4e-3, atol=1e-3)


def test_two_liquids_share_a_lattice_along_an_interface_that_slopes():
    """Else some particles there lay crowded and others apart, and the floor bore 0.7 to 1.3 of the weight."""
    corners = [[0.0, 0.0], [1.2, 0.0], [1.2, 0.25], [0.0, 0.35]], [[0.0, 0.35], [1.2, 0.25], [1.2, 0.6], [0.0, 0.6]]
    made = sph.Case(
        simulation={"end_time": 0.1}, gravity=[0.0, -9.81], numerics={"spacing": 0.02}, wall=[TANK],
        fluid=[{"density": density, "shape": {"polygon": {"corners": one}}}
               for density, one in zip((1000.0, 800.0), corners)],
    )  # fmt: skip
    scene = Scene(made.config)
    found = scene.fluid(np.arange(scene.n_fluid))
    assert scene.n_fluid == 60 * 30 and found["m"].sum() == pytest.approx(1.2 * 0.3 * 1800.0, rel=2e-3)
    places = np.rint(found["x"] / 0.02 - 0.5)
    np.testing.assert_allclose(found["x"], (places + 0.5) * 0.02, atol=1e-12)
    assert len(np.unique(places, axis=0)) == scene.n_fluid
    x, y = found["x"].T
    between = 0.35 - 0.1 / 1.2 * x
    over = 0.8 * np.minimum(0.6 - y, 0.6 - between) + np.maximum(between - y, 0.0)
    np.testing.assert_allclose(scene.eos.pressure(found["drho"]) / 9810.0, over, rtol=4e-3)
