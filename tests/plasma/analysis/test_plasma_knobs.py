"""Knobs of the plasma: settings mean what they say, every case knows what it is about, orders and limits are right."""

import json
import math

import numpy as np
import pytest
from knob_cases import made_again, reader, sizes_of
from scipy.optimize import brentq

from hpcpic.core.app.read import read_case
from hpcpic.core.cli.main import build
from hpcpic.core.files.series import Series
from hpcpic.core.study.bisection import Limits
from hpcpic.core.study.pilot import Pilots
from hpcpic.core.study.stability import limited
from hpcpic.plasma.analysis.knobs import knobs_of, smooth
from hpcpic.plasma.app import APP, shipped_cases
from hpcpic.plasma.configure import configure
from hpcpic.plasma.forecast.derived import derived
from hpcpic.plasma.forecast.scales import total_plasma_frequency
from hpcpic.plasma.setup.scene import Scene

CASES = sorted(shipped_cases())
ABOUT = {
    "bump-on-tail": "growth",
    "cyclotron": "gyration",
    "exb-drift": "gyration",
    "ion-acoustic": "frequency",
    "landau-damping": "damping",
    "landau-damping-3d": "damping",
    "landau-damping-si": "damping",
    "magnetised-thermal-2d": "energy",
    "oscillation-3d": "frequency",
    "plasma-oscillation": "frequency",
    "thesis-1024-on-512": "energy",
    "thesis-10240-on-64": "energy",
    "two-particles": "frequency",
    "two-stream-cold": "growth",
    "two-stream-warm": "growth",
    "upper-hybrid": "frequency",
}


read = reader(configure, shipped_cases)


@pytest.mark.parametrize("case", CASES)
def test_its_own_sizes_are_the_case_itself(case):
    config, again = made_again(read, knobs_of, case)
    simulation = again.simulation.model_copy(update={"time_step": config.simulation.time_step})
    assert again.model_copy(update={"simulation": simulation}) == config
    assert again.simulation.time_step == pytest.approx(config.simulation.time_step, rel=1e-12)


@pytest.mark.parametrize("amplitude", [0.01, 0.5])
def test_stability_turns_the_step_also_where_a_wave_makes_the_plasma_dense(tmp_path, amplitude):
    """Twice the density at its crest: `check` judges the step there, in a row of another name, and dx was turned."""
    sets = (f"species[0].perturbation.amplitude={amplitude}",)
    case = read_case(APP, "landau-damping", sets)
    limits = Limits(Pilots(APP, case, sets, knobs := knobs_of(case.config), tmp_path, (1, 1)), knobs)
    knob = limited(limits)
    crest = 1.98 if amplitude == 0.5 else 1.0  # of the two densest cells
    assert knob.name == "dt" and limits.axis(knob).size(1.0) == pytest.approx(2.0 / math.sqrt(crest), rel=0.02)


@pytest.mark.parametrize("turn, exact", [(1.0, False), (1.0, True), (2.0, True), (8.0, True)])
def test_the_end_of_stability_knows_what_an_exact_phase_makes_of_waves_across_the_field(tmp_path, turn, exact):
    """wp dt sqrt(f) = 2, f = tan(wc dt/2)/(wc dt/2), and 2 without; a bisection to 1 % is off by 0.5 %. With f as that
    of the case's own step it was 2 for all. Runs follow: 1.72 at wc = wp and 1.265 at 2 wp.
    """
    sets = (f"field.magnetic=[0, 0, {turn}]", f"numerics.exact_phase={str(exact).lower()}")
    case = read_case(APP, "upper-hybrid", sets)
    knobs = knobs_of(case.config)
    limits = Limits(Pilots(APP, case, sets, knobs, tmp_path, (1, 1)), knobs)
    dt = limits.axis(next(knob for knob in knobs.knobs if knob.name == "dt")).size(1.0)
    across = brentq(lambda dt: dt * dt * np.tan(turn * dt / 2) - 2 * turn * dt, 0.1, 0.9999 * np.pi / turn)
    assert dt == pytest.approx(across if exact else 2.0, rel=0.01)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("factor", [3.7, 1.25, 0.4])
