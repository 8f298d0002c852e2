"""What must come out of SPH, measured against theory and experiment. Run by `pytest -m validation -s`.

Tolerances are some times the error that was measured; the reason of each error is beside it.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import curve_fit

from hpcpic.core.case.config import load, loads
from hpcpic.core.tasks.graph import Pool
from hpcpic.core.timers import Timers
from sph.analysis import experiments, theory
from sph.app import shipped_cases
from sph.configure import configure
from sph.diagnostics.snapshot import particles_at
from sph.physics.equation_of_state import EquationOfState
from sph.step import Sph

pytestmark = [pytest.mark.validation, pytest.mark.timeout(3600)]


class Done:
    """A shipped case, or the text of one, run to its end: `app`, and the scalars `rows` at `t`, at least `period` s
    apart.
    """

    def __init__(self, world, case: str, *sets: str, period: float = math.inf, at: tuple[float, ...] = ()) -> None:
        self.config = configure(loads(case, sets=sets) if "=" in case else load(shipped_cases()[case], sets))
        self.rows, self.states, times = [], {}, []
        pool = Pool(1)
        try:
            self.app = app = Sph(self.config, world, pool, Timers())
            waiting, following = list(at), 0.0
            while True:
                if app.time >= following:
                    self.rows.append(app.scalars())
                    app.sampled()
                    times.append(app.time)
                    following += period
                if waiting and app.time >= waiting[0]:
                    waiting.pop(0)
                    self.states[app.time] = self.fluid()
                if app.time >= app.end_time:
                    break
                app.step()
            self.last, self.state = app.scalars(), self.fluid()
            app.close()
        finally:
            pool.close()
        self.t = np.array(times)

    def fluid(self) -> dict[str, np.ndarray]:
        """Copies of the fluid's columns in order of the ids."""
        own = particles_at(self.app.storage, self.app.storage.fluid_slots)
        order = np.argsort(own["id"])
        return {name: np.array(values[order]) for name, values in own.items()}

    def series(self, name: str) -> np.ndarray:
        return np.array([row[name] for row in self.rows])


def decaying(t, height, damping, frequency, phase, level):
    """A damped oscillation about a level."""
    return height * np.exp(-damping * t) * np.cos(frequency * t + phase) + level


def told(name: str, value: float, words: str) -> float:
    """Print a measured figure beside what is asked of it (pytest -s shows the table)."""
    print(f"{name:<64}{value:>14.6g}   {words}")
    return value


# ------------------------------------------------------------------------------------------- viscous flow


def poiseuille_error(world, across: int, *more: str) -> float:
    """Largest departure of any particle from (MP 24) at four times, over the steady maximum."""
    dp = 1e-3 / across
    corner = f"[{10 * dp!r}, 1.0e-3]"
    places = ("domain.high", "fluid[0].shape.box.high", "wall[0].shape.box.high")
    sets = (*(f"{place}={corner}" for place in places), f"numerics.spacing={dp!r}", "simulation.end_time=0.5")
    done = Done(world, "poiseuille", *sets, *more, at=(0.0225, 0.1, 0.225, 0.4999))
    worst = 0.0
    for t, state in done.states.items():
        exact = theory.poiseuille(state["x"][:, 1], t, 2e-4, 1e-6, 1e-3)
        worst = max(worst, float(np.abs(state["v"][:, 0] - exact).max()) / 2.5e-5)
    return told(f"Poiseuille, {across} across: largest error", worst, "of the steady maximum")


def test_poiseuille_flow_follows_the_series_at_all_times_to_second_order(world):
    """Measured: 0.28 % (20 across), 0.07 % (40). What is left is the kink of the mirrored profile at the wall."""
    errors = [poiseuille_error(world, across) for across in (20, 40)]
    order = told("Poiseuille: order in the spacing", math.log2(errors[0] / errors[1]), ">= 1.5")
    assert errors[1] < 0.002 and order > 1.5


def test_poiseuille_flow_between_walls_of_particles(world):
    """Measured: 0.30 % (20 across), 0.20 % (40); of walls with a density of their own 10 and 5 %."""
    for across, most in ((20, 0.005), (40, 0.004)):
        assert poiseuille_error(world, across, 'wall[0].type="extrapolated-no-slip"') < most


