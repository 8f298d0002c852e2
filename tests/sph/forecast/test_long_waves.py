"""Errors of waves are told by the smoothing length and by how long waves are, where there are such."""

import pytest
from test_sph_plausibility import PARTS, gate, told

PERIOD, SPEED = "error of the period of waves", "error of the speed of a solitary wave"
LONG = {
    "domain": "{ low = [0.0, 0.0]; high = [2.0, 1.0]; }",
    "wall": PARTS["wall"].replace("high = [1.0", "high = [2.0"),
}  # a column of 1 m by 0.3 m in 2 m: it spreads
STILL = LONG | {"fluid": PARTS["fluid"].replace("high = [1.0", "high = [2.0")}


def error(length, smoothing, periodic=False):
    """Of the period, where the longest wave of a tank 1 m long, or of that period, has so many depths."""
    depth = (1.0 if periodic else 2.0) / length
    fluid = PARTS["fluid"].replace("high = [1.0, 0.3]", f"high = [1.0, {depth}]")
    ends = ' periodic = ["x"];' if periodic else ""
    parts = {"fluid": fluid, "domain": f"{{ low = [0.0, 0.0]; high = [1.0, 1.0];{ends} }}"}
    return told(numerics=f"{{ spacing = 0.02; smoothing = {smoothing}; }}", **parts)[PERIOD].value


@pytest.mark.parametrize("smoothing, deep, long", [(1.3, -4.3, -6.0), (1.5, -0.6, -1.2), (2.0, -0.2, -0.8)])
def test_the_error_of_the_period_of_waves_is_told_by_the_smoothing_length_and_the_wave(smoothing, deep, long):
    assert [error(n, smoothing) for n in (2.0, 4.0, 20.0)] == [deep, long, long]
    assert error(2.0, smoothing, periodic=True) == deep and error(10.0, smoothing, periodic=True) == long
    assert PERIOD not in told(gravity="[0.0, 0.0]", eos="{ max_velocity = 1.0; }")


def test_a_column_has_the_waves_of_its_tank_when_it_has_spread():
    assert "of 26.7 depths" in told(**LONG)[PERIOD].source  # 4 m on 0.15 m
    assert "of 13.3 depths" in told(**STILL)[PERIOD].source


def test_the_error_of_the_speed_of_a_solitary_wave_is_told_by_the_smoothing_length():
    errors = [told(numerics=f"{{ spacing = 0.05; {more} }}", **LONG)[SPEED].value
              for more in ("", "smoothing = 2.0;", "gradient_correction = true;")]  # fmt: skip
    assert errors == [4.8, 0.1, 0.2]
    assert SPEED not in told(numerics="{ spacing = 0.05; smoothing = 1.3; gradient_correction = true; }", **LONG)
    assert SPEED not in told(numerics="{ spacing = 0.05; smoothing = 1.2; }", **LONG)


@pytest.mark.parametrize("parts, runs", [
    (LONG, True), (STILL, False), ({}, False),
    (STILL | {"fluid": STILL["fluid"].replace("shape", "velocity = [1.0, 0.0]; shape", 1)}, True),
    ({"fluid": PARTS["fluid"].replace("shape", "velocity = [1.0, 0.0]; shape", 1)}, False),  # 3 depths of tank
    (STILL | {"wall": STILL["wall"][:-1] + gate("velocity = [1.0, 0.0];").removeprefix(PARTS["wall"][:-1])}, True),
    (STILL | {"body_force": "[1.0, 0.0]"}, True),
    (STILL | {"wall": LONG["wall"].replace('1.0]; open = ["y+"]', "0.3]"), "body_force": "[1.0, 0.0]"}, False),  # a lid
])  # fmt: skip
def test_a_solitary_wave_is_told_of_where_something_drives_one_along_a_long_surface(parts, runs):
    assert (SPEED in told(**parts)) == runs


@pytest.mark.parametrize("nu, runs", [(1e-3, True), (2.5e-3, True), (2.7e-3, False), (1.0, False)])
def test_no_solitary_wave_is_told_of_where_viscosity_takes_it_in_a_period(nu, runs):
    """With omega = sqrt(g k) a wave of 0.3 m on as much water has lost that at nu = omega/(4 pi k^2) = 0.0026 m2/s."""
    fluid = PARTS["fluid"].replace("shape", f"kinematic_viscosity = {nu}; shape", 1)
    assert (SPEED in told(**LONG | {"fluid": fluid})) == runs
