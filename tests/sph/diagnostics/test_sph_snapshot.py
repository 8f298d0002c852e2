"""What a file of particles holds, at the start of a case."""

import numpy as np
import pytest
from sph_scenes import engine

from sph.diagnostics.snapshot import particles


def test_pressure_is_that_of_rest_and_of_the_density_by_the_equation_of_state():
    """(MP 14) with gamma = 7 and c0 = 20 m/s, below a surface at 0.5 m; single precision."""
    found = particles(engine(smoothing=1.4).storage)["water"]
    depth, (density, pressure) = 0.5 - found.position[:, 1], (found.columns[key] for key in ("density", "pressure"))
    assert len(depth) == 100 and np.ptp(depth) == pytest.approx(0.45)
    np.testing.assert_allclose(pressure, 1000 * 20.0**2 / 7 * ((density / 1000) ** 7.0 - 1.0), atol=0.2)
    np.testing.assert_allclose(pressure, 1000 * 9.81 * depth, rtol=0.007)  # what the water below is heavier by
    assert found.units["pressure"] == "Pa" and not found.columns["velocity"].any()