def test_poiseuille_flow_by_strain_rate_follows_the_series_within_two_percent(world):
    """As the paper says of (MP 22-23). Measured: 1.9 % at 0.5 s."""
    done = Done(world, "poiseuille-strain-rate", "simulation.end_time=0.5", at=(0.0225, 0.1, 0.225, 0.4999))
    for t, state in done.states.items():
        exact = theory.poiseuille(state["x"][:, 1], t, 2e-4, 1e-6, 1e-3)
        error = float(np.abs(state["v"][:, 0] - exact).max()) / 2.5e-5
        assert told(f"Poiseuille by strain rate, {t} s: largest error", error, "2 %") < 0.02


def test_taylor_green_vortices_decay(world):
    """Measured at t = 0.5 with 50 x 50 particles and 100 x 100: energy -0.08 and -0.12 % of theory, the whole field
    0.84 and 0.39 % off: first order at least.
    """
    misses, k = [], 2 * np.pi
    for dp in (0.02, 0.01):
        done = Done(world, "taylor-green", "simulation.end_time=0.5", f"numerics.spacing={dp}")
        left = done.last["energy_kinetic"] / done.rows[0]["energy_kinetic"]
        decay = math.exp(-8 * math.pi**2 * 0.01 * done.app.time)
        title = f"Taylor-Green, Re = 100, dp {dp:g}: "
        energy = told(title + "kinetic energy at t = 0.5 over theory - 1", left / decay**2 - 1, "0.5 %")
        (x, y), v = done.state["x"].T, done.state["v"]
        exact = decay * np.stack([-np.cos(k * x) * np.sin(k * y), np.sin(k * x) * np.cos(k * y)], axis=1)
        off = math.sqrt(np.sum((v - exact) ** 2) / np.sum(exact**2))
        misses.append(told(title + "velocity, rms", off, "1 %, falling with dp"))
        assert abs(energy) < 0.005
        for axis in "xy":
            assert abs(done.last[f"momentum_{axis}"] - done.rows[0][f"momentum_{axis}"]) < 1e-12
    assert misses[0] < 0.01 and misses[1] < 0.6 * misses[0]


# ------------------------------------------------------------------------------------------- free surfaces


def test_a_drop_is_drawn_out_as_the_ellipse_of_theory(world):
    """Semi-axes from the second moments of the particles. Measured 0.9 % and 0.06 %."""
    done = Done(world, "elliptical-drop")
    axes = 2 * np.sqrt(np.mean(done.state["x"] ** 2, axis=0))
    exact = [float(a[0]) for a in theory.drop_axes(np.array([done.app.time]), 100.0, 1.0)]
    for name, got, wanted in zip("ab", axes, exact):
        assert abs(told(f"drop: semi-axis {name} over theory - 1", got / wanted - 1, "1.2 %")) < 0.012
    scale = done.last["mass"] * done.last["max_velocity"]
    drift = max(abs(done.last["momentum_x"]), abs(done.last["momentum_y"])) / scale
    assert told("drop: momentum over mass x velocity", drift, "1e-12") < 1e-12


def test_a_standing_wave_has_the_period_of_linear_theory(world):
    """Measured 0.2 %; (k a)^2 / 8 of the amplitude and c0 of ten times the speed are as much."""
    done = Done(world, "standing-wave", "simulation.end_time=2.6", period=0.005)
    exact = 2 * math.pi / theory.wave_frequency(math.pi, 1.0, 9.81)
    period = theory.period_of(done.t, done.series("crest"))
    assert abs(told("standing wave: period over theory - 1", period / exact - 1, "1 %")) < 0.01


def test_a_rotating_square_does_not_clump(world):
    """Distances to the nearest particle at omega t = 2, in spacings: measured 0.52 (5 % quantile), 1.08 (largest)."""
    from scipy.spatial import cKDTree

    done = Done(world, "rotating-square")
    nearest = cKDTree(done.state["x"]).query(done.state["x"], 2)[0][:, 1] / 0.02
    assert told("rotating square: 5 % quantile of nearest distances / dp", np.quantile(nearest, 0.05), "> 0.4") > 0.4
    assert told("rotating square: farthest nearest neighbour / dp", nearest.max(), "< 1.6") < 1.6


