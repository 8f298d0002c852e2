"""Fields of the species: sums over particles on the nodes, exact, so that their bits depend on no order."""

import math
from collections.abc import Collection

import numpy as np

from hpcpic.core.comm.tags import Channel
from hpcpic.core.comm.world import World
from hpcpic.core.files.arrays import FieldArray
from hpcpic.core.space.domain import Domain
from hpcpic.core.space.exact import power_of_two_above
from hpcpic.plasma.field.slab_sums import SlabSums
from hpcpic.plasma.kernels.groups import NodeSumArrays
from hpcpic.plasma.particles.cloud import Cloud
from hpcpic.plasma.particles.tiles import Patches
from hpcpic.plasma.physics.moments import SPEED_SQUARED
from hpcpic.plasma.physics.species_fields import NodeSample, SpeciesField, unit_in
from hpcpic.plasma.setup.scene import Scene, SceneSpecies

SQUARE = 4.0  # a power of two above |v|^2 of v = (1, 1, 1)
BITS = 44  # of a particle's share of a sum, as many as of its charge, or fewer so that all may sit on one node
SLOWEST = 2.0**-200  # cells per step: with squares of less, numbers are no longer normal


class NodeMoments:
    """The species fields of a case: a particle's values are shared among nodes as its charge is, as integers.

    They are rounded to 2^-44 (of more than 2^18 particles: so much coarser) of the largest of all particles of the
    species. It is found while summing: where it is not what served last, all is summed again.
    """

    def __init__(self, scene: Scene, world: World, domain: Domain, cloud: Cloud, fields: list[SpeciesField]) -> None:
        self.scene, self.world, self.pool, self.fields = scene, world, cloud.pool, fields
        self.moments = tuple(dict.fromkeys(moment for field in fields for moment in field.moments)) or (SPEED_SQUARED,)
        self.sizes = [moment.size(scene.velocity_components) for moment in self.moments]
        n, ghosts, d = 1 + sum(self.sizes), cloud.spec.shape.ghosts, scene.dimensions
        patches = Patches(cloud.tiles, n, d, ghosts)
        self.sums = SlabSums(world, cloud.pool, domain, n, ghosts, Channel.MOMENTS)
        self.arrays = arrays = NodeSumArrays(
            sampled=np.zeros(1, np.int64),
            whole=np.ones(1, np.int64),
            node_half_kick=cloud.arena["half_kick"],
            half_turn=np.array([species.half_turn for species in scene.species]),
            side=scene.sides,
            per_scale=np.ones(n - 1),
            fastest=np.zeros(cloud.blocks),
        )
        kernel = cloud.spec.node_moments(self.moments)
        with world.first_on_node():
            tasks = [
                cloud.arena.bind(kernel, block=b, first=first, last=last, patch=patch, node_sums=arrays)
                for b, ((first, last), patch) in enumerate(zip(cloud.tiles.ranges, patches.of_block))
            ]
        self._tasks = tasks  # the arena follows them as long as somebody holds them
        self._graph = self.sums.graph(patches, before=[tasks])

    def arrays_of(self, iteration: int, names: Collection[str]) -> dict[str, FieldArray]:
        """Fields at t = n dt, as <field>_<species>: those of these names, of all species where a name has none.
        Collective.
        """
        found = {}
        for k, species in enumerate(self.scene.species):
            wanted = [f for f in self.fields if f.name in names or f"{f.name}_{species.name}" in names]
            if not wanted:
                continue
            self.arrays.sampled[0] = k
            sample = self._sample(species, iteration)
            for field in wanted:
                unit = unit_in(field.unit, self.scene.dimensions)
                found[f"{field.name}_{species.name}"] = FieldArray(field.value(sample), unit)
        return found

    def _sample(self, species: SceneSpecies, iteration: int) -> NodeSample:
        scene, whole = self.scene, 1 << min(BITS, 62 - max(species.n, 1).bit_length())
        self.arrays.whole[0] = whole
        scales = self._sum(whole, iteration)
        parts = self.sums.field.inner
        real, unit = species.section.mass, scene.spacing[0] / scene.time_step
        count = parts[0].astype(np.float64)
        density = count * (species.m / real / whole / scene.cell_volume)
        means, at = {}, 1
        for moment, size, scale in zip(self.moments, self.sizes, scales):
            sums = parts[at : at + size] * (scale * unit**moment.power)
            mean = np.divide(sums, count, out=np.zeros_like(sums), where=parts[0] != 0)
            means[moment] = np.moveaxis(mean, 0, -1) if moment.vector else mean[0]
            at += size
        return NodeSample(real, density, means)

    def _sum(self, whole: int, iteration: int) -> list[float]:
        """Sum over the particles; the scale of each moment, in cells along x per step to its power."""
        fastest, known = 1.0, math.nan
        while fastest != known:
            known = fastest
            scales = [known**moment.power * SQUARE ** (moment.power // 2) for moment in self.moments]
            self.arrays.per_scale[:] = np.repeat([whole / scale for scale in scales], self.sizes)
            self.sums.fold.at(iteration)
            self.pool.run(self._graph)
            most = self.world.max(float(self.arrays.fastest.max()))
            if not math.isfinite(most):
                return [math.nan for _ in scales]
            fastest = power_of_two_above(max(most, SLOWEST))
        return scales

    def free(self) -> None:
        """Free what MPI holds (all ranks together)."""
        self.sums.fold.free()
