"""Histograms of the species: particles counted in bins of position and velocity, as integers, over all ranks."""

import logging
import math

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.world import World
from hpcpic.core.files.arrays import Counts
from hpcpic.core.tasks.graph import Bound
from hpcpic.plasma.case.config import HISTOGRAM_AXES, Histogram
from hpcpic.plasma.kernels.groups import HistogramArrays
from hpcpic.plasma.particles.cloud import Cloud
from hpcpic.plasma.setup.scene import Scene

BEYOND = 0.01  # share of the particles that may lie in no bin without a word
log = logging.getLogger("hpcpic.histogram")


class Histograms:
    """The histograms of a case at t = n dt: positions are x^n, velocities v^n, as in the series."""

    def __init__(self, scene: Scene, world: World, cloud: Cloud) -> None:
        self.scene, self.world, self.cloud = scene, world, cloud
        kernel = cloud.spec.histogram()
        self._bound: list[tuple[Histogram, HistogramArrays, list[Bound]]] = []
        self._warned: set[str] = set()
        with world.first_on_node():
            for histogram in scene.config.histogram:
                arrays = self._arrays(histogram)
                tasks = [
                    cloud.arena.bind(kernel, block=b, first=first, last=last, histogram=arrays)
                    for b, (first, last) in enumerate(cloud.tiles.ranges)
                ]
                self._bound.append((histogram, arrays, tasks))

    def _arrays(self, histogram: Histogram) -> HistogramArrays:
        scene, axes = self.scene, [*HISTOGRAM_AXES]
        low, bins = np.array(histogram.low), np.array(histogram.bins)
        width = np.array(histogram.high) - low
        units = [  # of coordinates in the kernel, as parts of the width
            scene.lengths[axes.index(axis)] / width[k] / scene.points[axes.index(axis)]
            if HISTOGRAM_AXES[axis] == "m"
            else scene.spacing[0] / scene.time_step / width[k]
            for k, axis in enumerate(histogram.of)
        ]
        return HistogramArrays(
            species=np.array([[species.name for species in scene.species].index(histogram.species)]),
            axes=np.array([axes.index(axis) for axis in histogram.of]),
            bins=bins,
            low=low / width * bins,
            per_unit=np.array(units) * bins,
            node_half_kick=self.cloud.arena["half_kick"],
            half_turn=np.array([species.half_turn for species in scene.species]),
            side=scene.sides,
            counts=np.zeros((self.cloud.blocks, math.prod(histogram.bins) + 1), np.int64),
        )

    def counted(self) -> dict[str, Counts]:
        """All histograms by name. Collective."""
        return {one[0].name: self._count(*one) for one in self._bound}

    def _count(self, histogram: Histogram, arrays: HistogramArrays, tasks: list[Bound]) -> Counts:
        self.cloud.each(tasks)
        counts: NDArray[np.int64] = self.world.sum_int(arrays.counts.sum(axis=0))
        species, beyond = self.scene.species[arrays.species[0]], int(counts[-1])
        if beyond > BEYOND * species.n and histogram.name not in self._warned:
            self._warned.add(histogram.name)
            if self.world.rank == 0:
                share = f"{beyond / species.n:.3g} of {species.name}"
                log.warning("histogram %s: a share of %s lies beyond its low and high", histogram.name, share)
        edges = {
            axis: np.linspace(low, high, n + 1)
            for axis, n, low, high in zip(histogram.of, histogram.bins, histogram.low, histogram.high)
        }
        units = {axis: HISTOGRAM_AXES[axis] for axis in edges}
        return Counts(counts[:-1].reshape(histogram.bins), beyond, edges, units, species.m / species.section.mass)
