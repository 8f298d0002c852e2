"""Figures are made from real runs, and what a run does not hold is said."""

import functools

import numpy as np
import pytest
from figure_texts import unreadable
from matplotlib import pyplot

import lbmdem
from hpcpic.core.app.figures import NoData, save
from hpcpic.core.files.reader import open_run
from lbmdem.analysis import grain_plots
from lbmdem.analysis.plots import PLOTS, _cut_the_start_off, config_of

SHORT = {
    "settling-disc": {"domain.spacing": 4e-4, "simulation.end_time": 0.2, "output.period.fields": 0.1},
    "poiseuille": {"simulation.end_time": 0.3},
    "slide-to-roll": {"simulation.end_time": 0.004},
    "restitution": {"gravity": [0.0, 0.0, -9.81]},  # no friction ends sliding
    "sphere-array": {"domain.spacing": 1.61199e-5, "simulation.end_time": 0.004, "output.period.fields": 0.004},
}
ALWAYS = {"energies", "timers"}
EXPECTED = {
    "settling-disc": ALWAYS | {"flow", "grains", "tracks", "mass"},
    "poiseuille": ALWAYS | {"flow", "profile", "mass"},
    "slide-to-roll": ALWAYS | {"grains", "tracks", "rolling"},
    "restitution": ALWAYS | {"grains", "tracks"},
    "sphere-array": ALWAYS | {"flow", "permeability", "forces", "mass"},
}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The run of a case, made once for all tests of it, whatever their order."""

    @functools.cache
    def run_of(name):
        folder = tmp_path_factory.mktemp("runs") / name
        lbmdem.Case(name).changed(SHORT[name]).run(folder, threads=1, quiet=True)
        return open_run(folder)

    return run_of


@pytest.fixture
def run(request, made):
    return made(request.param)


@pytest.mark.parametrize(("run", "expected"), EXPECTED.items(), indirect=["run"])
def test_figures_of_a_run(run, expected, tmp_path):
    made = set()
    for what, plot in PLOTS.items():
        try:
            figure = plot.make(run, None)
        except NoData as reason:
            assert str(reason)
            continue
        save(figure, tmp_path / f"{what}.png")
        assert not unreadable(figure)
        made.add(what)
    assert made == expected, "EXPECTED, above, names the figures that this run has"


@pytest.mark.parametrize("run", ["settling-disc"], indirect=True)
def test_tracks_are_the_grains_of_the_snapshots(run):
    """The disc sinks: its drawn heights are those in the file, and fall."""
    height = next(axes for axes in PLOTS["tracks"].make(run, None).axes if axes.get_ylabel().startswith("height"))
    drawn = np.asarray(height.get_lines()[0].get_ydata())
    assert drawn[0] == pytest.approx(config_of(run).grains[0].position[0][1])
    assert len(drawn) == len(run.particle_snapshots.steps) and np.all(np.diff(drawn) < 0)


@pytest.mark.parametrize("run", ["sphere-array"], indirect=True)
def test_the_force_on_a_sphere_that_stays_is_drawn_as_the_series_has_it(run):
    (axes,) = PLOTS["forces"].make(run, None).axes
    for along, line in zip("xyz", axes.get_lines(), strict=True):
        assert line.get_label() == along
        assert np.array_equal(line.get_ydata(), run.series[f"force_sphere_{along}"])


@pytest.mark.parametrize(("blow", "cut"), [(20.0, True), (2.0, False)])
def test_a_blow_of_the_start_leaves_the_forces_after_it_their_place(blow, cut):
    """All that comes after the first fifth of the time fills half of the figure, which says what it cuts off."""
    t = np.linspace(0.0, 1.0, 101)
    _, axes = pyplot.subplots()
    axes.plot(t, np.where(t < 0.01, blow, np.sin(9.0 * t)))
    axes.plot(t, -0.5 + 0.0 * t)
    _cut_the_start_off(axes)
    low, high = axes.get_ylim()
    assert low < -1.0 and (1.0 < high < 4.0) and (high < blow) == cut
    assert [text.get_text() for text in axes.texts] == (["20 at the start is cut off"] if cut else [])
    pyplot.close()


@pytest.mark.parametrize("run", ["slide-to-roll"], indirect=True)
def test_pictures_of_a_flat_box_stand_two_in_a_line_in_their_order(run, monkeypatch):
    in_one_line = PLOTS["grains"].make(run, None).axes
    monkeypatch.setattr(grain_plots, "FLAT", 2.0 * config_of(run).domain.size[2] / config_of(run).domain.size[0])
    figure = PLOTS["grains"].make(run, None)
    figure.canvas.draw()
    places = [(round(-axes.get_position().y0, 3), axes.get_position().x0) for axes in figure.axes]
    assert [axes.get_title() for axes in figure.axes] == [axes.get_title() for axes in in_one_line]
    assert len(places) > 2 and places == sorted(places) and len({y for y, _ in places}) == (len(places) + 1) // 2
    assert not unreadable(figure)
