"""Control slices, and where lines of stress meet."""

import math

import numpy as np
import pytest

from lbmdem.analysis import quick_condition


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
