"""Heating by the grid as runs gave it, and cures that cure."""

import math
import re

import pytest
from app_runner import running
from forecast_numbers import numbers

from hpcpic.core.case.config import loads
from hpcpic.plasma.configure import configure
from hpcpic.plasma.forecast.derived import derived
from hpcpic.plasma.physics.heating import HEATING, energy_ratio, rate, rate_of_step, rates_across, rates_of

# Shape, dimensions, lambda_D/dx, particles per cell, wp t, W(t)/W(0) as runs gave it: those until 875 on 64 x 64 and
# 16 x 16 x 16 points, as by scripts/heating.py (in 2D, 0.1 with 64 per cell and TSC at 1.0: 32 x 32).
HEATED = [
    ("CIC", 2, 0.03, 16, 875, 4.972), ("CIC", 2, 0.03, 64, 875, 4.654), ("CIC", 2, 0.1, 16, 875, 3.660),
    ("CIC", 2, 0.1, 64, 875, 2.828), ("CIC", 2, 0.3, 16, 875, 1.529), ("CIC", 2, 0.3, 64, 875, 1.163),
    ("CIC", 2, 0.3, 16, 3150, 2.694), ("CIC", 2, 0.3, 16, 6300, 4.078), ("CIC", 2, 0.3, 16, 12425, 6.346),
    ("TSC", 2, 0.03, 16, 875, 1.640), ("TSC", 2, 0.1, 16, 875, 1.446), ("TSC", 2, 0.1, 64, 875, 1.219),
    ("TSC", 2, 0.3, 16, 875, 1.107), ("TSC", 2, 0.3, 64, 875, 1.030), ("TSC", 2, 0.5, 16, 875, 1.036),
    ("TSC", 2, 1.0, 16, 3500, 1.025),
    ("NGP", 2, 0.1, 16, 875, 22.52), ("NGP", 2, 0.3, 16, 875, 6.561), ("NGP", 2, 0.3, 64, 875, 3.225),
    ("NGP", 2, 0.5, 16, 875, 3.023), ("NGP", 2, 0.5, 64, 875, 1.637), ("NGP", 2, 1.0, 16, 875, 1.399),
    ("NGP", 3, 0.1, 16, 875, 29.91), ("NGP", 3, 0.3, 64, 875, 2.328), ("NGP", 3, 0.5, 16, 875, 2.244),
    ("NGP", 3, 0.5, 64, 875, 1.357), ("NGP", 3, 1.0, 16, 875, 1.219),
    ("CIC", 3, 0.03, 16, 875, 13.25), ("CIC", 3, 0.03, 64, 875, 5.958), ("CIC", 3, 0.1, 16, 875, 4.301),
    ("CIC", 3, 0.1, 64, 875, 2.376), ("CIC", 3, 0.3, 16, 875, 1.321), ("CIC", 3, 0.3, 64, 875, 1.085),
    ("CIC", 3, 0.5, 16, 875, 1.088), ("CIC", 3, 1.0, 16, 875, 1.012),
    ("TSC", 3, 0.03, 16, 875, 2.855), ("TSC", 3, 0.03, 64, 875, 1.699), ("TSC", 3, 0.1, 16, 875, 1.547),
    ("TSC", 3, 0.1, 64, 875, 1.154), ("TSC", 3, 0.3, 16, 875, 1.066), ("TSC", 3, 0.3, 64, 875, 1.016),
    ("TSC", 3, 0.5, 16, 875, 1.020),
]  # fmt: skip


@pytest.mark.parametrize("shape, dimensions, debye, per_cell, time, measured", HEATED)
def test_heating_is_foretold_as_it_was_measured(shape, dimensions, debye, per_cell, time, measured):
    found = energy_ratio(HEATING[shape, dimensions], debye, per_cell, time)
    assert found - 1 == pytest.approx(measured - 1, rel=0.1)