def test_the_water_column_of_the_paper(world):
    """Front against Koshizuka & Oka: measured 0.30 L rms, 0.31 with half the spacing, 0.30 to 0.32 with other walls:
    what is left is the gate and the friction of the bed, which the paper's scene has not.
    """
    done = Done(world, "water-column", period=0.002)
    clock = math.sqrt(2 * 9.81 / 0.146)
    found = experiments.KOSHIZUKA_FRONT
    front = np.interp(found[:, 0], done.t * clock, done.series("front_x") / 0.146)
    rms = float(np.sqrt(np.mean((front - found[:, 1])[found[:, 1] < 3.6] ** 2)))
    assert told("water column: front, rms departure / L", rms, "< 0.35") < 0.35
    x = done.state["x"]
    outside = np.any((x < [-1e-6, -1e-6]) | (x > [0.584 + 1e-6, 1.0]), axis=1).sum()
    assert told("water column: particles outside the tank", float(outside), "0") == 0
    assert len(x) == 800


# -------------------------------------------------------------------------------------------- still water


def test_a_deep_layer_keeps_the_pressure_of_rest(world):
    """3D, 25 layers. Measured +0.7 %, the quadrature of the kernel (+2.9 % with h / dp = 1.3)."""
    done = Done(world, "hydrostatic", period=0.004)
    eos = EquationOfState(1000.0, done.config.sound_speed, 7.0)
    exact = float(eos.pressure(eos.excess_at_rest(np.array([0.5]), 9.81))[0])
    mean = done.series("bottom")[done.t > 0.5].mean() / exact
    assert abs(told("hydrostatic: mean bottom pressure over theory - 1", mean - 1, "1 %")) < 0.01
    fastest = done.series("max_velocity").max() / done.config.sound_speed
    assert told("hydrostatic: largest velocity / c0", fastest, "1e-3") < 1e-3


def test_corrected_gradients_make_up_for_few_neighbours(world):
    """The same with h / dp = 1.3: measured +0.2 %, and +2.8 % without the correction."""
    done = Done(world, "hydrostatic-corrected", period=0.004)
    eos = EquationOfState(1000.0, done.config.sound_speed, 7.0)
    exact = float(eos.pressure(eos.excess_at_rest(np.array([0.5]), 9.81))[0])
    mean = done.series("bottom")[done.t > 0.2].mean() / exact
    assert abs(told("hydrostatic, corrected: mean bottom pressure over theory - 1", mean - 1, "0.5 %")) < 0.005


def test_still_water_stays_still_for_twenty_seconds(world):
    """Measured: height -0.004 %, level +0.06 %, bottom pressure +1.04 %, of which 0.25 % are compression."""
    done = Done(world, "still-tank", period=0.01)
    settled = done.t > 10.0
    height = done.series("energy_potential")[settled].mean() / (9.81 * 1000.0) * 2 - 1
    assert abs(told("still tank: mean height over H / 2 - 1", height, "0.1 %")) < 0.001
    assert abs(told("still tank: level over H - 1", done.series("level")[settled].mean() - 1, "0.1 %")) < 0.001
    pressure = done.series("bottom")[settled].mean() / (1000 * 9.81) - 1
    assert abs(told("still tank: bottom pressure over rho g H - 1", pressure, "1.5 %")) < 0.015


# ------------------------------------------------------------------------------------------ waves, impacts


def test_the_piston_makes_waves_of_the_height_of_linear_theory(world):
    """First harmonic at x = 1.5 m. Measured -3 % (+4 % without artificial viscosity, which damps by 2 nu k^2 x / cg).
    The wave is steep (k H / 2 = 0.13): what crests and troughs have beyond the harmonic is no part of linear theory.
    """
    done = Done(world, "oscillating-piston", period=0.01)
    k = theory.wave_number(2 * math.pi, 0.4, 9.81)
    late = (done.t > 4.0) & (done.t <= 6.0)  # two periods
    turn = np.exp(2j * math.pi * done.t[late])
    height = 4 * abs(np.mean(turn * done.series("wave")[late]))
    ratio = height / theory.wavemaker_height(0.04, k, 0.4)
    assert abs(told("piston: height of the first harmonic over theory - 1", ratio - 1, "5 %")) < 0.05


