"""What theory says an electrostatic plasma does: continuum roots, and the exact dispersion of the scheme.

Units are whatever the caller uses, all alike: frequencies in rad/s, velocities in m/s, wave numbers in
rad/m, or all of them normalised. Waves are exp(i k x - i omega t): a positive imaginary part of omega grows.

Sources
* Landau (1946); Fried & Conte, The Plasma Dispersion Function (1961): Z' and the roots of a Maxwellian.
* Bernstein, Phys. Rev. 109, 10 (1958): waves of a warm plasma across a magnetic field.
* Birdsall & Langdon, Plasma Physics via Computer Simulation (1985), chapters 4, 5, 8: leapfrog, cold beams,
  and the dispersion of the particle-mesh scheme with its aliases.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hpcpic.plasma.physics.boris import impulse_across
from hpcpic.plasma.physics.dispersion import Beam, NoRoot, root_near, susceptibility, total_frequency
from hpcpic.plasma.physics.shapes import SHAPES

ALIASES = {1: 24, 2: 10, 3: 5}  # each way, by axes that k is not across: the shape falls as 1/p^2 or faster, and what
# is left out is under 1e-6 of the sum for CIC, with axes of a cell per radian
LEAST_SPREAD = 1e-4  # k vth dt; less changes the response of a beam by 3e-6 at most where |omega - k v| dt = 0.1


@dataclass(frozen=True, slots=True)
class Mesh:
    """What the discrete dispersion needs to know of the scheme. dx: along k, or of each axis."""

    dx: float | tuple[float, ...]
    dt: float
    shape: str = "CIC"
    spectral: bool = False


# ---------------------------------------------------------------------------------------------- continuum


def cold_roots(k: float, beams: Sequence[Beam]) -> np.ndarray:
    """All roots of 1 = sum wp^2/(omega - k v)^2 as complex[2 n], most unstable first, spread ignored."""
    squares = [np.poly1d([1.0, -k * b.drift]) ** 2 for b in beams]
    polynomial = np.poly1d([1.0])
    for square in squares:
        polynomial = polynomial * square
    for i, beam in enumerate(beams):
        others = np.poly1d([beam.plasma_frequency**2])
        for j, square in enumerate(squares):
            if j != i:
                others = others * square
        polynomial = polynomial - others
    roots = polynomial.roots
    return roots[np.argsort(-roots.imag, kind="stable")]


def landau(k_lambda_d: float) -> complex:
    """omega/wp of the least damped electron wave of a Maxwellian at k lambda_D (ions at rest).

    It solves 1 = Z'(omega/(sqrt2 k vth))/(2 k^2 lambda_D^2), and is followed up from the small k of Bohm and Gross.
    """
    beam = (Beam(1.0, 0.0, 1.0),)
    omega = np.sqrt(1.0 + 3.0 * 0.04) + 0j
    for k in np.append(np.arange(0.2, k_lambda_d, 0.05), k_lambda_d) if k_lambda_d > 0.2 else (k_lambda_d,):
        if k <= 0.2:
            omega = np.sqrt(1.0 + 3.0 * k * k) - 1e-9j
        omega = root_near(omega, lambda w, k=k: 1.0 - susceptibility(w, k, beam))  # type: ignore[misc]
    return omega


def bernstein(k: float, beam: Beam, cyclotron_frequency: float, most: float) -> list[float]:
    """Frequencies up to `most` of the waves across a magnetic field of a Maxwellian at rest: one between any two
    harmonics of its cyclotron frequency. Without spread, the upper hybrid frequency alone.
    """
    from scipy.optimize import brentq
    from scipy.special import ive

    wp, wc = beam.plasma_frequency, cyclotron_frequency
    larmor2 = (k * beam.thermal_velocity / wc) ** 2
    if larmor2 == 0.0:
        return [float(np.hypot(wp, wc))]
    harmonics = np.arange(1, 20 + int(most / wc) + int(10 * np.sqrt(larmor2)))  # they fall as exp(-n^2 / (2 larmor2))
    weights = 2.0 * (wp / wc) ** 2 * harmonics**2 * ive(harmonics, larmor2) / larmor2

    def permittivity(x: float) -> float:
        return 1.0 - float(np.sum(weights / (x * x - harmonics**2)))

    between = [n for n in range(1, int(most / wc) + 1) if weights[n - 1 : n + 1].min() > 1e-6]  # weaker ones touch none
    found = [wc * brentq(permittivity, n * (1 + 1e-9), (n + 1) * (1 - 1e-9)) for n in between]
    return [omega for omega in found if omega <= most]


def unstable_root(k: float, beams: Sequence[Beam]) -> complex:
    """The fastest growing root of warm beams at wave number k; raises NoRoot when nothing grows.

    Newton's method from the cold roots, from a net of points over the band of resonant frequencies, and from the waves
    of each beam as all others shield it, which are far slower than the net is fine where ions sound among electrons.
    """
    if all(b.thermal_velocity == 0.0 for b in beams):
        best = complex(cold_roots(k, beams)[0])
        if best.imag <= 1e-7 * abs(best):
            raise NoRoot(f"nothing grows at k = {k}")
        return best
    wp = total_frequency(beams)
    resonances = [k * b.drift for b in beams]
    low, high = min(*resonances, -wp) - wp, max(*resonances, wp) + wp
    starts = [complex(w.real, abs(w.imag) + 0.01 * wp) for w in cold_roots(k, beams)]
    starts += [complex(re, im * wp) for im in (0.02, 0.1, 0.3, 0.6) for re in np.linspace(low, high, 25)]
    starts += [complex(k * b.drift + w, 0.1 * abs(w)) for b in beams for w in _shielded(k, b, beams)]
    found = []
    for start in starts:
        try:
            omega = root_near(start, lambda w: 1.0 - susceptibility(w, k, beams))
        except NoRoot:
            continue
        if omega.imag > 1e-9 * wp:
            found.append(omega)
    if not found:
        raise NoRoot(f"nothing grows at k = {k}")
    return max(found, key=lambda w: w.imag)


def _shielded(k: float, beam: Beam, beams: Sequence[Beam]) -> tuple[float, float]:
    """Frequencies of a beam's own waves in its frame: warm fluid among others that follow the potential at once."""
    others = (b for b in beams if b is not beam and b.thermal_velocity)
    shield = sum((b.plasma_frequency / (k * b.thermal_velocity)) ** 2 for b in others)
    frequency = float(np.sqrt(beam.plasma_frequency**2 / (1.0 + shield) + 3.0 * (k * beam.thermal_velocity) ** 2))
    return -frequency, frequency