# In 1D: the Debye length is that of heat and field of the start together. Boxes of 64 points, the last two of 256.
HEATED_1D = [
    ("CIC", 0.044, 12288, 4.547), ("CIC", 0.063, 8192, 2.798), ("CIC", 0.103, 4096, 1.138), ("CIC", 0.133, 256, 1.788),
    ("CIC", 0.134, 1024, 1.181), ("CIC", 0.219, 256, 1.154), ("CIC", 0.309, 64, 1.292), ("CIC", 0.313, 256, 1.061),
    ("CIC", 0.381, 64, 1.129), ("CIC", 0.485, 16, 1.247), ("CIC", 0.553, 64, 1.038), ("CIC", 0.797, 16, 1.079),
    ("TSC", 0.044, 12288, 1.097), ("TSC", 0.063, 8192, 1.066), ("TSC", 0.132, 256, 1.065), ("TSC", 0.170, 256, 1.019),
    ("NGP", 0.0395, 4096, 96.4), ("NGP", 0.137, 256, 14.78), ("NGP", 0.388, 64, 3.977), ("NGP", 0.314, 256, 2.751),
    ("NGP", 0.313, 1024, 1.530), ("NGP", 0.557, 64, 2.225), ("NGP", 0.509, 256, 1.372), ("NGP", 0.501, 4096, 1.033),
    ("NGP", 0.742, 64, 1.437), ("NGP", 0.706, 1024, 1.034), ("NGP", 1.03, 64, 1.221), ("NGP", 1.0, 256, 1.061),
    ("CIC", 0.470, 64, 1.087), ("CIC", 0.617, 64, 1.032),
]  # fmt: skip


@pytest.mark.parametrize("shape, debye, per_cell, measured", HEATED_1D)
def test_heating_on_a_line_is_foretold_within_forty_percent(shape, debye, per_cell, measured):
    found = energy_ratio(HEATING[shape, 1], debye, per_cell, 875)
    assert found - 1 == pytest.approx(measured - 1, rel=0.4)


LINE = """
simulation = { cycles = 4375; time_step = 0.2; space_length = [64.0]; };
grid = { points = [64]; };
species = ({ name = "e"; particles_per_cell = 256; charge = -1.0; mass = 1.0; plasma_frequency = 1.0;
             thermal_velocity = 0.3; });
"""


def test_heating_by_ngp_on_a_line_is_warned_of():
    """It was not foretold, and a plasma of lambda_D = dx/2 gained 61 % until wp t = 400 with every verdict ok."""
    sets = ['numerics.shape="NGP"', "species[0].thermal_velocity=0.5", "simulation.cycles=2000"]
    number = numbers([*sets, "species[0].particles_per_cell=64"], LINE)[0]["dW/W"]
    assert number.verdict == "warn" and 0.6 < number.value / 0.609 < 1.4


def test_heating_on_a_line_counts_the_field_of_a_random_start_as_heat():
    found = numbers(text=LINE)[0]["dW/W"]
    debye = 0.3 * math.sqrt(1 + 64 / (12 * 256 * 0.3**2))
    assert found.value == pytest.approx(energy_ratio(HEATING["CIC", 1], debye, 256, 875) - 1, rel=1e-6)
    assert 0.04 < found.value < 0.07  # three seeds: 0.061, 0.053, 0.051
    quiet = numbers(['species[0].init_method="quiet"'], LINE)[0]["dW/W"]
    assert quiet.value == pytest.approx(energy_ratio(HEATING["CIC", 1], 0.3, 256, 875) - 1, rel=1e-6)


@pytest.mark.parametrize("magnetic, across", [([1, 0, 0], False), ([0, 0, 1], True)])
def test_the_grid_heats_one_of_three_components_on_a_line(magnetic, across):
    """No forecast was made. It tells 2.0 %; runs of three seeds gave 1.6 to 2.2 % with B along the line, 1.1 to 1.5 %
    across, and 5.1 to 6.1 % of one component, for which it tells 5.2 %.
    """
    found, alone = numbers([f"field.magnetic={magnetic}"], LINE)[0]["dW/W"], numbers([], LINE)[0]["dW/W"]
    start = 64 / (12 * 256 * 0.3**2)
    assert found.value == pytest.approx(alone.value * (1 + start) / (3 + start), rel=1e-6)
    assert ("across the line" in found.source) == across


