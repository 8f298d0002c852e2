"""Particles per Debye length, waves over the noise of random places, and the field that such places start with."""

import math

import numpy as np
import pytest
from app_runner import running
from seldom import seldom

from hpcpic.core.case.config import loads
from hpcpic.core.case.derived import Derived
from hpcpic.core.comm.world import World
from hpcpic.core.space.rng import normal_quantile
from hpcpic.plasma.configure import configure
from hpcpic.plasma.forecast.derived import derived
from hpcpic.plasma.forecast.noise import ALONG_X, ELSEWHERE, noise_over_wave, start_noise
from hpcpic.plasma.physics.quiet_start import radical_inverse

FEW = """
simulation = { cycles = 400; time_step = 0.05; space_length = [12.566370614359172]; };
grid = { points = [64]; };
species = ({ name = "e"; particles = 64; charge = -1.0; mass = 1.0; init_method = "random"; plasma_frequency = 1.0;
             thermal_velocity = 1.0; perturbation = { mode = [1]; amplitude = 0.01; }; });
output = { modes = ([1]); every = { series = 1; }; };
"""
PER_DEBYE, OVER_NOISE = "N_D", "a sqrt(N)/2"
FLAT = ("simulation.space_length=[8, 4]", "grid.points=[8, 4]", "species[0].perturbation.mode=[1, 0]")
DEEP = ("simulation.space_length=[8, 4, 4]", "grid.points=[8, 4, 4]", "species[0].perturbation.mode=[1, 0, 0]")
NO_MODES = "output.modes=()"


def checked(*sets: str) -> dict[str, Derived]:
    return {number.symbol: number for number in derived(configure(loads(FEW, sets=sets)))}


def test_a_wave_of_few_random_electrons_is_noise_and_the_check_says_so():
    found = checked()
    assert found[PER_DEBYE].value == pytest.approx(64 / (4 * math.pi)) and found[PER_DEBYE].verdict == "warn"
    assert found[OVER_NOISE].value == pytest.approx(0.01 * 8 / 2) and found[OVER_NOISE].verdict == "warn"


@pytest.mark.parametrize(
    "sets, counted",
    [
        ((*FLAT, NO_MODES), math.pi * 64 / 32),
        ((*FLAT, "grid.points=[8, 1]", NO_MODES), 64 / 8),
        ((*DEEP, NO_MODES), 4 / 3 * math.pi * 64 / 128),
        (("species[0].thermal_velocity=0.5",), 0.5 * 64 / (4 * math.pi)),
        (("species[0].plasma_frequency=2",), 0.5 * 64 / (4 * math.pi)),
    ],
)
def test_particles_are_counted_in_the_length_circle_and_sphere_of_debye(sets, counted):
    assert checked(*sets)[PER_DEBYE].value == pytest.approx(counted)


@pytest.mark.parametrize("method", ["quiet", "strata"])
def test_ordered_places_are_not_warned_of(method):
    found = checked(f'species[0].init_method="{method}"')
    assert found[PER_DEBYE].limit == "" and OVER_NOISE not in found


def test_a_cold_species_and_one_without_a_charge_have_no_debye_length():
    assert PER_DEBYE not in checked("species[0].thermal_velocity=0")
    assert PER_DEBYE not in checked("species[0].plasma_frequency=0", "species[0].charge=0")


def test_a_velocity_makes_a_wave_too():
    """In a cold plasma a velocity b makes the density k b/wp, a quarter of a period after it."""
    found = checked("species[0].perturbation={amplitude=0; velocity_amplitude=0.3;}", "species[0].plasma_frequency=2")
    assert found[OVER_NOISE].value == pytest.approx(0.5 * 0.3 / 2 * 8 / 2)
    assert OVER_NOISE not in checked("species[0].perturbation.amplitude=0")


@pytest.mark.parametrize("n", [64, 4096])
def test_the_noise_of_a_mode_is_as_random_places_start_with(n):
    """Relative density of mode 1 in 40 starts, and the field that a run begins with: E = rho/k, as eps0 = rho_0 = 1."""
    square, field = [], []
    for seed in range(40):
        sets = [f"species[0].particles={n}", f"simulation.random_seed={seed}", "species[0].perturbation.amplitude=1e-9"]
        with running(World.alone(), "hpcpic", configure(loads(FEW, sets=sets))) as app:
            (species,) = app.scene.species
            x = species.positions(np.arange(n))[:, 0]
            square.append(abs(2 / n * np.exp(-0.5j * x).sum()) ** 2)
            field.append(math.hypot(*(app.scalars()[f"mode_1_{part}"] for part in ("re", "im"))) * 0.5)
    assert np.mean(square) == pytest.approx(4 / n, rel=0.5)  # an exponential distribution: 16 % is one deviation
    assert field == pytest.approx(np.sqrt(square), rel=0.01)


