"""The numbers of a case against theory, their verdicts at the limits, and cures that cure."""

import math
import re

import numpy as np
import pytest
from app_runner import running
from forecast_numbers import numbers
from hypothesis import given, settings
from hypothesis import strategies as st

from hpcpic.core.case.config import Tree, loads
from hpcpic.core.case.derived import Derived, enforce
from hpcpic.core.comm.world import World
from hpcpic.core.errors import ConfigError
from hpcpic.plasma.analysis.series_analysis import fit_oscillation
from hpcpic.plasma.analysis.theory import Beam, Mesh, mesh_root
from hpcpic.plasma.configure import configure
from hpcpic.plasma.forecast.derived import derived


def test_plasma_frequency_from_macro_particles_and_as_given():
    # 4 pi^2 = n q^2 / (eps0 m): 32768 particles of charge q and mass 1 on 2048 m2
    q = -2 * math.pi / 4
    macro, _ = numbers([f"species[0].charge={q}", "species[0].plasma_frequency=0"])
    assert macro["wp"].value == pytest.approx(2 * math.pi, rel=1e-15)
    given, _ = numbers(["species[0].plasma_frequency=3.5"])
    assert given["wp"].value == 3.5 and given["wp dt"].value == 3.5 * 0.2


@pytest.mark.parametrize(
    "step, verdict, forceable",
    [
        (0.5, "ok", True),
        (0.51, "warn", True),
        (1.19, "warn", True),
        (1.2, "fail", True),
        (1.99, "fail", True),
        (2.0, "fail", False),
        (50.0, "fail", False),
        (-0.3, "ok", True),
        (-2.5, "fail", False),
    ],
)
def test_the_time_step_is_refused_where_the_scheme_is_unstable(step, verdict, forceable):
    found, tree = numbers([f"simulation.time_step={step}"])
    assert (found["wp dt"].verdict, found["wp dt"].forceable) == (verdict, forceable)
    if verdict != "fail":
        return
    with pytest.raises(ConfigError, match=r"--set simulation.time_step=.*: simulation.time_step: time step wp dt = "):
        enforce(found.values(), tree)
    if forceable:
        assert any("refused without --force" in warning for warning in enforce(found.values(), tree, force=True))
    else:
        with pytest.raises(ConfigError):
            enforce(found.values(), tree, force=True)


SETTING = re.compile(r"([\w.\[\]]+) = (\[.*?\]|\"\w+\"|[-+.\w]+)")


def ways(number):
    """--set lists, one for each way that a cure names."""
    dotted_key = ".".join(map(str, number.key))
    for way in number.cure.partition(";")[0].split(", or "):
        if found := SETTING.findall(way):
            yield [f"{key if '.' in key else dotted_key}={value}" for key, value in found]


PASSED = Derived("", "", 0.0)  # a number that is not told any more
IMBALANCE = "species=({density=1e3; particles=64; charge=-1; mass=1;}, {density=3e3; particles=64; charge=1; mass=9;})"
WAVE = "species[0].perturbation={mode=[1, 0]; amplitude=0.001;}"
CURED = [
    *(("wp dt", [f"simulation.time_step={step}"]) for step in (0.51, 1.0, 1.1, 1.19, 1.2, 1.9, 2.0, 2.1, 50.0, -2.5)),
    *(("wp dt", [f"simulation.time_step={dt}", f"species[0].plasma_frequency={wp}"])
      for dt, wp in ((3e-12, 1e12), (1e9, 2.7e-9), (0.7, 0.9), (0.77, 3.3))),
    *(("lambda_D/dx", [f"species[0].thermal_velocity={v}"]) for v in (0.49, 0.4, 0.3, 0.0476, 0.0048)),
    ("lambda_D/dx", ["species[0].thermal_velocity=0.3", "grid.points=[64, 1]"]),
    ("lambda_D/dx", ["species[0].thermal_velocity=0.3", "grid.points=[64, 128]"]),
    ("v dt/dx", ["species[0].drift_velocity=[6.0, 0.0]"]),
    ("wc dt", ["field.magnetic=[0, 3, 4]"]),
    ("wc dt", ["field.magnetic=[0, 3, 4e9]"]),
    ("pi/(wp dt K)", ["output.every.series=40"]),
    ("pi/(wp dt K)", ["output.every.series=7", "field.magnetic=[0, 0, 1.7]"]),  # of upper hybrid waves
    ("N_D", ["species[0].particles=2000"]),
    ("N_D", ["species[0].particles=2000", "species[0].plasma_frequency=0"]),
    ("N_D", ["species[0].particles=2000", "species[0].plasma_frequency=0", "species[0].density=2"]),
    ("a sqrt(N)/2", [WAVE]),
    ("a sqrt(N)/2", [WAVE, "species[0].plasma_frequency=0"]),
    ("rho_0", [IMBALANCE]),
    ("rho_0", [IMBALANCE.replace("density=1e3; ", "plasma_frequency=3; ")]),
    ("rho_0", [IMBALANCE.replace("density=1e3; ", "")]),
    ("rho_0", [IMBALANCE, "species[1].density=1.00001e3"]),
]  # fmt: skip


