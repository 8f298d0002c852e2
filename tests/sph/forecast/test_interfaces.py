"""check tells what holds back waves on the interface of two liquids: friction of pressed particles, and a lattice."""

import math

import pytest

import sph
from sph.forecast.interfaces import MOST

DEEP, WAVE, LIGHT, HEAVY, G = 0.5, 0.5, 800.0, 1200.0, 9.81
PRESSED = "friction of pressed particles where lower and upper meet"


def told(densities=(HEAVY, LIGHT), deep=DEEP, wave=WAVE, amplitude=0.02, disorder=0.1, spacing=0.025,
         periodic=("x",), d=2, **numerics):  # fmt: skip
    flow = {"flow": {"type": "standing-wave", "amplitude": amplitude, "wavelength": wave}} if wave else {}
    layers = (("lower", 0.0, 0.5), ("upper", 0.5, 0.5 + deep))
    low, high = [0.0] * (d - 1), [0.5] * (d - 1)
    case = sph.Case(
        simulation={"dimensions": d, "end_time": 1.0}, gravity=[0.0] * (d - 1) + [-G],
        numerics={"spacing": spacing, **numerics},
        domain={"low": [*low, 0.0], "high": [*high, 0.5 + deep], "periodic": list(periodic)},
        fluid=[{"name": name, "density": density, "disorder": disorder, **flow,
                "shape": {"box": {"low": [*low, bottom], "high": [*high, end]}}}
               for density, (name, bottom, end) in zip(densities, layers)],
        wall=[{"shape": {"box": {"low": [*low, 0.0], "high": [*high, 0.5 + deep]}}}],
    )  # fmt: skip
    return {row.name: row for row in case.check().rows if "lower" in row.name or "upper" in row.name}


@pytest.mark.parametrize("smoothing, part", [(1.5, 0.014), (2.0, 0.0031)])
@pytest.mark.parametrize("made", [{}, {"deep": 0.1}, {"wave": 0.25}, {"spacing": 0.0125}, {"d": 3}])
def test_damping_is_the_share_of_the_pressure_in_the_weight_that_drives_a_wave(made, smoothing, part):
    """45 dp / L of k p part / (g (rho1 - rho2))."""
    row = told(**made, smoothing=smoothing)[PRESSED]
    deep, wave = made.get("deep", DEEP), made.get("wave", WAVE)
    expected = part * LIGHT * G * deep * 2 * math.pi / wave / (G * (HEAVY - LIGHT))
    expected *= 45 * made.get("spacing", 0.025) / wave
    assert row.value == pytest.approx(expected, rel=0.02)
    assert (row.verdict == "warn") == (expected > MOST) == bool(row.cure)


def test_growth_loses_less_and_is_cured_by_spacings_alone():
    rows = [told(densities=(LIGHT, HEAVY), smoothing=ratio)[PRESSED] for ratio in (1.3, 1.5, 2.0)]
    assert rows[1].value == rows[2].value < rows[0].value
    assert rows[1].value == pytest.approx(20 / 45 * HEAVY / LIGHT * told()[PRESSED].value, rel=0.02)
    assert "smoothing = 1.5" in rows[0].cure and "smoothing" not in rows[1].cure and "spacing = " in rows[1].cure


def test_what_is_told_is_a_cure():
    row = told(spacing=0.0125)[PRESSED]
    assert row.verdict == "warn" and "smoothing = 2.0" in row.cure and 'viscosity_form = "none"' in row.cure
    cured = told(spacing=0.0125, smoothing=2.0, viscosity_form="none")[PRESSED]
    assert cured.verdict == "ok" and cured.value == pytest.approx(0.0031 / 0.014 * row.value)
    spacing = float(row.cure.split("spacing = ")[1].split(",")[0])
    assert told(spacing=spacing)[PRESSED].value == pytest.approx(MOST, rel=0.05)


def test_without_a_wave_of_the_case_the_longest_counts_that_an_interface_has_room_for():
    along = told(wave=0.0)[PRESSED].value
    assert along == pytest.approx(told(wave=0.5)[PRESSED].value)
    assert told(wave=0.0, periodic=())[PRESSED].value == pytest.approx(along / 4, rel=0.02)


def test_liquids_of_one_density_have_no_such_waves():
    assert PRESSED not in told(densities=(HEAVY, HEAVY))