def test_a_wave_has_the_amplitude_that_stands_over_the_noise():
    sets = ('species[0].init_method="quiet"', "species[0].particles=4096")
    with running(World.alone(), "hpcpic", configure(loads(FEW, sets=sets))) as app:
        started = math.hypot(*(app.scalars()[f"mode_1_{part}"] for part in ("re", "im")))
    assert started == pytest.approx(0.01 / 0.5, rel=5e-3)


def test_random_places_start_with_the_field_that_is_foretold():
    """On average: the field of one start is mostly that of its longest waves, which differ."""
    sets = ["species[0].particles=1024", "species[0].thermal_velocity=0.2", "species[0].perturbation.amplitude=0"]
    config = configure(loads(FEW, sets=sets))
    assert start_noise(config) == pytest.approx((4 * math.pi) ** 2 / (12 * 1024 * 0.2**2))
    found = []
    for seed in range(40):
        config = configure(loads(FEW, sets=[*sets, f"simulation.random_seed={seed}"]))
        with running(World.alone(), "hpcpic", config) as app:
            scalars = app.scalars()
            found.append(scalars["energy_total"] / scalars["energy_kinetic"] - 1)
    assert np.mean(found) == pytest.approx(start_noise(config), rel=0.3)
    assert start_noise(configure(loads(FEW, sets=['species[0].init_method="quiet"']))) == 0.0


def test_the_noise_that_stays_beside_a_wave_is_as_foretold():
    """Of a run without a wave, from t = 20 on: the share of the wave of 1 % that the case would start."""
    sets = ["species[0].particles=1024"]
    foretold = noise_over_wave(configure(loads(FEW, sets=sets)), (1,)) * 0.01 / 0.5  # E = rho/k
    assert foretold == pytest.approx(2 / 32 * math.sqrt(0.2) / 0.5)
    silent = configure(loads(FEW, sets=[*sets, "species[0].perturbation.amplitude=0", "simulation.time_step=0.2"]))
    found = []
    with running(World.alone(), "hpcpic", silent) as app:
        for step in range(1200):
            app.step()
            if step > 100 and step % 5 == 0:
                scalars = app.scalars()
                found.append(scalars["mode_1_re"] ** 2 + scalars["mode_1_im"] ** 2)
    assert math.sqrt(np.mean(found)) == pytest.approx(foretold, rel=0.3)


def test_even_places_leave_no_noise_and_noise_is_all_where_no_wave_is_started():
    assert noise_over_wave(configure(loads(FEW, sets=['species[0].init_method="quiet"'])), (1,)) == 0.0
    assert noise_over_wave(configure(loads(FEW, sets=["species[0].perturbation.amplitude=0"])), (1,)) == math.inf


COLD = """
simulation = { cycles = 100; time_step = 0.05; space_length = [6.283185307179586]; };
grid = { points = [64]; };
numerics = { precision = "single"; };
species = ({ name = "e"; particles = 4096; charge = -1.0; mass = 1.0; init_method = "quiet"; plasma_frequency = 1.0;
             perturbation = { mode = [1]; amplitude = 1e-5; }; });
"""
PARTS = "wp dt a/(k dx) 2^20"


@pytest.mark.parametrize("amplitude, off", [seldom(1e-3, 1e-3), (3e-6, None)])
def test_a_cold_wave_that_single_precision_rounds_away_is_warned_of(amplitude, off, world: World):
    """The field after a period, of single and of double precision: alike, or off by a tenth and more and warned of."""
    setting = f"species[0].perturbation.amplitude={amplitude}"
    number = {one.symbol: one for one in derived(configure(loads(COLD, sets=[setting])))}[PARTS]
    assert number.value == pytest.approx(0.05 * amplitude * 64 / (2 * math.pi) * 2**20)
    assert number.verdict == ("ok" if off else "warn")
    found = []
    for precision in ("single", "double"):
        with running(world, "hpcpic", configure(loads(COLD, sets=[setting, f"numerics.precision={precision}"]))) as app:
            for _ in range(app.n_steps):
                app.step()
            found.append(app.scalars()["mode_1"])
    if off:
        assert found[0] == pytest.approx(found[1], rel=off)
    else:
        assert abs(found[0] / found[1] - 1) > 0.05


def test_only_cold_species_in_single_precision_are_rounded_alike():
    for sets in (["numerics.precision=double"], ["species[0].thermal_velocity=0.1"]):
        assert PARTS not in {one.symbol for one in derived(configure(loads(COLD, sets=sets)))}


DAMPED = """
simulation = { cycles = 600; time_step = 0.05; space_length = [12.566370614359172]; };
grid = { points = [32]; };
species = ({ name = "e"; particles = 262144; charge = -1.0; mass = 1.0; plasma_frequency = 1.0; thermal_velocity = 1.0;
             perturbation = { mode = [1]; amplitude = 0.02; }; });
"""


