"""Control slices, and where lines of stress meet."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from hpcpic.core.files.series import Series
from lbmdem.analysis import plots, quick_condition
from lbmdem.app import shipped_cases


def test_lines_meet():
    """Exact lines through one point, whatever comes before and after the part that is fitted."""
    gradient = np.linspace(0.0, 1.0, 101)
    straight = [3.0 + slope * (gradient - 0.9) for slope in (-40.0, -25.0, -12.0, -2.0)]
    share = straight[0] / straight[0][0]
    early, late = (share > quick_condition.LINEAR[1]) & (gradient > 0.0), share < quick_condition.LINEAR[0]
    bent = [np.select([early, late], [1.1 * line, 0.9 * line], line) for line in straight]
    assert quick_condition.meeting(gradient, bent) == pytest.approx((0.9, 3.0), rel=1e-12)


def test_porosity_of_a_lattice_of_spheres():
    """A simple cubic array between two planes through centres: 1 - pi / 6."""
    z, r = np.repeat(np.arange(6.0), 4), np.full(24, 0.5)
    found = quick_condition.porosity_between(z, r, 1.0, 4.0, 4.0)
    assert found == pytest.approx(1.0 - math.pi / 6.0, abs=1e-4)  # 512 planes


def test_gradient_of_a_hydrostatic_column():
    z = np.array([0.1, 0.3, 0.35, 0.7])
    pressures = [np.array([9810.0, 4905.0]) * (1.0 - height) for height in z]
    assert quick_condition.gradient_inside(pressures, z, 9810.0) == pytest.approx([1.0, 0.5])


def test_the_critical_gradient_is_that_which_the_paper_prints():
    """1.042 for grains of 2.60 at a porosity of 0.349."""
    assert quick_condition.critical_gradient(2.60, 0.349) == pytest.approx(1.042, abs=5e-4)


def test_the_figure_has_the_stress_of_each_slice_and_lines_that_meet_at_the_critical_gradient(monkeypatch):
    """Figure 4, of a cubic array with looser ends: i_c = 1.65 pi / 6 between the slices, at 0.95 of which lines meet;
    1.2 / 1.325 as much of all, which the fluid carries at 0.98 of it.
    """
    side, height = (np.arange(6) + 0.5) * 1e-4, 1.5e-4 + 1e-4 * np.arange(12)
    height[[0, -1]] += (-6.25e-5, 6.25e-5)
    x = np.stack(np.meshgrid(side, side, height), axis=-1).reshape(-1, 3)
    columns = {"position": x, "radius": np.full(432, 5e-5)}
    monkeypatch.setattr(plots, "all_grains", lambda run, step: columns)
    monkeypatch.setattr(plots, "snapshots_of", lambda run: SimpleNamespace(steps=np.array([0])))
    critical, middle = 1.65 * math.pi / 6, 2.5e-4 + 2.25e-4 * np.arange(5)
    inside = np.linspace(0.0, 0.9 * critical, 40)
    stresses = [9810.0 * critical * (1.3e-3 - z) * (1 - inside / critical / 0.95) for z in middle]
    series = {f"stress_zz_{k + 1}": stress for k, stress in enumerate(stresses)}
    series |= {f"pressure_{k + 1}": 9810.0 * inside * (1.3e-3 - z) for k, z in enumerate(middle)}
    series |= {"hydraulic_gradient": 1.1 * inside, "force_sample_z": 9810.0 * 1.1 * inside * 6e-4**2 * 1.325e-3 / 0.98}
    run = SimpleNamespace(config=shipped_cases()["quick-condition"].read_text(), config_file="case")
    run.series = Series(series, {}, np.arange(40), np.linspace(0.0, 0.01, 40))
    axes = plots.stress(run).axes[0]
    *pairs, theory = axes.lines
    for k, (dots, line) in enumerate(zip(pairs[::2], pairs[1::2], strict=True)):
        assert dots.get_label() == f"slice {k + 1}"
        np.testing.assert_allclose(dots.get_data(), [inside, stresses[k] / stresses[0][0]], rtol=1e-9, atol=1e-12)
        gradient, share = line.get_data()
        np.testing.assert_allclose(share, (1 - gradient / critical / 0.95) * stresses[k][0] / stresses[0][0], atol=1e-9)
    assert theory.get_xdata()[0] == pytest.approx(critical, rel=3e-4)  # 512 planes
    (told,) = (text.get_text() for text in axes.texts)
    assert f"lines meet at i = {0.95 * critical:.4f}, 0.000 of the lowest" in told and "other: 0.9500\n" in told
    assert "carries the whole bed (n = 0.5258) at 0.9800 of its own" in told
