"""Roots of the dispersion relations against independently computed figures and each other."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad

from hpcpic.plasma.analysis import theory
from hpcpic.plasma.analysis.theory import Beam, Mesh

LANDAU = {  # k lambda_D: (omega, gamma)/wp, computed with the Faddeeva function to ten digits
    0.20: (1.0639843407, -5.5107414769e-05),
    0.25: (1.1057308230, -2.1640780639e-03),
    0.30: (1.1598464806, -1.2620368421e-02),
    0.50: (1.4156618886, -1.5335946691e-01),
    0.60: (1.5457067551, -2.6411033817e-01),
    0.70: (1.6738659828, -3.9240143225e-01),
    0.80: (1.7998993183, -5.3455236160e-01),
    1.00: (2.0459048657, -8.5133045869e-01),
}
WB = 1.0 / math.sqrt(2.0)  # each of two equal beams, total plasma frequency 1


def pair(v0: float, vth: float = 0.0) -> tuple[Beam, Beam]:
    return Beam(WB, v0, vth), Beam(WB, -v0, vth)


@pytest.mark.parametrize("k", LANDAU)
def test_landau_roots(k):
    omega = theory.landau(k)
    assert omega.real == pytest.approx(LANDAU[k][0], abs=1e-9)
    assert omega.imag == pytest.approx(LANDAU[k][1], abs=1e-9)


def test_landau_root_solves_its_equation_beyond_the_table():
    omega = theory.landau(1.7)
    assert abs(1.0 - theory.susceptibility(omega, 1.7, (Beam(1.0, 0.0, 1.0),))) < 1e-12


@pytest.mark.parametrize("k, vth, wc", [(0.4, 0.5, 0.5), (1.0, 1.0, 0.3), (3.0, 0.2, 2.0)])
def test_waves_across_a_magnetic_field_solve_the_integral_over_a_turn(k, vth, wc):
    """Stix 1992, chapter 11: the sum over harmonics as an integral over the angle."""
    found = theory.bernstein(k, Beam(1.0, 0.0, vth), wc, most=6.5 * wc)
    assert [int(omega / wc) for omega in found] == list(range(1, len(found) + 1)) and len(found) >= 2
    larmor2 = (k * vth / wc) ** 2
    for x in np.array(found) / wc:
        turn = quad(lambda a, x=x: np.exp(-larmor2 * (1 + np.cos(a))) * np.cos(x * a), 0, np.pi, epsabs=1e-13)[0]
        assert x / np.sin(np.pi * x) * turn == pytest.approx(1 + (k * vth) ** 2, rel=1e-7)


def test_long_waves_across_a_magnetic_field_are_the_upper_hybrid():
    cold, warm = (theory.bernstein(1e-3, Beam(1.0, 0.0, vth), 0.7, 2.0) for vth in (0.0, 1.0))
    assert cold == [math.hypot(1.0, 0.7)]
    assert min(abs(omega - cold[0]) for omega in warm) < 1e-5


def test_weakly_damped_wave_is_bohm_and_gross():
    k = 0.05  # next term of the expansion is 15 k^4
    assert theory.landau(k).real ** 2 == pytest.approx(1 + 3 * k**2, abs=2 * 15 * k**4)


@pytest.mark.parametrize(
    "x, gamma",
    [
        (0.2, 0.136075276),
        (0.4, 0.245585879),
        (0.5, 0.286542809),
        (1.0, 0.343560750),
        (1.2, 0.282842712),
        (1.4, 0.081282684),
    ],
)
def test_cold_two_stream(x, gamma):
    assert theory.two_stream_growth(x * WB, WB) == pytest.approx(gamma, abs=1e-9)
    assert theory.unstable_root(x * WB, pair(1.0)).imag == pytest.approx(gamma, abs=1e-9)


def test_cold_two_stream_maximum_and_edge():
    best = math.sqrt(3.0) / 2.0 * WB
    assert theory.two_stream_growth(best, WB) == pytest.approx(WB / 2, rel=1e-15)
    assert theory.two_stream_growth(1.000001, WB) == 0.0
    with pytest.raises(theory.NoRoot, match="nothing grows"):
        theory.unstable_root(1.000001, pair(1.0))


@pytest.mark.parametrize(
    "v0, vth, k, gamma",
    [
        (1, 0.05, math.sqrt(0.375), 0.352546949),
        (1, 0.1, math.sqrt(0.375), 0.349379476),
        (1, 0.2, 0.5, 0.319943509),
        (3, 1, 0.2, 0.284509686),
        (2.4, 1, 0.2, 0.225844255),
    ],
)
def test_warm_two_stream(v0, vth, k, gamma):
    assert theory.unstable_root(k, pair(v0, vth)).imag == pytest.approx(gamma, abs=1e-9)


@pytest.mark.parametrize(
    "fraction, k, gamma", [(0.001, 1.00875, 0.066103), (0.01, 1.0365, 0.136206), (0.1, 1.13075, 0.264021)]
)
def test_weak_cold_beam(fraction, k, gamma):
    beams = Beam(math.sqrt(1 - fraction)), Beam(math.sqrt(fraction), 1.0)
    assert theory.unstable_root(k, beams).imag == pytest.approx(gamma, abs=1e-6)


@pytest.mark.parametrize(
    "u, mass, te_over_ti, k, omega",
    [
        (0.6, 100, 50, 0.5, 0.04711068 + 0.01109571j),  # a run: 0.2 % faster
        (0.6, 100, 50, 0.3, 0.02980794 + 0.00813450j),
        (1.0, 1836, 10, 0.5, 0.01223 + 0.00451j),
    ],
)
def test_sound_of_ions_that_drifting_electrons_drive(u, mass, te_over_ti, k, omega):
    """Roots by scipy's wofz and fsolve: slower than 0.05 wp, where a net over the band of wp met none."""
    ions = Beam(mass**-0.5, 0.0, (te_over_ti * mass) ** -0.5)
    assert theory.unstable_root(k, (Beam(1.0, u, 1.0), ions)) == pytest.approx(omega, abs=6e-6)
    with pytest.raises(theory.NoRoot):
        theory.unstable_root(k, (Beam(1.0, 0.0, 1.0), ions))