def test_a_wave_is_damped_into_the_noise_of_random_places_when_told():
    """Noise 2/sqrt(N) (k lambda_D)/sqrt(1 + (k lambda_D)^2) against 0.02 exp(-0.153 t): t = 15.9, as a run has it."""
    found = {one.name: one for one in derived(configure(loads(DAMPED)))}["wave of e damped into the noise"]
    assert found.value == pytest.approx(math.log(0.02 * 512 / 2 * math.sqrt(5)) / 0.1534 / 30, rel=0.03)
    assert found.verdict == "warn" and found.cure.startswith(
        'species[0].init_method = "quiet", or species[0].particles = '
    )
    for cure in ['species[0].init_method="quiet"', f"species[0].particles={found.cure.split()[-1]}"]:
        cured = {one.name: one for one in derived(configure(loads(DAMPED, sets=[cure])))}
        assert found.name not in cured or cured[found.name].verdict == "ok"


@pytest.mark.parametrize(
    "bases, bound", [((1, 2), ALONG_X), ((1, 5), ALONG_X), ((2, 5), ELSEWHERE), ((3, 11), ELSEWHERE)]
)
@pytest.mark.parametrize("n, m", [(1024, 1), (4096, 4), (30000, 1)])
def test_the_noise_of_a_quiet_start_rises_as_told(bases, bound, n, m):
    """2/N |sum of exp(-i (k.x + k v t))| of free particles at even places (base 1) or in digit-reversed order."""
    x, v = ((np.arange(n) + 0.5) / n if base == 1 else radical_inverse(np.arange(n), base, n) for base in bases)
    tau = np.linspace(3.0, 10.0, 15)[:, None]
    wave = 2 * np.abs(np.exp(-1j * (2 * np.pi * m * x + normal_quantile(v) * tau)).mean(axis=1))
    told = bound * m * tau[:, 0] / n
    assert 0.1 < np.sqrt(np.mean((wave / told) ** 2)) < 1.3


@pytest.mark.parametrize("n, right", [(1024, False), (65536, True)])
def test_a_quiet_wave_that_is_damped_into_its_noise_is_warned_of(n, right, world: World):
    """1024 quiet particles let a wave grow that Landau damps by exp(-1.8), with every verdict ok."""
    text, sets = DAMPED, [f"species[0].particles={n}", "species[0].init_method=quiet", "simulation.cycles=240"]
    found = {one.name: one for one in derived(configure(loads(text, sets=sets)))}["wave of e damped into the noise"]
    assert found.verdict == ("ok" if right else "warn")
    with running(world, "hpcpic", configure(loads(text, sets=sets))) as app:
        wave = [abs(app.scalars()["mode_1"])]
        for _ in range(app.n_steps):
            app.step()
            wave.append(abs(app.scalars()["mode_1"]))
    tops = [max(wave[start : start + 50]) for start in (46, 176)]  # a swing each, of 44 steps, 6.5 s apart
    assert (abs(math.log(tops[1] / tops[0]) / 6.5 + 0.1534) < 0.02) == right
    if not right:
        more = [*sets, f"species[0].particles={found.cure.split()[-1]}"]
        assert {one.name: one for one in derived(configure(loads(text, sets=more)))}[found.name].verdict == "ok"


@pytest.mark.parametrize("sets, told", [
    (["field.equation.c=-1.0", "species[0].thermal_velocity=0.5", "species[0].particles=512"], True),
    (["field.equation.c=-1.0", "species[0].thermal_velocity=0.5", "species[0].particles=65536"], False),
    (["simulation.space_length=[31.4]", "simulation.cycles=2000", "species[0].particles=1024"], True),
    (["simulation.space_length=[31.4]", "simulation.cycles=2000", "species[0].particles=4096"], False),
    (["species[0].thermal_velocity=0", "species[0].particles=64"], False),
])  # fmt: skip
def test_a_wave_without_a_known_damping_is_told_where_the_noise_of_a_quiet_start_hides_it(sets, told):
    """Runs of 0.01: sound of 512 ions grew by 0.07 wp, where they damp it by 0.097; a Langmuir wave of k lambda_D = 0.2
    fell by a third from wp t = 60 to 100 with 1024 electrons, and grew by 6 % with 4096.
    """
    quiet = ["species[0].init_method=quiet", "species[0].perturbation.amplitude=0.01"]
    found = {one.name: one for one in derived(configure(loads(DAMPED, sets=[*sets, *quiet])))}
    assert ("wave of e hidden by the noise" in found) == told
    if told:
        number = found["wave of e hidden by the noise"]
        more = f"species[0].particles={number.cure.split()[-1]}"
        cured = {one.name for one in derived(configure(loads(DAMPED, sets=[*sets, *quiet, more])))}
        assert number.verdict == "warn" and number.name not in cured
