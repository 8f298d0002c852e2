"""How fast particles become in a run, beside what check says of their speed before it."""

import numpy as np
import pytest
from app_runner import running
from forecast_numbers import numbers

from hpcpic.core.case.config import loads
from hpcpic.plasma.configure import configure
from hpcpic.plasma.forecast.speeds import gained

COLD = """
units = "SI";
simulation = { cycles = 60; time_step = 2e-12; space_length = [2.0]; };
grid = { points = [64]; };
species = ( { particle = "electron"; density = 1e18; particles = 4096; init_method = "quiet"; } );
"""
WAVE = ("species[0].perturbation={ mode = [1]; amplitude = 0.3; }",)  # a quarter of a period is 28 ps
FIELD = ("field.electric=[3e6, 0.0, 0.0]", "species[0].density=1.0")


@pytest.mark.parametrize("sets, what, close", [(WAVE, "waves", 0.05), (FIELD, "field.electric", 1e-6)])
def test_particles_that_a_wave_or_a_field_makes_as_fast_as_light_are_told(world, sets, what, close):
    """Both were told as 0, as loaded."""
    found = numbers(sets, COLD)[0]
    with running(world, "hpcpic", configure(loads(COLD, sets=list(sets)))) as app:
        fastest = 0.0
        for _ in range(60):
            app.step()
            fastest = max(fastest, float(np.abs(next(iter(app.particles().values())).columns["velocity"]).max()))
    row = found["v/c"]
    assert row.value > 0.1 and row.verdict == "warn" and what in row.source
    half = 0.5 / 60 if what == "field.electric" else 0.0  # velocities are of half a step before
    assert row.value * (1 - half) * 299792458.0 == pytest.approx(fastest, rel=close)
    assert found["v dt/dx"].value == pytest.approx(row.value * 299792458.0 * 2e-12 / (2.0 / 64))


@pytest.mark.parametrize(
    "electric, magnetic, speeds",
    [
        ([0.3, 0.0, 0.0], [0.0, 0.0, 0.0], [12.0, 0.0, 0.0]),
        ([0.3, 0.0, 0.0], [0.5, 0.0, 0.0], [12.0, 0.0, 0.0]),  # along B: no cycloid
        ([0.0, 0.3, 0.0], [0.0, 0.0, 0.5], [1.2, 0.6, 0.0]),  # E/B = 0.6
        ([0.0, 0.3, 0.0], [0.0, 0.0, 1e-6], [0.00024, 12.0, 0.0]),  # a small part of a turn
    ],
)
def test_uniform_fields_make_particles_as_fast_as_newton_has_them(electric, magnetic, speeds):
    text = COLD.replace('units = "SI";', "").replace(
        'particle = "electron"; density = 1e18', "charge = -2.0; mass = 2.0"
    )
    sets = ["simulation.cycles=400", "simulation.time_step=0.1"]
    sets += [f"field.electric={electric}", f"field.magnetic={magnetic}"]
    config = configure(loads(text, sets=sets))
    assert gained(config, config.species[0]) == pytest.approx(speeds)