def test_bump_on_tail_agrees_with_quasilinear_sign():
    """A gentle bump grows where the slope of f is positive at omega/k and nothing grows without it."""
    bump = Beam(math.sqrt(0.95), 0.0, 1.0), Beam(math.sqrt(0.05), 5.0, 0.5)
    omega = theory.unstable_root(0.25, bump)
    assert omega.imag > 0
    assert 3.5 < omega.real / 0.25 < 5.0
    with pytest.raises(theory.NoRoot):
        theory.unstable_root(0.25, (Beam(1.0, 0.0, 1.0),))


def test_a_common_drift_only_shifts_the_frequency():
    still, moving = pair(1.0, 0.1), (Beam(WB, 3.0, 0.1), Beam(WB, 1.0, 0.1))
    shift = theory.unstable_root(0.6, moving) - theory.unstable_root(0.6, still)
    assert shift == pytest.approx(0.6 * 2.0, abs=1e-12)


# ------------------------------------------------------------------------------------------ discrete scheme


@pytest.mark.parametrize(
    "wp_dt, factor", [(0.1, 1.0004171361), (0.2, 1.0016742116), (0.5, 1.0107210206), (1.0, 1.0471975512)]
)
def test_leapfrog_factor(wp_dt, factor):
    assert theory.leapfrog_frequency(1.0, wp_dt) == pytest.approx(factor, abs=1e-10)


def test_cold_wave_reference():
    assert theory.cold_wave_frequency(1.0, 0.2, 2 * math.pi, 1 / 64) == pytest.approx(1.000463607, abs=1e-9)


@pytest.mark.parametrize("cells", [64, 16, 4])
def test_alias_sum_closes_to_the_cosine(cells):
    """The sum over aliases of CIC with differences is cos^2(k dx/2): what is cut off falls as the cube."""
    mesh, k = Mesh(dx=1.0 / cells, dt=0.2), 2 * math.pi
    root = theory.mesh_root(1.0, k, (Beam(1.0),), mesh)
    assert root.real == pytest.approx(theory.cold_wave_frequency(1.0, 0.2, k, mesh.dx), abs=1e-5)
    assert abs(root.imag) < 1e-12


