"""Speeds beside which the default sound speed may be too small are told before the run."""

import pytest
from test_sph_plausibility import PARTS, gate, told

PLATE = """( {{ name = "lid"; shape = {{ plane = {{ point = [0.0, 1.0]; normal = [0.0, -1.0]; }}; }};
    motion = {{ {} }}; type = "{}"; }} )"""
VISCOUS = PARTS["fluid"].replace("shape", "dynamic_viscosity = 1.0; shape", 1)
LATER = "path = ( { time = 0.5; displacement = [0.0, 0.0]; }, { time = 1.0; displacement = [-1.5, 0.0]; } );"


def tank(motion):
    return PARTS["wall"].replace("shape", f"motion = {{ {motion} }}; shape", 1)


def block(motion, low, high):
    return f"""{PARTS["wall"][:-1]}, {{ name = "gate"; solid = true; motion = {{ {motion} }};
        shape = {{ box = {{ low = {low}; high = {high}; }}; }}; }} )"""


@pytest.mark.parametrize("name, speed, parts", [
    ("tank", 5.0, {"wall": tank("velocity = [5.0, 0.0];")}),
    ("tank", 2.0, {"wall": tank("velocity = [0.0, 2.0];")}),  # lifted by its floor
    ("tank", 0.0, {"wall": tank("velocity = [0.0, -50.0];")}),  # it falls away from the water
    ("gate", 0.0, {"wall": gate("velocity = [0.0, 50.0];")}),
    ("gate", 3.0, {"wall": gate("velocity = [0.0, -3.0]; stop = 0.1;")}),  # into the water
    ("gate", 0.0, {"wall": gate("velocity = [0.0, -3.0]; start = 2.0;")}),  # when all is over
    ("gate", 3.0, {"wall": block("velocity = [-3.0, 0.0];", "[1.0, 0.0]", "[1.1, 0.9]")}),
    ("gate", 0.0, {"wall": block("velocity = [3.0, 0.0];", "[1.0, 0.0]", "[1.1, 0.9]")}),
    ("gate", 0.0, {"wall": block("velocity = [0.0, 3.0];", "[1.0, 0.0]", "[1.1, 0.9]")}),
    ("gate", 3.0, {"wall": block(LATER, "[2.0, 0.0]", "[2.1, 0.9]")}),  # it comes to the water from afar
    ("gate", 0.0, {"wall": gate("velocity = [0.0, 50.0];"), "fluid": VISCOUS}),
    ("lid", 0.0, {"wall": PLATE.format("velocity = [50.0, 0.0];", "extrapolated-free-slip")}),
    ("lid", 4.0, {"wall": PLATE.format("velocity = [50.0, -4.0];", "extrapolated-free-slip")}),
    ("lid", 50.0, {"wall": PLATE.format("velocity = [50.0, 0.0];", "extrapolated-no-slip"), "fluid": VISCOUS}),
])  # fmt: skip
def test_a_wall_that_takes_fluid_with_it_is_compared_with_the_sound_speed(name, speed, parts):
    found = told(**parts, domain="{ low = [0.0, 0.0]; high = [4.0, 1.0]; }")
    number, c0 = found.get(f"sound speed over the speed of {name}"), found["sound speed"].value
    assert (number is None) == (speed == 0.0)
    if number:
        assert number.value == pytest.approx(c0 / speed)
        assert (number.verdict, bool(number.cure)) == (("ok", False) if c0 >= 7 * speed else ("warn", True))


def test_the_cure_of_a_tank_that_moves_is_one():
    cured = told(wall=tank("velocity = [5.0, 0.0];"), eos="{ max_velocity = 5.0; }")
    assert cured["sound speed over the speed of tank"].verdict == "ok"
    assert cured["sound speed"].value == 50.0


def test_without_gravity_walls_tell_the_sound_speed():
    lid = PLATE.format("velocity = [1e-3, 0.0];", "extrapolated-no-slip")
    assert told(wall=lid, fluid=VISCOUS, gravity="[0.0, 0.0]")["sound speed"].value == pytest.approx(1e-2)


FLOOR = '{{ name = "floor_{}"; solid = true; shape = {{ box = {{ low = [{}, -0.2]; high = [{}, 0.0]; }}; }}; {} }}'
FALL = "sound speed over the speed of a free fall"
BELOW = '{ low = [0.0, -2.0]; high = [1.0, 1.0]; outflow = ["y-"]; }'


