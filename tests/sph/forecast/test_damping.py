"""check tells that liquids with a free surface resist strain half as much by Morris' viscosity."""

import pytest

import sph

NAME = "resistance to strain at a free surface"


def told(viscosity, lid=False, wall=None, **numerics):
    sides = {} if lid else {"open": ["y+"]}
    case = sph.Case(
        simulation={"dimensions": 2, "end_time": 1.0}, gravity=[0.0, -9.81], numerics={"spacing": 0.05, **numerics},
        fluid=[{"shape": {"box": {"low": [0.0, 0.0], "high": [1.0, 1.0]}}, "kinematic_viscosity": viscosity}],
        wall=[{"shape": {"box": {"low": [0.0, 0.0], "high": [1.0, 1.0 if lid else 1.2], **sides}}, **(wall or {})}],
    )  # fmt: skip
    return [row for row in case.check().rows if row.name == NAME]


def test_a_wave_that_viscosity_damps_is_told_of_with_what_damps_it_right():
    (row,) = told(5e-3, viscosity_form="morris")
    assert row.verdict == "warn" and row.value == pytest.approx(0.52) and '"full-stress"' in row.cure
    assert not told(5e-3, viscosity_form="cleary") and not told(5e-3)


def test_syrup_that_has_no_waves_is_told_of():
    (row,) = told(1.0, viscosity_form="morris")
    assert row.verdict == "warn"


def test_a_cure_takes_the_walls_with_it():
    (row,) = told(5e-3, wall={"type": "mirror-no-slip"})
    assert "wall.type left out" in row.cure and '"cleary"' in row.cure


def test_a_drop_without_gravity_is_told_of():
    case = sph.Case(
        simulation={"dimensions": 2, "end_time": 1.0}, eos={"max_velocity": 1.0},
        domain={"low": [-2.0, -2.0], "high": [2.0, 2.0]}, numerics={"spacing": 0.1, "viscosity_form": "morris"},
        fluid=[{"shape": {"sphere": {"centre": [0.0, 0.0], "radius": 1.0}}, "kinematic_viscosity": 0.01}],
    )  # fmt: skip
    assert [row.verdict for row in case.check().rows if row.name == NAME] == ["warn"]
    still = case.changed({"fluid[0].kinematic_viscosity": 1e-4})
    assert not [row for row in still.check().rows if row.name == NAME]


@pytest.mark.parametrize(("viscosity", "lid"), [(1e-6, False), (5e-3, True)], ids=["water", "lid"])
def test_where_no_wave_is_damped_nothing_is_told(viscosity, lid):
    assert not told(viscosity, lid, viscosity_form="morris")