def test_spectral_gradient_reference():
    mesh = Mesh(dx=1 / 64, dt=0.2, spectral=True)
    assert theory.mesh_root(1.0, 2 * math.pi, (Beam(1.0),), mesh).real == pytest.approx(1.000867038, abs=1e-8)


@pytest.mark.parametrize("k", [0.3, 0.5])
def test_discrete_landau_tends_to_the_continuum_with_second_order(k):
    beams, exact = (Beam(1.0, 0.0, 1.0),), theory.landau(k)
    errors = [
        abs(theory.mesh_root(exact, k, beams, Mesh(2 * math.pi / k / cells, 6.4 / cells)) - exact)
        for cells in (32, 64, 128)
    ]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(2.0, abs=0.05)


def test_the_smallest_spread_takes_no_more_memory_and_is_met_smoothly():
    mesh, omega = Mesh(dx=0.1, dt=0.1), 0.3 + 0.35j
    spreads = (0.0, 1.01 * theory.LEAST_SPREAD / mesh.dt, 1e-9)
    cold, least, tiny = (theory.mesh_susceptibility(omega, 1.0, (Beam(0.7, 1.0, v),), mesh) for v in spreads)
    assert tiny == cold
    expected = 3 * (spreads[1] / abs(omega - 1.0)) ** 2  # the first term in k vth / (omega - k v)
    assert abs(least - cold) < 1.1 * expected * abs(cold)


def test_little_thermal_spread_is_the_cold_limit():
    """Both branches of the discrete response: warm beams pass into cold ones as vth^2."""
    mesh, k = Mesh(dx=2 * math.pi / 0.6 / 64, dt=0.1), 0.6
    cold = theory.mesh_root(0.35j, k, pair(1.0), mesh)
    gaps = [abs(theory.mesh_root(0.35j, k, pair(1.0, vth), mesh) - cold) for vth in (0.04, 0.02)]
    assert gaps[0] / gaps[1] == pytest.approx(4.0, rel=0.03)


def test_boris_angles_and_radius():
    for wc_dt, ratio in ((0.05, 0.9997917448), (0.1, 0.9991679144), (0.2, 0.9966865249), (0.5, 0.9799146525)):
        assert theory.boris_angle(wc_dt, 1.0) / wc_dt == pytest.approx(ratio, abs=1e-10)
        radius = math.sqrt(1 + wc_dt**2 / 4) / wc_dt
        assert theory.gyration_radius(1.0, wc_dt, 1.0) == pytest.approx(radius, rel=1e-14)
    assert theory.boris_angle(0.5, 1.0, exact_phase=True) == 0.5


@pytest.mark.parametrize("exact_phase", [False, True])
def test_upper_hybrid_is_the_eigenvalue_of_the_step(exact_phase):
    """The closed form against the matrix of (x, vx, vy): half kick, turn, half kick, drift."""
    wp, wc, dt = 1.0, 0.7, 0.3
    theta = theory.boris_angle(wc, dt, exact_phase)
    across = math.tan(0.5 * wc * dt) / (0.5 * wc * dt) if exact_phase else 1.0
    kick = np.array([[1, 0, 0], [-0.5 * wp**2 * dt * across, 1, 0], [0, 0, 1]])
    c, s = math.cos(theta), math.sin(theta)
    turn = np.array([[1, 0, 0], [0, c, s], [0, -s, c]])
    drift = np.array([[1, dt, 0], [0, 1, 0], [0, 0, 1]])
    phases = np.abs(np.angle(np.linalg.eigvals(drift @ kick @ turn @ kick))) / dt
    omega = theory.upper_hybrid_frequency(wp, wc, dt, exact_phase=exact_phase)
    assert np.sort(phases) == pytest.approx([0.0, omega, omega], abs=1e-12)


def test_upper_hybrid_limits():
    leapfrog = theory.leapfrog_frequency(1.0, 0.2)
    assert theory.upper_hybrid_frequency(1.0, 0.0, 0.2) == pytest.approx(leapfrog, rel=1e-14)
    assert theory.upper_hybrid_frequency(0.3, 0.4, 1e-4) == pytest.approx(0.5, abs=1e-9)
