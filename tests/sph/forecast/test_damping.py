"""check tells that waves on viscous liquids are damped half as fast by Morris' viscosity."""

import pytest

import sph


def told(viscosity, lid=False, **numerics):
    sides = {} if lid else {"open": ["y+"]}
    case = sph.Case(
        simulation={"dimensions": 2, "end_time": 1.0}, gravity=[0.0, -9.81], numerics={"spacing": 0.05, **numerics},
        fluid=[{"shape": {"box": {"low": [0.0, 0.0], "high": [1.0, 1.0]}}, "kinematic_viscosity": viscosity}],
        wall=[{"shape": {"box": {"low": [0.0, 0.0], "high": [1.0, 1.0 if lid else 1.2], **sides}}}],
    )  # fmt: skip
    return [row for row in case.check().rows if row.name == "damping of waves by viscosity"]


def test_a_wave_that_viscosity_damps_is_told_of_with_what_damps_it_right():
    (row,) = told(5e-3, viscosity_form="morris")
    assert row.verdict == "warn" and row.value == pytest.approx(0.52) and '"full-stress"' in row.cure
    assert not told(5e-3, viscosity_form="cleary") and not told(5e-3)


@pytest.mark.parametrize(
    ("viscosity", "lid"), [(1e-6, False), (1.0, False), (5e-3, True)], ids=["water", "syrup", "lid"]
)
def test_where_no_wave_is_damped_nothing_is_told(viscosity, lid):
    assert not told(viscosity, lid, viscosity_form="morris")