def test_settings_are_never_coarser_than_asked_and_end_at_the_time(case, factor):
    config = read(case)
    knobs = knobs_of(config)
    wanted = {name: factor * size for name, size in sizes_of(knobs, config).items()}
    time = 0.37 * knobs.time
    made = read(case, knobs.settings(wanted, time))
    assert made.simulation.cycles * made.simulation.time_step == pytest.approx(time, rel=1e-12)
    for name, size in sizes_of(knobs, made).items():
        assert size <= wanted[name] * (1 + 1e-9)
    assert all(n % 2 == 0 for n in made.grid.points)
    assert total_plasma_frequency(made) == pytest.approx(total_plasma_frequency(config), rel=1e-12)
    for species in made.species:  # as many in every cell, so that no beat is an alias
        assert species.init_method != "quiet" or species.particles % math.prod(made.grid.points) == 0


def test_coarse_pilots_keep_the_modes_that_their_grid_has_and_end_with_the_waves_of_the_case():
    """A wave that a case starts cannot be left out: the knob ends where it has two cells."""
    sets = ("output.modes=([1], [3], [-8])", "species[0].perturbation.mode=[3]", "grid.points=[128]")
    config = read("landau-damping", sets)
    knobs = knobs_of(config)
    dx = next(knob for knob in knobs.knobs if knob.name == "dx")
    assert dx.largest == pytest.approx(dx.size(config) * 128 / 6) and dx.beyond
    for factor, kept in ((1.0, 3), (8.0, 3), (11.0, 2), (dx.largest / dx.size(config), 2), (40.0, 1)):
        made = read("landau-damping", (*sets, *knobs.settings({"dx": factor * dx.size(config)}, knobs.time)))
        assert made.output.modes == config.output.modes[:kept]
        (wave,) = (number for number in derived(made) if number.symbol == "k dx")
        assert (wave.verdict == "fail") == (factor == 40.0)


@pytest.mark.parametrize("case", CASES)
def test_every_case_knows_what_it_is_about_and_its_pilot_is_no_longer_than_the_run(case):
    knobs = knobs_of(read(case))
    first, *_ = quantities = knobs.quantities()
    assert first.name == ABOUT[case] and quantities[-1].name == "energy"
    assert all(0 < quantity.time <= knobs.time for quantity in quantities)


def test_a_wave_that_hardly_decays_is_asked_for_its_frequency():
    """k lambda_D = 0.14, as in an ordinary case in SI units: exp(-27) of the frequency, which is noise in any run."""
    long = read("landau-damping", ("simulation.space_length=[45.0]",))
    assert [q.name for q in knobs_of(long).quantities()] == ["frequency", "energy"]


@pytest.mark.parametrize("cycles, about", [(300, "amplitude"), (4000, "growth")])
def test_sound_that_drifting_electrons_drive_is_about_its_growth_where_the_run_shows_it(cycles, about):
    """0.0111 wp: by a third of an e-fold in 300 steps, by 4.4 in 4000."""
    electrons = 'name="e"; plasma_frequency=1.0; thermal_velocity=1.0; charge=-1.0; mass=1.0; drift_velocity=[0.6];'
    ions = 'name="i"; density=1.0; thermal_velocity=0.0141421; charge=1.0; mass=100.0;'
    wave = "perturbation={ mode=[1]; amplitude=1e-3; };"
    even = 'particles=4096; init_method="strata"; places=4;'
    sets = [f"simulation={{ cycles={cycles}; time_step=0.1; space_length=[{4 * np.pi}]; }}", "grid.points=[64]"]
    config = read("landau-damping", [*sets, f"species=({{ {electrons} {even} }}, {{ {ions} {even} {wave} }})"])
    assert knobs_of(config).quantities()[0].name == about


