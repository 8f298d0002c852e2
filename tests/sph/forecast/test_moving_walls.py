"""Walls that move: the layer that they drag along, the sound that their swing asks for, and what they run into."""

import math
import re

import pytest
from test_sph_plausibility import PARTS, told

BOX = '{ name = "gate"; solid = true; shape = { box = { low = %s; high = %s; }; }; motion = { %s }; } )'
SWING = "amplitude = [0.02, 0.0]; period = 1.0;"


def meeting(low, high, motion, more="", **parts):
    """The row of the gate and the tank, or of a post."""
    wall = PARTS["wall"][:-1] + more + "," + BOX % (low, high, motion)
    found = [number for name, number in told(**parts | {"wall": wall}).items() if name.startswith("least gap")]
    return found[0] if found else None


def path(way, time=0.8):
    return f"path = ( {{ time = 0.1; displacement = [0.0, 0.0]; }}, {{ time = {time}; displacement = {way}; }} );"


@pytest.mark.parametrize("low, high, motion, verdict, least", [
    ([0.5, 0.0], [0.6, 0.9], path([-0.5, 0.0]), "warn", 0.0),  # through the water to the wall
    ([0.5, 0.0], [0.6, 0.9], path([-0.7, 0.0]), "fail", -0.1),
    ([0.5, 0.0], [0.6, 0.9], path([-0.4, 0.0]), None, None),
    ([0.5, 0.0], [0.6, 0.9], path([0.0, 0.6]), None, None),  # a gate that is lifted
    ([0.5, 0.0], [0.6, 0.9], path([0.0, -0.9]), None, None),  # through the floor on which it stands
    ([0.1, 0.4], [0.2, 0.9], path([-0.4, 0.0]), "warn", -0.1),  # above the water
    ([0.3, 0.0], [0.4, 0.9], "amplitude = [0.4, 0.0]; period = 0.9;", "fail", -0.1),
    ([0.3, 0.0], [0.4, 0.9], "amplitude = [0.2, 0.0]; period = 0.9;", None, None),
    ([0.3, 0.4], [0.4, 0.9], "velocity = [0.0, -1.0]; stop = 0.3;", None, None),
    ([0.3, 0.4], [0.4, 0.9], "velocity = [0.0, -1.0];", "fail", -0.1),
    ([0.3, 0.4], [0.4, 0.9], "velocity = [0.0, -1.0]; start = 2.0;", None, None),  # after the end
])  # fmt: skip
def test_a_wall_that_runs_into_another_is_told(low, high, motion, verdict, least):
    """It touches the floor or leaves it, or comes nearer to a side than a spacing; with water before it none begins."""
    number = meeting(low, high, motion)
    assert (number and number.verdict) == verdict
    if verdict:
        assert number.value <= least + 1e-9 and number.key == ("wall", 1, "motion") and number.forceable


@pytest.mark.parametrize("start, way", [([0.5, 0.0], "path"), ([0.3, 0.4], "velocity")])
def test_a_way_that_ends_when_is_told_meets_nothing(start, way):
    high = [start[0] + 0.1, 0.9]
    motion = {"path": path([-0.5, 0.0]), "velocity": "velocity = [0.0, -1.0];"}[way]
    end = float(re.fullmatch("an end of the way at t = (.*) s", meeting(start, high, motion).cure)[1])
    less = {"path": path([-0.5 * (end - 0.1) / 0.7, 0.0], end), "velocity": f"{motion} stop = {end};"}[way]
    assert meeting(start, high, less) is None
    more = {"path": path([-0.5 * (end - 0.08) / 0.7, 0.0], end), "velocity": f"{motion} stop = {end + 0.02};"}[way]
    assert meeting(start, high, more).verdict == "warn"


def test_solids_that_go_together_do_not_meet_and_those_that_meet_are_told_once():
    post = ', { name = "post"; solid = true; shape = { sphere = { centre = [0.2, 0.5]; radius = 0.1; }; }; %s }'
    number = meeting([0.5, 0.4], [0.6, 0.9], path([-0.3, 0.0]), post % "")
    assert number.name == "least gap between post and gate on the way of gate"
    along = f"motion = {{ {path([-0.3, 0.0])} }};"
    both = meeting([0.5, 0.4], [0.6, 0.9], path([-0.3, 0.0]), post % along)
    assert both.name == "least gap between post and tank on the way of post"  # 0.1 m from it at first


