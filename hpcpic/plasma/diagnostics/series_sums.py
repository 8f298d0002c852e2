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
            self.node_tasks = [arena.bind(node_sums, first=a, last=b, share=k) for k, (a, b) in enumerate(rows)]

    def _lay_out(self) -> None:
        """The whole numbers of a sample in one line, which one reduction sums over the ranks: `shapes` of its parts."""
        of_particles, axes = self.cloud.arena["limbs"].shape[1:], self.scene.dimensions
        self.shapes = {
            "too_fast": (1,),  # ranks with a particle beyond `speed`
            "above": (2,),  # ranks whose greatest term of the field energy, and of E_x, is above the known level
            "at": (2,),  # ranks where it is at that level
            "counts": of_particles[:1],
            "limbs": of_particles,
            "energy": (exact.LIMBS,),
            "columns": (self.width,),
            "places": (self.n_species, axes, 3),  # cells, parts of a cell and crossings of the box
        }
        self.words = np.zeros(sum(map(math.prod, self.shapes.values())), np.int64)

    def _parts(self, words: NDArray[np.int64]) -> dict[str, NDArray[np.int64]]:
        """Views of the parts of a line of words."""
        ends = list(itertools.accumulate(map(math.prod, self.shapes.values())))
        pieces = np.split(words, ends[:-1])
        return {name: piece.reshape(shape) for (name, shape), piece in zip(self.shapes.items(), pieces)}

    def _local(self) -> list[int]:
        """Levels [2] of this rank's terms. Fills the words (see `_lay_out`)."""
        cloud, mine = self.cloud, self._parts(self.words)
        cloud.arena["limbs"][:] = cloud.arena["places"][:] = 0
        cloud.arena["inv_scale"][:] = [1 / scale for scale in self._scales()]
        self.per_scale[:] = [math.ldexp(1.0, -4 * level) for level in self.levels]
        self.per_scale[1] *= 2.0 ** (61 - int(self.rows).bit_length())
        cloud.pool.each(self.node_tasks)
        mine["too_fast"][:] = False
        try:
            cloud.each(self.particle_tasks)
        except TaskError as error:
            if error.code != exact.NOT_BOUNDED:
                raise
            mine["too_fast"][:] = True
        levels = [_level(most) for most in self.most.max(axis=0).tolist()]
        mine["above"][:] = [own > known for own, known in zip(levels, self.levels)]
        mine["at"][:] = [own == known for own, known in zip(levels, self.levels)]
        mine["counts"][:] = self._counts()
        np.sum(cloud.arena["limbs"], axis=0, out=mine["limbs"])
        np.sum(self.energy, axis=0, out=mine["energy"])
        np.sum(self.columns, axis=0, out=mine["columns"][self.own])
        mine["places"][..., :2] = cloud.arena["places"].sum(axis=0)[: self.n_species]
        mine["places"][..., 2] = cloud.arena["crossings"].sum(axis=0)[: self.n_species]
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

    def _all(self) -> dict[str, NDArray[np.int64]]:
        """The parts of a sample of all ranks, summed at scales that fit; too_fast tells particles beyond MAX_SPEED."""
        while True:
            levels = self._local()
            found = self._parts(self.world.sum_int(self.words))
            if found["too_fast"] and self.speed < MAX_SPEED:
                self.speed *= 16
            elif found["above"].any() or not found["at"].all():
                self.levels = self.world.max_array(np.array(levels)).tolist()
            else:
                return found

    def _unwound(self, places: NDArray[np.int64]) -> Places:
        """Sums of places by species and axis in 2^-40 of a cell, as if the box had no ends, from cells, parts and
        crossings; whole numbers of any size.
        """
        return [
            [(cells + turns * n << PLACE_BITS) + parts for n, (cells, parts, turns) in zip(self.scene.points, axes)]
            for axes in places.tolist()
        ]

    def scalars(self) -> dict[str, float]:
        """All columns of the series at the present time. Collective."""
        found = self._all()
        self.places, self.momentum_before_turn = self._unwound(found["places"]), np.zeros(3)
        scales, species, valid = self._scales(), [], math.nan if found["too_fast"] else 1.0
        for k, one in enumerate(self.scene.species):
            values = [valid * exact.value(row, scale) for row, scale in zip(found["limbs"][k].tolist(), scales)]
            sums = self._moments_of(values, *self.turns[k], one.m)
            species.append(SpeciesSample(one.m, one.q, int(found["counts"][k]), sums))
        field = math.nan
        if self.levels[0] < TOP:
            field = 0.5 * self.scene.cell_volume * exact.value(found["energy"], 1 / float(self.per_scale[0]))
        sample = Sample(tuple(species), field, tuple(self.modes(found["columns"])))
        return {scalar.name: scalar.value(sample) for scalar in scalars.columns(self.scene.dimensions)}

    def _moments_of(
        self, values: list[float], mean_turn: NDArray, half_turn: NDArray, mass: float
    ) -> dict[Moment, float | NDArray]:
        """Moments of a species of particles of a mass, in powers of m/s. Adds to `momentum_before_turn`, of v-, which
        KeptMotion wants.

        A vector that is linear in v is that of (v^(n-1/2) + v^(n+1/2)) / 2, by which particles move: drifts are exact.
        Others are turned by half the angle of a step, with the length that v- gives them (docs/theory/plasma.md).
        """
        found: dict[Moment, float | NDArray] = {}
        rest, dt = values, self.scene.time_step
        for moment in self.moments:
            size = moment.size(len(self.side))
            here, rest = rest[:size], rest[size:]
            unit = (self.scene.spacing[0] / dt) ** (moment.power - moment.vector)
            if moment.vector:
                v = np.zeros(3)
                v[:size] = np.array(here) * self.side / dt
                found[moment] = unit * (v + (mean_turn if moment.power == 1 else half_turn) @ v)
                if moment is VELOCITY:
                    self.momentum_before_turn += mass * unit * v
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