@pytest.mark.parametrize(
    "sets, said",
    [
        (["species[0].thermal_velocity=0.1"], "the field of the random start has 2.1 times the heat"),
        (["numerics.cloud_radius=1"], "no rates for this scheme in 1D"),
        (["species[0].particles=63", "species[0].thermal_velocity=9"], "less than 1 particle per cell"),
    ],
)
def test_heating_on_a_line_that_is_not_foretold_says_why(sets, said):
    number = numbers(sets, LINE)[0]["dW/W"]
    assert math.isnan(number.value) and said in number.source and number.verdict == "ok"


@pytest.mark.parametrize("axes, share", [(1, "a seventh"), (2, "a thirtieth"), (3, "a seventieth")])
def test_clouds_are_offered_with_what_they_were_measured_to_do(axes, share):
    box = [f"simulation.space_length={[16.0] * axes}", f"grid.points={[16] * axes}", "species[0].thermal_velocity=0.1"]
    cure = numbers(box)[0]["lambda_D/dx"].cure
    assert f"numerics.cloud_radius = 1 (at most {share} of the heating in {axes}D" in cure


# Shape, points, lambda_D/dx, particles per cell, wp t, W(t)/W(0) - 1 as runs with spectral gradients gave it.
HEATED_SPECTRAL = [
    ("CIC", [40, 40], 0.1, 16, 400, 2.77), ("CIC", [40, 40], 0.2, 16, 400, 1.04),
    ("CIC", [40, 40], 0.3, 64, 400, 0.131),
    ("CIC", [48, 48], 0.5, 16, 600, 0.179), ("CIC", [40, 40], 1.0, 8, 400, 0.0397),
    ("TSC", [40, 40], 0.1, 16, 400, 0.397), ("TSC", [48, 48], 0.5, 16, 600, 0.0183),
    ("NGP", [40, 40], 0.3, 16, 400, 4.90), ("CIC", [12] * 3, 0.3, 16, 400, 0.191),
    ("TSC", [12] * 3, 0.3, 16, 400, 0.0174), ("CIC", [64], 0.3, 256, 800, 0.166), ("TSC", [64], 0.3, 256, 800, 0.0204),
    ("NGP", [64], 0.2, 1024, 400, 2.24), ("NGP", [64], 0.5, 64, 400, 0.983), ("NGP", [64], 1.0, 64, 400, 0.179),
    ("CIC", [48, 48], 5.0, 16, 490, 0.036),
]  # fmt: skip


@pytest.mark.parametrize("shape, points, debye, per_cell, time, measured", HEATED_SPECTRAL)
def test_heating_with_spectral_gradients_is_foretold_within_a_factor_of_two(
    shape, points, debye, per_cell, time, measured
):
    """Nothing was told of it in 2D and 3D."""
    step = 0.49 if debye > 1 else 0.2
    sets = [f"simulation.space_length={[float(n) for n in points]}", f"grid.points={points}", f"numerics.shape={shape}",
            "numerics.gradient=spectral", f"species[0].thermal_velocity={debye}", f"simulation.time_step={step}",
            f"simulation.cycles={round(time / step)}", f"species[0].particles_per_cell={per_cell}"]  # fmt: skip
    found = numbers(sets, BOX)[0]["dW/W"]
    assert 0.5 < found.value / measured < 2.0 and found.verdict == ("warn" if found.value > 0.1 else "ok")


# Shape, dimensions, lambda_D/dx, particles per cell, wp dt, wp t, W(t)/W(0) - 1 as runs gave it: 64 and 128 points in
# 1D, 64 x 64, 48 x 48, 16 x 16 x 16; those of 720 and less are told from a tenth of the run on.
HEATED_BY_STEP = [
    ("CIC", 1, 10.0, 64, 0.49, 4000, 0.199), ("CIC", 1, 4.0, 256, 0.49, 4000, 0.053),
    ("CIC", 1, 4.0, 256, 0.4, 4000, 0.0272), ("TSC", 1, 8.0, 64, 0.49, 2700, 0.118),
    ("CIC", 2, 5.0, 16, 0.49, 2000, 0.116), ("CIC", 2, 3.0, 16, 0.4, 2000, 0.0645),
    ("CIC", 2, 10.0, 4, 0.3, 720, 0.0322), ("CIC", 2, 20.0, 16, 0.2, 1000, 0.0021),
    ("TSC", 2, 4.0, 8, 0.49, 720, 0.0630), ("CIC", 3, 3.0, 8, 0.4, 540, 0.0137), ("CIC", 3, 6.0, 4, 0.49, 360, 0.0188),
]  # fmt: skip