def test_a_mode_without_a_law_is_asked_for_its_amplitude_from_the_start_to_the_end():
    """Ions that wave among electrons as particles: the energy knows nothing of a wave that drowns in noise."""
    strata = ('name="e"', "particles=30208", "charge=-1.0", "mass=1.0", 'init_method="strata"')
    electrons = f"{{ {'; '.join((*strata, 'plasma_frequency=1.0', 'thermal_velocity=1.0'))}; }}"
    wave = "perturbation={ mode=[%d]; amplitude=0.02; }"
    ions = f'{{ name="i"; particles=10240; charge=1.0; mass=50.0; plasma_frequency=0.141421356; {wave}; }}'
    for mode, names in ((1, ["amplitude", "energy"]), (12, ["energy"])):  # mode_12 is no column of the series
        config = read("two-stream-warm", (f"species=({electrons}, {ions % mode})",))
        quantities = knobs_of(config).quantities()
        assert [q.name for q in quantities] == names
        assert all("no law of" in q.why for q in quantities)
    knobs = knobs_of(read("two-stream-warm", (f"species=({electrons}, {ions % 1})", "simulation.cycles=200")))
    first, energy = knobs.quantities()
    assert "mode_1" in first.why and first.time == knobs.time > energy.time
    clean = first.measure(series(mode_1=lambda t: np.abs(np.cos(0.063 * t))))
    noisy = first.measure(series(mode_1=lambda t: np.abs(np.cos(0.063 * t)) + (t > 5.0) * np.sin(9.0 * t) ** 2))
    assert np.linalg.norm(noisy - clean) > 0.3 * np.linalg.norm(clean)


def test_a_warm_quiet_start_has_a_quieter_one_of_the_same_plasma_whose_velocities_no_grid_changes():
    own = read("landau-damping", ('species[0].init_method="quiet"',))
    sets = knobs_of(own).quieter
    strata = read("landau-damping", sets)
    assert strata.species[0].init_method == "strata" and knobs_of(strata).quieter == ()
    assert total_plasma_frequency(strata) == pytest.approx(total_plasma_frequency(own), rel=1e-12)
    velocities = set()
    for factor in (2.0, 1.0, 0.4):
        knobs = knobs_of(strata)
        made = read("landau-damping", (*sets, *knobs.settings({"dx": factor * knobs.knobs[0].size(strata)}, 1.0)))
        (species,) = Scene(made).species
        velocities.add(len(np.unique(species.velocities(np.array(species.ids))[:, 0])))
    assert len(velocities) == 1


def test_smooth_numbers_are_even_without_large_primes():
    found = [smooth(n) for n in (1, 2, 7, 8.5, 121, 1025)]
    assert found == [2, 2, 8, 10, 128, 1080]


def series(**values):
    time = np.linspace(0.0, 40.0, 801)
    return Series({name: value(time) for name, value in values.items()}, {}, np.arange(801), time)


def test_quantities_read_exact_signals():
    growth = {q.name: q for q in knobs_of(read("two-stream-cold")).quantities()}["growth"]
    assert growth.measure(series(mode_1=lambda t: 1e-5 * np.exp(0.3 * t))) == pytest.approx(0.3, rel=1e-9)
    frequency = {q.name: q for q in knobs_of(read("plasma-oscillation")).quantities()}["frequency"]
    wave = series(energy_kinetic=lambda t: np.sin(1.01 * t) ** 2)
    assert frequency.measure(wave) == pytest.approx(1.01, rel=1e-9)
    damping = {q.name: q for q in knobs_of(read("landau-damping")).quantities()}["damping"]
    damped = series(mode_1=lambda t: np.abs(np.exp(-0.15 * t) * np.cos(1.4 * t)))
    assert damping.measure(damped) == pytest.approx(0.15, rel=1e-5)  # a spline between the samples
    energy = {q.name: q for q in knobs_of(read("magnetised-thermal-2d")).quantities()}["energy"]
    assert energy.measure(series(energy_total=lambda t: 2 + 0.001 * t)) == pytest.approx(1 + 0.0005 * 100, rel=1e-9)
    with pytest.raises(ArithmeticError, match="no energy"):
        energy.measure(series(energy_total=lambda t: 0 * t))


def program(*words):
    with pytest.raises(SystemExit) as end:
        build(lambda: APP, "hpcpic", "plasma").main(list(words))
    return int(end.value.code or 0)


