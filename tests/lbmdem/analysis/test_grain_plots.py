"""Figures of many grains, on a bed of discs across a periodic side."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from figure_texts import unreadable
from matplotlib import colormaps
from matplotlib.collections import LineCollection, PatchCollection
from matplotlib.colors import to_rgba

import lbmdem
from hpcpic.core.app.figures import COLOURS, NoData
from hpcpic.core.files.reader import open_run
from lbmdem.analysis import grain_plots
from lbmdem.analysis.grain_plots import all_grains, config_of, touching, with_images
from lbmdem.analysis.plots import PLOTS
from lbmdem.app import shipped_cases

BED = """
simulation = { end_time = 0.002; random_seed = 2; };
domain = { size = [0.012, 0.012]; spacing = 1.5e-4; periodic = ["x"]; };
fluid = { viscosity = 1.0e-5; relaxation_time = 0.62; };
obstacle = ({ shape = { plane = { point = [0.0, -1.0e-4]; normal = [0.0, 1.0]; }; }; });
grains = ({ diameters = { min = 1.5e-3; max = 2.0e-3; count = 20; }; packing = { low = 1.5e-4; }; });
contact = { normal_stiffness = 1.5e4; damping = 0.5; tangential = "history"; friction = 0.4; };
gravity = [0.0, -9.81];
output = { period = { series = 0.001; fields = 0.001; grains = 0.001; }; };
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bed")
    (folder / "bed.conf").write_text(BED)
    lbmdem.Case(folder / "bed.conf").run(folder / "run", threads=1, quiet=True)
    return open_run(folder / "run")


def test_the_words_of_all_figures_can_be_read(run):
    """Of a square box too, whose labels were cut off."""
    for what in ("flow", "grains", "contacts"):
        assert not unreadable(PLOTS[what].make(run, None)), what


def test_grains_that_reach_over_a_periodic_side_are_seen_on_both(run):
    columns = all_grains(run, int(run.particle_snapshots.steps[-1]))
    x, r = columns["position"][:, 0], columns["radius"]
    over = int((x < r).sum() + (x > 0.012 - r).sum())
    figure = PLOTS["grains"].make(run, None)
    axes, bar = figure.axes[-2:]
    drawn = next(some for some in axes.collections if isinstance(some, PatchCollection))
    assert over > 0 and len(drawn.get_paths()) == 20 + over
    assert len(axes.patches) == 1  # the plane
    speeds = [np.linalg.norm(all_grains(run, int(s))["velocity"], axis=1) for s in run.particle_snapshots.steps]
    colours = colormaps["viridis"](speeds[-1] / np.max(speeds))
    assert bar.get_ylabel() == "speed, m/s" and np.allclose(drawn.get_facecolor()[:20], colours)


def test_the_lines_of_discs_are_diameters_that_turn_with_them(run, monkeypatch):
    """The line of the first disc lies along x, that of the second along y, that of the third halfway between."""
    x = np.array([[0.004, 0.004], [0.008, 0.004], [0.006, 0.008]])
    discs = {"id": np.arange(3), "position": x, "radius": np.full(3, 1e-3), "angle": np.array([0.0, 0.5, 0.25]) * np.pi}
    monkeypatch.setattr(grain_plots, "all_grains", lambda run, step: discs)
    axes = grain_plots.grains(run, int(run.particle_snapshots.steps[0])).axes[-1]
    drawn = next(some for some in axes.collections if isinstance(some, LineCollection)).get_segments()
    half = 1e-3 * np.array([[1.0, 0.0], [0.0, 1.0], [np.sqrt(0.5), np.sqrt(0.5)]])
    np.testing.assert_allclose(drawn, np.stack([x - half, x + half], axis=1), atol=1e-15)