@pytest.mark.parametrize("shape, dimensions, debye, per_cell, step, time, measured", HEATED_BY_STEP)
def test_a_step_in_which_particles_cross_short_waves_heats_as_foretold(
    shape, dimensions, debye, per_cell, step, time, measured
):
    of_step = rate_of_step(shape, dimensions, debye, step)
    found = energy_ratio(HEATING[shape, dimensions], debye, per_cell, time, (), of_step) - 1
    assert found == pytest.approx(measured, rel=0.3)


def test_the_heating_of_a_long_step_is_that_of_the_continuum_where_the_grid_is_fine():
    """In 1D, for dx -> 0: the integral over all waves is (wp dt)^2/(3 sqrt(pi)), over the particles of a lambda_D."""
    found = rate_of_step("CIC", 1, 900.0, 0.5) * 900
    assert found == pytest.approx(0.25 / (3 * math.sqrt(math.pi)), rel=0.01)
    assert (
        rate_of_step("CIC", 2, 0.3, 0.2) == rate_of_step("CIC", 2, 1e-100, 0.2) == rate_of_step("CIC", 1, 1e100, 1) == 0
    )


def test_a_long_step_that_heats_is_warned_of_and_a_shorter_one_cures(world):
    """Measured: +20 % by wp t = 4000, of which 4.6 % by 800. Told were 3e-5."""
    sets = ["species[0].thermal_velocity=10", "species[0].particles_per_cell=64", "simulation.time_step=0.49"]
    number = numbers([*sets, "simulation.cycles=8163"], LINE)[0]["dW/W"]
    assert number.verdict == "warn" and "time_step = 0.245, or 2 times the particles" in number.cure
    assert numbers([*sets, "simulation.time_step=0.245", "simulation.cycles=16326"], LINE)[0]["dW/W"].verdict == "ok"
    found, tree = numbers([*sets, "simulation.cycles=1632"], LINE)
    with running(world, "hpcpic", configure(tree)) as app:
        start = app.scalars()["energy_total"]
        for _ in range(app.n_steps):
            app.step()
        assert 0.5 < (app.scalars()["energy_total"] / start - 1) / found["dW/W"].value < 2.0


# Dimensions, shape, wc/wp, lambda_D/dx, particles per cell, wp t, W(t)/W(0) - 1 as runs gave it: B out of the plane on
# 32 x 32 points, along an axis on 16 x 16 x 16. The first three are of the table of rates, the others are not.
HEATED_ACROSS = [
    (2, "CIC", 2.0, 0.5, 32, 200, 0.575), (2, "CIC", 0.5, 0.5, 32, 200, 0.033), (2, "TSC", 2.0, 0.5, 32, 200, 0.251),
    (2, "CIC", 2.0, 0.5, 512, 200, 0.549), (2, "CIC", 2.0, 0.5, 32, 1600, 2.03), (2, "CIC", 1.0, 1.0, 32, 1600, 0.105),
    (2, "CIC", 1.0, 0.7, 32, 400, 0.092), (2, "CIC", 1.4, 0.4, 64, 300, 1.01), (2, "CIC", 1.4, 1.0, 64, 600, 0.0656),
    (2, "CIC", 0.7, 0.3, 16, 500, 0.826), (2, "CIC", 3.0, 0.7, 32, 300, 0.592), (2, "CIC", 6.0, 0.7, 64, 300, 0.542),
    (3, "CIC", 2.0, 0.5, 32, 200, 0.322), (3, "CIC", 0.5, 0.2, 16, 400, 1.02), (3, "CIC", 1.0, 1.0, 16, 1600, 0.0475),
    (3, "CIC", 4.0, 1.0, 16, 800, 0.388), (3, "CIC", 2.0, 1.0, 16, 1600, 0.157),
]  # fmt: skip
HEATED_ACROSS_SPECTRAL = [
    (2, "NGP", 4.0, 0.5, 32, 200, 6.52), (2, "CIC", 1.0, 0.5, 32, 600, 0.155), (2, "CIC", 4.0, 0.5, 32, 600, 1.12),
    (2, "TSC", 2.0, 0.5, 32, 600, 0.0329), (3, "CIC", 1.0, 0.3, 16, 200, 0.177), (3, "TSC", 2.0, 0.5, 16, 200, 0.0054),
]  # fmt: skip


