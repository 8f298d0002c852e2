"""Every shape of a particle has the figures that forecasts need of it."""

import pytest

from hpcpic.plasma.forecast import cold_drift, cold_wave, rates
from hpcpic.plasma.physics import heating
from hpcpic.plasma.physics.shapes import SHAPES


@pytest.mark.parametrize("shape", SHAPES)
def test_a_shape_has_its_measured_figures(shape):
    by_shape = {
        "GAIN of forecast/cold_drift.py": cold_drift.GAIN,
        "DRIFTING of forecast/cold_wave.py": cold_wave.DRIFTING,
        "LONG_WAVES of forecast/cold_wave.py": cold_wave.LONG_WAVES,
        "SHORT_WAVES of forecast/cold_wave.py": cold_wave.SHORT_WAVES,
        "ACROSS of physics/heating.py (python scripts/heating.py across)": heating.ACROSS,
        "HEATING of physics/heating.py (python scripts/heating.py)": {name for name, _ in heating.HEATING},
        "SPECTRAL of physics/heating.py": {name for name, _ in heating.SPECTRAL},
    }
    missing = [table for table, figures in by_shape.items() if shape not in figures]
    missing += [f"{gradient} gradients in ALIASES of forecast/cold_wave.py" for gradient in ("difference", "spectral")
                if (shape, gradient) not in cold_wave.ALIASES]  # fmt: skip
    missing += [f"{rate!r} in DEFAULT of forecast/rates.py (hpcpic bench)" for d in (1, 2, 3)
                for precision in ("double", "single")
                if (rate := f"particle_ns {d}D {shape} {precision}") not in rates.DEFAULT]  # fmt: skip
    assert not missing, f"check and estimate need these figures of {shape}:\n" + "\n".join(missing)