# Mean pressures from t sqrt(g/H) = 3.4 to 4.8 and highest until 3.2, rho g H, on the sensors of Lobovsky et al., 3, 15,
# 30 and 80 mm above the floor: computed in 2D without friction at H / 400 by De Courcy et al. 2024 (CMAME 420), and by
# TrixiParticles.jl, delta-SPH (validation/dam_break_2d, which has both).
DE_COURCY = np.array([(1.006, 2.59), (0.937, 1.82), (0.831, 1.26), (0.352, 0.217)])
TRIXI = np.array([(0.972, 3.06), (0.921, 2.27), (0.825, 1.40), (0.356, 0.226)])


def sensors_of(world, *sets: str) -> tuple[float, np.ndarray]:
    """Arrival of the front at the wall, and means and peaks [4, 2] of dam-break-pressure, in the units of DE_COURCY."""
    done = Done(world, "dam-break-pressure", "simulation.end_time=0.85", *sets, period=0.001)
    t, unit = done.t * math.sqrt(9.81 / 0.3), 1000 * 9.81 * 0.3
    read = [done.series(f"sensor_{k}") / unit for k in (1, 2, 3, 4)]
    level, first = (t > 3.4) & (t < 4.8), t < 3.2
    return t[np.argmax(read[0] > 0.2)], np.array([(p[level].mean(), p[first].max()) for p in read])


def test_a_dam_break_presses_the_wall_as_two_other_programs_have_it(world):
    """Arrival 2.43 (Lobovsky et al. 2014): -1.3 %. The means of four sensors are those of the two computations."""
    arrival, found = sensors_of(world)
    assert abs(told("dam break: arrival at the wall over 2.43 - 1", arrival / 2.43 - 1, "3 %")) < 0.03
    for (mean, _), known in zip(found, (DE_COURCY[:, 0] + TRIXI[:, 0]) / 2):
        assert abs(told("dam break: mean pressure over that of others - 1", mean / known - 1, "6 %")) < 0.06


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_peak_at_the_foot_is_the_measured_one_at_the_spacing_of_others(world, seed):
    """Lobovsky et al. 2014: 2.84 rho g H on 4.2 mm, 3 mm above the floor. Measured with 0.75 mm: 2.70, 3.02, 3.05 (8
    min of two cores each); with 1.25 mm 3.1 to 4.4.
    """
    sizes = ["gauge[1].size=[0,0.0042]", *(f"gauge[{k}].size=[0,0.0084]" for k in (2, 3, 4))]
    _, found = sensors_of(world, "numerics.spacing=0.00075", f"simulation.random_seed={seed}", *sizes)
    assert abs(told(f"foot, seed {seed}: peak over 2.84 - 1", found[0, 1] / 2.84 - 1, "10 %")) < 0.1
    for (mean, _), known in zip(found, (DE_COURCY[:, 0] + TRIXI[:, 0]) / 2):
        assert abs(told("... mean pressure over that of others - 1", mean / known - 1, "6 %")) < 0.06


def read_by_buchners_sensor(world, *sets: str) -> tuple[Done, np.ndarray, np.ndarray]:
    """The run of dam-break-sensor, and times over sqrt(H/g) and readings over rho g H of its sensor."""
    done = Done(world, "dam-break-sensor", "simulation.end_time=1.3", *sets, period=0.02, at=(0.5,))
    read = np.array([row.get("sensor_1", np.nan) for row in done.rows]) / (1000 * 9.81 * 0.6)
    there = ~np.isnan(read)
    return done, (done.t[there] - 0.01) * math.sqrt(9.81 / 0.6), read[there]


def beside_buchner(t: np.ndarray, read: np.ndarray) -> tuple[float, float]:
    """Mean from 3.4 to 4.8 over that measured less one, and rms of the difference from 2.4 to 5.2."""
    measured = np.interp(t, *experiments.BUCHNER_PRESSURE.T)
    level, whole = (t > 3.4) & (t < 4.8), (t > 2.4) & (t < 5.2)
    plateau = told("sensor: plateau over measured - 1", read[level].mean() / measured[level].mean() - 1, "5 %")
    return plateau, told("sensor: rms of 2.4 to 5.2, rho g H", np.sqrt(np.mean((read - measured)[whole] ** 2)), "0.12")


