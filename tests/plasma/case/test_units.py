"""Units: constants of nature, particles by density and temperature, and the same run in SI and normalised units."""

import math

import numpy as np
import pytest
from app_runner import running
from seldom import seldom

from hpcpic.core.case.accelerations import ACCELERATIONS
from hpcpic.core.case.config import loads
from hpcpic.core.case.dump import dump
from hpcpic.core.errors import ConfigError
from hpcpic.plasma.case.units import PARTICLES, SI
from hpcpic.plasma.configure import configure
from hpcpic.plasma.forecast.derived import derived
from hpcpic.plasma.forecast.scales import plasma_frequency
from hpcpic.plasma.setup.macro_particles import macro_charge, macro_mass
from hpcpic.plasma.setup.scene import Scene

DENSITY, TEMPERATURE = 1e16, 2.0
WP = math.sqrt(DENSITY * SI.charge**2 / (SI.permittivity * SI.mass))
DEBYE = math.sqrt(SI.permittivity * TEMPERATURE / (DENSITY * SI.charge))
SPEED = WP * DEBYE  # thermal

PHYSICAL = """
units = "SI";
simulation = {{ cycles = 200; time_step = {dt!r}; space_length = {lengths}; }};
grid = {{ points = {points}; }};
field = {{ magnetic = [0.0, 0.0, {magnetic!r}]; }};
species = (
  {{ particle = "electron"; density = {density!r}; temperature = {temperature!r}; particles_per_cell = 32;
     drift_velocity = {drift}; perturbation = {{ mode = {mode}; amplitude = 0.05; }}; }},
  {{ particle = "proton"; density = {density!r}; temperature = {temperature!r}; particles_per_cell = 8; }} );
"""


def twins(d, precision="double", magnetic=0.2):
    """The same plasma in SI and in units of 1/wp, lambda_D and the electron."""
    lengths, points, mode = (12.0, 6.0)[:d], (16, 8)[:d], (1, 1)[:d]
    shared = {"points": list(points), "mode": list(mode)}
    si = PHYSICAL.format(
        dt=0.1 / WP, lengths=[length * DEBYE for length in lengths], magnetic=magnetic * WP * SI.mass / SI.charge,
        density=DENSITY, temperature=TEMPERATURE, drift=[0.5 * SPEED] * d, **shared,
    )  # fmt: skip
    one = PHYSICAL.format(
        dt=0.1, lengths=list(lengths), magnetic=magnetic, density=1.0, temperature=1.0, drift=[0.5] * d, **shared
    ).replace('"SI"', '"normalised"')
    return [configure(loads(text, sets=[f"numerics.precision={precision}"])) for text in (si, one)]


@pytest.mark.parametrize("d, precision, magnetic, close", [
    (1, "double", 0.0, 1e-9), (2, "double", 0.2, 1e-9), seldom(2, "single", 0.0, 2e-3),
    seldom(1, "double", 0.2, 1e-9), seldom(2, "single", 0.2, 2e-3),
])  # fmt: skip
def test_a_run_in_si_units_is_its_normalised_twin_scaled(world, d, precision, magnetic, close):
    """By default in modules of kernels that other tests compile, too."""
    found = []
    for config in twins(d, precision, magnetic):
        with running(world, "hpcpic", config) as app:
            for _ in range(20):
                app.step()
            field = app.fields()
            found.append((app.scalars(), {name: np.array(field[name].values, float) for name in ("rho", "phi")}))
    (si, si_field), (one, one_field) = found
    energy = DENSITY * DEBYE**d * SI.mass * SPEED**2
    scales = {"energy_kinetic": energy, "energy_field": energy, "energy_total": energy,
              "momentum_x": DENSITY * DEBYE**d * SI.mass * SPEED, "charge": DENSITY * DEBYE**d * SI.charge}  # fmt: skip
    for name, scale in scales.items():
        top = max(abs(one[name]), 1.0)
        assert si[name] / scale == pytest.approx(one[name], abs=close * top), name
    volt = SI.mass * SPEED**2 / SI.charge
    for name, scale in {"rho": DENSITY * SI.charge, "phi": volt}.items():
        top = np.abs(one_field[name]).max()
        np.testing.assert_allclose(si_field[name] / scale, one_field[name], rtol=0, atol=close * top, err_msg=name)


def test_derived_numbers_without_a_unit_are_the_same_in_both(world):
    si, one = ({n.symbol: n for n in derived(config)} for config in twins(2))
    assert si["wp"].value == pytest.approx(math.hypot(WP, WP / math.sqrt(PARTICLES["proton"][1])), rel=1e-12)
    for symbol in one:
        if one[symbol].unit in ("", "cells", "rad", "periods") and not math.isnan(one[symbol].value):
            assert si[symbol].value == pytest.approx(one[symbol].value, rel=1e-9), symbol
            assert si[symbol].verdict == one[symbol].verdict


