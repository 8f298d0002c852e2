"""Time-step limits: the discrete operators against what is known of them, the integrators against their regions."""

import numpy as np
import pytest

from sph.physics.smoothing import SMOOTHING
from sph.physics.stability import limit_of
from sph.physics.waves import waves_of


@pytest.mark.parametrize("kernel", SMOOTHING)
@pytest.mark.parametrize("d", [2, 3])
def test_long_waves_see_the_continuous_operators(kernel, d):
    """At k h -> 0 the gradient is ik, both laplacians are k^2 but for what the lattice leaves."""
    waves = waves_of(kernel, d, 1.5)
    k = np.pi / 24 * 1.5
    assert waves.acoustic[0] == pytest.approx(k, rel=0.03)  # k^2 h^2 / 2 and the lattice sums
    assert waves.laplacian[0] == pytest.approx(k * k, rel=0.06)
    mean = {2: 3 / 8, 3: 3 / 10}[d]  # half of <cos^4> / <cos^2> over all directions; a lattice has few of them
    assert waves.pairs[0] / waves.laplacian[0] == pytest.approx(mean, rel=0.1)


@pytest.mark.parametrize(
    "integrator, imaginary, real",
    [("euler", 0.0, 2.0), ("predictor-corrector", 1.0, 1.0), ("rk3-tvd", 3**0.5, 2.5127), ("symplectic", 2.0, 2.0)],
)
def test_the_limits_of_integrators_on_the_axes(integrator, imaginary, real):
    """A pure oscillation and a pure decay: the ends of the region of stability."""
    one, nothing = np.ones(1), np.zeros(1)
    oscillation = limit_of(integrator, one, nothing, nothing)
    assert oscillation == pytest.approx(imaginary, rel=2e-3) if imaginary else oscillation < 0.05
    assert limit_of(integrator, nothing, one, nothing) == pytest.approx(real, rel=2e-3)


@pytest.mark.parametrize(
    "integrator, none, weak, rusanov",
    [
        ("euler", 0.04, 0.16, 0.64),
        ("predictor-corrector", 0.90, 1.10, 0.32),
        ("rk3-tvd", 1.58, 2.04, 0.82),
        ("symplectic", 1.82, 1.58, 0.66),
    ],
)
def test_the_measured_limits_of_the_cubic_spline_in_3d(integrator, none, weak, rusanov):
    """Bisection of the discrete operator on a 3D lattice, h/dp = 1.3: no flux, delta = alpha = 0.1, full Rusanov."""
    waves = waves_of("cubic", 3, 1.3)
    a, nothing = waves.acoustic, np.zeros_like(waves.acoustic)
    assert limit_of(integrator, a, nothing, nothing) == pytest.approx(none, rel=0.05)
    assert limit_of(integrator, a, 0.1 * waves.laplacian, 0.1 * waves.pairs) == pytest.approx(weak, rel=0.08)
    assert limit_of(integrator, a, waves.upwind, nothing) == pytest.approx(rusanov, rel=0.06)


@pytest.mark.parametrize("kernel", SMOOTHING)
@pytest.mark.parametrize("smoothing", [0.1, 0.34, 0.5, 0.7])
def test_particles_without_neighbours_have_finite_rates(kernel, smoothing):
    with np.errstate(all="raise"):
        assert all(np.isfinite(found).all() for d in (2, 3) for found in waves_of(kernel, d, smoothing))