@pytest.mark.parametrize("shape", [
    "box = { low = [0.5, -0.1, 0.0]; high = [0.6, 1.1, 0.9]; };",
    "cylinder = { base = [0.55, 0.0, 0.5]; top = [0.55, 1.0, 0.5]; radius = 0.05; };",
])  # fmt: skip
def test_a_wall_through_a_period_is_as_long_as_that(shape):
    ways = path([-0.5, 0.0]).replace("0.0]", "0.0, 0.0]")
    gate = f', {{ name = "gate"; solid = true; shape = {{ {shape} }}; motion = {{ {ways} }}; }} )'
    numbers = told(
        simulation="{ dimensions = 3; end_time = 1.0; }",
        gravity="[0.0, 0.0, -9.81]",
        domain='{ low = [0.0, 0.0, 0.0]; high = [1.0, 1.0, 1.0]; periodic = ["y"]; }',
        fluid='( { name = "water"; shape = { box = { low = [0.0, 0.0, 0.0]; high = [0.5, 1.0, 0.4]; }; }; } )',
        wall=PARTS["wall"]
        .replace("0.0, 0.0]", "0.0, 0.0, 0.0]")
        .replace("1.0, 1.0]", "1.0, 1.0, 1.0]")
        .replace("y+", "z+")[:-1]
        + gate,
    )
    number = numbers["least gap between gate and tank on the way of gate"]
    assert number.value == pytest.approx(0.0, abs=0.011)  # round walls by spheres in their particles
    assert number.cure.startswith("an end of the way at t = 0.7")


def oscillating(kind, nu, spacing=0.05, motion=SWING):
    fluid = PARTS["fluid"].replace("shape", f"kinematic_viscosity = {nu}; shape", 1) if nu else PARTS["fluid"]
    extra = BOX.replace("solid", f'type = "{kind}"; solid', 1) if kind else BOX
    wall = PARTS["wall"][:-1] + "," + extra % ([0.5, 0.1], [0.6, 0.2], motion)
    numbers = told(fluid=fluid, wall=wall, numerics=f"{{ spacing = {spacing}; }}")
    return numbers.get("layer of fluid that gate drags along")


def test_the_layer_that_a_swing_drags_along_is_that_of_stokes_and_the_cure_resolves_it():
    number = oscillating("", 0.0314159265)
    assert number.value == pytest.approx((0.0314159265 / math.pi) ** 0.5 / 0.05) and number.verdict == "warn"
    finer = float(re.fullmatch("spacing = (.*)", number.cure)[1])
    assert oscillating("", 0.0314159265, finer).verdict == "ok"


@pytest.mark.parametrize("kind, nu, motion", [
    ("", 0.0, SWING), ("extrapolated-free-slip", 0.03, SWING), ("repulsive", 0.03, SWING),
    ("", 0.03, "velocity = [0.01, 0.0];"),
])  # fmt: skip
def test_what_slips_or_does_not_swing_drags_no_layer_along(kind, nu, motion):
    assert oscillating(kind, nu, motion=motion) is None


def test_the_sound_that_a_swing_asks_for_is_not_too_fast():
    """A slow swing in a wide box: c0 of 50 times the largest velocity would be told as waste."""
    parts = {"gravity": "[0.0, 0.0]"}
    wall = f"( {BOX % ([0.5, 0.1], [0.6, 0.2], SWING)}"
    first = told(**parts, wall=wall)
    assert first["swing of gate beside sound"].verdict == "warn"
    cured = told(**parts, wall=wall, eos=f"{{ {first['swing of gate beside sound'].cure}; }}")
    assert cured["sound speed factor"].value > 50
    assert [cured[name].verdict for name in ("swing of gate beside sound", "sound speed factor")] == ["ok", "ok"]
    wasted = told(**parts, wall=wall, eos="{ sound_speed = 200.0; }")["sound speed factor"]
    assert wasted.verdict == "warn"
    useful = told(**parts, wall=wall, eos=f"{{ sound_speed_factor = {wasted.cure.split()[1]}; }}")
    assert useful["swing of gate beside sound"].verdict == "ok"
