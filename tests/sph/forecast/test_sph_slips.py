"""Slips of a unit or a place are told."""

import pytest
from test_sph_plausibility import PARTS, air, told

RIM = PARTS["wall"].replace("high = [1.0, 1.0]", "high = [1.0, 0.6]")
HIGH = PARTS["fluid"].replace("0.3]", "0.8]")
BESIDE = (
    RIM[:-1]
    + """, { name = "dam"; solid = true; shape = { box = { low = [-0.2, 0.5]; high = [0.0, 1.0]; }; }; },
    { name = "gate"; solid = true; shape = { box = { low = [1.0, 0.5]; high = [1.2, 1.0]; }; }; } )"""
)
DROP = HIGH.replace("low = [0.0, 0.0]; high = [1.0", "low = [0.4, 0.7]; high = [0.6")
NAME = "height of water over the rim of tank"


@pytest.mark.parametrize("density, more, warns", [
    (1.0, {}, True),
    (1e6, {}, True),
    (71.0, {}, False),
    (1000.0, {}, False),
    (1.0, {"gravity": "[0.0, -1.0]", "eos": "{ max_velocity = 1.0; }"}, False),  # in units of its own
    (1.2, {"eos": "{ gamma = 1.4; sound_speed = 340.0; }"}, False),
])  # fmt: skip
def test_a_liquid_as_light_as_a_gas_is_told_where_units_are_known(density, more, warns):
    found = told(fluid=PARTS["fluid"].replace("shape", f"density = {density}; shape", 1), **more)
    assert (getattr(found.get("density of water"), "verdict", "") == "warn") == warns


def test_air_beside_water_may_be_as_light_as_it_is():
    assert "density of air" not in told(fluid=air())


@pytest.mark.parametrize("parts, sides", [
    ({"wall": RIM, "fluid": HIGH}, "x- x+"),
    ({"wall": RIM, "fluid": HIGH.replace("high = [1.0", "high = [0.5")}, "x-"),
    ({"wall": RIM}, ""),
    ({"fluid": HIGH}, ""),
    ({"wall": BESIDE, "fluid": HIGH, "domain": "{ low = [-0.2, 0.0]; high = [1.2, 1.0]; }"}, ""),  # others hold it
    ({"wall": RIM, "fluid": DROP}, ""),  # it falls into the tank
    ({"wall": RIM, "fluid": HIGH, "domain": '{ low = [0.0, 0.0]; high = [1.0, 1.0]; periodic = ["x"]; }'}, ""),
])  # fmt: skip
def test_water_over_the_rim_of_its_tank_is_told_with_the_sides(parts, sides):
    number = told(**parts).get(NAME)
    assert (number.symbol if number else "") == sides
    if number:
        assert number.value == pytest.approx(0.2) and number.verdict == "warn" and "0.6 m" in number.cure


BALL = PARTS["fluid"].replace("{ box = { low = [0.0, 0.0]; high = [1.0, 0.3]; }; }",
                              "{ sphere = { centre = [0.5, 0.6]; radius = 0.1; }; }")  # fmt: skip
POOL = ', { name = "pool"; shape = { box = { low = [0.0, 0.0]; high = [1.0, 0.3]; }; }; } )'


@pytest.mark.parametrize("fluid, height", [
    (DROP, 0.1),
    (DROP.replace("0.7]", "0.0]"), 0.0),
    (DROP.replace("shape", 'initial_pressure = "zero"; shape', 1), 0.0),
    (DROP.replace("shape", "surface = 0.8; shape", 1), 0.0),
    (BALL, 0.1 + (0.1**2 - 0.025**2) ** 0.5),  # half a spacing beside its middle
    (BALL.replace("0.6]", "0.1]"), 0.0),
    (DROP[:-2] + POOL, 0.1),
    (DROP.replace("0.7]", "0.3]")[:-2] + POOL, 0.0),  # it lies on another
    (PARTS["fluid"].replace("0.0, 0.0", "0.0, 0.5").replace("0.3]", "0.8]"), 0.3),  # between walls alone
])  # fmt: skip
def test_the_pressure_of_rest_of_water_that_rests_on_nothing_is_told(fluid, height):
    number = told(fluid=fluid).get("pressure of rest in water, under which there is nothing")
    assert bool(number) == bool(height)
    if number:
        assert number.value == pytest.approx(9810 * (height - 0.025), rel=0.01) and number.verdict == "warn"


@pytest.mark.parametrize("point, warns", [("[5.0, 5.0]", True), ("[0.2, 0.9]", False), ("[0.5, 1.05]", False)])
def test_a_hinge_far_from_its_body_and_the_domain_is_told(point, warns):
    float_ = f"""{{ name = "float"; solid = true; body = {{ density = 500.0; hinge = {{ point = {point}; }}; }};
        shape = {{ box = {{ low = [0.4, 0.5]; high = [0.7, 0.8]; }}; }}; }}"""
    found = told(wall=f"{PARTS['wall'][:-1]}, {float_} )")
    assert ("distance of the hinge of float from it" in found) == warns


@pytest.mark.parametrize("thick, sensor, warns", [
    (0.1, 'at = [0.5, 0.2]; axis = "x+";', True),
    (0.1, 'at = [0.6, 0.2]; axis = "x-"; wall = "plate";', True),
    (0.1, 'at = [1.0, 0.2]; axis = "x+";', False),  # the tank, which has no other face
    (0.4, 'at = [0.5, 0.2]; axis = "x+";', False),
    (0.5, 'at = [0.5, 0.2]; axis = "x+";', False),  # it leans on the tank
])  # fmt: skip
def test_a_sensor_in_a_plate_that_feels_both_faces_is_told(thick, sensor, warns):
    """A partition of one to four spacings between 2943 and 981 Pa: its sensors tell the difference, or less."""
    plate = f"""{{ name = "plate"; solid = true;
        shape = {{ box = {{ low = [0.5, 0.0]; high = [{0.5 + thick}, 0.6]; }}; }}; }}"""
    found = told(wall=PARTS["wall"][:-1] + f", {plate} )",
                 gauge=f'( {{ name = "p"; what = "wall-pressure"; size = [0.0, 0.1]; {sensor} }} )')  # fmt: skip
    row = found.get("thickness of plate behind p")
    assert (row is not None and row.verdict == "warn") == warns