def test_the_constants_are_those_of_codata():
    physical_constants = pytest.importorskip("scipy.constants").physical_constants
    known = {
        "vacuum electric permittivity": SI.permittivity,
        "elementary charge": SI.charge,
        "electron mass": SI.mass,
        "speed of light in vacuum": SI.light,
        "proton-electron mass ratio": PARTICLES["proton"][1],
        "deuteron-electron mass ratio": PARTICLES["deuteron"][1],
        "alpha particle-electron mass ratio": PARTICLES["alpha"][1],
    }
    for name, value in known.items():  # scipy may still have those of 2018
        assert value == pytest.approx(physical_constants[name][0], rel=1e-9), name


CASE = """
units = "SI";
simulation = { cycles = 2000; time_step = 1e-11; space_length = [1e-3]; };
grid = { points = [32]; };
species = ( { particle = "electron"; density = 1e16; temperature = 1.0; particles_per_cell = 10; } );
"""


def read(*sets, text=CASE):
    tree = loads(text, sets=sets)
    return configure(tree), tree


def test_a_macro_particle_is_as_many_electrons_as_the_density_says():
    config, _ = read()
    (electrons,) = config.species
    assert (electrons.particles, electrons.particles_per_cell, electrons.temperature) == (320, None, None)
    weight = 1e16 * 1e-3 / 320
    assert macro_charge(config, electrons) == pytest.approx(-weight * SI.charge, rel=1e-15)
    assert macro_mass(config, electrons) == pytest.approx(weight * SI.mass, rel=1e-15)
    assert Scene(config).species[0].m == macro_mass(config, electrons)
    assert electrons.thermal_velocity == pytest.approx(4.19383e5, rel=1e-5)  # of 1 eV
    assert plasma_frequency(config, electrons) == pytest.approx(5.64146e9, rel=1e-6)  # 8980 Hz sqrt(n/cm3), Chen (4-29)


def test_more_particles_and_more_cells_are_the_same_plasma():
    wp = [
        plasma_frequency(config, config.species[0])
        for sets in ((), ("species[0].particles=77",), ("grid.points=[64]",), ("species[0].particles_per_cell=1.5",))
        for config, _ in [read(*sets)]
    ]
    assert wp == [wp[0]] * 4
    assert read("species[0].particles=77")[0].species[0].particles == 77  # --set counts


@pytest.mark.parametrize(
    "word, other, value", [("plasma_frequency", "density", 1e9), ("thermal_velocity", "temperature", 1e5)]
)
def test_of_two_words_for_one_quantity_the_last_one_set_counts(word, other, value):
    config, _ = read(f"species[0].{word}={value}")
    assert getattr(config.species[0], word) == value and getattr(config.species[0], other) is None
    both, alone = read(f"species[0].{word}={value}", f"species[0].{other}=2.0")[0], read(f"species[0].{other}=2.0")[0]
    assert both == alone
    with pytest.raises(ConfigError, match=rf"species\[0\].{other}: give either {other} or {word}"):
        read(text=CASE.replace(f"{other} =", f"{word} = {value}; {other} ="))


def test_of_one_word_and_two_that_say_the_same_the_last_ones_set_count():
    """A known particle or charge and mass; points or blocks of them. One of two says nothing, whoever sets it."""
    pair, alone = ("species[0].charge=-1e-19", "species[0].mass=1e-30"), ("species[0].particle=electron",)
    config, _ = read(*pair)
    assert (config.species[0].charge, config.species[0].mass) == (-1e-19, 1e-30)
    assert read(*pair, *alone)[0] == read()[0] == read(*alone)[0]
    assert read(*alone, *reversed(pair))[0] == config
    assert read("grid.blocks=[8]", "grid.blocksize=[4]")[0] == read("grid.points=[32]")[0]
    older = CASE.replace("points = [32]", "blocks = [8]; blocksize = [4]")
    assert read("grid.points=[64]", text=older)[0] == read("grid.points=[64]")[0]
    for sets, text, told in (
        (("species[0].charge=-1e-19",), CASE, r"species\[0\].particle: give either particle, or charge and mass"),
        ((), CASE.replace("particle =", "charge = 1.0; mass = 1.0; particle ="), "give either particle, or charge"),
        (("grid.blocksize=[4]",), CASE, r"grid.blocksize: give either points, or blocks and blocksize"),
        ((), CASE.replace("points =", "blocks = [8]; blocksize = [4]; points ="), "grid.blocks: give either points"),
    ):
        with pytest.raises(ConfigError, match=told):
            read(*sets, text=text)