@pytest.mark.parametrize(("case", "up"), [("settling-disc", 1), ("quick-condition", 2)])
def test_grains_are_drawn_where_they_are_with_their_radii(monkeypatch, case, up):
    """Of one snapshot and of all; spheres as seen from y, the nearest last; lines of discs turn (figure 5)."""
    run = SimpleNamespace(config=shipped_cases()[case].read_text(), config_file="case")
    size = np.array(config_of(run).domain.size)
    x = np.pad(np.array([[0.3, 0.4, 0.2], [0.6, 0.5, 0.8]])[:, : len(size)] * size, ((0, 0), (0, 3 - len(size))))
    seen = []
    for number in range(3):
        some = {"id": np.arange(2), "position": x + 0.02 * number * size[0] * np.eye(3)[up], "velocity": 0 * x}
        seen.append(some | {"radius": np.array([0.05, 0.1]) * size[0], "angle": np.array([0.3, -0.4]) * number})
    snapshots = SimpleNamespace(steps=np.array([0, 10, 20]), times=np.array([0.0, 0.1, 0.2]), index=lambda step: 1)
    monkeypatch.setattr(grain_plots, "snapshots_of", lambda _: snapshots)
    monkeypatch.setattr(grain_plots, "all_grains", lambda _, step: seen[step // 10])
    for step, numbers in ((10, [1]), (None, [0, 1, 2])):
        for axes, number in zip(grain_plots.grains(run, step).axes, numbers, strict=True):
            order = [0, 1] if up == 1 else [1, 0]
            circles = next(some for some in axes.collections if isinstance(some, PatchCollection))
            boxes = [circle.get_extents() for circle in circles.get_paths()]
            place, r = seen[number]["position"][order][:, [0, up]], seen[number]["radius"][order]
            np.testing.assert_allclose([(box.x0 + box.x1, box.y0 + box.y1) for box in boxes], 2 * place, rtol=1e-9)
            np.testing.assert_allclose([(box.width, box.height) for box in boxes], 2 * np.stack([r, r], axis=1))
            np.testing.assert_allclose(circles.get_facecolor(), [to_rgba(COLOURS[k]) for k in order])
            lines = [some.get_segments() for some in axes.collections if isinstance(some, LineCollection)]
            assert len(lines) == (up == 1)
            if lines:
                ways = np.diff(lines[0], axis=1)[:, 0]
                np.testing.assert_allclose(np.arctan2(ways[:, 1], ways[:, 0]), seen[number]["angle"], atol=1e-9)
            screens = [line.get_ydata()[0] for line in axes.get_lines()]
            assert screens == ([] if up == 1 else [config_of(run).grains[0].packing.low])
            assert axes.get_title(loc="left") == f"{snapshots.times[number]:.3g} s"
            assert axes.get_xlim() == (0.0, size[0]) and axes.get_ylim() == (0.0, size[-1])


def test_the_contacts_that_are_drawn_are_those_of_the_run(run):
    """As many between grains and with the floor as the grains' own dynamics counts, across the periodic side too."""
    columns, config = all_grains(run, int(run.particle_snapshots.steps[-1])), config_of(run)
    images = with_images(columns, config, float(columns["radius"].max()))
    ends, overlap, share, neighbours = touching(images, config, 20)
    on_floor = int((columns["position"][:, 1] - columns["radius"] < 1.5e-4).sum())
    assert on_floor > 3 and share.sum() == run.series["contact_count"][-1] == 0.5 * neighbours + on_floor
    assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).max() < 2.0e-3
    assert 0.0 < 0.5 * overlap.max() / 1.0e-3 <= run.series["overlap"][-1]  # over the largest diameter, the smaller


def test_what_a_run_warns_of_is_kept_with_it(run):
    """In its log and its summary, as the making of the packing is: not only on the screen."""
    said = (run.path / "log.txt").read_text()
    assert "of the links have no room for their wall rule" in said and "packing" in said
    assert any(
        "of the links have no room" in text for text in json.loads((run.path / "run.json").read_text())["warnings"]
    )


SILO = """
simulation = { end_time = 1.0e-4; };
domain = { size = [0.006, 0.03]; };
grains = ({ diameters = { min = 0.9e-3; max = 1.1e-3; count = 120; }; packing = { porosity = 0.2; }; });
contact = { normal_stiffness = 1.0e5; };
gravity = [0.0, -9.81];
output = { period = { series = 1.0e-4; grains = 1.0e-4; }; };
"""


def test_the_title_of_contacts_in_a_tall_box_fits(tmp_path):
    """The axes of a tall box are narrow, and their title was as wide as the figure to the right of their left edge."""
    lbmdem.Case(config_file(tmp_path, SILO)).run(tmp_path / "run", quiet=True, force=True)
    figure = PLOTS["contacts"].make(open_run(tmp_path / "run"), None)
    assert not unreadable(figure)
    figure.draw_without_rendering()
    title, whole = figure._suptitle.get_window_extent(), figure.bbox
    assert whole.x0 <= title.x0 and title.x1 <= whole.x1


def config_file(folder, text):
    (folder / "silo.conf").write_text(text)
    return folder / "silo.conf"


def test_a_run_without_snapshots_of_grains_names_their_file(tmp_path):
    text = SILO.replace("grains = 1.0e-4;", "")
    lbmdem.Case(config_file(tmp_path, text)).run(tmp_path / "run", quiet=True, force=True)
    with pytest.raises(NoData, match=r"grains\.vtkhdf"):
        PLOTS["contacts"].make(open_run(tmp_path / "run"), None)
