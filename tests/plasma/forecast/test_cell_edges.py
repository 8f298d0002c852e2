"""Waves that move no particle to another node, against the field that a run starts with."""

import re

import pytest
from app_runner import running
from forecast_numbers import numbers

from hpcpic.core.case.config import loads
from hpcpic.plasma.configure import configure

STREAMS = """
simulation = { cycles = 4; time_step = 0.1; space_length = [6.4, 12.8]; };
grid = { points = [POINTS]; };
numerics = { shape = "NGP"; };
species = ( { name = "e"; charge = -1.0; mass = 1.0; plasma_frequency = 1.0; particles = N; init_method = "quiet";
              perturbation = { mode = [MODE]; amplitude = 1e-4; }; } );
"""
PLANES = [("32, 32", 16384, "1, 1"), ("32, 32", 1024, "1, 1"), ("20, 30", 2400, "0, 2"), ("18, 12", 1944, "-2, 1")]
LINES = [("64", 256, "1"), ("64", 192, "1"), ("60", 90, "3")]  # kernels for these alone
SCENES = PLANES + [pytest.param(*line, marks=pytest.mark.validation) for line in LINES]


def seen_at_start(world, text, amplitude):
    """Whether the field differs from that of the places without a wave."""
    found = []
    for a in (0.0, amplitude):
        config = configure(loads(text, sets=[f"species[0].perturbation.amplitude={a}"]))
        with running(world, "hpcpic", config) as app:
            found.append(app.scalars()["energy_field"])
    return abs(found[1] - found[0]) > 1e-12


@pytest.mark.parametrize("points, n, mode", SCENES)
def test_ngp_sees_a_wave_from_the_amplitude_on_that_is_told(world, points, n, mode):
    text = STREAMS.replace("POINTS", points).replace("MODE", mode).replace("N;", f"{n};")
    text = text.replace("6.4, 12.8", "6.4") if "," not in points else text
    told = numbers([], text)[0].get("a/(k d)")
    if told is None:  # particles on edges, which any wave moves
        assert seen_at_start(world, text, 1e-4)
        return
    assert told.verdict == "warn" and 0 < told.value < 1
    for share, seen in ((0.99, False), (1.1, True)):  # no particle has the whole amplitude
        assert seen_at_start(world, text, share * 1e-4 / told.value) == seen


def test_its_cures_pass_and_what_moves_of_itself_has_no_such_number():
    text = STREAMS.replace("POINTS", "32, 32").replace("MODE", "1, 1").replace("N;", "16384;")
    for cure in re.split(", or ", numbers([], text)[0]["a/(k d)"].cure):
        assert getattr(numbers([cure.replace(" ", "")], text)[0].get("a/(k d)"), "verdict", "ok") == "ok"
    for other in ("perturbation.velocity_amplitude=1e-3", "thermal_velocity=0.1", "init_method=random"):
        assert "a/(k d)" not in numbers([f"species[0].{other}"], text)[0]