@pytest.mark.parametrize(
    "dimensions, shape, turn, debye, per_cell, time, measured, spectral",
    [*((*run, False) for run in HEATED_ACROSS), *((*run, True) for run in HEATED_ACROSS_SPECTRAL)],
)
def test_heating_across_a_magnetic_field_is_foretold_within_a_factor_of_two(
    dimensions, shape, turn, debye, per_cell, time, measured, spectral
):
    across = rates_across(shape, dimensions, turn, time, spectral)
    rates = rates_of(shape, dimensions, spectral)
    assert 0.5 < (energy_ratio(rates, debye, per_cell, time, across) - 1) / measured < 2


BOX = """
simulation = { cycles = 2000; time_step = 0.1; space_length = [32.0, 32.0]; };
grid = { points = [32, 32]; };
species = ({ name = "e"; charge = -1.0; mass = 1.0; density = 1.0; thermal_velocity = 0.5; particles_per_cell = 32; });
"""


def test_a_magnetic_field_across_a_plane_is_warned_of_with_cures_that_runs_have_shown_to_cure():
    """Measured: +57.5 %; with clouds +0.55 %, TSC +25 %, 64 x 64 points and as many particles per cell +5.4 %."""
    across = "field.magnetic=[0, 0, 2]"
    number = numbers([across], BOX)[0]["dW/W"]
    assert number.verdict == "warn" and "wc = 2 wp across the grid" in number.source
    assert "cloud_radius = 1, or 2 times the points" in number.cure
    assert "particles," not in number.cure and "TSC" not in number.cure
    finer = [across, "grid.points=[64, 64]", "species[0].particles_per_cell=32"]
    assert numbers(finer, BOX)[0]["dW/W"].verdict == "ok"
    assert "dW/W" not in numbers([across, "numerics.cloud_radius=1"], BOX)[0]  # not foretold


@pytest.mark.parametrize("field", ["[2, 0, 0]", "[1.2, 0, 1.6]", "[0, 0, 0.1]"])
def test_a_magnetic_field_in_the_plane_or_far_from_its_normal_or_weak_changes_no_heating(field):
    """Measured: +0.95 and +1.5 % where +1.8 % was without it."""
    without = numbers(text=BOX)[0]["dW/W"]
    assert numbers([f"field.magnetic={field}"], BOX)[0]["dW/W"] == without


def test_in_three_dimensions_any_direction_of_a_magnetic_field_is_across_the_grid():
    cube = ["grid.points=[16, 16, 16]", "simulation.space_length=[16.0, 16.0, 16.0]"]
    found = [numbers([*cube, f"field.magnetic={b}"], BOX)[0]["dW/W"].value for b in ("[2, 0, 0]", "[0, 1.2, 1.6]")]
    assert found[0] == pytest.approx(found[1]) and found[0] > 0.1


def test_heating_slows_down_as_the_debye_length_grows():
    """Two runs one after the other are one run, at the Debye length that the first has left."""
    half = energy_ratio(HEATING["CIC", 2], 0.3, 16, 5000)
    whole = energy_ratio(HEATING["CIC", 2], 0.3, 16, 10000)
    assert energy_ratio(HEATING["CIC", 2], 0.3 * math.sqrt(half), 16, 5000) * half == pytest.approx(whole, rel=1e-3)
    assert whole < half**2 and energy_ratio(HEATING["CIC", 2], 0.3, 16, 0.0) == 1.0
    for debye in (1e-70, 1e-4, 1.0, 1e70):  # and ends, in any number of steps
        assert 1.0 <= energy_ratio(HEATING["CIC", 2], debye, 16, 1e30) < math.inf


