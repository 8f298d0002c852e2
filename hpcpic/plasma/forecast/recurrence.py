"""Stratified species: when their beams, which damp the waves that a case starts, are in phase again."""

import math
from collections.abc import Iterator, Sequence

from hpcpic.core.case.derived import Derived, judged
from hpcpic.plasma.case.config import PlasmaConfig, Species
from hpcpic.plasma.forecast.scales import plasma_frequency, spacing
from hpcpic.plasma.physics.dispersion import Beam, NoRoot, root_near, susceptibility
from hpcpic.plasma.physics.poisson import operator_of, response
from hpcpic.plasma.physics.quiet_start import recurrence_time
from hpcpic.plasma.setup.loaders import loader_of

RECURRENCE = 10.0  # runs until beams are in phase: damping 5 % off, with 4 6 to 12 %, with 25 1.5 %
UNDAMPED = 0.01  # of a wave's amplitude: what a species takes of it in a run without being told
WAVE = 0.5  # damping over frequency: what falls faster has no phase velocity that beams could move with


def recurrence(config: PlasmaConfig) -> Iterator[Derived]:
    """The time until the beams of each warm stratified species are in phase again, the shortest for the waves of the
    whole plasma at the wave number of any perturbation. Not told where the species damps none of them in the run.
    """
    if not (length := abs(config.simulation.time_step) * config.simulation.cycles):
        return
    perturbed = (species.perturbation.mode for species in config.species if species.perturbation)
    modes = [mode for mode in dict.fromkeys(perturbed) if any(mode) and on_grid(mode, config.points)]
    for i, species in enumerate(config.species):
        if species.init_method != "strata" or not species.thermal_velocity or not plasma_frequency(config, species):
            continue
        times = [time for mode in modes for time in recurrence_times(config, species, mode, UNDAMPED / length)]
        if not times:
            continue
        time, wanted = min(times), RECURRENCE * length
        yield judged(
            f"recurrence of {species.name}", "2 pi/(k dv)", time, ok=time > wanted, legal=True, unit="s",
            limit=f"> {wanted:.3g}, {RECURRENCE:g} times the run",
            source="Landau damping to 5 %, at 25 times to 1.5 %, measured",
            cure=f"{wanted / time if time else math.inf:.2g} times the particles, or fewer places",
            key=("species", i, "particles"),
        )  # fmt: skip


def on_grid(mode: Sequence[int], points: Sequence[int]) -> bool:
    return all(2 * abs(n) <= m for n, m in zip(mode, points))


def recurrence_times(config: PlasmaConfig, species: Species, mode: Sequence[int], least: float) -> Iterator[float]:
    """Time, s, until strata are in phase again near the velocity of each wave of a mode that they damp faster than
    `least`, rad/s.
    """
    vector = [2 * math.pi * n / length for n, length in zip(mode, config.simulation.space_length)]
    k, dx, radius = math.hypot(*vector), spacing(config), config.numerics.cloud_radius
    spectral = config.numerics.gradient == "spectral"
    _, factor = response(operator_of(config), vector, dx, spectral=spectral, cloud_radius=radius)
    if not 0 < factor < math.inf:  # charges of one sign attract each other
        return
    share = [component / k for component in vector]
    (own,) = beams_along(config, species, share)
    beams = [beam for other in config.species for beam in beams_along(config, other, share)]
    unit = math.hypot(*(beam.plasma_frequency for beam in beams)) * math.sqrt(factor)  # of frequencies
    own, *beams = (
        Beam(math.sqrt(factor) * b.plasma_frequency / unit, k * b.drift / unit, k * b.thermal_velocity / unit)
        for b in (own, *beams)
    )
    count = species.particles // loader_of(species).batch_size(species, config.points)  # type: ignore[operator]
    for omega in waves_of(beams):
        h = 1e-6 * math.hypot(omega - own.drift, own.thermal_velocity)
        slope = (susceptibility(omega + h, 1.0, beams) - susceptibility(omega - h, 1.0, beams)) / (2 * h)
        damping = abs(susceptibility(omega, 1.0, [own]).imag / slope)  # Landau's, weak
        if damping * unit >= least:
            yield recurrence_time(count, 1.0, own.thermal_velocity, omega - own.drift) / unit


def beams_along(config: PlasmaConfig, species: Species, share: Sequence[float]) -> list[Beam]:
    """The parts of a species as beams along a unit vector[d]."""
    axes = {axis: loader_of(species).populations(species, axis) for axis, c in enumerate(share) if c}
    found, wp = [], plasma_frequency(config, species)
    for j in range(max(map(len, axes.values())) if wp else 0):
        parts = {axis: listed[j % len(listed)] for axis, listed in axes.items()}  # what does not drift there is one
        drift = sum(share[axis] * part.mean for axis, part in parts.items())
        spread = math.hypot(*(share[axis] * part.spread for axis, part in parts.items()))
        velocity = tuple(parts[axis].mean if axis in parts else 0.0 for axis in range(len(share)))
        found.append(Beam(wp * math.sqrt(min(part.share for part in parts.values())), drift, spread, velocity))
    return found


def waves_of(beams: Sequence[Beam]) -> Iterator[float]:
    """Frequencies of the waves at k = 1 both ways: Langmuir's, and those of cooler beams that hotter ones shield; of
    beams that drift apart, those of each drift too.

    Each is a root of the dispersion relation near what fluids have (Bohm and Gross; acoustic waves). Langmuir's that
    is no wave any more, for its damping, has the frequency of Bohm and Gross; one of the others is none.
    """
    together = [[beam for beam in beams if beam.drift == drift] for drift in sorted({beam.drift for beam in beams})]
    groups = [beams, *together] if len(together) > 1 else together
    for group, thermal in [(some, v) for some in groups for v in sorted({b.thermal_velocity for b in some})]:
        fluid = [beam for beam in group if beam.thermal_velocity <= thermal]
        shield = sum((b.plasma_frequency / b.thermal_velocity) ** 2 for b in beams if b.thermal_velocity > thermal)
        square = sum(beam.plasma_frequency**2 for beam in fluid)
        drift = sum(beam.plasma_frequency**2 * beam.drift for beam in fluid) / square
        pressure = 3 * sum((beam.plasma_frequency * beam.thermal_velocity) ** 2 for beam in fluid) / square
        frequency = math.sqrt(square / (1 + shield) + pressure)
        for guess in (drift - frequency, drift + frequency):
            try:
                root = root_near(guess, lambda w: 1.0 - susceptibility(w, 1.0, beams))
            except NoRoot:
                root = complex(math.nan, math.nan)
            if abs(root.imag) < WAVE * abs(root.real - drift):
                yield root.real
            elif len(fluid) == len(beams):
                yield guess