def slotted(*floors):
    sides = PARTS["wall"].replace('"y+"', '"y+", "y-"')
    return f"{sides[:-1]}, {', '.join(FLOOR.format(k, *floor) for k, floor in enumerate(floors))} )"


@pytest.mark.parametrize("floors, low, verdict", [
    ([(0.0, 0.4, ""), (0.6, 1.0, "")], -2.0, "warn"),
    ([(0.0, 0.4, ""), (0.6, 1.0, "")], -0.25, None),  # half as deep as the water is enough for twice its height
    ([(0.0, 1.0, "")], -2.0, "ok"),
    ([(0.0, 0.4, ""), (0.4, 1.0, "motion = { velocity = [0.3, 0.0]; };")], -2.0, "warn"),  # it opens
    ([(0.0, 0.4, ""), (0.6, 1.0, ""), (0.2, 0.8, "type = \"extrapolated-free-slip\";")], -2.0, "ok"),
])  # fmt: skip
def test_a_fall_to_where_fluid_can_come_is_told_before_the_run(floors, low, verdict):
    parts = {"wall": slotted(*floors), "domain": BELOW.replace("-2.0", str(low))}
    number = told(**parts).get(FALL)
    assert (number.verdict if number else None) == verdict
    if verdict == "warn":
        speed = (2 * 9.81 * (0.3 - low)) ** 0.5
        assert told(**parts)["sound speed"].value / number.value == pytest.approx(speed, rel=0.03)
        cured = told(**parts, eos=f"{{ {number.cure}; }}")
        assert FALL not in cured


JOURNAL = """( {{ name = "outer"; shape = {{ sphere = {{ centre = [0.0, 0.0]; radius = 0.2; }}; }}; }},
    {{ name = "journal"; solid = true; shape = {{ sphere = {{ centre = [0.0, {}]; radius = 0.1; }}; }};
       body = {{ density = 1000.0; held = ["x", "y", "rz"]; angular_velocity = [{}]; }}; }} )"""
OIL = """( { name = "oil"; dynamic_viscosity = 20.0;
    shape = { sphere = { centre = [0.0, 0.0]; radius = 0.2; }; }; } )"""
SQUEEZED = "density by viscosity between journal and outer"


def bearing(place, spin, spacing=0.01):
    """A journal that turns in oil, off the middle of its bearing by the place."""
    return {"wall": JOURNAL.format(place, spin), "fluid": OIL, "gravity": "[0.0, 0.0]",
            "domain": "{ low = [-0.3, -0.3]; high = [0.3, 0.3]; }",
            "numerics": f"{{ spacing = {spacing}; }}"}  # fmt: skip


@pytest.mark.parametrize("place, spin, c0, expected", [
    (-0.05, 1.0, 1.0, 0.04),  # the load after a second is 0.57 of Wannier's
    (-0.05, 1.0, 2.0, 0.01),  # 0.95 of it
    (0.0, 1.0, 1.0, None),  # Couette flow has no pressure to make
    (-0.05, 0.0, 1.0, None),
])  # fmt: skip
def test_the_sound_speed_is_compared_with_what_viscosity_presses_together(place, spin, c0, expected):
    """The largest speed says nothing of it: c0 was ten times that of the journal, and its load was half of theory."""
    parts = bearing(place, spin)
    number = told(**parts, eos=f"{{ sound_speed = {c0}; max_velocity = 0.1; }}").get(SQUEEZED)
    assert (number and number.value) == (expected and pytest.approx(expected, rel=1e-3))
    if number and number.verdict == "warn":
        assert told(**parts, eos=f"{{ {number.cure}; max_velocity = 0.1; }}")[SQUEEZED].verdict == "ok"


@pytest.mark.parametrize("place, spin, spacing, expected", [
    (-0.05, 1.0, 0.01, 5.0), (0.0, 1.0, 0.01, 10.0), (0.0, 1.0, 0.005, None), (-0.05, 0.0, 0.01, None),
])  # fmt: skip
def test_few_spacings_across_a_gap_that_a_rotor_shears_are_told(place, spin, spacing, expected):
    name, c0 = "spacings across the gap between journal and outer", "{ sound_speed = 5.0; max_velocity = 0.1; }"
    number = told(**bearing(place, spin, spacing), eos=c0).get(name)
    assert (number and number.value) == (expected and pytest.approx(expected))
    if number:
        assert number.verdict == ("warn" if expected < 6 else "ok")
    if number and number.verdict == "warn":
        assert told(**bearing(place, spin, number.cure.split()[-1]), eos=c0)[name].verdict == "ok"
