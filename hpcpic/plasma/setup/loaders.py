"""How a species starts: a loader gives positions and velocities by the number of a particle, whoever asks.

A case names its loader as init_method. Another one is a subclass of Loader that replaces what differs, registered:

    class Ring(Loader):
        name = "ring"
        def mean_velocities(self, batch): ...

    register(Ring())
"""

import difflib
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.case.schema import Fault, abridged
from hpcpic.core.errors import ConfigError
from hpcpic.core.files.start import arrays, start_faults
from hpcpic.core.simd.own import enter
from hpcpic.core.space.domain import wrap
from hpcpic.core.space.rng import normal_quantile, normals, uniforms
from hpcpic.plasma.case.config import BEFORE, PlasmaConfig, Species, given_velocity, velocity_columns
from hpcpic.plasma.physics.quiet_start import BASES, even_places, from_x_to, radical_inverse, strata
from hpcpic.plasma.setup.thermal_spread import thermal_spread

POSITION, VELOCITY = 1, 2  # streams of random numbers
TAIL = 6.0  # deviations of a velocity that hardly a particle exceeds


@dataclass(frozen=True, slots=True)
class Batch:
    """Particles of one species that are to be loaded, and what a loader may want to know of the run.

    section: the species as the case says it, complete. n: all its particles. index[m]: number within the species;
    ids[m]: within the run. lengths[d] m, points[d] of the grid; components of the velocity; seed of random numbers;
    k[d] of the wave that the species starts, or else the first species that starts one, rad/m; zeros without one.
    """

    section: Species
    n: int
    index: NDArray[np.int64]
    ids: NDArray[np.int64]
    lengths: NDArray[np.float64]
    points: tuple[int, ...]
    components: int
    seed: int
    k: NDArray[np.float64]

    @property
    def drift(self) -> NDArray[np.float64]:
        """drift_velocity[v], m/s."""
        return np.array(self.section.drift_velocity[: self.components])

    @property
    def odd(self) -> NDArray[np.bool_]:
        """Every second particle, [m, 1]."""
        return self.index[:, None] % 2 == 1


class Population(NamedTuple):
    """A part of a species: its share of the particles, mean and standard deviation of a velocity component, m/s."""

    share: float
    mean: float
    spread: float


class Fastest(NamedTuple):
    """The largest moduli of the components of velocities, and of velocities, m/s."""

    components: tuple[float, float, float]
    speed: float


class Loader:
    """Random positions, and normal deviates of the thermal velocity about the drift.

    random_positions, random_deviates: drawn with the seed of the case. placed: particle by particle, so that another
    number of them is another scene. whole_batches: other numbers than multiples of `batch_size` are refused.
    """

    name = "random"
    random_positions = True
    random_deviates = True
    placed = False
    whole_batches = False

    def positions(self, batch: Batch) -> NDArray[np.float64]:
        """Positions[m, d] in m within the box, before the perturbation."""
        return uniforms(batch.seed, POSITION, batch.ids, len(batch.lengths)) * batch.lengths

    def mean_velocities(self, batch: Batch) -> NDArray[np.float64]:
        """Velocities[m, v] in m/s, before the thermal deviate and the perturbation are added."""
        return np.tile(batch.drift, (len(batch.ids), 1))

    def deviates(self, batch: Batch) -> NDArray[np.float64]:
        """Standard normal deviates[m, v] of a warm species."""
        return normals(batch.seed, VELOCITY, batch.ids, batch.components)

    def faults(self, section: Species, dimensions: int) -> Iterator[Fault]:
        """What this loader misses or cannot take in a species: key within it, and sentence."""
        return iter(())

    def batch_size(self, section: Species, points: tuple[int, ...]) -> int:
        """Numbers of particles for which it is made are multiples of this: on a grid of so many points per axis."""
        return 1

    def populations(self, section: Species, axis: int) -> tuple[Population, ...]:
        """Distribution of a velocity component as loaded, without the perturbation: what forecasts and theory read."""
        return (Population(1.0, section.drift_velocity[axis], section.thermal_velocity),)

    def fastest(self, section: Species) -> Fastest:
        """What no particle exceeds as loaded, but for the thermal deviate and the perturbation: what `check` judges.

        By default TAIL deviations of `populations`, less that of the thermal deviate, beyond their means.
        """
        heat = section.thermal_velocity**2
        x, y, z = (
            max(abs(part.mean) + TAIL * math.sqrt(max(part.spread**2 - heat, 0.0)) for part in parts)
            for parts in (self.populations(section, axis) for axis in range(3))
        )
        return Fastest((x, y, z), math.hypot(x, y, z))

    def draws_random(self, section: Species) -> bool:
        """Whether the initial state changes with the seed."""
        drawn = self.random_positions or (self.random_deviates and section.thermal_velocity)
        return bool(section.particles and drawn)


