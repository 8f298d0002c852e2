"""Fluid at rest starts with the pressure of what lies over each of its points, whatever it is made of."""

import math

import numpy as np
import pytest

import sph
from sph.setup.scene import Scene

DP = 0.02
TANK = {"name": "tank", "shape": {"box": {"low": [0.0, 0.0], "high": [1.0, 0.8], "open": ["y+"]}}}
TANK_3D = {"shape": {"box": {"low": [0.0, 0.0, 0.0], "high": [0.8, 0.4, 0.8], "open": ["z+"]}}}


def start(fluid, gravity=(0.0, -9.81), wall=(TANK,)):
    """Places[n, d] in m and the head of the pressure[n] in m of particles at t = 0; c0 is so high that density is 1."""
    made = sph.Case(simulation={"end_time": 0.1}, gravity=list(gravity), fluid=[fluid], numerics={"spacing": DP},
                    eos={"sound_speed": 1e4}, wall=list(wall))  # fmt: skip
    scene = Scene(made.config)
    found = scene.fluid(np.arange(scene.n_fluid))
    return found["x"], scene.eos.pressure(found["drho"]) / 9810.0


def below(top, n=50):
    """Points of a lattice in the tank under heights of a surface over x."""
    line = (np.arange(n) + 0.5) * DP
    x = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
    return x[x[:, 1] < top(x[:, 0])]


def test_arrays_start_with_the_pressure_under_their_own_surface():
    """They had that of their highest particle everywhere, of spray too."""
    water = below(lambda x: 0.3 + 0.1 * x)
    top = np.array([water[water[:, 0] == x, 1].max() for x in water[:, 0]]) + DP / 2
    spray = np.array([[0.31, 0.71], [0.35, 0.71], [0.33, 0.77]])
    x, head = start({"start": {"position": np.concatenate([water, spray])}})
    np.testing.assert_allclose(head[: len(water)], top - x[: len(water), 1], atol=1e-6)
    np.testing.assert_allclose(head[len(water) :], 0.0, atol=1e-9)


def test_arrays_under_a_solid_start_with_the_level_beside_it():
    box = {"name": "box", "solid": True, "shape": {"box": {"low": [0.4, 0.2], "high": [0.6, 0.7]}}}
    water = below(lambda x: np.where(abs(x - 0.5) < 0.1, 0.2, 0.4))
    x, head = start({"start": {"position": water}}, wall=(TANK, box))
    np.testing.assert_allclose(head, 0.4 - x[:, 1], atol=1e-6)


@pytest.mark.parametrize("degrees", [10.0, -30.0])
def test_a_level_box_has_no_pressure_at_its_surface_under_gravity_that_is_oblique(degrees):
    """It had the pressure below the corner that lies highest against gravity, and rang by a third of it."""
    a = math.radians(degrees)
    x, head = start({"shape": {"box": {"low": [0.0, 0.0], "high": [1.0, 0.3]}}},
                    (9.81 * math.sin(a), -9.81 * math.cos(a)))  # fmt: skip
    under = (0.3 - x[:, 1]) / math.cos(a)
    edge = (x[:, 0] if a > 0.0 else 1.0 - x[:, 0]) < (0.3 + DP - x[:, 1]) * math.tan(abs(a))  # a side is over these
    assert 0 < edge.sum() < 0.2 * len(x)
    np.testing.assert_allclose(head[~edge], under[~edge], atol=0.3 * DP)
    assert np.all(head < 0.31 / math.cos(a))


def test_so_has_one_in_space():
    a = math.radians(10.0)
    x, head = start({"shape": {"box": {"low": [0.0, 0.0, 0.0], "high": [0.8, 0.4, 0.2]}}},
                    (9.81 * math.sin(a), 0.0, -9.81 * math.cos(a)), (TANK_3D,))  # fmt: skip
    inner = x[:, 0] > 0.1
    np.testing.assert_allclose(head[inner], (0.2 - x[inner, 2]) / math.cos(a), atol=0.3 * DP)


def test_a_strip_that_lies_askew_has_the_pressure_under_its_slope():
    c, s = math.cos(0.2), math.sin(0.2)
    strip = {"base": [-0.15 * s, 0.15 * c], "top": [c - 0.15 * s, s + 0.15 * c], "radius": 0.15}
    trough = [[0.0, 0.0], [c, s], [c - 0.6 * s, s + 0.6 * c], [-0.6 * s, 0.6 * c]]
    x, head = start({"shape": {"cylinder": strip}}, wall=({"shape": {"polygon": {"corners": trough}}},))
    under = 0.3 - (c * x[:, 1] - s * x[:, 0])  # the distance from the surface
    inner = c * x[:, 0] + s * x[:, 1] < 0.9  # beyond, an end is over them
    np.testing.assert_allclose(head[inner], under[inner] / c, atol=0.1 * DP)


def test_round_water_and_that_of_a_file_have_no_pressure_at_their_upper_sides(tmp_path):
    """They had the pressure below their highest point everywhere."""
    ball = pytest.importorskip("trimesh").creation.icosphere(subdivisions=3, radius=0.16)
    ball.apply_translation([0.4, 0.2, 0.2]).export(tmp_path / "ball.stl")
    lying = {"base": [0.1, 0.2, 0.2], "top": [0.7, 0.2, 0.2], "radius": 0.16}
    disc = {"sphere": {"centre": [0.4, 0.2], "radius": 0.16}}
    for shape, up, wall in ((disc, [0.0, 1.0], TANK), ({"cylinder": lying}, [0.0, 0.0, 1.0], TANK_3D),
                            ({"stl": {"file": str(tmp_path / "ball.stl")}}, [0.0, 0.0, 1.0], TANK_3D)):  # fmt: skip
        x, head = start({"shape": shape}, [-9.81 * part for part in up], (wall,))
        off = (x - [0.4, 0.2, 0.2][: len(up)])[:, slice(int("cylinder" in shape), -1)]  # from the middle, across
        squares = np.sum(off * off, axis=1)
        inner = squares < 0.1**2
        top = 0.2 + np.sqrt(0.16**2 - squares[inner])
        np.testing.assert_allclose(head[inner], top - x[inner, -1], atol=0.4 * DP)