def highest_gap(done: Done) -> float:
    """Between the floor and the stream over it, less half a spacing, in spacings."""
    x = next(iter(done.states.values()))["x"]
    lowest = [x[np.abs(x[:, 0] - a) < 0.03, 1].min() / 0.01 - 0.5 for a in np.arange(1.3, 2.6, 0.06)]
    return told("sensor: highest gap under the stream, spacings", np.abs(lowest).max(), "0.5")


def test_a_dam_break_on_a_sensor_of_90_mm(world):
    """Without a gate (it hangs above the water): arrival 2.43, as measured; mean pressure from 3.4 to 4.8 +3 %. The
    measured rise to 0.69 at 2.8 is 0.50 at 3.1 then: a root mean square of 0.131. Particles run 0.14 spacings lower
    than they started.
    """
    up = "wall[1].shape.box={ low = [1.2, 0.8]; high = [1.22, 0.9]; }"
    done, t, read = read_by_buchners_sensor(world, up)
    arrival = done.t[np.argmax(done.series("front") > 3.21)] * math.sqrt(9.81 / 0.6)
    assert abs(told("sensor: arrival at the wall over 2.43 - 1", arrival / 2.43 - 1, "3 %")) < 0.03
    plateau, rms = beside_buchner(t, read)
    assert abs(plateau) < 0.05 and rms < 0.18 and read.min() > -0.05
    assert highest_gap(done) < 0.5


def test_a_dam_break_behind_a_gate_on_a_sensor_of_90_mm(world):
    """Beside Buchner 2002, whose clock is not that of our gate: rms is 0.049 to 0.054 where both pass 0.2 rho g H at
    once, 0.144 to 0.153 by the clock of the gate. The case, whose plateau is +4.4 %, and three seeds, with +5.4, +5.0
    and +4.2 %: of these the mean is held. Gates of 4 and 6 m/s have peaks of 0.58 to 0.62 and 0.57, of 1.5 m/s 0.79.
    """
    known, rise, plateaus = experiments.BUCHNER_PRESSURE.T, experiments.PRESSURE_RISE, []
    highest = known[1][known[0] < 3.3].max()
    seeds = [("fluid[0].disorder=0.1", f"simulation.random_seed={seed}") for seed in (1, 2, 3)]
    for sets in [(), *seeds]:
        done, t, read = read_by_buchners_sensor(world, *sets)
        peak = told("sensor behind a gate: peak over measured - 1", read[t < 3.3].max() / highest - 1, "10 %")
        plateau, rms = beside_buchner(t, read)
        assert abs(peak) < 0.1 and rms < 0.18 and read.min() > (-0.3 if sets else -0.05)
        plateaus.append(plateau)
        late = told("sensor: later than measured, sqrt(H/g)", experiments.passing(t, read, rise)
                    - experiments.passing(*known, rise), "unknown")  # fmt: skip
        _, rms = beside_buchner(t - late, read)
        assert rms < 0.12 and highest_gap(done) < 0.5
    assert abs(plateaus[0]) < 0.05 and abs(np.mean(plateaus[1:])) < 0.05


@pytest.mark.parametrize(
    ("case", "most"),
    [
        ("column-impact-a", {"peak": 0.2, "plateau": 0.1, "impulse": 0.05}),
        ("column-impact-printed", {"peak": 0.2, "plateau": 0.15, "impulse": 0.05}),
    ],
)
def test_the_force_of_the_wave_on_the_column(world, case, most):
    """Case A of (SC) beside Yeh & Petroff, whose clock is 0.068 s late for that of our case F (5 mm), by our scheme and
    by the printed one, whose peak is 8 % low and whose plateau 10 % high. Measured: see the table of
    scripts/column_impact.py.
    """
    done = Done(world, case, "simulation.end_time=1.3", period=0.0005)
    found = experiments.column_figures(done.t, done.series("impulse_column_x"))
    for name, value in found.items():
        told(f"{case}: {name}", value, f"{experiments.COLUMN_FIGURES[name]:g} measured")
    assert abs(found["arrival"] - experiments.COLUMN_FIGURES["arrival"]) < 0.02
    lost = done.series("energy_total")
    assert np.all(np.diff(lost) < 1e-3 * lost[0])  # no scheme gives energy to the water, in 0.5 ms nor at all
    off = {name: found[name] / experiments.COLUMN_FIGURES[name] - 1 for name in most}
    missed = [name for name, within in most.items() if abs(off[name]) >= within]
    if case == "column-impact-a" and missed == ["impulse"] and off["impulse"] > -0.08:
        pytest.xfail("repulsive walls pull at their edges: impulse -6.2 %; extrapolated ones have +1 %")
    assert not missed, off