def test_the_case_as_used_reads_back_and_keeps_its_units():
    config, _ = read()
    again, tree = read(text=dump(config))
    assert again == config and tree.warnings == [] and config.constants.vacuum_permittivity == SI.permittivity


def test_an_ion_by_its_own_charge_and_mass():
    argon = 6.6335e-26
    text = CASE.replace('particle = "electron"', f"charge = {SI.charge!r}; mass = {argon!r}")
    config, _ = read(text=text)
    slower = math.sqrt(SI.mass / argon)
    assert plasma_frequency(config, config.species[0]) == pytest.approx(5.64146e9 * slower, rel=1e-5)


@pytest.mark.parametrize(
    "sets, text, message",
    [
        ((), 'particle = "electron";', "species[0].charge: missing: give charge and mass, or particle"),
        ((), "particles_per_cell = 10;", "species[0].particles: give either particles or particles_per_cell"),
        ((), "density = 1e16;", "species[0].particle: needs density or plasma_frequency"),
        (("species[0].mass=1.0",), "", "species[0].particle: give either particle, or charge and mass"),
        (("species[0].particles_per_cell=1e300",), "", "makes more than 4294967296 particles"),
        (("constants.vacuum_permittivity=1.0",), "", "is 8.8541878188e-12 F/m in SI units: leave it out"),
        (("species[0].particle=quark",), "", "must be 'electron', 'positron', 'proton', 'deuteron' or 'alpha'"),
        (("units=cgs",), "", "units: must be 'normalised' or 'SI'"),
    ],
)  # fmt: skip
def test_what_does_not_fit_together_is_refused(sets, text, message):
    with pytest.raises(ConfigError) as caught:
        read(*sets, text=CASE.replace(text, "") if text else CASE)
    assert any(message in fault for fault in caught.value.messages), caught.value.messages


def verdicts(*sets, text=CASE):
    return {n.symbol: n for n in derived(read(*sets, text=text)[0])}


def test_electrons_in_kg_and_coulomb_with_a_permittivity_of_one_are_told():
    """As macro-particles of one electron each: wp = 0.27 rad/s, and a Debye length beyond any box."""
    text = CASE.replace('units = "SI";', "").replace(
        'particle = "electron"; density = 1e16; temperature = 1.0; particles_per_cell = 10',
        f"charge = {-SI.charge!r}; mass = {SI.mass!r}; thermal_velocity = 4.2e5; particles = 16384",
    )
    found = verdicts(text=text)
    assert found["wp"].value < 1.0
    assert 'units = "SI"' in found["eps0"].cure and "electron" in found["eps0"].cure
    assert [s for s in ("eps0", "lambda_D/L", "wp t/2pi") if found[s].verdict != "warn"] == []
    assert "does nothing" in found["wp t/2pi"].cure


@pytest.mark.parametrize(
    "sets, symbol",
    [
        (("simulation.cycles=10",), "wp t/2pi"),
        (("simulation.space_length=[1e-7]", "simulation.time_step=1e-14"), "lambda_D/L"),
        (("simulation.time_step=1e-15",), "max(wp dt, wc dt, v dt/dx)"),
        (("species[0].temperature=3000.0",), "v/c"),
    ],
)
def test_too_little_is_warned_of_like_too_much(sets, symbol):
    assert verdicts().get(symbol) is None or verdicts()[symbol].verdict == "ok"
    assert verdicts(*sets)[symbol].verdict == "warn" and verdicts(*sets)[symbol].cure


def test_a_plasma_that_only_gyrates_does_something():
    sets = ("simulation.cycles=10", "field.magnetic=[0.0, 0.0, 0.1]")  # wc dt = 0.18
    assert verdicts(*sets)["wp t/2pi"].verdict == "ok"


def test_particles_that_a_force_of_ones_own_moves_may_be_too_few_for_a_plasma(monkeypatch):
    """Tracers were told that they do nothing, and to look after their units."""
    monkeypatch.setitem(ACCELERATIONS, "push", lambda x, v, t: (1.0, 0.0, 0.0))
    sets = ("simulation.cycles=10", "simulation.space_length=[1e-7]", "simulation.time_step=1e-14")
    alone, pushed = verdicts(*sets), verdicts(*sets, "species[0].acceleration=push")
    for symbol in ("lambda_D/L", "wp t/2pi"):
        assert alone[symbol].verdict == "warn" and pushed[symbol].verdict == "ok"
    idle, short = "max(wp dt, wc dt, v dt/dx)", (*sets, "simulation.time_step=1e-25")
    assert idle in verdicts(*short) and idle not in verdicts(*short, "species[0].acceleration=push")
