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
        self._bound: list[tuple[Histogram, HistogramArrays, list[Bound]]] = []
        self._warned: set[str] = set()
        with world.first_on_node():
            for histogram in scene.config.histogram:
                arrays = self._arrays(histogram)
                self._bound.append((histogram, arrays, cloud.bind_counts(arrays)))

    def _arrays(self, histogram: Histogram) -> HistogramArrays:
        species = [species.name for species in self.scene.species].index(histogram.species)
        weights, bins = np.zeros((2, 7)), np.ones(2)
        for k, (axis, n, low, high) in enumerate(
            zip(histogram.of, histogram.bins, histogram.low, histogram.high), 2 - len(histogram.of)
        ):
            bins[k] = n
            weights[k, :6] = self._coordinate(axis, species) * (n / (high - low))
            weights[k, 6] = -low * (n / (high - low))
        counts = np.zeros((self.cloud.blocks, math.prod(histogram.bins) + 2), np.int32)
        return HistogramArrays(np.array([species]), bins, weights, counts)

    def _coordinate(self, axis: str, species: int) -> NDArray[np.float64]:
        """What a coordinate in m or m/s is of (x, y, z, vx, vy, vz) of v-, in cells and cells per step."""
        scene, found, k = self.scene, np.zeros(6), [*HISTOGRAM_AXES].index(axis)
        if HISTOGRAM_AXES[axis] == "m":
            found[k] = scene.spacing[k]
        else:
            turned = np.eye(3) + scene.species[species].half_turn
            found[3:] = turned[k - 3] * scene.sides * (scene.spacing[0] / scene.time_step)
        return found

    def counted(self) -> dict[str, Counts]:
        """All histograms by name. Collective."""
        return {one[0].name: self._count(*one) for one in self._bound}

    def _count(self, histogram: Histogram, arrays: HistogramArrays, tasks: list[Bound]) -> Counts:
        self.cloud.each(tasks)
        local = arrays.counts[:, :-1].view(np.uint32).sum(axis=0, dtype=np.int64)
        counts: NDArray[np.int64] = self.world.sum_int(local)
        species, beyond = self.scene.species[int(arrays.species[0])], int(counts[-1])
        if beyond > BEYOND * species.n and histogram.name not in self._warned:
            self._warned.add(histogram.name)
            if self.world.rank == 0:
                share = f"{beyond / species.n:.3g} of {species.name}"
                limits = zip(histogram.of, histogram.low, histogram.high)
                wider = ", ".join(f"{axis} from {low:.4g} to {high:.4g}" for axis, low, high in limits)
                log.warning(
                    "histogram %s: a share of %s lies beyond its low and high, %s; give wider ones in the case",
                    histogram.name, share, wider,
                )  # fmt: skip
        edges = {
            axis: np.linspace(low, high, n + 1)
            for axis, n, low, high in zip(histogram.of, histogram.bins, histogram.low, histogram.high)
        }
        units = {axis: HISTOGRAM_AXES[axis] for axis in edges}
        return Counts(counts[:-1].reshape(histogram.bins), beyond, edges, units, species.m / species.section.mass)