@pytest.mark.parametrize("symbol, sets", CURED, ids=str)
def test_each_value_that_a_cure_names_passes(symbol, sets):
    number = numbers(sets)[0][symbol]
    assert number.verdict != "ok"
    tried = list(ways(number))
    assert tried
    for way in tried:
        assert numbers([*sets, *way])[0].get(symbol, PASSED).verdict == "ok", way


def test_a_time_step_that_cures_keeps_the_direction_of_time():
    (way,) = ways(numbers(["simulation.time_step=-2.5"])[0]["wp dt"])
    assert way == ["simulation.time_step=-0.49"]


@pytest.mark.parametrize(
    "symbol, key, limits",
    [
        ("wp dt", "simulation.time_step", {0.3: "<= 0.5", 0.5: "<= 0.5", 1.0: "<= 0.5", 1.1: "<= 0.5",
                                           1.2: "< 1.2, stable below 2", 1.9: "< 1.2, stable below 2",
                                           2.1: "< 1.2, stable below 2"}),
        ("lambda_D/dx", "species[0].thermal_velocity", {1.0: ">= 0.5", 0.0476: ">= 0.5", 0.0048: ">= 0.03"}),
    ],
)  # fmt: skip
def test_the_limit_that_is_shown_is_the_one_that_the_verdict_falls_by(symbol, key, limits):
    for value, limit in limits.items():
        assert numbers([f"{key}={value}"])[0][symbol].limit == limit


def test_charges_of_both_signs_that_do_not_cancel_are_told():
    """Nothing is said of one sign over a background, nor of what rounding leaves."""
    number = numbers([IMBALANCE])[0]["rho_0"]
    assert "a uniform charge makes up for what they leave" in number.source
    assert (number.value, number.verdict) == (-2e3, "warn")
    assert number.cure == "species[0].density = 3000, or species[1].density = 1000"
    for even in ("1e3", "1000.0001"):
        assert numbers([IMBALANCE, f"species[1].density={even}"])[0]["rho_0"].verdict == "ok"
    assert numbers()[0]["rho_0"].limit == "" and numbers([IMBALANCE, "species[1].particles=0"])[0]["rho_0"].limit == ""


@pytest.mark.parametrize("thermal, verdict", [(1.0, "ok"), (0.5, "ok"), (0.4, "warn"), (0.04, "warn"), (0.02, "fail")])
def test_the_debye_length_against_the_grid(thermal, verdict):
    found, _ = numbers([f"species[0].thermal_velocity={thermal}"])
    number = found["lambda_D/dx"]
    assert number.value == pytest.approx(thermal) and number.verdict == verdict and number.forceable


def test_an_axis_of_one_point_has_no_field_that_could_heat():
    for points, ratio in (("[64, 1]", 1.0), ("[1, 16]", 0.5)):
        found, _ = numbers([f"grid.points={points}"])
        assert found["lambda_D/dx"].value == pytest.approx(ratio)
    assert "lambda_D/dx" not in numbers(["grid.points=[1, 1]"])[0]


def test_a_cold_start_has_no_debye_length():
    found, _ = numbers(["species[0].thermal_velocity=0"])
    assert "lambda_D/dx" not in found


def test_the_uniform_distribution_of_the_thesis_has_a_debye_length():
    found, _ = numbers(["species[0].thermal_velocity=0", "species[0].drift_velocity=[3.0, 0.0]"])
    assert found["lambda_D/dx"].value == pytest.approx(math.sqrt(3))