def two_stream_growth(k_v0: float, wb: float) -> float:
    """Growth rate of two equal cold beams +-v0, each of plasma frequency wb (Birdsall & Langdon 5-6).

    Zero where nothing grows; the maximum is wb/2 at k v0 = sqrt(3)/2 wb.
    """
    gamma_sq = wb * np.sqrt(4.0 * k_v0**2 + wb**2) - k_v0**2 - wb**2
    return float(np.sqrt(max(gamma_sq, 0.0)))


# ------------------------------------------------------------------------------------------ discrete scheme


def leapfrog_frequency(omega: float, dt: float) -> float:
    """Frequency of an oscillator under leapfrog: (2/dt) asin(omega dt/2), stable for omega dt < 2."""
    return 2.0 / dt * float(np.arcsin(0.5 * omega * dt))


def cold_wave_frequency(wp: float, dt: float, k: ArrayLike, dx: ArrayLike, per_cell: float = np.inf) -> float:
    """Frequency of a cold wave in CIC, 3-, 5- or 7-point Poisson, centred E, leapfrog; k and dx of each axis.

    The sums over aliases close exactly. Along an axis omega = (2/dt) asin((wp dt/2) cos(k dx/2)). In any direction,
    with a_i = k_i dx_i, the cosine squared is a mean, with the weights (2 sin(a_i/2)/dx_i)^2 of the Laplacian, of
    cos^2(a_i/2) times the mean square that interpolation leaves of a wave along each other axis j: (2 + cos a_j)/3, of
    particles on a lattice of per_cell places in a cell along each axis less (1 - cos a_j)/(6 per_cell^2).
    """
    angles = np.atleast_1d(k) * np.atleast_1d(dx)
    weights = (2.0 * np.sin(0.5 * angles) / np.atleast_1d(dx)) ** 2
    across = (2.0 + np.cos(angles)) / 3.0 - (1.0 - np.cos(angles)) / (6.0 * per_cell**2)
    factors = np.cos(0.5 * angles) ** 2 * np.prod(across) / across
    return leapfrog_frequency(wp * float(np.sqrt(np.sum(weights * factors) / np.sum(weights))), dt)


def boris_angle(wc: float, dt: float, exact_phase: bool = False) -> float:
    """Angle turned per step: 2 atan(wc dt/2), or wc dt when the rotation uses t = tan(wc dt/2) b."""
    return wc * dt if exact_phase else 2.0 * float(np.arctan(0.5 * wc * dt))


