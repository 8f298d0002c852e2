"""The initial state and the numbers of a plasma run, the same on every rank: pure functions of case and id.

Inside the step lengths are in cells and velocities in cells per step, so that a case whose units are rescaled
by powers of two gives the same bits. An axis without grid (y and z in 1D, z in 2D) borrows the spacing of x.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.domain import wrap
from hpcpic.core.space.elementary import sin
from hpcpic.core.space.products import product
from hpcpic.plasma.case import config as case
from hpcpic.plasma.physics.boris import ABOUT_Z, impulse_across, part_of_turn, rotation_vectors, shears, turn
from hpcpic.plasma.physics.poisson import operator_of
from hpcpic.plasma.setup import loaders, macro_particles


class Scene:
    """A case made concrete. Vectors are in physical order (x, y, z); v is the number of velocity components.

    lengths[d] m, points[d], spacing[d] m, time_step s, permittivity, operator (of the field equation),
    cell_volume (m, m2 or m3), velocity_spacing[v] m (velocities in cells per step are v dt / velocity_spacing),
    background: charge density that makes the box neutral (rho_0 of (5.1)), species: tuple of SceneSpecies,
    n_particles of all species.
    """

    def __init__(self, config: case.PlasmaConfig) -> None:
        simulation = config.simulation
        self.config = config
        self.dimensions = config.dimensions
        self.lengths = simulation.space_length
        self.points = config.points
        self.spacing = tuple(length / n for length, n in zip(self.lengths, self.points))
        self.time_step = simulation.time_step
        self.permittivity = config.constants.vacuum_permittivity
        self.operator = operator_of(config)
        self.velocity_components = case.velocity_components(config)
        self.volume = case.volume(config)
        self.cell_volume = float(np.prod(self.spacing))
        self.velocity_spacing = np.array((*self.spacing, self.spacing[0], self.spacing[0])[: self.velocity_components])
        first = np.cumsum([0] + [section.particles for section in config.species])
        self.species = tuple(SceneSpecies(self, section, int(i)) for section, i in zip(config.species, first))
        self.n_particles = int(first[-1])
        self.background = -sum(species.q * species.n for species in self.species) / self.volume

    @property
    def sides(self) -> NDArray[np.float64]:
        """Sides[3] of a cell in that along x; 1 along an axis without grid."""
        return np.array((*(side / self.spacing[0] for side in self.spacing), 1.0, 1.0)[:3])

    def mover(self, field_scale: float, steps: float = 1.0) -> NDArray[np.float64]:
        """mover[species, 16] of physics.boris for `steps` time steps; kernels gather E times field_scale.

        steps = -1/2 rewinds: half the impulse, and half the angle that the mover turns in a step, backwards; nothing
        of a species whose velocities are those of half a step before already.
        """
        kind, rows = case.rotation(self.config), np.zeros((len(self.species), 16))
        side = np.array((*self.spacing, self.spacing[0], self.spacing[0])[:3])
        uniform = np.array(self.config.field.electric)
        for row, species in zip(rows, self.species):
            if steps < 0 and case.starts_before(species.section):
                continue
            impulse = np.zeros(3)
            impulse[: self.velocity_components] = species.half_kick * steps * (1 if kind else 2)
            across, axis = species.impulse_across(steps), species.axis * side
            row[10:13] = axis * impulse * np.where(np.arange(3) < self.dimensions, 1 / field_scale, uniform)
            row[13:] = 2 * (1 - across) * species.axis / side
            impulse[: 2 if kind == ABOUT_Z else 3] *= across
            row[:2][: self.dimensions] = impulse[:2][: self.dimensions] / field_scale
            row[2] = impulse[1] * uniform[1] if self.dimensions == 1 else 0.0
            row[3] = impulse[2] / field_scale if self.dimensions == 3 else impulse[2] * uniform[2]
            t, s = species.rotation
            if steps != 1.0:
                t, s = part_of_turn(t, steps)
            if kind == ABOUT_Z:
                row[4:6] = t[2] * side[1] / side[0], -s[2] * side[0] / side[1]
            elif kind > ABOUT_Z:
                row[4:10] = shears(t, s, side)
        return rows

    def half_kicks(self, field_scale: float) -> NDArray[np.float64]:
        """kicks[species, 9]: by what kernels make v- of v^(n-1/2), the impulse that the mover gives before the turn.

        Three impulses along x, y and z and then, as numbers 10 to 15 of `mover`, what corrects these along B: half of
        that, as it is there for both impulses of a step.
        """
        mover = self.mover(field_scale)
        kicks = mover[:, [0, 1 if self.dimensions > 1 else 2, 3, *range(10, 16)]]
        kicks[:, :3] *= 1.0 if case.rotation(self.config) else 0.5  # without a turn the mover gives both at once
        kicks[:, 6:] *= 0.5
        return np.ascontiguousarray(kicks)


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
        return macro_particles.macro_charge(self.scene.config, self.section)

    @property
    def m(self) -> float:
        """Mass of a macro-particle, kg."""
        return macro_particles.macro_mass(self.scene.config, self.section)

    @property
    def half_kick(self) -> NDArray[np.float64]:
        """h[v] = (q/m) dt^2 / (2 dx): turns E in V/m into half an electric impulse in cells per step."""
        dt = self.scene.time_step
        return 0.5 * self.charge_to_mass * (dt * dt) / self.scene.velocity_spacing

    @property
    def rotation(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The vectors t[3] and s[3] of the rotation in the magnetic field, see physics.boris."""
        config = self.scene.config
        exact = config.numerics.exact_phase
        return rotation_vectors(config.field.magnetic, self.charge_to_mass, self.scene.time_step, exact)

    @property
    def axis(self) -> NDArray[np.float64]:
        """Unit vector[3] along B; zero where there is none."""
        magnetic = np.array(self.scene.config.field.magnetic)
        return magnetic / (np.sqrt(np.sum(magnetic * magnetic)) or 1.0)

    def impulse_across(self, steps: float) -> float:
        """By what impulses across B of so many steps are multiplied, see physics.boris; 1 but with exact_phase."""
        config = self.scene.config
        if not config.numerics.exact_phase:
            return 1.0
        magnetic = np.array(config.field.magnetic)
        return impulse_across(self.charge_to_mass * np.sqrt(np.sum(magnetic * magnetic)) * self.scene.time_step * steps)

    @property
    def half_turn(self) -> NDArray[np.float64]:
        """A[3, 3] with v^n = v- + A v-: the rotation by half the angle of a step, less the identity."""
        return turn(*part_of_turn(self.rotation[0], 0.5))

    @property
    def mean_turn(self) -> NDArray[np.float64]:
        """M[3, 3] with (v^(n-1/2) + v^(n+1/2)) / 2 = (v- + v+) / 2 = v- + M v-."""
        return turn(*self.rotation) / 2

    def before_turn(self, steps: float) -> NDArray[np.float64]:
        """M[3, 3]: v + M a dt, turned by the mover for so many steps, has had half of a dt before the turn and half
        after it, across B by as much more as the electric impulse; 0 where `mover` does nothing.
        """
        if steps < 0 and case.starts_before(self.section):
            return np.zeros((3, 3))
        halves = steps * (np.eye(3) + turn(*part_of_turn(self.rotation[0], steps)).T / 2)
        across, along = self.impulse_across(steps), np.outer(self.axis, self.axis)
        return across * halves + (1 - across) * steps * along

    def own_impulse(self, steps: float) -> NDArray[np.float64]:
        """(M, P, N)[3, 3, 3] of an acceleration a of the user's own in an impulse of so many steps: M as `before_turn`
        gives it, and P v- + N a dt, the mean of the velocities before and after the turn, with half of a dt each.
        """
        before, turned = self.before_turn(steps), turn(*part_of_turn(self.rotation[0], steps))
        mean, share = np.eye(3) + turned / 2, (before + product(turned, before)) / 2
        missing = self.scene.velocity_components
        mean[missing:], share[missing:] = 0, 0
        return np.stack([before, mean, share])

    def positions(self, ids: NDArray) -> NDArray[np.float64]:
        """Positions[n, d] in m, in [0, L), of particles ids[n] of this species at t = 0."""
        x = self.unperturbed(np.asarray(ids))
        perturbation = self.section.perturbation
        if perturbation and perturbation.amplitude:
            k, sine = self.wave(x)
            x = x + sine[:, None] * (perturbation.amplitude * k / np.sum(k * k))
        return np.stack([wrap(x[:, i], length) for i, length in enumerate(self.scene.lengths)], axis=1)

    def velocities(self, ids: NDArray) -> NDArray[np.float64]:
        """Velocities[n, v] in m/s at t = 0."""
        ids, thermal = np.asarray(ids), self.section.thermal_velocity
        batch = self.batch(ids)
        velocity = self._loaded("mean_velocities", batch)
        velocity = velocity + (thermal * self._loaded("deviates", batch) if thermal else 0.0)
        perturbation = self.section.perturbation
        if perturbation and perturbation.velocity_amplitude:
            k, sine = self.wave(self.unperturbed(ids))
            velocity[:, : len(k)] += sine[:, None] * (perturbation.velocity_amplitude * k / np.sqrt(np.sum(k * k)))
        return velocity

    def unperturbed(self, ids: NDArray) -> NDArray[np.float64]:
        """Positions[n, d] in m before the perturbation."""
        return self._loaded("positions", self.batch(ids))

    def _loaded(self, method: str, batch: loaders.Batch) -> NDArray[np.float64]:
        """What a method of the loader gives. Raises ConfigError of what is no such thing."""
        columns = len(batch.lengths) if method == "positions" else batch.components
        return loaders.require_rows(self.loader, method, getattr(self.loader, method)(batch), batch, columns)

    @property
    def loader(self) -> loaders.Loader:
        """What gives the particles their positions and velocities."""
        return loaders.loader_of(self.section)

    def batch(self, ids: NDArray) -> loaders.Batch:
        """The particles ids[n], as loaders take them."""
        scene, lengths = self.scene, np.array(self.scene.lengths)
        seed = scene.config.simulation.random_seed
        started = (s.perturbation for s in (self.section, *scene.config.species) if s.perturbation)
        wave = next((np.array(one.mode) for one in started), np.zeros(len(lengths)))
        return loaders.Batch(
            self.section, self.n, ids - self.first, ids, lengths, scene.points, scene.velocity_components, seed,
            2 * np.pi * wave / lengths,
        )  # fmt: skip

    def wave(self, x: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """k[d] in rad/m of the perturbation and sin(k.x)[n]."""
        assert self.section.perturbation is not None
        mode = self.section.perturbation.mode
        lengths = self.scene.lengths
        k = np.array([2 * np.pi * n / length for n, length in zip(mode, lengths)])
        turns = sum(n * (x[:, i] / lengths[i]) for i, n in enumerate(mode))
        return k, sin(2 * np.pi * (turns - np.floor(turns)))