@pytest.mark.parametrize(
    "sets, symbol, verdict",
    [
        (["field.magnetic=[0, 0, 1]"], "wc dt", "ok"),
        (["field.magnetic=[0, 3, 4]"], "wc dt", "warn"),
        (["field.magnetic=[0, 3, 4]", "numerics.exact_phase=true"], "wc dt", "ok"),
        (["field.magnetic=[0, 0, 16]", "numerics.exact_phase=true"], "wc dt", "fail"),
        (["species[0].drift_velocity=[6.0, 0.0]"], "v dt/dx", "warn"),
        (["simulation.time_step=0.1"], "v dt/dx", "ok"),
        (["species[0].perturbation={mode=[4, 0]}"], "k dx", "ok"),
        (["species[0].perturbation={mode=[0, 4]}"], "k dx", "warn"),
        (["species[0].perturbation={mode=[0, 17]}"], "k dx", "fail"),
        (["grid.points=[1, 1]", "species[0].particles=600000"], "N/cells", "fail"),
        (["grid.points=[1, 1]", "species[0].particles=200000"], "N/cells", "warn"),
        (["simulation.plasma_chunks=65"], "Nx/chunks", "warn"),
        (["simulation.solver=LU"], "Nx Ny", "ok"),
        (["field.equation.c=-4"], "K^2/symbol", "ok"),
        (["field.equation.c=4.1"], "K^2/symbol", "warn"),
        (["field.equation.d=-1.1"], "K^2/symbol", "warn"),
        (["field.equation.d=-1"], "K^2/symbol", "fail"),
        (["field.equation.e=1"], "b, e", "warn"),
        (["simulation.time_step=2.1"], "wp dt", "fail"),
        (["simulation.time_step=2.1", "field.equation={a=50; d=50}"], "wp dt", "ok"),
        (["simulation.time_step=0.2", "field.equation={a=0.01; d=1}"], "wp dt", "fail"),
        (["numerics.cloud_radius=4"], "R/L", "ok"),
        (["numerics.cloud_radius=10"], "R/L", "warn"),
        (["species[0].perturbation={mode=[1, 0]}", "numerics.cloud_radius=1"], "k R", "ok"),
        (["species[0].perturbation={mode=[1, 0]}", "numerics.cloud_radius=2"], "k R", "warn"),
        (["simulation.solver=LU", "grid.points=[128, 64]"], "Nx Ny", "warn"),
        (["simulation.solver=LU", "grid.points=[256, 256]"], "Nx Ny", "fail"),
    ],
)
def test_verdicts_at_the_limits(sets, symbol, verdict):
    assert numbers(sets)[0][symbol].verdict == verdict


def test_the_background_neutralises_macro_charges_as_given_and_as_derived():
    # n q of -1 x 32768 on 2048 m2; or wp^2 eps0 m / q
    assert numbers(["species[0].plasma_frequency=0"])[0]["rho_0"].value == 16.0
    assert numbers(["species[0].plasma_frequency=3", "species[0].charge=-2"])[0]["rho_0"].value == 4.5


def test_more_ranks_than_rows_are_refused_with_the_largest_number():
    found, tree = numbers(ranks=33)
    assert "rows/R" in found and numbers(ranks=32)[0]["rows/R"].verdict == "ok"
    with pytest.raises(ConfigError, match=r"case:3:10: grid.points: rows per rank .* at most 32 ranks"):
        enforce(found.values(), tree)


def test_units_beyond_floating_point_are_refused():
    found, tree = numbers(["species[0].charge=1e200", "species[0].mass=1e-200", "species[0].plasma_frequency=0"])
    with pytest.raises(ConfigError, match="choose other units"):
        enforce(found.values(), tree, force=True)


def test_every_case_has_numbers_even_without_particles():
    for sets in (["species[0].particles=0"], ["species=()"]):
        found, tree = numbers(sets)
        assert found["wp"].value == 0 and enforce(found.values(), tree) == []


def test_the_numbers_do_not_depend_on_the_units():
    second, metre, volt = 2.0**20, 2.0**-30, 2.0**15  # new units are so many old ones
    scaled = [
        f"simulation.time_step={0.2 / second!r}",
        f"simulation.space_length=[{64 / metre!r}, {32 / metre!r}]",
        f"species[0].thermal_velocity={1 / metre * second!r}",
        f"species[0].plasma_frequency={second!r}",
        f"species[0].charge={-volt!r}",
    ]
    for symbol, number in numbers()[0].items():
        if not number.unit or number.unit == "cells":
            assert numbers(scaled)[0][symbol].value == number.value


positive = st.floats(5e-324, 1.7e308, allow_subnormal=True) | st.floats(1e-3, 1e3)
real = st.floats(allow_nan=False, allow_infinity=False) | st.floats(-10, 10)
count = st.integers(0, 2**62) | st.integers(0, 100)


def pairs(values, most=2):
    return st.lists(values, min_size=2, max_size=most)


