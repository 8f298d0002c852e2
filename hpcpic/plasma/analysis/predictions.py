"""Which result of theory belongs to a case, and a measured mode beside it. Frequencies in rad/s."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hpcpic.plasma.analysis import series_analysis, theory
from hpcpic.plasma.analysis.theory import Beam, Mesh
from hpcpic.plasma.case.config import PlasmaConfig
from hpcpic.plasma.configure import configure
from hpcpic.plasma.forecast.recurrence import beams_along, waves_of
from hpcpic.plasma.forecast.scales import plasma_frequency, spacing
from hpcpic.plasma.physics.dispersion import total_frequency
from hpcpic.plasma.physics.poisson import operator_of, response
from hpcpic.plasma.physics.quiet_start import lattice
from hpcpic.plasma.setup.loaders import loader_of

if TYPE_CHECKING:
    from hpcpic.core.files.reader import Run


LAST = 8  # half periods of a damped wave that are fitted
MOST_LEFT = 0.5  # of a steady wave's root mean square: what a fit leaves of a signal that it is no fit of
OVER_NOISE = 3.0  # of the maxima of a wave that a rate of decay is taken from
HEAVY = 0.03  # times the plasma frequency: that of ions which electrons leave at rest, to 5e-4 of their own


@dataclass(frozen=True, slots=True)
class Prediction:
    """A wave exp(i k.x - i omega t): continuum root, root of the scheme, and the name of the law."""

    law: str
    omega: complex
    omega_mesh: complex


def config_of(run: Run) -> PlasmaConfig:
    """The case of a run, with every default filled in."""
    from hpcpic.core.case.config import loads

    return configure(loads(run.config, run.config_file))


def beams_of(config: PlasmaConfig, k: NDArray[np.float64]) -> tuple[Beam, ...]:
    """The species as Maxwellian beams along a wave vector[d]; none where parts of one differ in spread by axis."""
    for species in config.species:
        axes = [loader_of(species).populations(species, axis) for axis in np.flatnonzero(k).tolist()]
        spreads = [[axis[j % len(axis)].spread for axis in axes] for j in range(max(map(len, axes)))]
        if any(min(of_a_part) < max(of_a_part) for of_a_part in spreads):
            return ()
    share = (k / np.linalg.norm(k)).tolist()
    return tuple(beam for species in config.species for beam in beams_along(config, species, share))


def beams_along_x(config: PlasmaConfig) -> tuple[Beam, ...]:
    return beams_of(config, np.eye(config.dimensions)[0])


def mesh_of(config: PlasmaConfig) -> Mesh:
    """What the dispersion of the scheme needs."""
    dt = abs(config.simulation.time_step)  # backwards a wave does the same
    return Mesh(spacing(config), dt, config.numerics.shape, config.numerics.gradient == "spectral")


@dataclass(frozen=True, slots=True)
class Wave:
    """A wave vector k[d] in a plasma that has a field along it, the beams along it in nature and as the mesh has them,
    and whether a magnetic field lies across it.
    """

    k: NDArray[np.float64]
    beams: tuple[Beam, ...]
    meshed: tuple[Beam, ...]
    across: bool

    @property
    def size(self) -> float:
        return float(np.linalg.norm(self.k))

    @property
    def still(self) -> bool:
        return not any(any(beam.velocity) for beam in self.beams)


def wave_of(config: PlasmaConfig, mode: Sequence[int]) -> Wave | None:
    """The wave of a mode, in whole wavelengths along x, or x, y, or x, y, z; None where no law here holds for it."""
    if not any(mode):
        return None
    sign = next(n for n in mode if n) // abs(next(n for n in mode if n))  # k and -k are one wave
    waves = np.pad(mode, (0, config.dimensions - len(mode)))
    k = 2.0 * math.pi * sign * waves / np.array(config.simulation.space_length)
    found, operator = beams_of(config, k), operator_of(config)
    if not found or any(operator.along("xyz"[axis])[1] for axis in np.flatnonzero(k)):
        return None
    dx, radius, spectral = spacing(config), config.numerics.cloud_radius, mesh_of(config).spectral
    continuum, on_mesh = response(operator, k.tolist(), dx, spectral=spectral, cloud_radius=radius)
    if min(continuum, on_mesh) <= 0:  # charges of one sign attract
        return None
    across = bool(np.cross(np.pad(k, (0, 3 - len(k))), config.field.magnetic).any())  # B along k leaves the wave alone
    return Wave(k, scaled(found, continuum), scaled(found, on_mesh), across)


def predict(config: PlasmaConfig, mode: Sequence[int]) -> Prediction | None:
    """What a mode should do, or None where no law here applies. mode: whole wavelengths along x, or x, y, or x, y, z.

    In order: upper hybrid (cold, k along an axis across B), an unstable root, Landau's root, the cold wave.
    """
    if (wave := wave_of(config, mode)) is None:
        return None
    k, found, mesh = wave.k, wave.beams, mesh_of(config)
    wp = total_frequency(found)
    cold = all(b.thermal_velocity == 0.0 for b in found)
    if wave.across:
        return _upper_hybrid(config, k, found, wave.meshed) if cold and wave.still else None
    if growing := _growing(wave, mesh):
        return growing
    if cold and wave.still:
        return Prediction("cold wave", complex(wp), _cold_on_mesh(config, k, wave.meshed))
    waving = [pair for pair in zip(found, wave.meshed) if pair[0].plasma_frequency > HEAVY * wp]
    started = [plasma_frequency(config, s) for s in config.species if s.perturbation]
    if len(waving) > 1 or not wave.still or any(own <= HEAVY * wp for own in started):  # also a wave of ions
        return None
    ((beam, scheme),) = waving
    wp = beam.plasma_frequency
    if wave.size * beam.thermal_velocity / wp < 2.0:
        omega = wp * theory.landau(wave.size * beam.thermal_velocity / wp)
        return Prediction("Landau damping", omega, _on_mesh(omega, k, (scheme,), mesh))
    return None


def _growing(wave: Wave, mesh: Mesh) -> Prediction | None:
    try:
        omega = theory.unstable_root(wave.size, wave.beams)
    except theory.NoRoot:
        return None
    law = "two-stream" if len(wave.beams) == 2 and wave.beams[0].drift == -wave.beams[1].drift else "beam instability"
    return Prediction(law, omega, _on_mesh(omega, wave.k, wave.meshed, mesh))


def predict_sound(config: PlasmaConfig, mode: Sequence[int]) -> Prediction | None:
    """The wave of several species at rest that a case starts: the least damped, which lasts longest, or, where only the
    lightest are started, the fastest. None where none is started, where one grows, and across a magnetic field.
    """
    wave, started = wave_of(config, mode), [plasma_frequency(config, s) for s in config.species if s.perturbation]
    if wave is None or not started or wave.across or not wave.still or len(wave.beams) < 2:
        return None
    if _growing(wave, mesh_of(config)):
        return None
    unit = total_frequency(wave.beams)
    own = [Beam(b.plasma_frequency / unit, 0.0, wave.size * b.thermal_velocity / unit) for b in wave.beams]
    roots = []
    for guess in waves_of(own):
        with contextlib.suppress(theory.NoRoot):
            roots.append(theory.root_near(guess, lambda w: 1.0 - theory.susceptibility(w, 1.0, own)))
    lasting = [root for root in roots if root.real > 0.0 and root.imag < 0.0]
    if not lasting:
        return None
    heavy = min(started) < max(plasma_frequency(config, s) for s in config.species)
    omega = unit * max(lasting, key=lambda root: root.imag if heavy else root.real)
    return Prediction("Landau damping of all species", omega, _on_mesh(omega, wave.k, wave.meshed, mesh_of(config)))


def scaled(found: tuple[Beam, ...], factor: float) -> tuple[Beam, ...]:
    """Beams whose field is `factor` times as strong."""
    return tuple(replace(beam, plasma_frequency=beam.plasma_frequency * math.sqrt(factor)) for beam in found)


def _on_mesh(omega: complex, k: NDArray[np.float64], found: tuple[Beam, ...], mesh: Mesh) -> complex:
    try:
        return theory.mesh_root(omega, k, found, mesh)
    except theory.NoRoot:
        return omega


def _cold_on_mesh(config: PlasmaConfig, k: NDArray[np.float64], found: tuple[Beam, ...]) -> complex:
    """The cold wave of the scheme; of a lattice of particles by the closed form that knows their places in a cell."""
    mesh, wp = mesh_of(config), total_frequency(found)
    lattices = [lattice(s.particles, config.points) for s in config.species if s.init_method == "quiet" and s.particles]
    per_cell = {n / cells for sides in lattices for n, cells in zip(sides or (), config.points)}
    if len(per_cell) == 1 and mesh.shape == "CIC" and not mesh.spectral and len(config.points) > 1:
        return complex(theory.cold_wave_frequency(wp, mesh.dt, k, mesh.dx, per_cell.pop()))
    return _on_mesh(complex(wp), k, found, mesh)


def _upper_hybrid(
    config: PlasmaConfig, k: NDArray[np.float64], found: tuple[Beam, ...], meshed: tuple[Beam, ...]
) -> Prediction | None:
    """Prediction for one cold species with B across k, and k along an axis."""
    magnetic, mesh = np.array(config.field.magnetic), mesh_of(config)
    moving = [s for s in config.species if s.particles]
    axes = np.flatnonzero(k)
    if magnetic[axes].any() or len(axes) > 1 or len(moving) != 1:
        return None
    (axis,), (beam,), (scheme,) = axes, found, meshed
    wc = abs(moving[0].charge / moving[0].mass) * float(np.linalg.norm(magnetic))
    wave = scheme.plasma_frequency, wc, mesh.dt, k[axis], spacing(config)[axis], config.numerics.exact_phase
    return Prediction(
        "upper hybrid", complex(math.hypot(beam.plasma_frequency, wc)), complex(theory.upper_hybrid_frequency(*wave))
    )


@dataclass(frozen=True, slots=True)
class Compared:
    """A mode beside its law: words, the line of theory (or None), and the times worth showing (or None)."""

    words: str
    line: np.ndarray | None = None
    shown: tuple[float, float] | None = None


def compare_mode(t: np.ndarray, amplitude: np.ndarray, law: Prediction | None, noise: float = 0.0) -> Compared:
    """Fit what the law says the mode does: growth, damping or a steady wave; growth without a law, and where the law's
    steady wave is not there, as in a plasma that is not uniform.

    noise: that of random places, of the wave that the case starts, as `noise_over_wave` knows it before the run.
    """
    steady = law is not None and abs(law.omega.imag) <= 1e-6 * abs(law.omega)
    try:
        if law is None or (not steady and law.omega.imag > 0.0):
            return _compare_growth(t, amplitude, law)
        return _compare_wave(t, amplitude, law) if steady else _compare_damping(t, amplitude, law, noise)
    except series_analysis.NoFit as error:
        if steady:
            with contextlib.suppress(series_analysis.NoFit):
                return _compare_growth(t, amplitude, None)
        return Compared(f"not fitted: {error}")


def _require_samples(t: np.ndarray, law: Prediction) -> None:
    """Raises NoFit where a wave of the law's frequency swings faster than the series is sampled."""
    if (half := np.pi / law.omega_mesh.real) < np.median(np.diff(t)):
        raise series_analysis.NoFit(f"output.period.series of {half:.2g} s or less shows the law's wave ({law.law})")


