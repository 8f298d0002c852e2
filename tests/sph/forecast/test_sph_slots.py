"""Slots too narrow for a particle, openings too narrow for a discharge, and tanks whose fluid is pressed down by what
is no gravity, are told.
"""

import pytest
from test_sph_plausibility import PARTS, told

PERIODIC = '{ low = [0.0, 0.0]; high = [1.0, 1.0]; periodic = ["x"]; }'
FLOOR = '( { name = "tank"; shape = { plane = { point = [0.0, 0.0]; normal = [0.0, 1.0]; }; }; } )'


def gate(low, high, more="", name="gate"):
    return f', {{ name = "{name}"; solid = true; {more} shape = {{ box = {{ low = {low}; high = {high}; }}; }}; }} )'


@pytest.mark.parametrize("bottom, layers", [(0.0, None), (-0.1, None), (0.025, 0.5), (0.045, 0.9), (0.05, None)])
@pytest.mark.parametrize("parts", [{}, {"wall": FLOOR}, {"domain": PERIODIC}, {"wall": FLOOR, "domain": PERIODIC}])
def test_a_slot_under_a_gate_that_no_particle_fits_into_is_told(bottom, layers, parts):
    """It touches the floor or reaches into it, or lets particles through: nothing is said."""
    wall = parts.get("wall", PARTS["wall"])[:-1] + gate(f"[0.4, {bottom}]", "[0.6, 0.9]")
    number = told(**parts | {"wall": wall}).get("slot between gate and tank")
    assert (number is None) == (layers is None)
    if number:
        assert number.verdict == "warn" and number.value == pytest.approx(layers)
        assert number.cure.startswith(f"spacing = {layers / 100:.3g}")


@pytest.mark.parametrize("more", ["motion = { velocity = [0.0, 1.0]; };", "body = { density = 2000.0; };"])
def test_slots_of_solids_that_go_or_float_are_none(more):
    wall = PARTS["wall"][:-1] + gate("[0.4, 0.025]", "[0.6, 0.9]", more)
    assert "slot between gate and tank" not in told(wall=wall)


FORCE = "measure_force = true;"


@pytest.mark.parametrize("bottom, more, title", [
    (0.0, "", "slot between gate and post"),
    (0.0, FORCE, "slot between gate and post"),
    (0.2, FORCE, "slot between gate and post"),
    (0.2, FORCE + ' type = "pressure-continuity";', "layers of fluid between gate and post"),  # nothing is nearer
])  # fmt: skip
def test_a_slot_between_two_solids_is_told_once(bottom, more, title):
    wall = (PARTS["wall"][:-1] + gate(f"[0.3, {bottom}]", "[0.4, 0.9]", more))[:-1]
    found = told(wall=wall + gate(f"[0.42, {bottom}]", "[0.6, 0.9]", name="post"))
    assert [name for name in found if "gate and post" in name or "post and gate" in name] == [title]
    assert found[title].verdict == "warn" and found[title].value == pytest.approx(0.4)


OPENING = "spacings across the opening between gate and tank"


@pytest.mark.parametrize("bottom, wide", [(0.0, None), (0.04, 1.0), (0.16, 4.0), (0.36, 9.0), (0.4, None)])
def test_a_gate_over_a_floor_is_told_until_ten_spacings_and_the_cure_passes(bottom, wide):
    wall = PARTS["wall"][:-1] + gate(f"[0.48, {bottom}]", "[0.52, 0.9]")
    number = told(wall=wall, numerics="{ spacing = 0.04; }").get(OPENING)
    assert (number is None) == (wide is None)
    if number:
        assert number.verdict == "warn" and number.value == pytest.approx(wide)
        assert OPENING not in told(wall=wall, numerics=f"{{ {number.cure}; }}")


def in_space(*solids):
    """A tank in 3D, 1 m wide and open on top, and solid boxes in it."""
    boxes = ", ".join(gate(*ends, name=f"s{i}")[2:-2] for i, ends in enumerate(solids))
    parts = {
        "simulation": "{ dimensions = 3; end_time = 1.0; }",
        "gravity": "[0.0, 0.0, -9.81]",
        "domain": "{ low = [0.0, 0.0, 0.0]; high = [1.0, 1.0, 1.0]; }",
        "fluid": '( { name = "water"; shape = { box = { low = [0.0, 0.0, 0.5]; high = [1.0, 1.0, 0.9]; }; }; } )',
        "wall": PARTS["wall"].replace("0.0, 0.0]", "0.0, 0.0, 0.0]").replace("1.0, 1.0]", "1.0, 1.0, 1.0]")
        .replace("y+", "z+")[:-1] + f", {boxes} )",
    }  # fmt: skip
    return {name.split()[-3] + name.split()[-1] for name in told(**parts) if "across the opening" in name}


LEFT, RIGHT = ([-0.1, -0.1, 0.4], [0.4, 1.1, 0.5]), ([0.6, -0.1, 0.4], [1.1, 1.1, 0.5])
FRONT, BACK = ([0.4, -0.1, 0.4], [0.6, 0.4, 0.5]), ([0.4, 0.6, 0.4], [0.6, 1.1, 0.5])
POST = ([0.4, 0.2, 0.0], [0.6, 0.4, 0.8])


@pytest.mark.parametrize("solids, told_of", [
    ((LEFT, RIGHT), {"s0s1"}),
    ((LEFT, RIGHT, FRONT, BACK), {"s0s1", "s2s3"}),  # a hole, four spacings wide
    ((LEFT, RIGHT, FRONT, BACK, ([0.4, 0.4, 0.4], [0.6, 0.6, 0.5])), set()),  # closed
    ((POST,), set()),  # water goes around it, up to the surface
    ((([0.4, -0.1, 0.2], [0.5, 1.1, 0.9]),), {"s0tank"}),  # a sluice from side to side
])  # fmt: skip
def test_an_opening_in_space_has_walls_on_all_sides(solids, told_of):
    assert in_space(*solids) == told_of


OWN = PARTS["fluid"].replace("shape", 'acceleration = "falls"; shape', 1)
STILL = {"gravity": "[0.0, 0.0]", "eos": "{ max_velocity = 2.0; }"}


@pytest.mark.parametrize("parts, cure", [
    ({"fluid": OWN}, "gravity, less which the acceleration gives"),
    ({"body_force": "[0.0, -9.81]"}, "gravity for body_force"),
    ({"fluid": OWN, "gravity": "[0.0, -9.81]"}, ""),
    ({"fluid": OWN.replace("shape", 'initial_pressure = "zero"; shape', 1)}, ""),
    ({}, ""),
    ({"body_force": "[1.0, 0.0]", "domain": PERIODIC}, ""),  # along a channel
    ({"fluid": OWN, "wall": PARTS["wall"].replace("0.0, 0.0]; high = [1.0, 1.0]; open = [\"y+\"]",
                                                  "0.0, 0.0]; high = [1.0, 0.3]")}, ""),  # it is full
    ({"fluid": OWN, "wall": "( )"}, ""),  # it flies
])  # fmt: skip
def test_a_fluid_in_a_tank_without_gravity_that_something_else_pulls_starts_without_pressure(monkeypatch, parts, cure):
    from hpcpic.core.case import accelerations

    monkeypatch.setitem(accelerations.ACCELERATIONS, "falls", lambda x, v, t: (0.0, -9.81, 0.0))
    number = told(**STILL | parts).get("gravity on water")
    assert (number.cure if number else "") == cure
    assert number is None or (number.verdict == "warn" and "without pressure" in number.source)