@pytest.mark.validation
def test_orders_of_a_cold_wave_and_a_recommendation_that_theory_confirms(tmp_path, monkeypatch, capfd):
    """The truth is sqrt(k-independent wp) = 1: the continuum, in no way known to the search."""
    monkeypatch.chdir(tmp_path)
    words = ("tradeoff", "plasma-oscillation", "--knobs", "dx,dt,particles")
    assert program(*words, "-o", "laws") == 0
    knobs = json.loads((tmp_path / "laws/tradeoff.json").read_text())["knobs"]
    assert knobs["dx"]["order"] == pytest.approx(2.0, abs=0.15)
    assert knobs["dt"]["order"] == pytest.approx(2.0, abs=0.15)
    assert knobs["particles"]["bound_here"] < 1e-6
    assert program(*words, "-o", "out", "--tolerance", "2%") == 0  # takes theory's orders, and checks them
    facts = json.loads((tmp_path / "out/tradeoff.json").read_text())
    assert [facts["knobs"][name]["order"] for name in ("dx", "dt")] == [None, None]
    assert facts["reference"][0] == pytest.approx(1.0, abs=facts["uncertainty"])
    best = facts["recommended"]
    assert best["error"] * facts["reference"][0] <= 0.02
    # (2/dt) asin(dt/2 cos(k dx/2)): the law of the scheme at the recommended sizes
    dt, dx = best["sizes"]["dt"], best["sizes"]["dx"]
    law = 2 / dt * math.asin(dt / 2 * math.cos(dx / 2))
    assert abs(law - 1.0) <= 0.02
    assert best["work"] < 0.2 * facts["pilot_work"]  # the shipped case is over-careful in particles
    capfd.readouterr()


def test_the_limit_of_the_time_step_is_measured_at_2(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    assert program("stability", "plasma-oscillation", "-o", "out") == 0
    facts = json.loads((tmp_path / "out/stability.json").read_text())
    assert facts["knob"] == "dt"  # no theory ends the stability of dx, which is the first
    assert facts["measured_over_theory"] == pytest.approx(1.0, abs=0.05)
    assert facts["seeds"] == {} and not facts["slow"]
    assert "nothing in the scene is random, so no other seed was run" in capfd.readouterr().out


@pytest.mark.parametrize(
    "case, sets",
    [
        ("plasma-oscillation", ()),
        ("landau-damping", ()),  # thermal, but from the inverse distribution
        ("two-particles", ()),
        ("two-particles", ("species[0].thermal_velocity=0.1",)),
        ("magnetised-thermal-2d", ()),
        ("magnetised-thermal-2d", ("species[0].particles=0",)),
        ("thesis-10240-on-64", ()),
        ("thesis-10240-on-64", ('species[0].init_method="opposite beams"',)),
    ],
)
def test_a_scene_has_another_seed_where_another_seed_makes_another_scene(case, sets):
    config = read(case, sets)
    other = read(case, (*sets, "simulation.random_seed=2"))

    def start(config):
        return [(s.positions(ids), s.velocities(ids)) for s in Scene(config).species for ids in [np.array(s.ids[:64])]]

    same = all(np.array_equal(a, b) for s, t in zip(start(config), start(other)) for a, b in zip(s, t))
    assert same == (knobs_of(config).seed is None)


def test_a_refusal_comes_with_ways_out_and_what_they_cost(capfd):
    assert program("check", "two-stream-warm", "--set", "simulation.time_step=1.5") == 3
    told = capfd.readouterr().out
    ways = [line for line in told.splitlines() if line.startswith("  --")]
    assert len(ways) == 3 and all("times the cost" in way for way in ways)
    assert "the nearest legal one" in ways[0] and "without a warning" in ways[1] and "--force" in ways[2]
    words = [word for word in ways[0].split(": the nearest")[0].split() if word != "--set"]
    assert program("check", "two-stream-warm", *(w for word in words for w in ("--set", word))) == 0
    capfd.readouterr()


def test_the_horizon_of_a_single_particle_is_no_billion_steps():
    """A proton's plasma frequency in SI units is 1e-7 of its gyration's: growth rates were run for 4e10 steps."""
    config = read("cyclotron", ("species[0].charge=-1e-20", "species[0].mass=1e-20"))
    assert knobs_of(config).horizon <= 100_000 * config.simulation.time_step
