"""Free bodies of a few spacings are told, with a spacing that is fine enough; and what gaps to walls do to them."""

import re

import pytest
from test_sph_plausibility import PARTS, told

SPACE = {
    "simulation": "{ dimensions = 3; end_time = 1.0; }",
    "gravity": "[0.0, 0.0, -9.81]",
    "domain": "{ low = [0.0, 0.0, 0.0]; high = [1.0, 1.0, 1.0]; }",
    "fluid": '( { name = "water"; shape = { box = { low = [0.0, 0.0, 0.0]; high = [1.0, 1.0, 0.8]; }; }; } )',
}
TANK = '( { name = "tank"; shape = { box = { low = %s; high = %s; open = ["%s+"]; }; }; }'
BODY = '{ name = "ball"; solid = true; shape = { %s }; body = { %s }; } )'


def across(d, shape, body, spacing=0.05):
    tank = TANK % (str([0.0] * d), str([1.0] * d), "xyz"[d - 1])
    parts = SPACE if d == 3 else {"fluid": PARTS["fluid"].replace("0.3", "0.8")}
    wall = f"{tank}, {BODY % (shape, body)}"
    return told(**parts | {"wall": wall, "numerics": f"{{ spacing = {spacing}; }}"}).get("spacings across ball")


def ball(d, radius):
    return f"sphere = {{ centre = {[0.5] * d}; radius = {radius}; }};"


@pytest.mark.parametrize("d, radius, density, least", [
    (3, 0.195, 500.0, 8), (3, 0.205, 500.0, 8), (3, 0.095, 2000.0, 4), (3, 0.105, 2000.0, 4),
    (2, 0.095, 500.0, 4), (2, 0.105, 500.0, 4),
])  # fmt: skip
def test_a_body_needs_spacings_across_by_its_weight_and_the_cure_passes(d, radius, density, least):
    number = across(d, ball(d, radius), f"density = {density};")
    assert number.limit == f">= {least}" and number.value == pytest.approx(40 * radius)
    assert number.verdict == ("ok" if 40 * radius >= least else "warn")
    if number.verdict == "warn":
        finer = float(re.fullmatch("spacing = (.*)", number.cure)[1])
        assert across(d, ball(d, radius), f"density = {density};", finer).verdict == "ok"


def test_a_flat_body_counts_by_its_volume():
    plate = "box = { low = [0.1, 0.1, 0.5]; high = [0.9, 0.9, 0.6]; };"
    assert across(3, plate, "density = 500.0;").value == pytest.approx((6 * 0.064 / 3.14159265) ** (1 / 3) / 0.05)


@pytest.mark.parametrize("held, free", [('["x", "y"]', False), ('["x", "rz"]', True)])
def test_a_body_that_goes_nowhere_is_not_asked(held, free):
    assert (across(2, ball(2, 0.05), f"density = 500.0; held = {held};") is not None) == free
    assert across(2, ball(2, 0.05), "density = 500.0; hinge = { point = [0.5, 0.5]; };") is None


@pytest.mark.parametrize(("low", "hinge", "limit"), [
    (0.0, "", ">= 0.05, a layer of fluid"), (0.0, "[0.6, 0.0]", "> 0.05, at which solids touch"),
    (0.05, "[0.6, 0.05]", "> 0.05, at which solids touch"), (0.05, "", ">= 0"), (0.075, "[0.6, 0.075]", ">= 0"),
])  # fmt: skip
def test_a_gate_that_a_body_is_starts_apart_from_its_floor(low, hinge, limit):
    """Water beside it, none in its place. A flap 0.1 m thick on a hinge at its foot, and on a line at its top, 0.4 m
    above, held 0.3 m of water by the contacts of its foot: the line bore 6 N/m for 110 with a gap of a spacing or none.
    """
    shape = f"box = {{ low = [0.5, {low}]; high = [0.7, 0.8]; }};"
    more = f"density = 500.0; hinge = {{ point = {hinge}; }};" if hinge else "density = 500.0;"
    water = '( { name = "water"; shape = { box = { low = [0.0, 0.0]; high = [0.5, 0.5]; }; }; } )'
    number = told(fluid=water, wall=f"{PARTS['wall'][:-1]}, {BODY % (shape, more)}")["gap between ball and tank"]
    assert number.limit == limit and number.value == pytest.approx(low)
    assert number.verdict == ("ok" if limit == ">= 0" else "warn")
