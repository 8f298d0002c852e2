"""The sums that the scalars of the series are made of, exact: their bits depend on neither ranks nor threads."""

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.world import World
from hpcpic.core.space import exact
from hpcpic.core.space.domain import Domain
from hpcpic.core.tasks.arena import Arena
from hpcpic.core.tasks.graph import TaskError
from hpcpic.plasma.diagnostics import scalars
from hpcpic.plasma.diagnostics.kept_motion import Places
from hpcpic.plasma.diagnostics.scalars import MODES, Sample, SpeciesSample
from hpcpic.plasma.field.mesh import Mesh
from hpcpic.plasma.field.slab_sums import shares
from hpcpic.plasma.kernels.mesh import node_sums
from hpcpic.plasma.particles.cloud import Cloud
from hpcpic.plasma.physics.moments import VELOCITY, Moment
from hpcpic.plasma.setup.scene import Scene
from hpcpic.plasma.sizes import MAX_SPEED, PLACE_BITS

LEAST, TOP = -225, 226  # levels (powers of 16) of nothing, and of what is not finite


class SeriesSums:
    """Sums over particles and nodes whose bits depend on neither ranks nor threads (core.space.exact).

    A sample is one reduction of integers over the ranks. The scales of the nodes' sums are those that served last;
    they are right if the greatest term of all ranks is of the same level, which counts of ranks tell. Else the
    levels are agreed on and all is summed again, so that a sample depends on the present state alone.
    """

    def __init__(self, scene: Scene, world: World, mesh: Mesh, cloud: Cloud, field_scale: float) -> None:
        self.scene, self.world, self.mesh, self.cloud = scene, world, mesh, cloud
        self.moments = cloud.spec.moments
        self.n_species, v = len(scene.species), scene.velocity_components
        ratio = scene.sides
        cloud.arena.set(half_kick=scene.half_kicks(field_scale).astype(cloud.spec.dtype), ratio_sq=ratio**2)
        self.particle_tasks = cloud.bind_moments()
        self.speed = 1.0  # power of two above |v| in cells per step
        self.largest_square = exact.power_of_two_above(float((ratio**2).sum()))  # |v|^2 of v = (1, 1, 1)
        self.side = np.array((*scene.spacing, scene.spacing[0], scene.spacing[0])[:v])
        self.turns = [(species.mean_turn, species.half_turn) for species in scene.species]
        self._bind_nodes()
        self._lay_out()

    def _bind_nodes(self) -> None:
        """Tasks of kernels.mesh.node_sums for the threads."""
        mesh, domain, world = self.mesh, self.mesh.domain, self.world
        arrays, flat, below = (mesh.rho, mesh.phi.values, mesh.e[0]), domain.ndim == 1, mesh.inside[0].start
        rho, phi, e_x = (a.reshape(1, -1) if flat else a.reshape(-1, a.shape[-1]) for a in arrays)
        rows = shares(len(rho), self.cloud.pool)
        self.width = domain.points[-1]
        self.rows = math.prod(domain.points[:-1])
        self.own = slice(*domain.row_range(world.rank)) if flat else slice(None)  # columns
        self.levels = [LEAST, LEAST]  # of the terms of the field energy, and of E_x
        self.per_scale = np.ones(2)
        self.energy = np.zeros((len(rows), exact.LIMBS), np.int64)
        self.columns = np.zeros((len(rows), rho.shape[1]), np.int64)
        self.most = np.zeros((len(rows), 2))
        arena = Arena(())
        arena.set(
            corners=np.array([_corner(domain, arrays[1].shape, below + 1), _corner(domain, arrays[2].shape, below)]),
            background=self.scene.background,
            per_scale=self.per_scale,
            rho_rows=rho,
            phi_rows=phi,
            e_x=e_x,
            limbs=self.energy,
            columns=self.columns,
            most=self.most,
        )
        with world.first_on_node():
            self.node_tasks = [
                arena.bind(node_sums, first=a, last=b, share=k) for k, (a, b) in enumerate(rows)
            ]

    def _lay_out(self) -> None:
        """The words of a sample in one line, which one reduction sums over the ranks."""
        shape, places = self.cloud.arena["limbs"].shape[1:], 3 * self.n_species * self.scene.dimensions
        ends = np.cumsum([5, shape[0], math.prod(shape), exact.LIMBS, self.width, places]).tolist()
        self.words = np.zeros(ends[-1], np.int64)
        self.parts = [slice(a, b) for a, b in itertools.pairwise([0, *ends])]

    def _local(self) -> list[int]:
        """Levels [2] of this rank's terms. Fills the words: flags (too fast; above and at the levels, two each),
        counts, limbs of particles, limbs of the field energy, columns, places and crossings.
        """
        cloud, too_fast = self.cloud, False
        limbs_of_blocks = cloud.arena["limbs"]
        limbs_of_blocks[:] = cloud.arena["places"][:] = 0
        cloud.arena["inv_scale"][:] = [1 / scale for scale in self._scales()]
        self.per_scale[:] = [math.ldexp(1.0, -4 * level) for level in self.levels]
        self.per_scale[1] *= 2.0 ** (61 - int(self.rows).bit_length())
        cloud.pool.each(self.node_tasks)
        try:
            cloud.each(self.particle_tasks)
        except TaskError as error:
            if error.code != exact.NOT_BOUNDED:
                raise
            too_fast = True
        levels = [_level(most) for most in self.most.max(axis=0).tolist()]
        flags, counts, limbs, energy, columns, places = (self.words[part] for part in self.parts)
        here = list(zip(levels, self.levels))
        flags[:] = [too_fast, *(own > known for own, known in here), *(own == known for own, known in here)]
        counts[:] = self._counts()
        np.sum(limbs_of_blocks, axis=0, out=limbs.reshape(limbs_of_blocks.shape[1:]))
        np.sum(self.energy, axis=0, out=energy)
        np.sum(self.columns, axis=0, out=columns[self.own])
        rows = places.reshape(self.n_species, self.scene.dimensions, 3)
        rows[..., :2] = cloud.arena["places"].sum(axis=0)[: self.n_species]
        rows[..., 2] = cloud.arena["crossings"].sum(axis=0)[: self.n_species]
        return levels

    def _scales(self) -> list[float]:
        """Scale of each value of the moments: a power of two that no particle exceeds at the present `speed`."""
        v = self.cloud.spec.velocities
        return [
            self.speed**moment.power * self.largest_square ** (moment.power // 2)
            for moment in self.moments
            for _ in range(moment.size(v))
        ]

    def _counts(self) -> NDArray[np.int64]:
        """Particles of each species on this rank."""
        return self.cloud.arena["count"].reshape(-1, max(self.n_species, 1)).sum(axis=0)

    def counts(self) -> NDArray[np.int64]:
        """Particles of each species, counted on all ranks."""
        return self.world.sum_int(self._counts())

    def _all(self) -> tuple[bool, NDArray, NDArray, NDArray, NDArray]:
        """True where a particle is beyond MAX_SPEED, counts [species], limbs [species, k, 3] of the moments of v-,
        limbs [3] of (rho + rho_0) phi, and sums over columns [Nx] of E_x: of all ranks. Also sets `places`.
        """
        world = self.world
        while True:
            levels = self._local()
            words = world.sum_int(self.words)
            flags, counts, limbs, energy, columns, places = (words[part] for part in self.parts)
            too_fast, *above, first_at, second_at = flags.tolist()
            if too_fast and self.speed < MAX_SPEED:
                self.speed *= 16
            elif any(above) or not (first_at and second_at):
                self.levels = world.max_array(np.array(levels)).tolist()
            else:
                self.places = self._unwound(places.tolist())
                return bool(too_fast), counts, limbs.reshape(self.cloud.arena["limbs"].shape[1:]), energy, columns

    def _unwound(self, places: list[int]) -> Places:
        """Sums of places by species and axis in 2^-40 of a cell, as if the box had no ends, from cells, parts and
        crossings.
        """
        sums, d = iter(places), self.scene.dimensions
        threes = list(zip(sums, sums, sums))
        return [
            [(cells + turns * n << PLACE_BITS) + parts for n, (cells, parts, turns) in zip(self.scene.points, axes)]
            for axes in zip(*(threes[axis::d] for axis in range(d)))
        ]

    def scalars(self) -> dict[str, float]:
        """All columns of the series at the present time. Collective."""
        too_fast, counts, limbs, energy, columns = self._all()
        scales, species, self.momentum = self._scales(), [], np.zeros(3)
        for one, count, rows, turns in zip(self.scene.species, counts.tolist(), limbs.tolist(), self.turns):
            values = [exact.value(row, scale) for row, scale in zip(rows, scales)]
            sums = self._moments_of(values, turns, math.nan if too_fast else 1.0, one.m)
            species.append(SpeciesSample(one.m, one.q, count, sums))
        field = math.nan
        if self.levels[0] < TOP:
            field = 0.5 * self.scene.cell_volume * exact.value(energy, 1 / float(self.per_scale[0]))
        sample = Sample(tuple(species), field, tuple(self.modes(columns)))
        return {scalar.name: scalar.value(sample) for scalar in scalars.columns(self.scene.dimensions)}

    def _moments_of(
        self, values: list[float], turns: tuple[NDArray, NDArray], valid: float, mass: float
    ) -> dict[Moment, float | NDArray]:
        """Moments of a species in powers of m/s. `valid` is 1, or nan. Adds to the momentum of v- that of this species,
        of particles of a mass.

        A vector that is linear in v is that of (v^(n-1/2) + v^(n+1/2)) / 2, with which particles move: a drift is exact.
        Others are turned by half the angle of a step, with the length that v- gives them.
        """
        found: dict[Moment, float | NDArray] = {}
        rest, dt = values, self.scene.time_step
        for moment in self.moments:
            size = moment.size(len(self.side))
            here, rest = rest[:size], rest[size:]
            unit = valid * (self.scene.spacing[0] / dt) ** (moment.power - moment.vector)
            if moment.vector:
                v = np.zeros(3)
                v[:size] = np.array(here) * self.side / dt
                found[moment] = unit * (v + turns[moment.power > 1] @ v)
                if moment is VELOCITY:
                    self.momentum += mass * unit * v
            else:
                found[moment] = unit * here[0]
        return found

    def modes(self, columns: NDArray[np.int64]) -> list[float]:
        """Amplitudes |E_k| of cos, sin (2 pi n x / Lx) in E_x averaged over y and z, n = 1 .. MODES."""
        if self.levels[1] == TOP:
            return [math.nan] * MODES
        mean = columns * (1 / self.per_scale[1] / self.rows)
        waves = np.abs(np.fft.rfft(mean)[1 : MODES + 1]).tolist()
        both = [2.0 if 2 * n < self.width else 1.0 for n in range(1, MODES + 1)]  # the shortest wave is its own mirror
        return [k * wave / self.width for k, wave in zip(both, waves)]


def _corner(domain: Domain, shape: tuple[int, ...], below: int) -> tuple[int, ...]:
    """Where the slab begins in an array with ghosts (see kernels.mesh.node_sums)."""
    if domain.ndim < 3:
        return (domain.ndim - 1) * below, below, 1, 0
    return below * shape[1] + below, below, domain.points[1], shape[1] - domain.points[1]


def _level(most: float) -> int:
    """Exponent of the least power of 16 above a magnitude."""
    if most == 0:
        return LEAST
    return -(-math.frexp(most)[1] // 4) if math.isfinite(most) else TOP
