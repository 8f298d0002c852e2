"""Every shape of a particle has the figures that forecasts need of it."""

import math

import numpy as np
import pytest

from hpcpic.plasma.forecast import cold_drift, cold_wave, rates
from hpcpic.plasma.physics import heating
from hpcpic.plasma.physics.shapes import SHAPES


@pytest.mark.parametrize("shape", SHAPES)
def test_a_shape_has_its_measured_figures(shape):
    by_shape = {
        "GAIN of forecast/cold_drift.py": cold_drift.GAIN,
        "DRIFTING of forecast/cold_wave.py": cold_wave.DRIFTING,
        "ACROSS of physics/heating.py (python scripts/heating.py across)": heating.ACROSS,
        "HEATING of physics/heating.py (python scripts/heating.py)": {name for name, _ in heating.HEATING},
        "SPECTRAL of physics/heating.py": {name for name, _ in heating.SPECTRAL},
        "ACROSS_SPECTRAL of physics/heating.py": heating.ACROSS_SPECTRAL,
    }
    missing = [table for table, figures in by_shape.items() if shape not in figures]
    missing += [f"{gradient} gradients in ALIASES of forecast/cold_wave.py" for gradient in ("difference", "spectral")
                if (shape, gradient) not in cold_wave.ALIASES]  # fmt: skip
    missing += [f"{rate!r} in DEFAULT of forecast/rates.py (hpcpic bench)" for d in (1, 2, 3)
                for precision in ("double", "single")
                if (rate := f"particle_ns {d}D {shape} {precision}") not in rates.DEFAULT]  # fmt: skip
    assert not missing, f"check and estimate need these figures of {shape}:\n" + "\n".join(missing)


@pytest.mark.parametrize("shape", SHAPES)
def test_random_places_have_the_noise_of_all_aliases(shape):
    angle, aliases = np.array([[0.1], [1.0], [3.0]]), np.arange(-2000, 2001)
    squared = np.sinc(angle / (2 * np.pi) + aliases) ** (2 * SHAPES[shape].nodes)
    assert SHAPES[shape].of_random_places(angle)[:, 0] == pytest.approx(squared.sum(axis=1), rel=1e-3)


@pytest.mark.parametrize("points, spacing", [((64,), (0.1,)), ((16, 12), (1.0, 0.7)), ((8, 10, 6), (1.0, 1.2, 1.0))])
@pytest.mark.parametrize("debye", [0.0, 0.6, 20.0])
def test_the_field_that_random_places_lose_is_a_sum_over_waves(points, spacing, debye):
    """Of S^2/K^2/(1 + (K lambda_D)^2), wave by wave."""
    angles = np.meshgrid(*(2 * np.pi * np.fft.fftfreq(n) for n in points), indexing="ij")
    noise = math.prod(SHAPES["CIC"].of_random_places(angle) for angle in angles).ravel()[1:]
    squared = sum((2 / dx * np.sin(angle / 2)) ** 2 for angle, dx in zip(angles, spacing)).ravel()[1:]
    found = heating.field_of_random_places("CIC", points, spacing, debye)
    assert found == pytest.approx(np.sum(noise / squared / (1 + squared * debye**2)), rel=4e-3)
