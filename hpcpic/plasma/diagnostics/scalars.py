"""The plasma's scalars in time: energies, momentum, charge and field modes, all at one time level."""

import itertools
import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space import exact
from hpcpic.core.space.domain import block_ranges
from hpcpic.core.tasks.graph import TaskError, bind
from hpcpic.plasma.kernels.nodes import node_sums
from hpcpic.plasma.physics.boris import part_of_turn, turn
from hpcpic.plasma.setup.scene import Scene

if TYPE_CHECKING:
    from hpcpic.plasma.step import Plasma

MODES = 8
FASTEST = 2.0**40  # cells per step
LEAST, TOP = -225, 226  # levels (powers of 16) of nothing, and of what is not finite


def units(scene: Scene) -> dict[str, str]:
    """Units per unit of what a 1D or 2D box lacks of a volume are those of the macro-particles themselves."""
    energies = dict.fromkeys(("energy_field", "energy_kinetic", "energy_total"), "J")
    momenta = dict.fromkeys(("momentum_x", "momentum_y"), "kg m/s")
    return energies | momenta | {"charge": "C"} | {f"mode_{n}": "V/m" for n in range(1, MODES + 1)}


class Moments:
    """Sums over particles and nodes whose bits depend on neither ranks nor threads (core.space.exact).

    A sample is one reduction of integers over the ranks. The scales of the nodes' sums are those that served last;
    they are right if the greatest term of all ranks is of the same level, which counts of ranks tell. Else the
    levels are agreed on and all is summed again, so that a sample depends on the present state alone.
    """

    def __init__(self, plasma: "Plasma") -> None:
        self.plasma = plasma
        scene, cloud = plasma.scene, plasma.cloud
        self.n_species, v = len(scene.species), scene.velocity_components
        kick = np.zeros((self.n_species, 3))
        for row, species in zip(kick, scene.species):
            row[:v] = species.half_kick
        kick[:, : scene.dimensions] /= plasma.field_scale
        kick[:, scene.dimensions :] *= np.array(scene.config.field.electric)[scene.dimensions :]
        self.speed = 1.0  # power of two above |v| in cells per step
        self.inv_scale = np.ones(2)
        self.limbs = np.zeros((cloud.blocks, max(self.n_species, 1), 1 + v, exact.LIMBS), np.int64)
        ratio = np.ones(3)
        ratio[: scene.dimensions] = np.array(scene.spacing) / scene.spacing[0]
        self.particle_tasks = cloud.bind_moments(
            half_kick=kick.astype(cloud.spec.dtype), ratio_sq=ratio**2, inv_scale=self.inv_scale, limbs=self.limbs
        )
        self.ratio_most = float((ratio**2).sum())
        self.side = np.array((*scene.spacing, scene.spacing[0], scene.spacing[0])[:v])
        self.half_turns = [turn(*part_of_turn(species.rotation[0], 0.5)) for species in scene.species]
        self.masses, self.charges = ([getattr(s, name) for s in scene.species] for name in ("m", "q"))
        self._bind_nodes()
        self._lay_out()

    def _bind_nodes(self) -> None:
        """Tasks of kernels.nodes for the threads."""
        scene, mesh, domain = self.plasma.scene, self.plasma.mesh, self.plasma.domain
        world, flat = self.plasma.world, scene.dimensions == 1
        rho, phi, e_x = (a.reshape(1, -1) if flat else a for a in (mesh.rho, mesh.phi.values, mesh.e[0]))
        first = mesh.inside[0].start
        corners = np.array([[0 if flat else first + 1, first + 1], [0 if flat else first, first]])
        shares = block_ranges(len(rho), self.plasma.cloud.pool.threads)
        self.rows, self.width = (1, domain.points[0]) if flat else domain.points
        self.own = slice(*domain.row_range(world.rank)) if flat else slice(None)  # columns
        self.levels = [LEAST, LEAST]  # of the terms of the field energy, and of E_x
        self.node_inv_scale = np.ones(2)
        self.energy = np.zeros((len(shares), exact.LIMBS), np.int64)
        self.columns = np.zeros((len(shares), rho.shape[1]), np.int64)
        self.most = np.zeros((len(shares), 2))
        with world.first_on_node():
            self.node_tasks = [
                bind(node_sums, a, b, k, corners, scene.background, self.node_inv_scale, rho, phi, e_x,
                     self.energy, self.columns, self.most)
                for k, (a, b) in enumerate(shares)
            ]  # fmt: skip

    def _lay_out(self) -> None:
        """The words of a sample in one line, which one reduction sums over the ranks."""
        shape = self.limbs.shape[1:]
        ends = np.cumsum([5, shape[0], math.prod(shape), exact.LIMBS, self.width]).tolist()
        self.words = np.zeros(ends[-1], np.int64)
        self.parts = [slice(a, b) for a, b in itertools.pairwise([0, *ends])]

    def _local(self) -> list[int]:
        """Levels [2] of this rank's terms. Fills the words: flags (too fast; above and at the levels, two each),
        counts, limbs of particles, limbs of the field energy, columns.
        """
        self.inv_scale[:] = 1 / exact.power_of_two_above(self.speed**2 * self.ratio_most), 1 / self.speed
        self.node_inv_scale[:] = [math.ldexp(1.0, -4 * level) for level in self.levels]
        self.node_inv_scale[1] *= 2.0 ** (61 - int(self.rows).bit_length())
        self.limbs[:] = 0
        cloud, too_fast = self.plasma.cloud, False
        cloud.pool.each(self.node_tasks)
        try:
            cloud.each(self.particle_tasks)
        except TaskError as error:
            if error.code != exact.NOT_BOUNDED:
                raise
            too_fast = True
        levels = [_level(most) for most in self.most.max(axis=0).tolist()]
        flags, counts, limbs, energy, columns = (self.words[part] for part in self.parts)
        here = list(zip(levels, self.levels))
        flags[:] = [too_fast, *(own > known for own, known in here), *(own == known for own, known in here)]
        counts[:] = self._counts()
        np.sum(self.limbs, axis=0, out=limbs.reshape(self.limbs.shape[1:]))
        np.sum(self.energy, axis=0, out=energy)
        np.sum(self.columns, axis=0, out=columns[self.own])
        return levels

    def _counts(self) -> NDArray[np.int64]:
        return self.plasma.cloud.pages.count.reshape(-1, max(self.n_species, 1)).sum(axis=0)

    def counts(self) -> NDArray[np.int64]:
        """Particles of each species, counted on all ranks."""
        return self.plasma.world.sum_int(self._counts())

    def _all(self) -> tuple[bool, NDArray, NDArray, NDArray, NDArray]:
        """Whether a particle is beyond FASTEST, counts [species], limbs [species, k, 3] of |v-|^2 in (side of x per
        step)^2 (k = 0) and of the components of v- in cells per step, limbs [3] of (rho + rho_0) phi, and sums over
        columns [Nx] of E_x: of all ranks.
        """
        world = self.plasma.world
        while True:
            levels = self._local()
            words = world.sum_int(self.words)
            flags, counts, limbs, energy, columns = (words[part] for part in self.parts)
            too_fast, *above, first_at, second_at = flags.tolist()
            if too_fast and self.speed < FASTEST:
                self.speed *= 16
            elif any(above) or not (first_at and second_at):
                self.levels = world.max_array(np.array(levels)).tolist()
            else:
                return bool(too_fast), counts, limbs.reshape(self.limbs.shape[1:]), energy, columns

    def scalars(self) -> dict[str, float]:
        """energy_field = sum over nodes of (rho + rho_0) phi dV / 2; energy_kinetic and momentum of v^n."""
        scene, dt = self.plasma.scene, self.plasma.scene.time_step
        too_fast, counts, limbs, energy, columns = self._all()
        scales = (1 / self.inv_scale).tolist()
        kinetic, momentum, charge = 0.0, np.zeros(3), 0.0
        species = zip(self.masses, self.charges, counts.tolist(), limbs.tolist(), self.half_turns)
        for m, q, count, row, half_turn in species:
            squares, *v_sums = (exact.value(k, scales[min(i, 1)]) for i, k in enumerate(row))
            kinetic += 0.5 * m * squares * (scene.spacing[0] / dt) ** 2
            v = np.zeros(3)
            v[: len(self.side)] = np.array(v_sums) * self.side / dt
            momentum += m * (v + half_turn @ v)  # v^n is v- turned by half the angle
            charge += q * count
        if too_fast:
            kinetic, momentum[:] = math.nan, math.nan
        field = math.nan
        if self.levels[0] < TOP:
            field = 0.5 * scene.cell_volume * exact.value(energy, 1 / float(self.node_inv_scale[0]))
        return {
            "energy_field": field, "energy_kinetic": kinetic, "energy_total": field + kinetic,
            "momentum_x": float(momentum[0]), "momentum_y": float(momentum[1]), "charge": charge,
            **{f"mode_{n}": amplitude for n, amplitude in enumerate(self.modes(columns), start=1)},
        }  # fmt: skip

    def modes(self, columns: NDArray[np.int64]) -> list[float]:
        """Amplitudes |E_k| of cos, sin (2 pi n x / Lx) in E_x averaged over y, n = 1 .. MODES."""
        if self.levels[1] == TOP:
            return [math.nan] * MODES
        mean = columns * (1 / self.node_inv_scale[1] / self.rows)
        waves = np.abs(np.fft.rfft(mean)[1 : MODES + 1]).tolist()
        both = [2.0 if 2 * n < self.width else 1.0 for n in range(1, MODES + 1)]  # the shortest wave is its own mirror
        return [k * wave / self.width for k, wave in zip(both, waves)] + [0.0] * (MODES - len(waves))

    def trouble(self) -> str | None:
        """Why the state is no solution, or None. What fails in a step raises by itself: only the field is looked at."""
        rho = self.plasma.mesh.rho
        if not np.isfinite(rho).all() or not np.isfinite(self.plasma.mesh.phi.inner).all():
            return "the field is not finite"
        return None


def _level(most: float) -> int:
    """Exponent of the least power of 16 above it."""
    if most == 0:
        return LEAST
    return -(-math.frexp(most)[1] // 4) if math.isfinite(most) else TOP