cases = st.fixed_dictionaries(
    {
        "simulation": st.fixed_dictionaries(
            {"cycles": st.integers(1, 2**62), "time_step": real, "space_length": pairs(positive)}
        ),
        "grid": st.fixed_dictionaries({"points": pairs(st.integers(1, 2**62) | st.integers(1, 64))}),
        "constants": st.fixed_dictionaries({"vacuum_permittivity": positive}),
        "field": st.fixed_dictionaries({"magnetic": st.lists(real, min_size=3, max_size=3)}),
        "numerics": st.fixed_dictionaries({"exact_phase": st.booleans()}),
        "species": st.lists(
            st.fixed_dictionaries(
                {
                    "particles": count,
                    "charge": real,
                    "mass": positive,
                    "thermal_velocity": st.just(0.0) | positive,
                    "plasma_frequency": st.just(0.0) | positive,
                    "drift_velocity": pairs(real, 3),
                    "init_method": st.sampled_from(["random position", "quiet", "default"]),
                    "perturbation": st.fixed_dictionaries({"mode": pairs(st.integers(-(2**62), 2**62))}),
                }
            ),
            max_size=2,
        ).map(tuple),
    }
)


@settings(max_examples=500)
@given(cases)
def test_no_numbers_break_the_check(data):
    tree = Tree(data=data)
    try:
        enforce(derived(configure(tree)), tree)
    except ConfigError as error:
        assert error.messages


@pytest.mark.parametrize("key", ["simulation.time_step", "species[0].mass", "constants.vacuum_permittivity"])
@pytest.mark.parametrize("value", ["1e-80", "1e80"])
def test_magnitudes_that_products_would_overflow_are_refused(key, value):
    found, tree = numbers([f"{key}={value}"])
    with pytest.raises(ConfigError, match=f"--set {re.escape(key)}=.*choose other units"):
        enforce(found.values(), tree, force=True)


COLD_WAVE = """
simulation = { cycles = 400; time_step = 0.3; space_length = [6.283185307179586]; };
grid = { points = [32]; };
species = ({ particles = 4096; charge = -1.0; mass = 1.0; init_method = "quiet"; plasma_frequency = 1.0;
             perturbation = { mode = [6]; amplitude = 0.0005; }; });
output = { modes = ([6]); };
"""


def cold_frequency(*sets: str) -> float:
    config = configure(loads(COLD_WAVE, sets=sets))
    return next(number.value for number in derived(config) if number.name == "cold frequency on this grid")


@pytest.mark.parametrize("mode", [1, 6, 10])
@pytest.mark.parametrize("shape", ["NGP", "CIC", "TSC"])
def test_the_cold_frequency_is_that_of_the_shape(shape, mode):
    """The closed form is the sum over aliases, whose cut-off tail falls most slowly for NGP."""
    told = cold_frequency(f'numerics.shape="{shape}"', f"species[0].perturbation.mode=[{mode}]")
    exact = mesh_root(0.9 * told, mode, (Beam(1.0),), Mesh(2.0 * math.pi / 32, 0.3, shape)).real
    assert told == pytest.approx(exact, rel=1e-2 if shape == "NGP" else 1e-5)


@pytest.mark.parametrize(
    "magnetic, second, told", [("0, 0, 0", 6, 1), ("0.5, 0, 0", 6, 1), ("0, 0, 0", 3, 2), ("0, 0, 0.5", 6, 0)]
)
def test_the_cold_frequency_is_told_once_for_a_wave_and_not_across_a_magnetic_field(magnetic, second, told):
    """Two species with one wave have one frequency; across B it is the upper or lower hybrid one."""
    first = COLD_WAVE[COLD_WAVE.index("({") + 1 : COLD_WAVE.index(");")]
    both = COLD_WAVE.replace(first, f"{first}, {first.replace('[6]', f'[{second}]')}")
    config = configure(loads(both, sets=[f"field.magnetic=[{magnetic}]"]))
    assert sum(number.name == "cold frequency on this grid" for number in derived(config)) == told


def test_a_cold_wave_of_quadratic_clouds_has_the_frequency_that_is_told():
    case = loads(COLD_WAVE, sets=('numerics.shape="TSC"', 'numerics.precision="single"'))  # kernels that others have
    with running(World.alone(), "hpcpic", configure(case)) as app:
        wave = []
        for _ in range(400):
            app.step()
            wave.append(app.scalars()["mode_6_im"])
    told = cold_frequency('numerics.shape="TSC"')
    fit = fit_oscillation(0.3 * np.arange(1, 401), np.array(wave), frequency=told, damped=False)
    assert fit.frequency == pytest.approx(told, rel=1e-4)