SECOND_MODE = """
simulation = {{ dimensions = 2; end_time = 4.0; }};
gravity = [0.0, -9.81];
fluid = ( {{ shape = {{ box = {{ low = [0.0, 0.0]; high = [1.0, 0.5]; }}; }};
    flow = {{ type = "standing-wave"; amplitude = 0.02; wavelength = 1.0; }}; }} );
numerics = {{ spacing = 0.0125; {smoothing} }};
wall = ( {{ shape = {{ box = {{ low = [0.0, 0.0]; high = [1.0, 0.7]; open = ["y+"]; }}; }}; }} );
gauge = ( {{ name = "side"; what = "elevation"; at = [0.02, 0.0]; }} );
output = {{ period = {{ series = 0.01; }}; }};
"""


@pytest.mark.parametrize(("smoothing", "error"), [("", -0.006), ("smoothing = 1.3;", -0.043)])
def test_waves_in_a_tank_have_their_period_unless_neighbours_are_few(world, smoothing, error):
    """Two half waves in a tank: omega^2 = g k tanh k H. By default within 1 %; h/dp 1.3 is 4 % off at any spacing."""
    done = Done(world, SECOND_MODE.format(smoothing=smoothing), period=0.01)
    k = 2 * np.pi
    omega = np.sqrt(9.81 * k * np.tanh(k * 0.5))
    first = 0.02, 0.1, omega, 0.0, 0.5

    (_, damping, found, *_), _ = curve_fit(decaying, done.t, done.series("side"), first)
    told(f"second mode of a tank, {smoothing or 'default h/dp'} period over theory - 1", omega / found - 1, "1 %")
    told("... damping, 1/s", damping, "")
    assert omega / found - 1 == pytest.approx(error, abs=0.006)


VISCOUS_WAVE = """
simulation = {{ dimensions = 2; end_time = 3.0; }};
domain = {{ low = [0.0, 0.0]; high = [1.0, 1.2]; periodic = ["x"]; }};
gravity = [0.0, -9.81];
fluid = ( {{ shape = {{ box = {{ low = [0.0, 0.0]; high = [1.0, 1.0]; }}; }}; kinematic_viscosity = 5e-3;
            flow = {{ type = "standing-wave"; amplitude = 0.03; wavelength = 1.0; }}; }} );
numerics = {{ spacing = 0.025; viscosity_form = "{form}"; }};
wall = ( {{ shape = {{ box = {{ low = [0.0, 0.0]; high = [1.0, 1.2]; open = ["x-", "x+", "y+"]; }}; }};
           type = "extrapolated-free-slip"; }} );
gauge = ( {{ name = "crest"; what = "elevation"; at = [0.0, 0.0]; }} );
output = {{ period = {{ series = 0.01; }}; }};
"""


@pytest.mark.parametrize(("form", "damped"), [("full-stress", 0.97), ("morris", 0.52), ("cleary", 1.12)])
def test_a_viscous_wave_is_damped(world, form, damped):
    """Rate over that of linear theory (Lamb 349): the root n of (n + 2 nu k2)2 + g k = 4 nu^1.5 k3 (n + nu k2)^0.5."""
    done = Done(world, VISCOUS_WAVE.format(form=form), period=0.01)
    k, nu = 2 * np.pi, 5e-3
    s = np.roots([1, 0, 2, -4, 1 + 9.81 * k / (nu * k * k) ** 2])  # n + nu k2 = nu k2 s2
    rates = [-(nu * k * k * (z * z - 1)).real for z in s if z.real > 0]

    late = done.t > 0.3
    first = 0.03, rates[0], np.sqrt(9.81 * k), 0.0, 1.0
    (_, found, *_), _ = curve_fit(decaying, done.t[late], done.series("crest")[late], first)
    assert told(f"viscous wave, {form}: damping over theory", found / rates[0], "1") == pytest.approx(damped, abs=0.03)
