"""check foretells where the friction of particles that are pressed together matters."""

import math

import pytest

import sph


def disc_that_sinks(density=1500.0, **numerics):
    return sph.Case(
        simulation={"dimensions": 2, "end_time": 1.0}, gravity=[0.0, -9.81], numerics={"spacing": 0.002, **numerics},
        fluid=[{"shape": {"box": {"low": [0.0, 0.0], "high": [0.08, 0.16]}}, "kinematic_viscosity": 1e-3}],
        wall=[
            {"name": "tank", "shape": {"box": {"low": [0.0, 0.0], "high": [0.08, 0.18], "open": ["y+"]}}},
            {"name": "disc", "solid": True, "body": {"density": density},
             "shape": {"sphere": {"centre": [0.04, 0.12], "radius": 0.01}}},
        ],
    )  # fmt: skip


def array(background, viscosity=1e-3, **numerics):
    side = 0.1
    return sph.Case(
        simulation={"dimensions": 2, "end_time": 1.0}, body_force=[0.026, 0.0],
        domain={"low": [0.0, 0.0], "high": [side, side], "periodic": ["x", "y"]},
        numerics={"spacing": side / 30, "smoothing": 1.6, **numerics},
        eos={"max_velocity": 0.06, "background_pressure": background},
        fluid=[{"shape": {"box": {"low": [0.0, 0.0], "high": [side, side]}}, "initial_pressure": "zero",
                "kinematic_viscosity": viscosity}],
        wall=[{"name": "rod", "solid": True, "shape": {"sphere": {"centre": [0.05, 0.05], "radius": 0.025}}}],
    )  # fmt: skip


def told(case):
    return {row.name.removeprefix("friction of pressed particles "): (row.value, row.verdict)
            for row in case.check().rows if row.name.startswith("friction of pressed")}  # fmt: skip


@pytest.mark.parametrize(
    ("case", "name", "measured"),
    [
        (disc_that_sinks(smoothing=1.3, shifting=False), "on disc", 1.42),
        (disc_that_sinks(shifting=False), "on disc", 0.48),
        (disc_that_sinks(smoothing=2.0, shifting=False), "on disc", 0.105),
        (disc_that_sinks(), "on disc", 0.18),
        (array(20.0, shifting=False), "past rod", 0.14),
    ],
    ids=["1.3-lattice", "1.5-lattice", "2.0-lattice", "1.5", "array-lattice"],
)
def test_it_is_warned_of_and_foretold_within_a_third(case, name, measured):
    value, verdict = told(case)[name]
    assert verdict == "warn" and abs(math.log(value / measured)) < math.log(4 / 3)


@pytest.mark.parametrize(
    ("case", "names"),
    [
        (disc_that_sinks(gradient_correction=True), set()),
        (array(20.0, gradient_correction=True), set()),
        (array(0.0), set()),  # nothing presses
        (array(20.0, viscosity=1e-6), set()),  # not slow
        (disc_that_sinks(8000.0, smoothing=2.0), {"on disc"}),
    ],
    ids=["corrected", "array-corrected", "no-pressure", "water", "heavy"],
)
def test_no_warning_where_it_does_not_matter(case, names):
    found = told(case)
    assert set(found) == names and all(verdict == "ok" for _, verdict in found.values())


@pytest.mark.parametrize(("densities", "tells"), [((1000.0,), 0), ((1200.0, 800.0), 2)])
def test_check_tells_the_sound_of_disorder_where_it_stays(densities, tells):
    """Two liquids of 0.5 m swing by 0.2 of rho g H at the bottom, measured; one is evened out and is silent."""
    case = sph.Case(
        simulation={"end_time": 1.0}, gravity=[0.0, -9.81], numerics={"spacing": 0.0125},
        fluid=[{"density": density, "disorder": 0.1,
                "shape": {"box": {"low": [0.0, 0.5 * k], "high": [0.5, 0.5 + 0.5 * k]}}}
               for k, density in enumerate(densities)],
        wall=[{"shape": {"box": {"low": [0.0, 0.0], "high": [0.5, 1.2], "open": ["y+"]}}}],
    )  # fmt: skip
    rows = [row for row in case.check().rows if row.name.startswith("sound that the disorder")]
    assert len(rows) == tells and all(0.2 < row.value < 0.7 and row.verdict == "ok" for row in rows)


@pytest.mark.parametrize(("disorder", "measured"), [(0.1, 0.41), (0.05, 0.14), (0.0, 0.0)])
def test_check_warns_of_the_sound_of_disorder_in_water_that_runs_out(disorder, measured):
    """Half of the range of the pressure at the bottom of 1 m that does not run yet, over rho g H: measured in a tank
    before such water was evened out, it goes a little faster than the disorder. That which the cure names makes none
    that counts.
    """
    case = sph.Case(
        simulation={"end_time": 1.0}, gravity=[0.0, -9.81], numerics={"spacing": 0.01},
        fluid=[{"shape": {"box": {"low": [0.0, 0.0], "high": [0.8, 1.0]}}, "disorder": disorder}],
        wall=[{"shape": {"box": {"low": [0.0, 0.0], "high": [1.6, 1.2], "open": ["y+"]}}}],
    )  # fmt: skip
    rows = [row for row in case.check().rows if row.name == "sound that the disorder of fluid_1 makes"]
    assert len(rows) == bool(disorder)
    for row in rows:
        assert measured <= 1.05 * row.value < 2 * measured and row.verdict == "warn"
        cured = case.changed({"fluid[0].disorder": float(row.cure.split()[-1])}).check()
        assert {one.verdict for one in cured.rows if one.name == row.name} == {"ok"}
