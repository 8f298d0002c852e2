"""Flows through inlets and outlets against theory and experiment: the shipped cases."""

import numpy as np
import pytest

import sph

pytestmark = [pytest.mark.validation, pytest.mark.timeout(1800)]


def test_plane_poiseuille_flow_through_inlet_and_outlet(tmp_path):
    series = sph.Case("channel").run(tmp_path / "run", threads=1).series
    late = np.asarray(series["time"]) > 3.0
    mean = {name: np.mean(np.asarray(series[name])[late]) for name in ("middle_x", "quarter_x", "through")}
    drop = np.mean((np.asarray(series["upstream"]) - np.asarray(series["downstream"]))[late])
    print(mean, drop)
    assert mean["middle_x"] == pytest.approx(0.015, rel=0.01) and mean["quarter_x"] == pytest.approx(0.01125, rel=0.01)
    assert mean["through"] == pytest.approx(1e-4, rel=0.01)
    assert drop == pytest.approx(0.015 * 12 * 5e-3 * 0.01 / 1e-4, rel=0.03)  # sound of 0.02 Pa in 0.09 Pa
    assert np.ptp(np.asarray(series["mass_total"])) < 1e-14


def test_a_weir_has_the_head_of_rehbock(tmp_path):
    series = sph.Case("weir").run(tmp_path / "run", threads=1).series
    time, level, over = (np.asarray(series[name]) for name in ("time", "level", "outflow"))
    late = time > 4.0
    head = np.mean(level[late]) - 0.2
    flow = np.polyfit(time[late], over[late], 1)[0] / 1000.0
    print(head, flow)
    assert 2 / 3 * (0.602 + 0.083 * head / 0.2) * np.sqrt(2 * 9.81) * head**1.5 == pytest.approx(0.06, rel=0.03)
    assert head == pytest.approx(0.0999, rel=0.02) and flow == pytest.approx(0.06, rel=0.01)