def _compare_growth(t: np.ndarray, amplitude: np.ndarray, law: Prediction | None) -> Compared:
    fit = series_analysis.growth_rate(t, amplitude)
    words = f"growth {fit.value:.5g} ± {fit.error:.1g} 1/s"
    if law is None:
        return Compared(words)
    middle = 0.5 * (fit.start + fit.stop)
    line = fit.amplitude * np.exp(fit.value * middle + law.omega_mesh.imag * (t - middle))
    words += f"\ntheory {law.omega.imag:.5g} ({law.law})"
    return Compared(words, np.where(line <= 2.0 * amplitude.max(), line, np.nan))


def _compare_damping(t: np.ndarray, amplitude: np.ndarray, law: Prediction, known: float) -> Compared:
    _require_samples(t, law)
    times, heights = series_analysis.peaks(t, amplitude)
    if times.size < 4:
        raise series_analysis.NoFit("fewer than four maxima")
    noise = max(series_analysis.noise_of(times, heights, law.omega.imag), known * amplitude.max())
    below = np.flatnonzero(heights < OVER_NOISE * noise)
    last = min(LAST, (int(below[0]) if below.size else times.size) - 1)
    if last < 3:
        words = "it meets the noise, or traps particles as large waves do,"
        raise series_analysis.NoFit(f"{words} after {last + 1} of the four maxima that a fit needs")
    window = (t >= times[1]) & (t <= times[last])  # the first maximum has other roots in it
    wave = series_analysis.signed(amplitude)[window]
    fit = series_analysis.fit_oscillation(t[window], wave, frequency=law.omega.real, rate=law.omega.imag)
    swung = noise / (heights[last] * (times[last] - times[1]))  # noise of the same frequency, of any phase
    errors = math.hypot(fit.rate_error, swung), math.hypot(fit.frequency_error, swung)
    words = _damped_words(fit, errors, law)
    return Compared(words, heights[1] * np.exp(law.omega_mesh.imag * (t - times[1])))


