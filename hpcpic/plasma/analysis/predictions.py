"""Which result of theory belongs to a case, and a measured mode beside it. Frequencies in rad/s."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hpcpic.plasma.analysis import series_analysis, theory
from hpcpic.plasma.analysis.theory import Beam, Mesh
from hpcpic.plasma.case.config import PlasmaConfig
from hpcpic.plasma.configure import configure
from hpcpic.plasma.forecast.derived import plasma_frequency
from hpcpic.plasma.physics.poisson import operator_of, response
from hpcpic.plasma.setup.loaders import loader_of

if TYPE_CHECKING:
    from hpcpic.core.files.reader import Run


@dataclass(frozen=True, slots=True)
class Prediction:
    """A wave exp(i k x - i omega t): continuum root, root of the scheme, and the name of the law."""

    law: str
    k: float
    omega: complex
    omega_mesh: complex


def config_of(run: Run) -> PlasmaConfig:
    """The case of a run, with every default filled in."""
    from hpcpic.core.case.config import loads

    return configure(loads(run.config))


def beams(config: PlasmaConfig) -> tuple[Beam, ...]:
    """The species as Maxwellian beams along x; two for a species that starts as two."""
    found: list[Beam] = []
    for species in config.species:
        wp = plasma_frequency(config, species)
        if not wp:
            continue
        populations = loader_of(species).populations(species, 0)
        found += [Beam(wp * math.sqrt(part.share), part.mean, part.spread) for part in populations]
    return tuple(found)


def mesh_of(config: PlasmaConfig) -> Mesh:
    """What the dispersion of the scheme needs, for waves along x."""
    dx = config.simulation.space_length[0] / config.points[0]
    dt = abs(config.simulation.time_step)  # backwards a wave does the same
    return Mesh(dx, dt, config.numerics.shape, config.numerics.gradient == "spectral")


def predict(config: PlasmaConfig, mode: int) -> Prediction | None:
    """What mode `mode` along x should do, or None where no law here applies.

    In order: upper hybrid (cold, B across x), an unstable root, Landau's root, the cold wave.
    """
    found = beams(config)
    if not found or not mode or config.field.equation.b:
        return None
    k, mesh = 2.0 * math.pi * mode / config.simulation.space_length[0], mesh_of(config)
    continuum, on_mesh = field_factors(config, k)
    if min(continuum, on_mesh) <= 0:  # charges of one sign attract
        return None
    found, meshed = scaled(found, continuum), scaled(found, on_mesh)
    wp = math.sqrt(sum(b.plasma_frequency**2 for b in found))
    cold = all(b.thermal_velocity == 0.0 for b in found)
    still = all(b.drift == 0.0 for b in found)
    if any(config.field.magnetic[1:]):  # B along k leaves the wave alone
        return _upper_hybrid(config, mode) if cold and still else None
    try:
        omega = theory.unstable_root(k, found)
        law = "two-stream" if len(found) == 2 and found[0].drift == -found[1].drift else "beam instability"
        return Prediction(law, k, omega, _on_mesh(omega, k, meshed, mesh))
    except theory.NoRoot:
        pass
    if cold and still:
        return Prediction("cold wave", k, complex(wp), _on_mesh(complex(wp), k, meshed, mesh))
    if len(found) == 1 and still and k * found[0].thermal_velocity / wp < 2.0:
        omega = wp * theory.landau(k * found[0].thermal_velocity / wp)
        return Prediction("Landau damping", k, omega, _on_mesh(omega, k, meshed, mesh))
    return None


def field_factors(config: PlasmaConfig, k: float) -> tuple[float, float]:
    """Factors of the squared plasma frequency by the field equation: without a mesh, and on that of the case."""
    mesh, radius = mesh_of(config), config.numerics.cloud_radius
    return response(operator_of(config), k, mesh.dx, spectral=mesh.spectral, cloud_radius=radius)


def scaled(found: tuple[Beam, ...], factor: float) -> tuple[Beam, ...]:
    """Beams whose field is `factor` times as strong."""
    return tuple(replace(beam, plasma_frequency=beam.plasma_frequency * math.sqrt(factor)) for beam in found)


def _on_mesh(omega: complex, k: float, found: tuple[Beam, ...], mesh: Mesh) -> complex:
    try:
        return theory.mesh_root(omega, k, found, mesh)
    except theory.NoRoot:
        return omega


def _upper_hybrid(config: PlasmaConfig, mode: int) -> Prediction | None:
    """Prediction for one cold species with B across x."""
    bx, by, bz = config.field.magnetic
    moving = [s for s in config.species if s.particles]
    if bx or len(moving) != 1:
        return None
    (beam,), mesh = beams(config), mesh_of(config)
    wc = abs(moving[0].charge / moving[0].mass) * math.hypot(by, bz)
    k = 2.0 * math.pi * mode / config.simulation.space_length[0]
    wp, on_mesh = (beam.plasma_frequency * math.sqrt(factor) for factor in field_factors(config, k))
    discrete = theory.upper_hybrid_frequency(on_mesh, wc, mesh.dt, k, mesh.dx, config.numerics.exact_phase)
    return Prediction("upper hybrid", k, complex(math.hypot(wp, wc)), complex(discrete))


@dataclass(frozen=True, slots=True)
class Compared:
    """A mode beside its law: words, the line of theory (or None), and the times worth showing (or None)."""

    words: str
    line: np.ndarray | None = None
    shown: tuple[float, float] | None = None


def compare_mode(t: np.ndarray, amplitude: np.ndarray, law: Prediction | None) -> Compared:
    """Fit what the law says the mode does: growth, damping or a steady wave; growth without a law."""
    try:
        if law is None or law.omega.imag > 1e-6 * abs(law.omega):
            return _compare_growth(t, amplitude, law)
        return _compare_damping(t, amplitude, law) if law.omega.imag < 0 else _compare_wave(t, amplitude, law)
    except series_analysis.NoFit as error:
        return Compared(f"not fitted: {error}")


def _compare_growth(t: np.ndarray, amplitude: np.ndarray, law: Prediction | None) -> Compared:
    fit = series_analysis.growth_rate(t, amplitude)
    words = f"growth {fit.value:.5g} ± {fit.error:.1g} 1/s"
    if law is None:
        return Compared(words)
    middle = 0.5 * (fit.start + fit.stop)
    line = fit.amplitude * np.exp(fit.value * middle + law.omega_mesh.imag * (t - middle))
    words += f"\ntheory {law.omega.imag:.5g} ({law.law})"
    return Compared(words, np.where(line <= 2.0 * amplitude.max(), line, np.nan))


def _compare_damping(t: np.ndarray, amplitude: np.ndarray, law: Prediction) -> Compared:
    times, heights = series_analysis.peaks(t, amplitude)
    if times.size < 4:
        raise series_analysis.NoFit("fewer than four maxima")
    window = (t >= times[1]) & (t <= times[min(8, times.size - 1)])  # the first maximum has other roots in it
    wave = series_analysis.signed(amplitude)[window]
    fit = series_analysis.fit_oscillation(t[window], wave, frequency=law.omega.real, rate=law.omega.imag)
    words = (
        f"decay {-fit.rate:.4g} ± {fit.rate_error:.1g} 1/s, frequency {fit.frequency:.5g} rad/s\n"
        f"theory {-law.omega.imag:.4g} and {law.omega.real:.5g} ({law.law})"
    )
    return Compared(words, heights[1] * np.exp(law.omega_mesh.imag * (t - times[1])))


def _compare_wave(t: np.ndarray, amplitude: np.ndarray, law: Prediction) -> Compared:
    """The end of the run beside a wave of the scheme's frequency whose phase was fixed at the beginning."""
    if amplitude.min() > 0.5 * amplitude.max():
        raise series_analysis.NoFit("it hardly swings, so no wave stands here")
    wave, omega = series_analysis.signed(amplitude), law.omega_mesh.real
    fit = series_analysis.fit_oscillation(t, wave, frequency=omega)
    begin = slice(0, max(8, t.size // 10))
    phases = np.stack((np.cos(omega * t), np.sin(omega * t)), axis=1)
    line = np.abs(phases @ np.linalg.lstsq(phases[begin], wave[begin], rcond=None)[0])
    words = (
        f"frequency {fit.frequency:.7g} ± {fit.frequency_error:.1g} rad/s\n"
        f"theory {law.omega.real:.7g}, in this mesh and step {omega:.7g} ({law.law})"
    )
    return Compared(words, line, (max(t[0], t[-1] - 12 * np.pi / omega), t[-1]))
