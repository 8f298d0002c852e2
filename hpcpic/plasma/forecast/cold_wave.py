"""Waves in cold species, which a case starts or a weak beam drives: aliases heat what they set moving, and all that
drifts through the grid.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from hpcpic.core.case.derived import Derived, judged, rounded_down, rounded_up
from hpcpic.core.files.start import Start, arrays
from hpcpic.plasma.case.config import MOST_POINTS, Equation, PlasmaConfig, Species, velocity_components, volume
from hpcpic.plasma.forecast.cold_drift import COLD, GAIN, SPECTRAL, TOLD
from hpcpic.plasma.forecast.noise import MIN_OVER_NOISE, even_places, started_amplitude
from hpcpic.plasma.forecast.scales import (
    MOST_WITHOUT_FIELD,
    charge_density,
    plasma_frequency,
    spacing,
    thermal_velocities,
    total_plasma_frequency,
)
from hpcpic.plasma.forecast.turning import turn_across_grid
from hpcpic.plasma.physics.heating import field_of_random_places
from hpcpic.plasma.setup.loaders import loader_of, random_places
from hpcpic.plasma.setup.macro_particles import macro_charge, macro_mass


@dataclass(frozen=True, slots=True)
class Aliases:
    """gain: of m (wp dx)^2/2 a particle until wp t = 400, whatever the speed u that the wave gives it, in wp dx, up to
    FASTEST; it begins at wp t = onset/u, and is twice as much by 800. places: whether those of fewer than MANY_PLACES
    in a cell along the wave gain more, as one over their root; not with TSC. fold: wp t of an e-fold of the energy of
    a wave of any u, where it begins at wp t = onset whatever the wave.
    """

    gain: float
    onset: float
    places: bool = True
    fold: float = math.inf

    def until(self, time: float, speed: float, number: float) -> float:
        """The gain until wp t = time by a wave of `speed`, wp dx, with so many places in a cell along it."""
        if time * (speed if self.fold == math.inf else 1.0) <= self.onset:
            return 0.0
        gain = self.gain * (math.sqrt(max(MANY_PLACES / number, 1.0)) if self.places else 1.0)
        if self.fold == math.inf:
            return gain
        return min(gain, 0.5 * speed**2 * FIRST * math.expm1(min(time / self.fold, 100.0)))  # of a wave: speed^2/2


MANY_PLACES = 64.0  # those of the gains below
# 1D, 64 points, 64 particles per cell at even places, wp dt = 0.2, waves of u = 0.02 to 3 and beams of 0.0003 to 0.1 of
# the density; from 2 places in a cell on, and in 2D: docs/measured/plasma.md.
ALIASES = {
    ("NGP", "difference"): Aliases(0.2, 5.0, fold=7.5), ("CIC", "difference"): Aliases(0.02, 20.0),
    ("TSC", "difference"): Aliases(0.0045, 40.0, places=False), ("NGP", "spectral"): Aliases(0.2, 5.0, fold=4.0),
    ("CIC", "spectral"): Aliases(0.06, 10.0), ("TSC", "spectral"): Aliases(0.05, 20.0, places=False),
}  # fmt: skip
FIRST = 0.2  # of the energy of a wave, that grows by e-folds (NGP, 16 to 128 points, u = 0.02 to 0.5)
LEAST_MOVED = 0.5  # of the distance from one place to the next: a wave that moves its particles by less was not heated
FASTEST = 3.0  # wp dx: no heating of faster motions was seen
# A cold plasma that drifts as a whole, at any speed, gains GAIN of cold_drift from this wp t on, whatever its wave.
DRIFTING = {"NGP": 15.0, "CIC": 70.0, "TSC": 170.0}
SOONER = 0.5  # of that with spectral gradients
WEAK = 0.3  # density of a beam over that of the plasma, for the laws below
GROWN = 5.0  # e-folds until the wave of a beam is large
# A weak cold beam of f times the density, at v, drives the wave k = wp/v at the rate sqrt(3/4) (f/2)^(1/3) wp until it
# traps the beam, when it moves the plasma by SATURATED f^(2/3) v (measured for f from 0.0003 to 0.03).
SATURATED = 1.3
# A cold plasma across a magnetic field becomes as warm as lambda_D = ACROSS_HEATED dx, whatever its wave: 32 x 24
# points, 16 per cell at even places, wc = 0.1 to 4 wp, waves of 1e-3 to 0.1, until wp t = 600; 16 x 12 x 8 points. At
# wc = 8 wp nothing was heated until then, nor with clouds of R = dx, nor in 1D: docs/measured/plasma.md.
ACROSS_HEATED = 0.3
ACROSS_TURNS = 0.1, 4.0  # wc/wp
ACROSS_ONSET = 100.0  # wp t
LONGEST_WAVES = 8  # wavelengths in the box along an axis: waves of given places that are looked for
LEAST_WAVE = 1e-9  # relative density that is no rounding of even places
NOISE = 0.1  # of the energy, that noise may have
MOST_SUMMED = 1 << 18  # points along an axis, whose waves are summed in a tenth of a second


@dataclass(frozen=True, slots=True)
class Moved:
    """A speed that a wave gives a species, m/s, from when on, s, and whether the wave runs along the axis."""

    speed: float
    since: float
    along: bool = True


@dataclass(frozen=True, slots=True)
class Heated:
    """What aliases add to an energy, over it, with this shape and with TSC; and of which motion they do."""

    growth: float
    smoother: float
    motion: str


def cold_wave(config: PlasmaConfig) -> Iterator[Derived]:
    """What aliases make of the energy of the scene, or of a wave in a plasma that drifts as a whole, along the axis
    where that is most. Not told where clouds are as large as cells, as little was heated there, nor of another field
    equation; where B lies across see across_field.
    """
    numerics = config.numerics
    if numerics.cloud_radius >= min(spacing(config)) or config.field.equation != Equation():
        return
    for species in config.species:
        found = [one for axis in range(config.dimensions) for one in heated(config, species, axis)]
        if not found:
            continue
        worst = max(found, key=lambda one: one.growth)
        finer = (worst.growth / TOLD) ** (2 / 3) * (1 + 1e-9)  # as heat falls and places in a cell become fewer
        points = [math.ceil(n * finer) if n > MOST_WITHOUT_FIELD else n for n in config.points]
        ways = [f"grid.points = {points}"] if max(points) <= MOST_POINTS else []
        if numerics.gradient == "difference" and numerics.shape != "TSC":
            ways.insert(0, f'numerics.shape = "TSC" ({worst.smoother:.2g} of it)')
        if config.simulation.solver == "MFT":
            ways.append(f"numerics.cloud_radius = {rounded_down(min(spacing(config)) * 1.1):g}")
        yield judged(
            f"aliases in cold {species.name}", "dW/W(0)", worst.growth, limit=f"< {TOLD:g}", ok=worst.growth < TOLD,
            legal=True, source=worst.motion, cure=", or ".join([*ways, "a spread of lambda_D = dx/2 or more"]),
            key=("grid", "points"),
        )  # fmt: skip
    yield from across_field(config)


def across_field(config: PlasmaConfig) -> Iterator[Derived]:
    """What aliases make of the energy of a cold plasma in a magnetic field across the grid, whose waves nothing damps:
    they grow out of any noise or wave.
    """
    wp, time = total_plasma_frequency(config), abs(config.simulation.time_step) * config.simulation.cycles
    if not ACROSS_TURNS[0] <= turn_across_grid(config) <= ACROSS_TURNS[1] or wp * time < ACROSS_ONSET:
        return
    species = max(config.species, key=lambda one: plasma_frequency(config, one))
    axes = [axis for axis, n in enumerate(config.points) if n > MOST_WITHOUT_FIELD]
    cells = [plasma_frequency(config, species) * spacing(config)[axis] for axis in axes]
    spreads = [max(part.spread for part in loader_of(species).populations(species, axis)) for axis in axes]
    energy = wave_energy(config) + energy_of_motion(config)
    if any(spread >= COLD * cell for spread, cell in zip(spreads, cells)) or not energy:
        return
    heat = 0.5 * species.particles * macro_mass(config, species) * len(axes) * (ACROSS_HEATED * min(cells)) ** 2
    clouds = f"numerics.cloud_radius = {rounded_up(min(spacing(config))):g}, or "
    yield judged(
        f"aliases in cold {species.name} across B", "dW/W(0) in B", heat / energy, limit=f"< {TOLD:g}",
        ok=heat < TOLD * energy, legal=True, key=("field", "magnetic"),
        source=f"lambda_D becomes {ACROSS_HEATED:g} dx, by wp t = 120 to 460, measured (0.2 to 0.5 dx)",
        cure=(clouds if config.simulation.solver == "MFT" else "") + "a spread of lambda_D = dx or more",
    )  # fmt: skip


def heated(config: PlasmaConfig, species: Species, axis: int) -> Iterator[Heated]:
    """What the run sees aliases add to a cold species by its motion along an axis."""
    numerics, wp = config.numerics, plasma_frequency(config, species)
    across = any(b for j, b in enumerate(config.field.magnetic) if j != axis)
    if not wp or across or config.points[axis] <= MOST_WITHOUT_FIELD or (species.particles or 0) < config.cells:
        return
    parts, cell = loader_of(species).populations(species, axis), wp * spacing(config)[axis]
    if any(part.spread >= COLD * cell for part in parts):
        return
    heat = 0.5 * (species.particles or 0) * macro_mass(config, species) * cell * cell
    run, waves = abs(config.simulation.time_step) * config.simulation.cycles, tuple(by_start(config, species, axis))
    aliases, spectral = ALIASES[numerics.shape, numerics.gradient], numerics.gradient == "spectral"
    if not any(part.mean for part in parts):
        waves += tuple(by_beams(config, species, axis))
        number = places(config, species)
        least = LEAST_MOVED * cell / number
        seen = [one for one in waves if least < one.speed < FASTEST * cell]
        along = any(one.along for one in seen)
        gain = max((aliases.until(wp * (run - one.since), one.speed / cell, number if along else MANY_PLACES)
                    for one in seen), default=0.0)  # fmt: skip
        gains = [gain, ALIASES["TSC", "difference"].gain]
        speed = max((one.speed for one in seen if gain), default=0.0)
        energy, motion = wave_energy(config) + energy_of_motion(config), f"waves move it by {speed / cell:.2g} wp dx; "
        motion += "measured until wp t = 400; up to five times it later or on 32 points"
    else:
        begun = wp * run > DRIFTING[numerics.shape] * (SOONER if spectral else 1.0)
        seen = list(waves) if begun and drifts_as_a_whole(config, axis) else []
        gains = [GAIN[numerics.shape] * (SPECTRAL if spectral else 1.0), GAIN["TSC"]]
        speed = max((one.speed for one in seen), default=0.0)
        energy = wave_energy(config)
        motion = f"over the energy of its wave, which moves it by {speed / cell:.2g} wp dx; measured"
    if speed:
        growth, smoother = (gain * heat / energy for gain in gains)
        yield Heated(growth, smoother, motion)


def places(config: PlasmaConfig, species: Species) -> float:
    """Places of particles in a cell along each axis; infinity where they are drawn."""
    if random_places(species):
        return math.inf
    axes = sum(n > MOST_WITHOUT_FIELD for n in config.points)
    return ((species.particles or 0) / config.cells) ** (1 / axes)


def noise_of_start(config: PlasmaConfig) -> Iterator[Derived]:
    """The field of random places that becomes heat, over the energy of waves, drifts and heat: all of it in a cold
    species, and what a Debye length of its own would not leave in a warm one.
    """
    axes = [axis for axis, n in enumerate(config.points) if n > MOST_WITHOUT_FIELD]
    energy = wave_energy(config) + energy_of_motion(config)
    noisy = {i: s for i, s in enumerate(config.species) if random_places(s) and plasma_frequency(config, s)}
    if not axes or not noisy or not energy or config.field.equation != Equation() or max(config.points) > MOST_SUMMED:
        return
    field = 0.0
    grid = [config.points[axis] for axis in axes], [spacing(config)[axis] for axis in axes]
    for species in noisy.values():
        debye = min(thermal_velocities(config, species)[axis] for axis in axes) / plasma_frequency(config, species)
        waves = field_of_random_places(config.numerics.shape, *grid, debye)
        field += (species.particles or 0) * macro_charge(config, species) ** 2 * waves
    share = field / (2 * config.constants.vacuum_permittivity * volume(config)) / energy
    even = ", ".join(way for i, species in noisy.items() for way in even_places(i, species))
    more = f"{rounded_up(share / NOISE):g} times the particles" if NOISE <= share < math.inf else ""
    yield judged(
        "noise of random places", "W/W(0)", share, limit=f"< {NOISE:g}", ok=share < NOISE, legal=True,
        source="their field, of which half and more becomes heat within wp t = 60",
        cure=", or ".join(filter(None, [even, more])), key=("species", min(noisy), "init_method"),
    )  # fmt: skip


def drifts_as_a_whole(config: PlasmaConfig, axis: int) -> bool:
    """Whether no species drifts through another along an axis."""
    moving = [species for species in config.species if species.particles and species.charge]
    return len({part.mean for species in moving for part in loader_of(species).populations(species, axis)}) == 1


def by_start(config: PlasmaConfig, species: Species, axis: int) -> Iterator[Moved]:
    """Motions in the field of each wave that the case starts: (q/m) E/wp."""
    for mode, field in started_fields(config).items():
        vector = [n / length for n, length in zip(mode, config.simulation.space_length)]
        along = abs(vector[axis]) / math.hypot(*vector) * field
        if wp := total_plasma_frequency(config):
            yield Moved(abs(species.charge / species.mass) * along / wp, 0.0, sum(map(bool, mode)) == 1)


def started_fields(config: PlasmaConfig) -> dict[tuple[int, ...], float]:
    """Amplitudes of E, V/m, of the modes that species start, by `perturbation` or by the places of arrays."""
    fields: dict[tuple[int, ...], complex] = {}
    for species in config.species:
        waves = dict[tuple[int, ...], complex]()
        if species.start and species.particles:
            waves.update(given_waves(species.start, config.simulation.space_length))
        if species.perturbation and species.particles:
            mode = max(species.perturbation.mode, tuple(-n for n in species.perturbation.mode))
            size = math.copysign(started_amplitude(config, species), species.perturbation.amplitude)
            waves[mode] = waves.get(mode, 0.0) + size
        for mode, amplitude in waves.items():
            k = 2 * math.pi * math.hypot(*(n / length for n, length in zip(mode, config.simulation.space_length)))
            field = charge_density(config, species) * amplitude / (k * config.constants.vacuum_permittivity)
            fields[mode] = fields.get(mode, 0.0) + field
    return {mode: abs(field) for mode, field in fields.items()}


@lru_cache(maxsize=8)
def given_waves(start: Start, lengths: tuple[float, ...]) -> dict[tuple[int, ...], complex]:
    """The waves along each axis, of 1 to LONGEST_WAVES wavelengths in the box, that given places make: a of
    n (1 - a cos(k.x)), as `perturbation` makes them. Shorter ones are the noise that they stand out of.
    """
    waves: dict[tuple[int, ...], complex] = {}
    for axis, places in enumerate(arrays(start).get("position", np.zeros((0, 0))).T[: len(lengths)]):
        turn = np.exp(-2j * math.pi / lengths[axis] * places)
        found, power = [], np.ones_like(turn)
        for _ in range(2 * LONGEST_WAVES):
            power *= turn
            found.append(complex(-2 * power.mean()))
        noise = math.sqrt(np.mean(np.abs(found[LONGEST_WAVES:]) ** 2))
        for n, amplitude in enumerate(found[:LONGEST_WAVES], 1):
            if abs(amplitude) > max(MIN_OVER_NOISE * noise, LEAST_WAVE):
                waves[tuple(n * (i == axis) for i in range(len(lengths)))] = amplitude
    return waves


def by_beams(config: PlasmaConfig, species: Species, axis: int) -> Iterator[Moved]:
    """Motions in the waves that weak cold beams along an axis drive, where the box has one."""
    wp, length = plasma_frequency(config, species), config.simulation.space_length[axis]
    for other in config.species:
        for part in loader_of(other).populations(other, axis):
            share = part.share * (plasma_frequency(config, other) / wp) ** 2
            speed = abs(part.mean)
            narrow = part.spread < share ** (1 / 3) * speed
            if 0 < share < WEAK and narrow and 2 * math.pi * speed < wp * length * (1 + share ** (1 / 3)):
                growth = math.sqrt(0.75) * (0.5 * share) ** (1 / 3) * wp
                yield Moved(SATURATED * share ** (2 / 3) * speed, GROWN / growth)


def wave_energy(config: PlasmaConfig) -> float:
    """Energy of the waves that the case starts, J."""
    fields = started_fields(config).values()
    return 0.25 * config.constants.vacuum_permittivity * volume(config) * sum(field * field for field in fields)


def energy_of_motion(config: PlasmaConfig) -> float:
    """Energy of drifts and heat, J."""
    total = 0.0
    for species in config.species:
        axes = (loader_of(species).populations(species, axis) for axis in range(velocity_components(config)))
        square = sum(part.share * (part.mean**2 + part.spread**2) for parts in axes for part in parts)
        total += 0.5 * (species.particles or 0) * macro_mass(config, species) * square
    return total
