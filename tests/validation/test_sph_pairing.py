"""Particles that pair where a kernel has many neighbours (Dehnen & Aly 2012, 10.1111/j.1365-2966.2012.21439.x)."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

import sph

pytestmark = [pytest.mark.validation, pytest.mark.timeout(3600)]


def nearest(kernel: str, smoothing: float) -> float:
    """Spacings within which 5 % of the particles of vortices have their nearest neighbour, after half a second."""
    settings = {"numerics.kernel": kernel, "numerics.smoothing": smoothing, "numerics.shifting": False}
    case = sph.Case("taylor-green").changed(settings)
    with case.simulation(threads=1) as sim:
        sim.advance(until=0.5)
        x = sim.particles()["position"].values[:, :2]
    low, high = (np.array(corner) for corner in (case.config.domain.low, case.config.domain.high))
    x = (x - low) % (high - low)
    apart, _ = cKDTree(x, boxsize=high - low).query(x, k=2)
    return float(np.percentile(apart[:, 1], 5)) / case.config.numerics.spacing


@pytest.mark.parametrize("kernel, most", [("cubic", 0.5), ("quintic", 0.42), ("wendland2", 0.73), ("wendland4", 0.73)])
def test_splines_pair_and_wendlands_kernels_do_later(kernel, most):
    found = [nearest(kernel, smoothing) for smoothing in (1.5, 2.5)]
    print(f"{kernel}: nearest neighbours within {found[0]:.2f} spacings (h/dp 1.5), {found[1]:.2f} (2.5)")
    assert found[1] < found[0] - 0.05 and most - 0.06 < found[0] < most
