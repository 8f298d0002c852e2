"""The initial state and the numbers of a plasma run, the same on every rank: pure functions of case and id.

Inside the step lengths are in cells and velocities in cells per step, so that a case whose units are rescaled
by powers of two gives the same bits. An axis without grid (y and z in 1D, z in 2D) borrows the spacing of x.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.domain import wrap
from hpcpic.core.space.rng import normal_quantile, normals, uniforms
from hpcpic.plasma.case import config as case
from hpcpic.plasma.physics.quiet_start import BASES, lattice, radical_inverse
from hpcpic.plasma.setup import loaders

POSITION, VELOCITY = 1, 2  # streams of random numbers


class Scene:
    """A case made concrete. Vectors are in physical order (x, y, z); v is the number of velocity components.

    lengths[d] m, points[d], spacing[d] m, time_step s, permittivity, cell_volume (m in 1D, m2 in 2D),
    velocity_spacing[v] m (velocities in cells per step are v dt / velocity_spacing),
    background: charge density that makes the box neutral (rho_0 of (5.1)), species: tuple of SceneSpecies,
    n_particles of all species.
    """

    def __init__(self, config: case.PlasmaConfig) -> None:
        simulation = config.simulation
        self.config = config
        self.dimensions = config.dimensions
        self.lengths = simulation.space_length
        self.points = config.grid.points
        self.spacing = tuple(length / n for length, n in zip(self.lengths, self.points))
        self.time_step = simulation.time_step
        self.permittivity = config.constants.vacuum_permittivity
        self.velocity_components = case.velocity_components(config)
        self.volume = case.volume(config)
        self.cell_volume = float(np.prod(self.spacing))
        self.velocity_spacing = np.array(
            (*self.spacing, self.spacing[0], self.spacing[0])[: self.velocity_components]
        )
        first = np.cumsum([0] + [section.particles for section in config.species])
        self.species = tuple(SceneSpecies(self, section, int(i)) for section, i in zip(config.species, first))
        self.n_particles = int(first[-1])
        self.background = -sum(species.q * species.n for species in self.species) / self.volume


@dataclass(frozen=True, slots=True)
class SceneSpecies:
    """One species: ids first .. first + n - 1, q and m of one macro-particle, and its initial state by id."""

    scene: Scene
    section: case.Species
    first: int

    @property
    def name(self) -> str:
        return self.section.name

    @property
    def n(self) -> int:
        return self.section.particles

    @property
    def ids(self) -> range:
        return range(self.first, self.first + self.n)

    @property
    def charge_to_mass(self) -> float:
        return self.section.charge / self.section.mass

    @property
    def q(self) -> float:
        """Charge of a macro-particle, C."""
        return loaders.macro_charge(self.scene.config, self.section)

    @property
    def m(self) -> float:
        """Mass of a macro-particle, kg."""
        return loaders.macro_mass(self.scene.config, self.section)

    @property
    def half_kick(self) -> NDArray[np.float64]:
        """h[v] = (q/m) dt^2 / (2 dx): turns E in V/m into half an electric impulse in cells per step."""
        dt = self.scene.time_step
        return 0.5 * self.charge_to_mass * (dt * dt) / self.scene.velocity_spacing

    @property
    def boris(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The vectors t[3] and s[3] of the rotation (5.4.1): t = (q/m) B dt/2, s = 2 t / (1 + t.t).

        With numerics.exact_phase, t has the length tan(wc dt/2) and the angle per step is exactly wc dt.
        """
        t = np.array(self.scene.config.field.magnetic) * (self.charge_to_mass * self.scene.time_step / 2)
        length = np.sqrt(t @ t)
        if self.scene.config.numerics.exact_phase and length:
            t = t * (np.tan(length) / length)
        return t, 2 * t / (1 + t @ t)

    @property
    def turn(self) -> NDArray[np.float64]:
        """A[v, v] with v+ = v- + A v- in cells per step: the rotation of (5.4.1) less the identity.

        Small entries are kept to their own precision, so that |v| does not drift.
        """
        t, s = (cross_matrix(vector) for vector in self.boris)
        v, spacing = self.scene.velocity_components, self.scene.velocity_spacing
        return (s + s @ t)[:v, :v] * spacing[None, :] / spacing[:, None]

    def positions(self, ids: NDArray) -> NDArray[np.float64]:
        """Positions[n, d] in m, in [0, L), of particles ids[n] of this species at t = 0."""
        x = self.unperturbed(np.asarray(ids))
        perturbation = self.section.perturbation
        if perturbation and perturbation.amplitude:
            k, sine = self.wave(x)
            x = x + sine[:, None] * (perturbation.amplitude * k / (k @ k))
        return np.stack([wrap(x[:, i], length) for i, length in enumerate(self.scene.lengths)], axis=1)

    def velocities(self, ids: NDArray) -> NDArray[np.float64]:
        """Velocities[n, v] in m/s at t = 0."""
        ids = np.asarray(ids)
        velocity = self.mean_velocities(ids) + self.section.thermal_velocity * self.deviates(ids)
        perturbation = self.section.perturbation
        if perturbation and perturbation.velocity_amplitude:
            k, sine = self.wave(self.unperturbed(ids))
            velocity[:, : len(k)] += sine[:, None] * (perturbation.velocity_amplitude * k / np.sqrt(k @ k))
        return velocity

    def unperturbed(self, ids: NDArray) -> NDArray[np.float64]:
        """Positions[n, d] in m before the perturbation; those of "position delta" may lie outside the box."""
        lengths = np.array(self.scene.lengths)
        index = ids - self.first
        method = self.section.init_method
        if method == "position delta":
            x = np.array(self.section.position_init) + index[:, None] * np.array(self.section.position_delta)
            return np.stack([wrap(x[:, i], length) for i, length in enumerate(lengths)], axis=1)
        if method == "harmonic two electrons":
            fraction = np.full((len(ids), len(lengths)), 0.5)
            fraction[:, 0] = np.where(index % 2 == 1, 5 / 8, 3 / 8)
            return fraction * lengths
        if method == "quiet":
            return self.quiet_fractions(index) * lengths
        return uniforms(self.scene.config.simulation.random_seed, POSITION, ids, len(lengths)) * lengths

    def quiet_fractions(self, index: NDArray) -> NDArray[np.float64]:
        """Even positions[n, d] in (0, 1).

        1D, and x of a warm 2D species: equal steps. A cold 2D species: a lattice; the y of a warm one, or of
        a number that makes no lattice, is in bit-reversed order.
        """
        even = (index + 0.5) / max(self.n, 1)
        if self.scene.dimensions == 1:
            return even[:, None]
        shape = None if self.section.thermal_velocity or not self.n else lattice(self.n, self.scene.points)
        if shape is None:
            return np.stack([even, radical_inverse(index, BASES[0], self.n)], axis=1)
        columns, rows = shape
        return np.stack([(index % columns + 0.5) / columns, (index // columns + 0.5) / rows], axis=1)

    def mean_velocities(self, ids: NDArray) -> NDArray[np.float64]:
        """Velocities[n, v] in m/s before the thermal deviate and the perturbation are added."""
        v = self.scene.velocity_components
        drift = np.array(self.section.drift_velocity[:v])
        method = self.section.init_method
        if method == "uniform velocities":
            u = uniforms(self.scene.config.simulation.random_seed, VELOCITY, ids, v)
            return (2 * u - 1) * drift
        odd = (ids - self.first)[:, None] % 2 == 1
        if method == "opposite beams":
            return np.where(odd, drift, -drift)
        if method == "harmonic two electrons":
            along_x = np.arange(v) == 0
            return np.where(along_x, np.where(odd, -drift, drift), 0.0)
        return np.tile(drift, (len(ids), 1))

    def deviates(self, ids: NDArray) -> NDArray[np.float64] | float:
        """Standard normal deviates[n, v]; 0 for a cold species."""
        if not self.section.thermal_velocity:
            return 0.0
        v, d = self.scene.velocity_components, self.scene.dimensions
        if self.section.init_method == "quiet":
            bases = BASES[d - 1 : d - 1 + v]
            fractions = (radical_inverse(ids - self.first, base, self.n) for base in bases)
            return np.stack([normal_quantile(u) for u in fractions], axis=1)
        return normals(self.scene.config.simulation.random_seed, VELOCITY, ids, v)

    def wave(self, x: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """k[d] in rad/m of the perturbation and sin(k.x)[n]."""
        mode = self.section.perturbation.mode
        lengths = self.scene.lengths
        k = np.array([2 * np.pi * n / length for n, length in zip(mode, lengths)])
        turns = sum(n * (x[:, i] / lengths[i]) for i, n in enumerate(mode))
        return k, np.sin(2 * np.pi * np.ascontiguousarray(turns - np.floor(turns)))


def cross_matrix(w: NDArray) -> NDArray[np.float64]:
    """The matrix K with K x = x cross w."""
    return np.array([[0.0, w[2], -w[1]], [-w[2], 0.0, w[0]], [w[1], -w[0], 0.0]])