@pytest.mark.parametrize("made, tells", [
    ({"disorder": 0.0}, True),
    ({"disorder": 0.0, "amplitude": 0.0}, False),  # it rests
    ({"disorder": 0.0, "amplitude": 0.0, "densities": (LIGHT, HEAVY)}, True),  # it overturns
    ({}, False),
])  # fmt: skip
def test_a_perfect_lattice_at_an_interface_that_moves_is_told(made, tells):
    rows = [row for name, row in told(**made).items() if name.startswith("disorder of")]
    assert len(rows) == 2 * tells and all(row.verdict == "warn" and row.cure == "disorder = 0.1" for row in rows)


def lock(densities=(1050.0, 1000.0), height=0.2, gap=0.0, turned=False, **numerics):
    """The row of a front in a closed box of two liquids beside each other, if there is one; turned: along y."""
    low, middle, high = [0.0, 0.0], [1.0, height], [2.0 + gap, height]
    corners = ((low, middle), ([1.0 + gap, 0.0], high), (low, high))
    boxes = [
        {"box": dict(zip(("low", "high"), (one[::-1], other[::-1]) if turned else (one, other)))}
        for one, other in corners
    ]
    case = sph.Case(
        simulation={"end_time": 1.0}, gravity=[-G, 0.0] if turned else [0.0, -G],
        numerics={"spacing": 0.01, **numerics},
        fluid=[{"name": name, "density": density, "disorder": 0.1, "shape": box}
               for name, density, box in zip(("heavy", "light"), densities, boxes)],
        wall=[{"shape": boxes[2]}],
    )  # fmt: skip
    found = [row for row in case.check().rows if "front of" in row.name]
    assert len(found) <= 1
    return found[0] if found else None


@pytest.mark.parametrize("smoothing, part", [(1.5, 0.014), (2.0, 0.0031)])
@pytest.mark.parametrize(
    "made", [{}, {"densities": (1250.0, 1000.0)}, {"densities": (1000.0, 1050.0)}, {"turned": True}]
)
def test_a_front_is_held_back_by_pressed_particles_and_by_artificial_viscosity(made, smoothing, part):
    """0.75 s p / (g (rho1 - rho2) H), and 25 / Re, Re of sqrt(g' H)."""
    heavy, light = sorted(made.get("densities", (1050.0, 1000.0)), reverse=True)
    rubbed = 0.75 * part * heavy / (heavy - light)
    bare = lock(**made, smoothing=smoothing, viscosity_form="none")
    assert bare.value == pytest.approx(rubbed, rel=0.02) and (bare.verdict == "warn") == (rubbed > MOST)
    speed = math.sqrt(2 * (heavy - light) / (heavy + light) * G * 0.2)
    nu = 0.02 * 10 * math.sqrt(2 * G * 0.2) * smoothing * 0.01 / 16
    assert lock(**made, smoothing=smoothing).value == pytest.approx(rubbed + 25 * nu / (speed * 0.2), rel=0.02)


def test_the_cure_of_a_front_is_one():
    row = lock()
    assert row.verdict == "warn" and row.cure == 'smoothing = 2.0 with viscosity_form = "none"'
    assert lock(smoothing=2.0, viscosity_form="none").verdict == "ok"


@pytest.mark.parametrize("made", [{"densities": (1000.0, 1000.0)}, {"gap": 0.1}])
def test_no_front_without_two_densities_that_meet(made):
    assert lock(**made) is None
    assert not [name for name in told(wave=0.0) if "front of" in name]  # one lies on the other


@pytest.mark.parametrize("slope", [0.0, 0.1])
def test_a_lattice_at_an_interface_that_slopes_is_told_and_friction_as_of_a_level_one(slope):
    a, b = 0.5 - slope / 2, 0.5 + slope / 2
    corners = [[0.0, 0.0], [0.5, 0.0], [0.5, a], [0.0, b]], [[0.0, b], [0.5, a], [0.5, 1.0], [0.0, 1.0]]
    case = sph.Case(
        simulation={"end_time": 1.0}, gravity=[0.0, -G], numerics={"spacing": 0.025},
        fluid=[{"name": name, "density": density, "shape": {"polygon": {"corners": corner}}}
               for name, density, corner in zip(("lower", "upper"), (HEAVY, LIGHT), corners)],
        wall=[{"shape": {"box": {"low": [0.0, 0.0], "high": [0.5, 1.0]}}}],
    )  # fmt: skip
    rows = {row.name: row for row in case.check().rows}
    level = told(wave=0.0, periodic=())[PRESSED].value
    assert rows[PRESSED].value == pytest.approx(level, rel=0.12)  # as deep as it is on average, but for the slope
    assert len([name for name in rows if name.startswith("disorder of")]) == (2 if slope else 0)