def test_the_noise_heats_less_with_more_particles_and_the_aliases_do_not():
    few, many = (rate(HEATING["CIC", 2], math.log(1.0), n) for n in (16, 64))
    assert few == pytest.approx(4 * many, rel=0.01)
    cold = [rate(HEATING["CIC", 2], math.log(0.03), n) for n in (16, 1e9)]
    assert cold[1] == pytest.approx(cold[0], rel=0.05)


def test_in_three_dimensions_heating_is_foretold_and_cured_by_rates_of_its_own():
    """On an axis of one point there is no field: the rates are those of two dimensions."""
    flat, deep = "[16, 16, 1]", "[16, 16, 16]"
    for shape in ("NGP", "CIC", "TSC"):
        sets = ["simulation.space_length=[16.0, 16.0, 16.0]", "species[0].thermal_velocity=0.3",
                "simulation.cycles=4375", f'numerics.shape="{shape}"']  # fmt: skip
        for points, axes in ((deep, 3), (flat, 2)):
            cells = f"species[0].particles={16 * 16**axes}"
            found = numbers([*sets, f"grid.points={points}", cells])[0]["dW/W"]
            assert found.value == pytest.approx(energy_ratio(HEATING[shape, axes], 0.3, 16, 875) - 1, rel=1e-6)
        found = numbers([*sets, f"grid.points={deep}", f"species[0].particles={16**4}"])[0]["dW/W"]
        assert (found.verdict == "warn") == (shape != "TSC") == ("TSC" in found.cure)
        if found.verdict == "warn":
            finer = int(re.search(r"(\d+) times the points", found.cure)[1])
            cured = f"grid.points={[16 * finer] * 3}", f"species[0].particles={16 * (16 * finer) ** 3}"
            assert numbers([*sets, *cured])[0]["dW/W"].verdict == "ok"


@pytest.mark.parametrize("ions, measured", [(20000, 0.0051), (5000, 0.0108), (4000, 0.0121), (200, None)])
def test_unequal_weights_heat_as_their_noise(ions, measured):
    """20 000 electrons and ions 100 times as heavy, of a weight of their own, on 32 x 32 points until wp t = 201."""
    text = f"""
    simulation = {{ cycles = 1000; time_step = 0.2; space_length = [16.0, 16.0]; }};
    grid = {{ points = [32, 32]; }};
    species = (
      {{ name = "e"; charge = -1.0; mass = 1.0; density = 1.0; particles = 20000; thermal_velocity = 0.5; }},
      {{ name = "i"; charge = 1.0; mass = 100.0; density = 1.0; particles = {ions}; thermal_velocity = 0.05; }});
    """
    found = numbers(text=text)[0]["dW/W"]
    if measured:
        assert found.value == pytest.approx(measured, rel=0.2)
    else:
        assert math.isnan(found.value) and "of one charge: these have the noise of 0.77" in found.source


@pytest.mark.parametrize(
    "mass, ions, electrons, time, measured",
    [(400, 0.12, 0.35, 300, 0.161), (400, 0.12, 0.35, 1500, 0.763), (25, 0.12, 0.35, 1500, 0.967),
     (400, 0.04, 0.35, 300, 0.168), (25, 0.2, 0.5, 600, 0.171), (400, 0.35, 0.35, 300, 0.104)],
)  # fmt: skip
def test_cold_ions_shield_no_more_than_the_electrons_that_heat_them(mass, ions, electrons, time, measured):
    """16 of each per cell on 48 x 32 points; lambda_D/dx of each alone."""
    text = f"""
    simulation = {{ cycles = {5 * time}; time_step = 0.2; space_length = [48.0, 32.0]; }};
    grid = {{ points = [48, 32]; }};
    species = (
      {{ name = "e"; charge = -1.0; mass = 1.0; density = 1.0; particles_per_cell = 16;
         thermal_velocity = {electrons}; }},
      {{ name = "i"; charge = 1.0; mass = {mass}.0; density = 1.0; particles_per_cell = 16;
         thermal_velocity = {ions / math.sqrt(mass)}; }});
    """
    assert numbers(text=text)[0]["dW/W"].value == pytest.approx(measured, rel=0.4)


