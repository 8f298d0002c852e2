"""The modes plot of scenes that no shipped case has: charges that cancel at the start, waves of several species."""

import re

import numpy as np
import pytest
from plasma_reference import make_run

from hpcpic import Case
from hpcpic.core.case.config import loads
from hpcpic.core.files.reader import open_run
from hpcpic.plasma.analysis import plots
from hpcpic.plasma.analysis.plots import PLOTS
from hpcpic.plasma.analysis.predictions import predict_sound
from hpcpic.plasma.configure import configure

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


def test_long_words_leave_the_axes_as_wide_as_they_are(tmp_path, monkeypatch):
    """One line of 105 characters left an eighth of the figure to the axes."""
    (tmp_path / "case.conf").write_text(NEUTRAL)
    run = open_run(make_run(tmp_path / "case.conf", tmp_path / "a"))
    widths = []
    for words in ("not fitted", f"not fitted: {'it meets the noise ' * 5}"):
        monkeypatch.setattr(plots, "_compared_sound", lambda *_, words=words: plots.Compared(words))
        figure = plots.PLOTS["modes"].make(run, None)
        figure.canvas.draw()
        widths.append(figure.axes[0].get_position().width)
        assert figure.axes[0].texts[0].get_text().replace("\n", " ") == words.strip()
    assert widths[1] == pytest.approx(widths[0], rel=0.02)


SOUND = """
simulation = { cycles = 600; time_step = 0.25; space_length = [15.707963267948966]; };
grid = { points = [32]; };
species = (
  { name = "electrons"; particles = 32000; charge = -1.0; mass = 1.0; plasma_frequency = 1.0; init_method = "quiet";
    thermal_velocity = 1.0; perturbation = { mode = [1]; amplitude = ELECTRONS; }; },
  { name = "ions"; particles = 32000; charge = 1.0; mass = 25.0; plasma_frequency = 0.2; init_method = "quiet";
    thermal_velocity = 0.06; IONS }
);
output = { modes = ([1]); every = { series = 1; fields = 0; }; };
"""
WAVE = "perturbation = { mode = [1]; amplitude = 0.02; };"


@pytest.mark.parametrize("electrons, ions, fast", [(0.017, WAVE, False), (0.02, "", True)])
def test_a_wave_of_several_species_is_fitted_beside_the_root_of_all_of_them(electrons, ions, fast, tmp_path):
    """Ions among hot electrons that shield them: sound; of electrons alone Langmuir's wave."""
    text = SOUND.replace("ELECTRONS", str(electrons)).replace("IONS", ions)
    law = predict_sound(configure(loads(text)), (1,))
    assert (law.omega.real > 1.0) == fast and law.omega.imag < 0
    (tmp_path / "case.conf").write_text(text)
    words = Case(tmp_path / "case.conf").run(tmp_path / "a", threads=1).plot("modes").axes[0].texts[0]
    decay, frequency = map(float, re.search(r"decay (\S+) ± .* frequency (\S+) ±", words.get_text()).groups())
    assert frequency == pytest.approx(law.omega.real, rel=0.03)
    assert decay == pytest.approx(-law.omega.imag, abs=0.03 * law.omega.real)


def test_sound_needs_a_start_species_at_rest_and_no_field_across():
    text = SOUND.replace("ELECTRONS", "0.017").replace("IONS", WAVE)
    assert predict_sound(configure(loads(text, sets=["field.magnetic=[1, 0, 0]"])), (1,))
    silent = text.replace(WAVE, "").replace("perturbation = { mode = [1]; amplitude = 0.017; };", "")
    drifting = text.replace("thermal_velocity = 1.0;", "thermal_velocity = 1.0; drift_velocity = [0.1, 0.0, 0.0];")
    for none in (silent, drifting, f"{text} field = {{ magnetic = [0.0, 0.0, 1.0]; }};"):
        assert predict_sound(configure(loads(none)), (1,)) is None
