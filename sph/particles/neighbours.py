"""Cells of a rank: bodies in slots by layer, row and fine cell, and the runs of slots where neighbours are."""

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.errors import Diverged
from hpcpic.core.simd.generate import specialise
from hpcpic.core.simd.registers import lanes
from hpcpic.core.tasks.graph import TaskError
from sph.kernels.groups import Table
from sph.kernels.marks import BODY, OWN
from sph.particles.slabs import PADS, CellGrid, Slabs
from sph.particles.storage import Storage
from sph.particles.tasks import Tasks, equal_parts

MAX_FINE_CELLS = 2**28  # fine cells of a rank: a table of 1 GB
VECTOR = lanes(np.float64)  # neighbours at a time
BODY_COST = 4  # vectors of neighbours that take as long as all else that is done with a body


class Cells:
    """Puts the bodies of a rank into slots and finds their neighbours, in `here` layers of cells from `first` on."""

    def __init__(self, tasks: Tasks, grid: CellGrid, d: int) -> None:
        self.tasks, self.grid, self.parts = tasks, grid, tasks.parts
        self.kernels, self.runs = (specialise("sph.kernels", [stem], DIM=d) for stem in ("cells", "runs"))
        tasks.arena.group(table=Table)
        tasks.arena.set(scale=grid.scale, edge=grid.edges)
        tasks.foresee(self.runs.find, blocks="sweeps")
        tasks.foresee(self.kernels.tally, self.kernels.scatter)
        tasks.arena.ask(self.kernels.divide, first=0, here=0)
        tasks.foresee(self.kernels.extents, self.kernels.arrange, self.kernels.find_places, blocks="layers")

    def _place(self, storage: Storage, wanted: int) -> None:
        a = self.tasks.arena
        a["shape"][:] = PADS, self.grid.layers, 0, 0, self.grid.rows, 0
        a["chunks"][:] = equal_parts(storage.end, self.parts)
        self.tasks.each(self.kernels.place, wanted=wanted)

    def layer_of(self, storage: Storage) -> NDArray[np.int32]:
        """Layers [slots] of the own particles, in the whole domain; of others -1. In memory that `sort` uses."""
        self._place(storage, OWN)
        return self.tasks.arena["layer"][: storage.end]

    def counts(self, storage: Storage) -> NDArray[np.int64]:
        """Own particles by layers [layers] of the whole domain. In memory that `sort` uses."""
        return np.bincount(self.layer_of(storage) + 1, minlength=self.grid.layers + 1)[1:]  # 0: nobody

    def costs(self) -> NDArray[np.int64]:
        """What a step does with the own bodies, in vectors of neighbours, by layers [layers] of the whole domain: after
        `find`. A dry wall has no neighbours.
        """
        a, costs = self.tasks.arena, np.zeros(self.grid.layers, np.int64)
        base = a["base"][: self.here + 1]
        vectors = (-(-a["run_length"][:, : base[-1]].astype(np.int64) // VECTOR)).sum(axis=0)
        own = a["flags"][: base[-1]] & OWN != 0
        layers = self.first + np.arange(self.here)
        inside = (layers >= 0) & (layers < self.grid.layers)  # beside them are ghosts at most
        costs[layers[inside]] = np.add.reduceat(np.where(own, BODY_COST + vectors, 0), base[:-1])[inside]
        return costs

    def sort(self, storage: Storage, slabs: Slabs) -> NDArray[np.int32]:
        """Put bodies into slots by cells: own ones are in layers of the slab, ghosts also beside it. By old slot, the
        new one, until the next search.
        """
        tasks, kernels, a = self.tasks, self.kernels, self.tasks.arena
        self._place(storage, BODY)
        first, here = self._span(slabs.low, slabs.high)
        self.first, self.here = first, here
        a.reserve(layers=here + 1)
        a["shape"][2:4] = first, here
        self._tally()
        a.reserve(rows=a.call(kernels.divide, first=first, here=here))
        if storage.reserve(int(a["base"][here])):  # in other memory now
            return self.sort(storage, slabs)
        tasks.each(kernels.scatter)
        tasks.each(kernels.extents, blocks="layers")
        fine = a["fine_total"]
        fine[1 : here + 1], fine[0] = np.cumsum(fine[:here]), 0
        if fine[here] > MAX_FINE_CELLS:
            raise Diverged("particles are too far from each other: there is no room for the cells between them")
        a.reserve(cells=int(fine[here]))
        tasks.each(kernels.arrange, blocks="layers")
        tasks.each(kernels.find_places, blocks="layers")
        storage.sorted(int(a["base"][here]))
        tasks.permute(kernels.gather, kernels.put_back, len(storage.state), blocks="layers")
        a["chunks"][:] = equal_parts(storage.end, self.parts)
        return a["bucket"]

    def find(self, radius: float) -> None:
        """Find the runs of slots where all neighbours within `radius` m are."""
        self.tasks.arena["edge"][4] = radius
        try:
            self.tasks.each(self.runs.find, blocks="sweeps")
        except TaskError as error:
            if error.code == self.runs.CROWDED:
                raise Diverged(f"more than {self.runs.MAX_RUN} particles in one place") from error
            raise

    def _tally(self) -> None:
        try:
            self.tasks.each(self.kernels.tally)
        except TaskError as error:
            if error.code == self.kernels.LOST:
                raise Diverged("a particle moved farther than a layer of cells in a step") from error
            raise

    def _span(self, low: int, high: int) -> tuple[int, int]:
        """First and number of the layers with bodies and of one more on each side: an empty tank costs nothing. low,
        high: own layers.
        """
        span = self.tasks.arena["span"]
        lowest, highest = int(span[:, 0].min()), int(span[:, 1].max())
        if highest < 0:
            return low - 1, 2
        first, last = max(lowest, low) - 1, min(highest + 1, high)
        return first, last - first + 1