OBLONG = """
simulation = { cycles = 1000; time_step = 0.2; space_length = [16.0, 128.0]; };
grid = { points = [32, 32]; };
species = ( { charge = -1.0; mass = 1.0; plasma_frequency = 1.0; thermal_velocity = 1.0; particles_per_cell = 16.0; } );
"""  # lambda_D is 2 and 0.25 of the sides of a cell


@pytest.mark.parametrize("points, most", [("[32, 32]", 2.0), ("[32, 64]", 1.6)])
def test_cells_of_unequal_sides_heat_as_the_mean_of_what_each_side_makes(world, points, most):
    """By the longest side alone 3.4 and 2.6 times as much as runs gain was told."""
    found, tree = numbers([f"grid.points={points}"], OBLONG)
    config = configure(tree)
    with running(world, "hpcpic", config) as app:
        before = app.scalars()["energy_total"]
        for _ in range(1000):
            app.step()
        grown = app.scalars()["energy_total"] / before - 1
    assert 0.8 < found["dW/W"].value / grown < most
    square = [
        numbers([f"simulation.space_length=[{32 * dx}, {32 * dx}]"], OBLONG)[0]["dW/W"].value
        for dx in (0.5, 128.0 / config.points[1])
    ]
    assert found["dW/W"].value == pytest.approx(sum(square) / 2, rel=1e-6)


def test_a_few_particles_have_no_heating_that_could_be_foretold():
    for particles in (1, 2047):
        number = numbers([f"species[0].particles={particles}", "species[0].thermal_velocity=0.1"])[0]["dW/W"]
        assert math.isnan(number.value) and "cannot be foretold" in number.source and number.verdict == "ok"


@pytest.mark.parametrize(
    "debye, cycles, tsc", [(0.3, 2000, True), (0.3, 20000, False), (0.1, 4375, False), (1e-4, 5000, False)]
)
def test_each_cure_of_heating_cures_by_the_same_formula(debye, cycles, tsc):
    sets = [f"species[0].thermal_velocity={debye}", f"simulation.cycles={cycles}"]
    number = numbers(sets)[0]["dW/W"]
    assert number.verdict == "warn" and ('numerics.shape = "TSC"' in number.cure) == tsc
    assert ("TSC" in numbers(sets)[0]["lambda_D/dx"].cure) == tsc
    if tsc:
        assert numbers([*sets, 'numerics.shape="TSC"'])[0]["dW/W"].verdict == "ok"
    if more := re.search(r"(\d+) times the particles", number.cure):
        cured = [*sets, f"species[0].particles={int(more[1]) * 32768}"]
        assert numbers(cured)[0]["dW/W"].verdict == "ok"
    if finer := re.search(r"(\d+) times the points", number.cure):
        f = int(finer[1])
        cured = [*sets, f"grid.points=[{64 * f}, {32 * f}]", f"species[0].particles={f * f * 32768}"]
        assert numbers(cured)[0]["dW/W"].verdict == "ok"


def test_the_debye_length_that_no_grid_can_resolve_has_no_grid_as_a_cure():
    cure = numbers(["species[0].thermal_velocity=1e-9"])[0]["lambda_D/dx"].cure
    assert "points" not in cure and "a hotter or thinner plasma" in cure


@pytest.mark.parametrize("points", [(1, 1), (1, 2), (2, 2), (2, 64)])
def test_axes_without_a_field_ask_for_no_debye_length(points):
    """A difference over two cells of two points is none: `check` ended with a KeyError where no axis had more."""
    text = f"""simulation = {{ cycles = 10; time_step = 0.1; space_length = [1.0, 1.0]; }};
        grid = {{ points = {list(points)}; }};
        species = ({{ name = "e"; particles = 640; charge = -1.0; mass = 1.0; thermal_velocity = 0.01;
                     plasma_frequency = 1.0; }});"""
    told = {one.symbol: one for one in derived(configure(loads(text)))}
    assert ("lambda_D/dx" in told) == (max(points) > 2)
