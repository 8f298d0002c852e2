"""The table and the picture of the force on the column (SC figures 4 to 10), from runs of a known force."""

import sys
from pathlib import Path

import numpy as np
import pytest

from sph.analysis import experiments, theory

SHIFT = experiments.COLUMN_SHIFT


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[3] / "scripts"))
    import column_impact

    yield column_impact
    for name in ("column_impact", "gallery"):
        sys.modules.pop(name, None)


def test_force_and_impulse_of_each_run_are_drawn_by_the_clock_of_the_experiment(script, monkeypatch, tmp_path):
    made = []
    monkeypatch.setattr(script, "save_small", lambda figure, _: made.append(figure))
    t = 1e-3 * np.arange(1500)
    runs = {"a": (t, 2.0 * t), "c": (t, 1.5 * t**2)}  # 2 N; 3 N/s times the time
    script.draw(runs, tmp_path / "none.png")
    top, low = (axes.lines for axes in made[0].axes)
    for k, (impulse, force) in enumerate(((2.0 * t, 2.0 + 0 * t), (1.5 * t**2, 3.0 * t))):
        np.testing.assert_allclose(low[k].get_data(), [t + SHIFT, impulse], atol=1e-12)
        at, drawn = top[k].get_data()
        np.testing.assert_allclose(at, (t[1:] + t[:-1]) / 2 + SHIFT, atol=1e-12)
        inner = (at > at[7]) & (at < at[-8])  # where the filter is whole
        np.testing.assert_allclose(drawn[inner], np.interp(at - SHIFT, t, force)[inner], rtol=1e-9)
    measured = experiments.COLUMN_FORCE[experiments.COLUMN_FORCE[:, 0] < t[-1] + SHIFT].T
    np.testing.assert_array_equal(top[2].get_data(), measured)
    np.testing.assert_array_equal(low[2].get_data(), [measured[0], theory.cumulative(*measured)])


def test_runs_that_differ_by_their_seed_have_one_colour_and_one_entry_of_the_legend(script, monkeypatch, tmp_path):
    made, t = [], 1e-3 * np.arange(500)
    monkeypatch.setattr(script, "save_small", lambda figure, _: made.append(figure))
    script.draw(dict.fromkeys(("5 mm, seed 1", "8 mm", "5 mm, seed 2"), (t, t)), tmp_path / "none.png")
    top = made[0].axes[0]
    first, other, second = (line.get_color() for line in top.lines[:3])
    assert first == second != other
    assert [text.get_text() for text in top.get_legend().get_texts()][:-1] == ["5 mm", "8 mm"]


def test_a_line_of_the_table_has_no_number_that_a_short_run_lacks(script):
    found = {"peak": 33.26, "arrival": 0.3554, "plateau": np.nan, "impulse": np.nan}
    assert script.line("a", found) == "| a | 33.3 | 0.355 | - | - |"
