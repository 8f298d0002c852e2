"""The modes plot of scenes that no shipped case has: charges that cancel at the start, waves of several species."""

import numpy as np
from plasma_reference import make_run

from hpcpic.core.files.reader import open_run
from hpcpic.plasma.analysis.plots import PLOTS

NEUTRAL = """
simulation = { cycles = 40; time_step = 0.1; space_length = [20.0]; };
grid = { points = [32]; };
species = (
  { name = "electrons"; particles = 4000; charge = -1.0; mass = 1.0; plasma_frequency = 1.0; init_method = "quiet";
    thermal_velocity = 0.5; perturbation = { mode = [1]; amplitude = 0.1; }; },
  { name = "ions"; particles = 4000; charge = 1.0; mass = 100.0; plasma_frequency = 0.1; init_method = "quiet";
    perturbation = { mode = [1]; amplitude = 0.1; }; }
);
output = { every = { series = 1; fields = 0; }; };
"""


def test_the_axis_of_a_start_without_field_begins_above_its_rounding(tmp_path):
    (tmp_path / "case.conf").write_text(NEUTRAL)
    run = open_run(make_run(tmp_path / "case.conf", tmp_path / "a"))
    first, *others = run.series["mode_1"]
    assert first < 1e-9 * np.max(others)
    low, high = PLOTS["modes"].make(run, None).axes[0].get_ylim()
    assert 0.4 * min(others) < low < min(others) < max(others) < high
