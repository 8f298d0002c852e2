"""Figures are made from real runs, and what a run does not hold is said."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from figure_texts import unreadable
from matplotlib import colormaps

import sph
from hpcpic.core.app.figures import NoData, save
from hpcpic.core.files.reader import open_run
from hpcpic.core.files.series import Series
from sph.analysis import experiments, particle_plots, plots, render, theory
from sph.analysis.plots import PLOTS
from sph.app import shipped_cases
from sph.setup.channel import channel_of

SHORT = {
    "water-column": {"numerics.spacing": 0.0146, "simulation.end_time": 0.06, "output.pictures": [0.06]},
    "column-impact-a": {"numerics.spacing": 0.018, "simulation.end_time": 0.006},
}
PERIODS = {"output.period.series": 0.002, "output.period.particles": 0.03}
EXPECTED = {
    "water-column": {"sequence", "energies", "front", "depth", "step", "timers"},
    "column-impact-a": {"sequence", "energies", "forces", "impulses", "depth", "step", "timers"},
}


def run_of(name, folder, changes):
    sph.Case(name).changed(changes).run(folder, threads=1, quiet=True)
    return open_run(folder)


@pytest.mark.parametrize(
    "name", ["water-column", pytest.param("column-impact-a", marks=pytest.mark.validation)]
)  # another kind of scene to compile
def test_figures_of_a_run(name, tmp_path):
    run, made = run_of(name, tmp_path / "run", SHORT[name] | PERIODS), set()
    for what, plot in PLOTS.items():
        try:
            figure = plot.make(run, None)
            save(figure, tmp_path / f"{what}.png")
        except NoData as reason:
            assert str(reason)
            continue
        assert (tmp_path / f"{what}.png").stat().st_size > 4000
        assert not unreadable(figure)
        made.add(what)
    assert made == EXPECTED[name], "EXPECTED, above, names the figures that this run has"
    assert particle_plots.chosen(run, run.particle_snapshots)[0] == 0
    steps = PLOTS["sequence"].steps(run)
    assert len(steps) >= 2
    save(PLOTS["sequence"].make(run, steps[0]), tmp_path / "one.png")


def test_painted_balls_hide_what_is_behind_them():
    box = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    view = render.View(box, 60)
    eye = view.axes[2]
    near, far = np.array([0.5, 0.5, 0.5]) + 0.3 * eye, np.array([0.5, 0.5, 0.5]) - 0.3 * eye
    colours = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    for order in ([0, 1], [1, 0]):
        image = render.paint(view, np.stack([near, far])[order], colours[order], 0.1)
        painted = image[image[..., 3] > 0]
        assert len(painted) > 20 and np.all(painted[:, 1] == 0.0) and painted[:, 0].max() > 0.4
    edges = render.box_edges(*box)
    assert len(edges) == 12 and all(np.isclose(np.linalg.norm(edge[1] - edge[0]), 1.0) for edge in edges)


def test_the_triangular_filter_keeps_lines_and_impulses_of_uneven_samples():
    t = np.sort(np.random.default_rng(1).uniform(0.0, 1.0, 3000))
    smooth = theory.triangular(t, 3.0 + 2.0 * t)
    inner = (t > 0.02) & (t < 0.98)
    assert np.abs(smooth - 3.0 - 2.0 * t)[inner].max() < 2e-3  # half a gap between samples
    peak = np.exp(-(((t - 0.5) / 0.004) ** 2))
    filtered = theory.triangular(t, peak)
    assert filtered.max() < 0.75
    areas = [np.trapezoid(values, t) for values in (peak, filtered)]
    assert areas[1] == pytest.approx(areas[0], rel=0.03)


def test_the_filter_makes_a_triangle_13_ms_wide_of_a_spike():
    t = 1e-4 * np.arange(-200, 201)
    found = theory.triangular(t, (t == 0.0).astype(float))
    np.testing.assert_allclose(found, np.maximum(0.0, 1 - np.abs(t) / 6.5e-3) * 1e-4 / 6.5e-3, atol=1e-12)


def one_snapshot(monkeypatch, particles, t):
    """Figures of particles find these of the fluid, at one time, and none of walls."""
    monkeypatch.setattr(particle_plots, "fluid_at", lambda *_, **__: particles)
    only = SimpleNamespace(times=np.array([t]), steps=np.array([7]), species=(), index=lambda step: 0,
                           positions=lambda names, _: particles["position"][: len(names) * 3])  # fmt: skip
    monkeypatch.setattr(particle_plots, "snapshots_of", lambda _: only)


def case_of(name):
    return SimpleNamespace(config=shipped_cases()[name].read_text(), config_file="case")


THREE = {  # of three pressures in a plane, of three speeds in space
    "position": np.array([[0.05, 0.02, 0.1], [0.3, 0.25, 0.2], [0.5, 0.1, 0.3]]),
    "pressure": np.array([200.0, 1000.0, 500.0]),
    "density": np.array([1001.0, 1002.0, 1003.0]),
    "velocity": np.array([[3.0, 0.0, 0.0], [0.0, 4.0, 3.0], [0.5, -1.0, 1.0]]),
}


def test_particles_are_drawn_where_they_are_in_the_colour_of_their_pressure(monkeypatch):
    """MP figures 2 to 5."""
    one_snapshot(monkeypatch, THREE, 0.3)
    axes, bar = particle_plots.sequence(case_of("water-column"), 7).axes
    dots = axes.collections[-1]
    np.testing.assert_array_equal(dots.get_offsets(), THREE["position"][:, :2])
    np.testing.assert_array_equal(dots.get_array(), THREE["pressure"])
    assert dots.get_clim() == bar.get_ylim() == pytest.approx((0.0, 990.0))  # but for one in a hundred
    assert axes.get_title(loc="left") == "t = 0.3 s" and bar.get_ylabel() == "pressure, Pa"
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x, m", "y, m")
    assert axes.get_xlim()[0] < 0.0 < 0.5 < axes.get_xlim()[1] and axes.get_ylim()[0] < 0.0 < 0.25 < axes.get_ylim()[1]


def test_gases_are_dots_beside_liquids(monkeypatch):
    places = {"water": np.array([[0.1, 0.2, 0.0]]), "air": np.array([[0.4, 0.5, 0.0], [0.8, 0.3, 0.0]])}
    rows = {name: {"id": np.arange(len(x)), "position": x, "pressure": np.full(len(x), 900.0)}
            for name, x in places.items()}  # fmt: skip
    none = np.zeros((0, 3))
    snapshots = SimpleNamespace(times=np.array([0.3]), steps=np.array([7]), species=("water", "air"),
                                index=lambda step: 0, read=lambda name, number: rows[name],
                                positions=lambda names, _: np.concatenate([none, *map(places.get, names)]))  # fmt: skip
    monkeypatch.setattr(particle_plots, "snapshots_of", lambda _: snapshots)
    run = case_of("dam-break-air")
    assert len(particle_plots.fluid_at(run, snapshots, 0)["id"]) == 3
    *_, dots, painted = particle_plots.sequence(run, 7).axes[0].collections
    np.testing.assert_array_equal(dots.get_offsets(), places["air"][:, :2])
    np.testing.assert_array_equal(painted.get_offsets(), places["water"][:, :2])


def test_a_second_liquid_has_smaller_dots(monkeypatch):
    """Colours are those of the pressure, which tells no liquid from another."""
    rows = {name: {"id": np.arange(n), "position": np.full((n, 3), 0.1), "pressure": np.full(n, 900.0)}
            for name, n in (("water", 2), ("oil", 3))}  # fmt: skip
    snapshots = SimpleNamespace(times=np.array([0.3]), steps=np.array([7]), species=("water", "oil"),
                                index=lambda step: 0, read=lambda name, number: rows[name],
                                positions=lambda names, _: np.zeros((1, 3)))  # fmt: skip
    monkeypatch.setattr(particle_plots, "snapshots_of", lambda _: snapshots)
    text = shipped_cases()["interfacial-wave"].read_text()
    for other, small in ((text, True), (text.replace("500.0", "1000.0"), False)):
        run = SimpleNamespace(config=other, config_file="case")
        sizes = particle_plots.sequence(run, 7).axes[0].collections[-1].get_sizes()
        assert sizes.max() == sizes[0] and (len(sizes) == 5 and bool(np.all(sizes[2:] < 0.5 * sizes[0]))) == small


def test_particles_in_space_are_painted_in_the_colour_of_their_speed(monkeypatch):
    """SC figure 2."""
    one_snapshot(monkeypatch, THREE, 0.3)
    given, paint = [], render.paint
    monkeypatch.setattr(render, "paint", lambda view, *rest: given.append(rest) or paint(view, *rest))
    bar = particle_plots.sequence(case_of("column-impact-a"), 7).axes[-1]
    ((x, colours, _),) = given
    speed = np.array([3.0, 5.0, 1.5])
    np.testing.assert_array_equal(x[:3], THREE["position"])
    np.testing.assert_allclose(colours[:3], colormaps["viridis"](speed / bar.get_ylim()[1])[:, :3])
    assert bar.get_ylim() == pytest.approx((0.0, np.quantile(speed, 0.995))) and bar.get_ylabel() == "speed, m/s"


def test_a_picture_in_space_has_x_to_the_right_and_z_upwards():
    view = render.View(np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]), 100)
    right, up, depth = np.diff(view.project(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])), axis=0)[0]
    assert right > 60 and up < 0 < depth  # x+ is nearer to the eye, which looks down
    right, up, _ = np.diff(view.project(np.array([[0.5, 0.5, 0.0], [0.5, 0.5, 1.0]])), axis=0)[0]
    assert right == pytest.approx(0.0, abs=1e-9) and up > 60
    assert np.linalg.det(view.axes) == pytest.approx(1.0)  # no picture in a mirror


BLOW, BLOW_AT = 0.65, 0.20005  # N s, s


def run_with_a_blow(step=1e-4):
    """Column impact: 4 N along x with a blow in one of the steps of 0.1 ms; of abs(F) 10 N all the time."""
    t = step * np.arange(round(0.3 / step))
    along = 4.0 * t + BLOW * (t > BLOW_AT)
    columns = {"impulse_column": 10.0 * t, "impulse_column_x": along}
    units = {"impulse_column": "N s", "force_column_x": "N"}
    run = case_of("column-impact-a")
    run.series = Series(columns, units, np.arange(len(t)), t)
    return run


def test_forces_are_rates_of_the_impulse_and_their_mean_over_13_ms_beside_the_experiment():
    """SC figures 3 and 4."""
    raw, smooth, measured = plots.forces(run_with_a_blow()).axes[0].lines
    t = 1e-4 * (np.arange(2999) + 0.5)
    np.testing.assert_allclose(raw.get_data(), [t, 4.0 + BLOW / 1e-4 * np.isclose(t, BLOW_AT)], rtol=1e-6)
    triangle = np.maximum(0.0, 1.0 - np.abs(t - BLOW_AT) / 6.5e-3) / 6.5e-3
    np.testing.assert_allclose(smooth.get_data(), [t, 4.0 + BLOW * triangle], rtol=1e-3)
    at, force = measured.get_data()
    np.testing.assert_allclose([at + experiments.COLUMN_SHIFT, force], experiments.COLUMN_FORCE.T, atol=1e-12)


@pytest.mark.parametrize("step, filtered", [(6e-3, True), (7e-3, False), (1e-2, False)])
def test_forces_have_no_filter_that_holds_one_sample(step, filtered):
    """Half of 13 ms on either side reaches the next sample, or none."""
    lines = plots.forces(run_with_a_blow(step)).axes[0].lines
    assert ("13 ms filter" in [line.get_label() for line in lines]) == filtered
    t, force = lines[0].get_data()
    np.testing.assert_allclose(force, 4.0 + BLOW / step * np.isclose(t, BLOW_AT, atol=step / 2), rtol=1e-6)


def test_impulses_are_those_along_x_and_of_the_size_of_the_force_beside_the_experiment():
    """The measured one grows by the measured force."""
    run = run_with_a_blow()
    along, size, measured = plots.impulses(run).axes[0].lines
    for line, name in ((along, "impulse_column_x"), (size, "impulse_column")):
        np.testing.assert_array_equal(line.get_data(), [run.series.time, run.series[name]])
    t, impulse = measured.get_data()
    at, force = experiments.COLUMN_FORCE.T
    np.testing.assert_allclose(t + experiments.COLUMN_SHIFT, at, atol=1e-12)
    np.testing.assert_allclose(np.diff(impulse) / np.diff(t), (force[1:] + force[:-1]) / 2, atol=1e-9)
    assert impulse[0] == 0.0


def test_the_figures_of_the_column_are_those_of_a_known_force():
    """By the clock of the experiment: a triangle of 40 N and 0.1 s from 0.35 s, 17 N from 0.5 to 0.8 s, 5 N from 1.2 s.
    The filter takes a third of its half width off the tip; the run has its own clock, and may end early.
    """
    clock = np.arange(0.0, 1.5, 1e-5)
    force = np.maximum(0.0, 40.0 - 800.0 * np.abs(clock - 0.4))
    force += 17.0 * ((clock > 0.5) & (clock < 0.8)) + 5.0 * (clock > 1.2)
    t, impulse = (clock - experiments.COLUMN_SHIFT)[::50], theory.cumulative(clock, force)[::50]
    found = experiments.column_figures(t, impulse)
    assert found["peak"] == pytest.approx(40.0 - 800.0 * 6.5e-3 / 3, rel=3e-3)  # samples at every half ms
    assert found["arrival"] == pytest.approx(0.36, abs=1e-5)
    assert found["plateau"] == pytest.approx(17.0, rel=1e-6)
    assert found["impulse"] == pytest.approx(2.0 + 17.0 * 0.3 + 0.5, rel=1e-4)
    early = experiments.column_figures(t[clock[::50] < 0.7], impulse[clock[::50] < 0.7])
    assert np.isnan(early["plateau"]) and np.isnan(early["impulse"]) and early["peak"] == found["peak"]
    measured = {"peak": 33.3, "arrival": 0.355, "plateau": 17.6, "impulse": 13.1}  # as the case tells
    assert measured == pytest.approx(experiments.COLUMN_FIGURES, rel=5e-3)


def test_the_drawn_profiles_are_the_parabola_and_its_stress(monkeypatch):
    """Of steady Poiseuille flow: v / v_max = 4 z/L (1 - z/L); mu epsilon (MP 22) / (rho F L / 2) = 1 - 2 z/L."""
    width, force, nu = 1e-3, 2e-4, 1e-6
    x, z = (
        np.array(one).ravel()
        for one in np.meshgrid((np.arange(10) + 0.5) / 40 * width, (np.arange(40) + 0.5) / 40 * width)
    )
    along, full = force / (2 * nu) * z * (width - z), np.full(400, 1000.0)
    particles = {"position": np.stack([x, z], axis=1), "velocity": np.stack([along, 0 * z], axis=1)}
    particles |= {"mass": full * (width / 40) ** 2, "density": full}
    one_snapshot(monkeypatch, particles, 5.0)  # s: after five times L2 / nu
    figure = particle_plots.profiles(case_of("poiseuille"), 0)
    near = 0.05  # the lattice, and images in the planes, where the stress has a kink
    for axes, exact, error in zip(figure.axes, (lambda y: 4 * y * (1 - y), lambda y: 1 - 2 * y), (1e-9, near)):
        assert len(axes.lines) == 2  # of particles, of the series
        for line, tolerance in zip(axes.lines, (error, 1e-9)):
            np.testing.assert_allclose(line.get_xdata(), exact(np.array(line.get_ydata())), atol=tolerance)


def test_the_stress_of_a_shear_across_a_channel_counts_too():
    """Of v = (0, sin k x) with k of one period: rho nu dv_z/dx, but for what the kernel smooths and images undo."""
    x, z = (np.array(one).ravel() * 2.5e-5 for one in np.meshgrid(np.arange(10) + 0.5, np.arange(40) + 0.5))
    k, full = 2 * np.pi / 2.5e-4, np.full(400, 1000.0)
    particles = {"position": np.stack([x, z], axis=1), "velocity": np.stack([0 * x, np.sin(k * x)], axis=1)}
    particles |= {"mass": full * 2.5e-5**2, "density": full}
    config = particle_plots.config_of(case_of("poiseuille"))
    found = particle_plots.shear_stress(config, channel_of(config), particles) / (1e-3 * k)
    inner = np.abs(z - 5e-4) < 4e-4
    np.testing.assert_allclose(found[inner], np.cos(k * x)[inner], atol=0.1)


def test_the_series_of_poiseuille_flow_starts_at_rest_and_ends_steady():
    z = np.linspace(0.0, 1e-3, 41)
    assert np.abs(theory.poiseuille(z, 0.0, 2e-4, 1e-6, 1e-3)).max() < 1e-9
    assert theory.poiseuille(z, 10.0, 2e-4, 1e-6, 1e-3).max() == pytest.approx(2.5e-5, rel=1e-9)
    assert theory.poiseuille(np.array([2.5e-4]), 0.045, 2e-4, 1e-6, 1e-3)[0] == pytest.approx(7.0361e-6, rel=1e-5)
    slope = np.gradient(theory.poiseuille(z, 0.1, 2e-4, 1e-6, 1e-3), z) * 1e-3
    assert np.allclose(slope[1:-1], theory.poiseuille_stress(z, 0.1, 2e-4, 1e-6, 1e-3, 1000.0)[1:-1], atol=3e-7)


def test_the_ellipse_keeps_its_area_and_waves_their_relation():
    a, b = theory.drop_axes(np.array([0.0, 0.0038, 0.0076]), 100.0, 1.0)
    assert np.allclose(a * b, 1.0, rtol=1e-6) and b[-1] == pytest.approx(1.94452, rel=1e-5)
    k = theory.wave_number(5.0, 0.7, 9.81)
    assert theory.wave_frequency(k, 0.7, 9.81) == pytest.approx(5.0, rel=1e-12)
    assert 2 * np.pi / theory.wave_frequency(np.pi, 1.0, 9.81) == pytest.approx(1.13392, rel=1e-5)


def test_the_clock_of_an_experiment_behind_a_gate_is_laid_beside_that_of_the_run():
    """A run that reads the experiment 50 ms later lies on it; where nothing rises the experiment stays as it is."""
    known = experiments.BUCHNER_PRESSURE.T * [[math.sqrt(0.6 / 9.81)], [1000 * 9.81 * 0.6]]
    t = np.arange(0.0, 1.4, 1e-3)
    for read, words in ((np.interp(t - 0.05, *known), "Buchner 2002, 50 ms later"), (0 * t, "Buchner 2002")):
        run = case_of("dam-break-sensor")
        run.series = Series({"sensor_1": read}, {"sensor_1": "Pa"}, np.arange(len(t)), t)
        line, measured = plots.gauges(run).axes[0].lines
        np.testing.assert_array_equal(line.get_ydata(), read)
        assert measured.get_label() == "experiment: " + words
        late = 0.05 * read.any()
        times, pressure = measured.get_data()
        np.testing.assert_allclose(times - known[0], late, atol=1e-5)
        np.testing.assert_allclose(pressure, known[1])


def test_measurements_are_in_order_of_time():
    for table in (experiments.KOSHIZUKA_FRONT, experiments.COLUMN_FORCE):
        assert np.all(np.diff(table[:, 0]) > 0)
    t, force = experiments.COLUMN_FORCE.T
    assert force.max() == 33.3 and np.trapezoid(force[t < 1.3], t[t < 1.3]) == pytest.approx(13.1, rel=0.01)


def test_a_point_goes_with_the_rigid_body_that_holds_it():
    rng = np.random.default_rng(3)
    for plane in (False, True):
        x, point, shift = rng.normal(size=(40, 3)), rng.normal(size=3), rng.normal(size=3)
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        turn *= np.sign(np.linalg.det(turn))
        if plane:
            c, s = np.cos(2.0), np.sin(2.0)
            turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
            x[:, 2] = 0.0
        found = particle_plots.moved(point, x, x @ turn.T + shift)
        np.testing.assert_allclose(found, turn @ point + shift, atol=1e-12)


BODY_IN_SPACE = """
simulation = { dimensions = 3; end_time = 0.2; };
gravity = [0.0, 0.0, -9.81];
fluid = ( { name = "water"; shape = { box = { low = [0.0, 0.0, 0.0]; high = [0.4, 0.4, 0.1]; }; }; } );
numerics = { spacing = 0.03; };
wall = (
  { name = "tank"; shape = { box = { low = [0.0, 0.0, 0.0]; high = [0.4, 0.4, 0.6]; open = ["z+"]; }; }; },
  { name = "ball"; shape = { sphere = { centre = [0.2, 0.2, 0.45]; radius = 0.06; }; }; solid = true;
    body = { density = 500.0;
      mooring = ( { at = [0.2, 0.2, 0.51]; anchor = [0.2, 0.2, 0.59]; stiffness = 1.0; length = 1.0; } ); }; }
);
output = { period = { particles = 0.1; }; };
"""


def test_bodies_in_space_are_painted_where_they_are(tmp_path):
    case = tmp_path / "ball.conf"
    case.write_text(BODY_IN_SPACE)
    run = run_of(case, tmp_path / "run", {})
    snapshots = run.particle_snapshots
    for number in range(len(snapshots.times)):
        for names in (["water"], ["water", "ball"], ["ball"], []):
            whole = np.concatenate([np.zeros((0, 3)), *(snapshots.read(name, number)["position"] for name in names)])
            found = snapshots.positions(names, number)
            np.testing.assert_array_equal(np.sort(found, axis=0), np.sort(whole, axis=0))
    t = snapshots.times[-1]
    (ends,) = particle_plots.moorings_at(run, snapshots, len(snapshots.times) - 1)
    fallen = 9.81 * t * t / 2  # freely: a long line does not pull
    np.testing.assert_allclose(ends[0], (0.2, 0.2, 0.51 - fallen), atol=0.002)  # a hundredth of the way
    np.testing.assert_allclose(ends[1], (0.2, 0.2, 0.59))
    assert [axes.get_ylabel() for axes in plots.bodies(run).axes] == ["way from the start, m", "angle, rad"]
    orange = []
    for number in (0, len(snapshots.times) - 1):
        figure = particle_plots.sequence(run, int(snapshots.steps[number]))
        image = figure.axes[0].images[0].get_array()
        hue = (image[..., 3] > 0) & (image[..., 0] > 1.5 * image[..., 2]) & (image[..., 0] > image[..., 1])
        orange.append(np.argwhere(hue)[:, 0].mean())
        assert hue.sum() > 100
    assert orange[1] > orange[0] + 20  # rows downwards