def gyration_radius(speed: float, wc: float, dt: float, exact_phase: bool = False) -> float:
    """Radius of the circle through the leapfrogged positions: v dt/(2 sin(theta/2))."""
    return speed * dt / (2.0 * abs(np.sin(0.5 * boris_angle(wc, dt, exact_phase))))


def upper_hybrid_frequency(
    wp: float, wc: float, dt: float, k: float = 0.0, dx: float = 0.0, exact_phase: bool = False
) -> float:
    """Frequency of the cold wave across B as the scheme makes it: half kick, turn by theta, half kick, drift.

    The linear map of (x, vx, vy) over a step has eigenvalues 1 and exp(+-i omega dt) with
    sin^2(omega dt/2) = sin^2(theta/2) + cos^2(theta/2) (wp cos(k dx/2) dt/2)^2 f,
    which tends to omega^2 = wp^2 + wc^2; f is 1, or with an exact phase that of the impulse across B.
    """
    half = 0.5 * boris_angle(wc, dt, exact_phase)
    kick = 0.5 * wp * dt * np.cos(0.5 * k * dx) * (np.sqrt(impulse_across(wc * dt)) if exact_phase else 1.0)
    return 2.0 / dt * float(np.arcsin(np.sqrt(np.sin(half) ** 2 + (np.cos(half) * kick) ** 2)))


def mesh_factors(k: ArrayLike, mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Wave vectors k_p[m, d] = k + 2 pi p/dx and their weights S^2(k_p) k_p.kappa/K^2 in the force of the scheme.

    S is the transform of the particle shape, kappa of the gradient, K^2 of the Laplacian (Birdsall & Langdon,
    chapter 8). Across an axis no alias but that of p = 0 has a weight.
    """
    waves, dx = np.atleast_1d(k), np.atleast_1d(mesh.dx)
    most = ALIASES[max(1, int(np.count_nonzero(waves)))]
    along = [q + 2.0 * np.pi / h * np.arange(-most, most + 1) if q else np.zeros(1) for q, h in zip(waves, dx)]
    aliases = np.stack(np.meshgrid(*along, indexing="ij"), axis=-1).reshape(-1, len(waves))
    shape = np.prod(np.sinc(0.5 * aliases * dx / np.pi), axis=1) ** SHAPES[mesh.shape].nodes
    gradient = waves if mesh.spectral else np.sin(waves * dx) / dx
    laplacian = waves if mesh.spectral else 2.0 * np.sin(0.5 * waves * dx) / dx
    return aliases, shape**2 * (aliases @ gradient) / (laplacian @ laplacian)


def mesh_susceptibility(omega: complex, k: ArrayLike, beams: Sequence[Beam], mesh: Mesh) -> complex:
    """Response of the scheme to its own field; 1 = mesh_susceptibility is its dispersion, exact in dx and dt. Beams
    without a velocity of their own drift along k.

    A kick displaces by s dt after s steps, and a Maxwellian forgets it as exp(-(|k_p| vth s dt)^2/2):
    - wp^2 dt^2 sum_p F_p sum_s s exp(i (omega - k_p.v) s dt) exp(-(|k_p| vth s dt)^2/2).
    Without spread, or with too little for that to show, the inner sum is -1/(4 sin^2((omega - k_p.v) dt/2)).
    """
    waves, weights = mesh_factors(k, mesh)
    direction = np.atleast_1d(k) / np.linalg.norm(k)
    along, sizes = waves @ direction, np.linalg.norm(waves, axis=1)
    total = 0.0 + 0.0j
    for beam in beams:
        phase = (omega - (waves @ beam.velocity if beam.velocity else along * beam.drift)) * mesh.dt
        slowest = sizes.min() * beam.thermal_velocity * mesh.dt
        if slowest < LEAST_SPREAD:
            response = 1.0 / (4.0 * np.sin(0.5 * phase) ** 2)
        else:
            peak = abs(min(omega.imag * mesh.dt, 0.0)) / slowest**2  # largest terms of a damped wave
            s = np.arange(1.0, np.ceil(peak + 12.0 / slowest) + 2.0)
            decay = 0.5 * (sizes * beam.thermal_velocity * mesh.dt)[:, None] ** 2 * s**2
            response = -(s * np.exp(1j * phase[:, None] * s - decay)).sum(axis=1)
        total += (beam.plasma_frequency * mesh.dt) ** 2 * np.dot(weights, response)
    return total


def mesh_root(guess: complex, k: ArrayLike, beams: Sequence[Beam], mesh: Mesh) -> complex:
    """The root of the scheme's own dispersion relation next to guess (usually the continuum root)."""
    return root_near(guess, lambda w: 1.0 - mesh_susceptibility(w, k, beams, mesh), tolerance=1e-13)