class Quiet(Loader):
    """Even positions and velocities, without random numbers (see physics.quiet_start).

    1D, and x of a warm species: equal steps. A cold species: a lattice; the y and z of a warm one, or of a number that
    makes no lattice, are in digit-reversed order.
    """

    name = "quiet"
    random_positions = random_deviates = False

    def batch_size(self, section: Species, points: tuple[int, ...]) -> int:
        """The number of cells: with as many particles in each, no beat is an alias."""
        return math.prod(points)

    def positions(self, batch: Batch) -> NDArray[np.float64]:
        warm = bool(batch.section.thermal_velocity)
        return even_places(batch.index, batch.n, batch.points, as_lattice=not warm) * batch.lengths

    def deviates(self, batch: Batch) -> NDArray[np.float64]:
        d = len(batch.lengths)
        bases = BASES[d - 1 : d - 1 + batch.components]
        fractions = (radical_inverse(batch.index, base, batch.n) for base in bases)
        return np.stack([normal_quantile(u) for u in fractions], axis=1)


class Strata(Quiet):
    """A Maxwellian of cold beams: a velocity for each of equal strata, of each as many particles, evenly over the box.

    A beam that is even stays so, whatever its velocity, so only waves that the case starts are there. They hold until
    the beams are in phase again (physics.quiet_start.recurrence_time), which are even in velocity along the wave that
    the case starts. Source: Birdsall & Langdon, chapter 16.
    """

    name = "strata"
    whole_batches = True

    def batch_size(self, section: Species, points: tuple[int, ...]) -> int:
        """Places of each velocity; by default in every second cell of each axis, as the shortest wave has no field."""
        return section.places or math.prod(-(-n // 2) for n in points)

    def positions(self, batch: Batch) -> NDArray[np.float64]:
        places = self.batch_size(batch.section, batch.points)
        stratum, place = np.divmod(batch.index, places)
        bases = BASES[batch.components - 1 :][: len(batch.lengths)]
        shift = np.stack([radical_inverse(stratum, base, batch.n // places) for base in bases], axis=1)
        return even_places(place, places, batch.points, shift) * batch.lengths

    def deviates(self, batch: Batch) -> NDArray[np.float64]:
        places = self.batch_size(batch.section, batch.points)
        return from_x_to(batch.k, strata(batch.n // places, batch.components))[batch.index // places]


class OppositeBeams(Loader):
    """Every second particle has the drift, the others have its opposite."""

    name = "opposite beams"

    def mean_velocities(self, batch: Batch) -> NDArray[np.float64]:
        return np.where(batch.odd, batch.drift, -batch.drift)

    def populations(self, section: Species, axis: int) -> tuple[Population, ...]:
        return beams(section.particles or 0, -section.drift_velocity[axis], section.thermal_velocity)


class UniformVelocities(Loader):
    """Velocities uniform in [-drift, drift], without a thermal velocity."""

    name = "uniform velocities"

    def mean_velocities(self, batch: Batch) -> NDArray[np.float64]:
        u = uniforms(batch.seed, VELOCITY, batch.ids, batch.components)
        return (2 * u - 1) * batch.drift

    def faults(self, section: Species, dimensions: int) -> Iterator[Fault]:
        if section.thermal_velocity or section.temperature:
            yield ("init_method",), '"uniform velocities" have a spread of their own: no thermal_velocity, or "random"'

    def populations(self, section: Species, axis: int) -> tuple[Population, ...]:
        return (Population(1.0, 0.0, abs(section.drift_velocity[axis]) / math.sqrt(3)),)

    def fastest(self, section: Species) -> Fastest:
        x, y, z = map(abs, section.drift_velocity)
        return Fastest((x, y, z), math.hypot(x, y, z))


class PositionDelta(Loader):
    """Particles in equal steps from one position on, through the periodic box."""

    name = "position delta"
    random_positions = False
    placed = True

    def positions(self, batch: Batch) -> NDArray[np.float64]:
        first, step = np.array(batch.section.position_init), np.array(batch.section.position_delta)
        x = first + batch.index[:, None] * step
        return np.stack([wrap(x[:, i], length) for i, length in enumerate(batch.lengths)], axis=1)

    def faults(self, section: Species, dimensions: int) -> Iterator[Fault]:
        for name in ("position_init", "position_delta"):
            if not getattr(section, name):
                yield (), f'{name} is missing, which init_method "position delta" needs'


class HarmonicTwoElectrons(Loader):
    """Two particles at 3/8 and 5/8 of the box along x, with the drift along x and its opposite."""

    name = "harmonic two electrons"
    random_positions = False
    placed = True

    def positions(self, batch: Batch) -> NDArray[np.float64]:
        fraction = np.full((len(batch.ids), len(batch.lengths)), 0.5)
        fraction[:, 0] = np.where(batch.index % 2 == 1, 5 / 8, 3 / 8)
        return fraction * batch.lengths

    def mean_velocities(self, batch: Batch) -> NDArray[np.float64]:
        along_x = np.arange(batch.components) == 0
        return np.where(along_x, np.where(batch.odd, -batch.drift, batch.drift), 0.0)

    def faults(self, section: Species, dimensions: int) -> Iterator[Fault]:
        if section.particles != 2:
            yield ("particles",), f'must be 2 for init_method "harmonic two electrons" (got {section.particles})'

    def populations(self, section: Species, axis: int) -> tuple[Population, ...]:
        return beams(2, section.drift_velocity[0] if axis == 0 else 0.0, section.thermal_velocity)


class Arrays(Loader):
    """The positions[n, d] and velocities[n, v] of arrays; random ones in the place of an array that there is not. The
    array `velocity_before` holds velocities of half a step before the positions, with which a simulation goes on as
    the one that they are read from.

    Positions may be [n, 3], as they are read: 0 along axes that the box does not have.
    """

    name = "arrays"
    placed = True

    def positions(self, batch: Batch) -> NDArray[np.float64]:
        given = arrays(batch.section.start).get("position")
        if given is None:
            return super().positions(batch)
        x = np.asarray(given[batch.index], float)
        return np.stack([wrap(x[:, i], length) for i, length in enumerate(batch.lengths)], axis=1)

    def mean_velocities(self, batch: Batch) -> NDArray[np.float64]:
        given = given_velocity(batch.section)
        if given is None:
            return super().mean_velocities(batch)
        velocity = np.zeros((len(batch.ids), batch.components))
        velocity[:, : given.shape[1]] = given[batch.index]
        return velocity

    def faults(self, section: Species, dimensions: int) -> Iterator[Fault]:
        if section.start is None:
            yield (), 'start is missing, which init_method "arrays" needs'
            return
        components = 3 if velocity_columns(section) == 3 else dimensions
        shapes = {"position": (None, dimensions), "velocity": (None, components)}
        shapes[BEFORE] = shapes["velocity"]
        if {"velocity", BEFORE} <= arrays(section.start).keys():
            yield ("start", "file"), f"holds velocity, of the start, and {BEFORE}, of half a step before: one of them"
        wave = section.perturbation
        added = (
            section.thermal_velocity or section.temperature or (wave and (wave.amplitude or wave.velocity_amplitude))
        )
        if added and BEFORE in arrays(section.start):
            told = "of a state that goes on: thermal_velocity (temperature) and amplitudes of perturbation are to be 0"
            yield ("start", "file"), f"holds {BEFORE}, {told}"
        found = start_faults(section.start, shapes, section.particles, held={"position": slice(dimensions)})
        yield from ((("start", *path), text) for path, text in found)

    def populations(self, section: Species, axis: int) -> tuple[Population, ...]:
        given = given_velocity(section)
        if given is None:
            return super().populations(section, axis)
        own = given[:, axis] if axis < given.shape[1] and len(given) else np.zeros(1)
        heat = thermal_spread(arrays(section.start).get("position"), own)
        return (Population(1.0, float(own.mean()), math.hypot(heat, section.thermal_velocity)),)

    def fastest(self, section: Species) -> Fastest:
        given = given_velocity(section)
        if given is None or not len(given):
            return super().fastest(section)
        x, y, z = [*map(float, np.abs(given).max(axis=0)), 0.0, 0.0][:3]
        return Fastest((x, y, z), float(np.linalg.norm(given, axis=1).max()))


def beams(n: int, drift: float, spread: float) -> tuple[Population, ...]:
    """n particles, of which the first, third, ... have the drift and the others its opposite."""
    if not drift or not n:
        return (Population(1.0, 0.0, spread),)
    second = n // 2 / n
    return Population(1 - second, drift, spread), Population(second, -drift, spread)


LOADERS: dict[str, Loader] = {}  # by name
OLDER = ("default", "random position")  # the thesis author's words


EVEN = (Loader.positions, Quiet.positions, Strata.positions)  # as many particles everywhere


def register(loader: Loader) -> None:
    """Make a loader known under its name. TypeError of a class, or of something else; ValueError where a loader of
    another class has the name, unless that class is defined again.
    """
    if not isinstance(loader, Loader):
        raise TypeError(f"register takes an object of a class of loaders, as register(Ring()) (got {loader!r})")
    enter(LOADERS, "loader", loader.name, loader)


for kind in (Loader, Quiet, Strata, OppositeBeams, UniformVelocities, PositionDelta, Arrays, HarmonicTwoElectrons):
    register(kind())


def require_rows(loader: Loader, method: str, values: NDArray, batch: Batch, columns: int) -> NDArray[np.float64]:
    """What a method of a loader has returned. Raises ConfigError unless it is finite numbers, a row per particle."""
    wanted = (len(batch.ids), columns)
    plain = isinstance(values, np.ndarray) and values.dtype.kind in "fiu"
    if not plain or values.shape != wanted or not np.all(np.isfinite(values)):
        got = f"{values.dtype} {list(values.shape)}" if isinstance(values, np.ndarray) else type(values).__name__
        got = "some that are not finite" if plain and values.shape == wanted else got
        asked = f"finite numbers [n, {columns}] for n = {len(batch.ids)} particles"
        raise ConfigError(f"init_method {loader.name!r}: {method} must return {asked} (got {got})")
    return values


def present_word(word: str, thermal_velocity: float) -> str:
    """The present word for an init_method. "random position" has its own velocities where no spread is given."""
    if word == "default":
        return "opposite beams"
    if word == "random position":
        return "random" if thermal_velocity else "uniform velocities"
    return word


def loader_of(section: Species) -> Loader:
    """The loader of a species that has no faults."""
    return LOADERS[present_word(section.init_method, section.thermal_velocity)]


def loader_faults(section: Species, dimensions: int) -> Iterator[Fault]:
    """An init_method that nobody has registered, and what the loader objects to."""
    word = section.init_method
    if word in LOADERS:
        yield from LOADERS[word].faults(section, dimensions)
        if section.particles_per_cell and LOADERS[word].placed:
            yield ("particles_per_cell",), f"give particles where init_method is {word!r}"
    elif word not in OLDER:
        *names, last = (*LOADERS, *OLDER)
        near = difflib.get_close_matches(word.lower(), (*names, last), 1, 0.3)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        known = f"{', '.join(map(repr, names))} or {last!r}"
        yield ("init_method",), f"must be {known} (got {abridged(word)}){hint}"
        return
    if section.start is not None and not isinstance(LOADERS.get(word), Arrays):
        yield ("start",), f'arrays are read with init_method "arrays" only (got {word!r})'


def random_places(section: Species) -> bool:
    """Whether the particles start at places drawn one by one, which make noise."""
    loader = loader_of(section)
    given = isinstance(loader, Arrays) and "position" in arrays(section.start)
    return type(loader).positions is Loader.positions or (isinstance(loader, Arrays) and not given)


def velocity_moments(config: PlasmaConfig, section: Species, axis: int) -> tuple[float, float]:
    """Mean and standard deviation, m/s, of a velocity component as loaded."""
    populations = loader_of(section).populations(section, axis)
    mean = sum(part.share * part.mean for part in populations)
    variance = sum(part.share * (part.spread**2 + (part.mean - mean) ** 2) for part in populations)
    wave = section.perturbation
    if wave and axis < len(wave.mode):
        k = [mode / length for mode, length in zip(wave.mode, config.simulation.space_length)]
        variance += 0.5 * (wave.velocity_amplitude * k[axis] / math.hypot(*k)) ** 2  # sin(k.x) has the variance 1/2
    return mean, math.sqrt(variance)