def compare_parts(t: np.ndarray, parts: np.ndarray, law: Prediction) -> Compared:
    """Fit a damped wave to the complex amplitude E_k of a mode, along the line of the complex plane on which it swings.

    It may be small beside others that are faster: nothing is asked of its maxima.
    """
    turns = (t - t[0]) * law.omega.real / np.pi
    window = (turns >= 1.0) & (turns <= LAST)  # the first half period has other roots in it
    phase = 0.5 * np.angle(np.sum(parts**2))
    wave = (parts * np.exp(-1j * phase)).real
    try:
        fit = series_analysis.fit_oscillation(t[window], wave[window], frequency=law.omega.real, rate=law.omega.imag)
    except series_analysis.NoFit as error:
        return Compared(f"not fitted: {error}")
    if fit.frequency_error > series_analysis.STEADY * fit.frequency:
        return Compared("not fitted: it is no steady wave beside others and noise")
    words = _damped_words(fit, (fit.rate_error, fit.frequency_error), law)
    return Compared(words, fit.amplitude * np.exp(law.omega_mesh.imag * t))


def _damped_words(fit: series_analysis.Oscillation, errors: tuple[float, float], law: Prediction) -> str:
    return (
        f"decay {-fit.rate:.4g} ± {errors[0]:.1g} 1/s, frequency {fit.frequency:.5g} ± {errors[1]:.1g} rad/s\n"
        f"theory {-law.omega.imag:.4g} and {law.omega.real:.5g} ({law.law})"
    )


def _compare_wave(t: np.ndarray, amplitude: np.ndarray, law: Prediction) -> Compared:
    """The end of the run beside a wave of the scheme's frequency whose phase was fixed at the beginning."""
    _require_samples(t, law)
    if amplitude.min() > 0.5 * amplitude.max():
        raise series_analysis.NoFit("it hardly swings, so no wave stands here")
    wave, omega = series_analysis.signed(amplitude), law.omega_mesh.real
    fit = series_analysis.fit_oscillation(t, wave, frequency=omega)
    if fit.residual > MOST_LEFT * wave.std():
        raise series_analysis.NoFit(f"the law's wave ({law.law}) does not stand out")
    begin = slice(0, max(8, t.size // 10))
    phases = np.stack((np.cos(omega * t), np.sin(omega * t)), axis=1)
    line = np.abs(phases @ np.linalg.lstsq(phases[begin], wave[begin], rcond=None)[0])
    words = (
        f"frequency {fit.frequency:.7g} ± {fit.frequency_error:.1g} rad/s\n"
        f"theory {law.omega.real:.7g}, in this mesh and step {omega:.7g} ({law.law})"
    )
    return Compared(words, line, (max(t[0], t[-1] - 12 * np.pi / omega), t[-1]))
