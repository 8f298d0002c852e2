"""What theory says of scenes of water, at its own limits."""

import math

import numpy as np
import pytest

from sph.analysis import theory


def force_on_plate(width):
    """Over rho U^2 / 2 and the plate."""
    x, p = theory.jet_on_plate(width)
    assert x[0] == 0.0 and x[-1] == 1.0 and p[0] == 1.0 and p[-1] == 0.0 and (np.diff(x) > 0.0).all()
    return theory.cumulative(x, p)[-1]


def test_a_wide_jet_on_a_plate_is_the_stream_of_kirchhoff():
    assert force_on_plate(1000.0) == pytest.approx(2 * math.pi / (math.pi + 4), rel=1e-4)


def test_a_narrow_jet_gives_a_plate_all_its_momentum():
    """It leaves along the plate."""
    assert force_on_plate(0.25) == pytest.approx(2 * 0.25, rel=0.02)
    assert force_on_plate(0.25) < 2 * 0.25
    with pytest.raises(ValueError, match="along it"):
        force_on_plate(0.1)
