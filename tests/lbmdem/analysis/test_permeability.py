"""The lines of Carman and Kozeny in the figures of permeability (figure 3)."""

import importlib.util
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from hpcpic.core.app import figures
from hpcpic.core.case.config import loads
from lbmdem.analysis import plots
from lbmdem.analysis.plots import carman_kozeny
from lbmdem.app import shipped_cases
from lbmdem.configure import configure
from lbmdem.grains import placement

SPEC = importlib.util.spec_from_file_location("permeability", Path(__file__).parents[3] / "scripts/permeability.py")
script = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(script)


def test_the_formula_is_that_of_packed_spheres():
    assert carman_kozeny(0.4) == pytest.approx(9.8765e-4, rel=1e-4)  # 0.064 / (180 * 0.36)
    assert carman_kozeny(0.5) == pytest.approx(1 / 360, rel=1e-12)


def test_the_diameter_of_sauter_is_that_of_volume_over_area():
    """Of spheres of 1 and 2 mm: (1 + 8) / (1 + 4)."""
    spheres = SimpleNamespace(diameters=None, centres=((0, 0, 0), (5, 0, 0)), own_diameters=(1e-3, 2e-3))
    assert placement.mean_diameters(SimpleNamespace(grains=(spheres,))) == pytest.approx((1.5e-3, 1.8e-3))


def test_the_line_of_the_figure_is_the_formula(tmp_path, monkeypatch):
    """And its points are k over the squares of the two diameters."""
    made = []
    new = figures.new_figure
    monkeypatch.setattr(figures, "new_figure", lambda *given: made.append(new(*given)) or made[-1])
    monkeypatch.setattr(script, "PICTURE", tmp_path / "figure.png")
    n = np.array(script.POROSITIES)
    porosity = np.stack([n, 1e-12 * n, 1e-4 + 0 * n, 2e-4 + 0 * n], axis=1)  # and k, <d>, <d3>/<d2>
    k = 1e-12 + np.array(script.SPACINGS) ** 2 * 1e-3
    script.draw(porosity, np.stack([0.4 + 0 * k, k, 1e-4 + 0 * k, 2e-4 + 0 * k], axis=1))
    line, by_mean, by_sauter = made[0][1][0].lines
    x = line.get_xdata()
    np.testing.assert_allclose(line.get_ydata(), x**3 / (180 * (1 - x) ** 2), rtol=1e-12)
    np.testing.assert_allclose(by_mean.get_ydata(), 1e-4 * n, rtol=1e-12)
    np.testing.assert_allclose(by_sauter.get_ydata(), 0.25e-4 * n, rtol=1e-12)
    assert (tmp_path / "figure.png").stat().st_size > 4000


def test_the_lines_of_a_run_are_what_it_measured_and_the_formula(monkeypatch):
    """For spheres of one size, whose Sauter diameter is their diameter; and of several, by Sauter's."""
    config = configure(loads(shipped_cases()["sphere-array"].read_text()))
    series = {"permeability": np.array([0.9e-12, 1.1e-12, 1.0e-12]), "porosity": np.full(3, 0.6)}
    monkeypatch.setattr(plots, "config_of", lambda run: config)
    monkeypatch.setattr(plots, "series_of", lambda run: series)
    monkeypatch.setattr(plots, "columns_of", lambda run, *names: (np.arange(3.0), *(series[name] for name in names)))
    measured, line = plots.permeability(SimpleNamespace()).axes[0].lines
    np.testing.assert_array_equal(measured.get_data(), [np.arange(3.0), series["permeability"]])
    assert line.get_ydata()[0] == pytest.approx(config.grains[0].diameter ** 2 * 0.6**3 / (180 * 0.4**2), rel=1e-12)
    monkeypatch.setattr(placement, "mean_diameters", lambda config: (1e-4, 1.5e-4))
    axes = plots.permeability(SimpleNamespace()).axes[0]
    assert axes.lines[1].get_ydata()[0] == pytest.approx(1.5e-4**2 * 0.0075, rel=1e-12)
    (told,) = (text.get_text() for text in axes.texts)
    assert "= 0.0001 at porosity 0.6000\nover Carman-Kozeny: 0.013 with <d>, 0.006 with" in told
