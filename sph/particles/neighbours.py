"""Cells of a rank: bodies in slots by layer, row and fine cell, and the runs of slots where neighbours are."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.errors import Diverged
from hpcpic.core.tasks.graph import TaskError
from sph.kernels.marks import BODY, OWN
from sph.kernels.specialise import specialise
from sph.particles.particles import PADS, Bodies, Tasks, even

FINE = 8
MOST_FINE = 2**28  # fine cells of a rank: a table of 1 GB
GAP = 16  # slots between layers: a vector may overrun


class Grid:
    """Layers and rows of thickness `edge` over a box of these lengths [m], with PADS more on each side."""

    def __init__(self, lengths: NDArray[np.float64], edge: float) -> None:
        self.edge = edge
        self.layers, self.rows = (int(np.ceil(length / edge)) + 2 * PADS for length in lengths[:2])
        if len(lengths) == 2:
            self.rows = 1
        self.scale = np.full(len(lengths), 1.0 / edge)
        self.scale[-1] *= FINE
        self.edges = np.array([edge, edge, edge / FINE, PADS, 0.0])

    def layer(self, x: NDArray[np.float64]) -> NDArray[np.int64]:
        """Layer of positions along the slab axis, as the kernels find it."""
        at = np.floor(x * self.scale[0]) + PADS
        return np.clip(at, 0, self.layers - 1).astype(np.int64)


class Cells:
    """Slots and runs of the bodies of a rank; `tasks.arrays` gets all of it by name."""

    def __init__(self, tasks: Tasks, grid: Grid, d: int) -> None:
        self.tasks, self.grid, self.parts = tasks, grid, tasks.parts
        self.kernels, self.runs = (specialise(stem, DIM=d) for stem in ("cells", "runs"))
        self.n_runs = self.runs.ROWS
        self._layers = self._rows = self._fine = -1  # no arrays yet
        tasks.set(
            scale=grid.scale,
            edge=grid.edges,
            shape=np.zeros(6, np.int64),
            chunks=np.zeros(self.parts + 1, np.int64),
            span=np.zeros((self.parts, 2), np.int64),
            layers=np.zeros(self.parts + 1, np.int64),
            sweeps=np.zeros(self.parts + 1, np.int64),
            inner=np.zeros(self.parts + 1, np.int64),
        )

    def _room(self, **sizes: int) -> None:
        """Make the arrays named by a size large enough for it."""
        tasks, parts = self.tasks, self.parts
        n = sizes.get("layers", 0)
        if n > self._layers:
            self._layers = n = n + n // 8 + 4
            table = {name: np.zeros((parts, n), np.int64) for name in ("count", "low", "high", "start")}
            tasks.set(
                **table, begin=np.zeros(n + 1, np.int64), base=np.zeros(n + 1, np.int64),
                rows=np.zeros((n, 3), np.int64), fine_total=np.zeros(n + 1, np.int64),
            )  # fmt: skip
        n = sizes.get("rows", 0)
        if n > self._rows:
            self._rows = n = n + n // 4
            tasks.set(row_table=np.zeros((n, 8), np.int32))
        n = sizes.get("fine", 0)
        if n > self._fine:
            self._fine = n = n + n // 4
            tasks.set(fine_start=np.zeros(n, np.int32))

    def _fit(self, bodies: Bodies) -> None:
        """Memory for a sort, as large as the bodies now are."""
        n, need = bodies.capacity, self.tasks.workspace.need
        slots = {"body": ((n,), np.int32), "kind": ((n,), np.int32)}
        need("move", **slots, moved=((n,), np.float64))
        need("sort", **slots, **dict.fromkeys(("layer", "row", "fine", "bucket"), ((n,), np.int32)))

    def _place(self, bodies: Bodies, wanted: int) -> None:
        a = self.tasks.arrays
        self._fit(bodies)
        a["shape"][:] = PADS, self.grid.layers, 0, 0, self.grid.rows, 0
        a["chunks"][:] = even(bodies.end, self.parts)
        self.tasks.each(self.kernels.place, wanted=wanted)

    def layer_of(self, bodies: Bodies) -> NDArray[np.int32]:
        """Global layers by row, of others than the own bodies -1, in memory that the next `sort` uses."""
        self._place(bodies, OWN)
        return self.tasks.arrays["layer"][: bodies.end]

    def sort(self, bodies: Bodies, slab: tuple[int, int], fit: Callable[[], None]) -> None:
        """Bodies into slots by cells. The own ones are in the layers of the slab from slab[0] up to slab[1], ghosts
        also beside it. `fit` makes what else shares the memory as large as the bodies are.
        """
        tasks, kernels = self.tasks, self.kernels
        fit()
        self._place(bodies, BODY)
        a = tasks.arrays
        first, here = self._span(*slab)
        self.here = here
        self._room(layers=here)
        a["shape"][2:4] = first, here
        self._tally()
        self._buckets(a["count"][:, :here], first, here)
        if bodies.reserve(int(a["base"][here])):  # in other memory now
            return self.sort(bodies, slab, fit)
        tasks.each(kernels.scatter)
        tasks.each(kernels.extents, blocks="layers")
        fine = a["fine_total"]
        totals = fine[:here].copy()
        fine[0] = 0
        np.cumsum(totals, out=fine[1 : here + 1])
        if fine[here] > MOST_FINE:
            raise Diverged("particles are too far from each other: there is no room for the cells between them")
        self._room(fine=int(fine[here]))
        tasks.each(kernels.arrange, blocks="layers")
        tasks.each(kernels.find_places, blocks="layers")
        bodies.sorted(a["bucket"], int(a["base"][here]))
        for k in range(len(bodies.state)):
            tasks.each(kernels.gather, blocks="layers", k=k)
            tasks.each(kernels.put_back, blocks="layers", k=k)
        a["chunks"][:] = even(bodies.end, self.parts)
        return None

    def find(self, radius: float) -> None:
        """Runs of the slots of all neighbours within `radius`."""
        self.tasks.arrays["edge"][4] = radius
        try:
            self.tasks.each(self.runs.find, blocks="sweeps")
        except TaskError as error:
            if error.code == self.runs.CROWDED:
                raise Diverged(f"more than {self.runs.MOST} particles in one place") from error
            raise

    def _tally(self) -> None:
        try:
            self.tasks.each(self.kernels.tally)
        except TaskError as error:
            if error.code == self.kernels.LOST:
                raise Diverged("a particle moved farther than a layer of cells in a step") from error
            raise

    def _span(self, low: int, high: int) -> tuple[int, int]:
        """First and number of the layers with bodies, and one more on each side: an empty tank costs nothing."""
        lowest, highest = self.tasks.arrays["span"].min(axis=0)[0], self.tasks.arrays["span"].max(axis=0)[1]
        if highest < 0:
            return low - 1, 2
        first, last = max(lowest - 1, low - 1), min(highest + 1, high)
        return int(first), int(last - first) + 1

    def _buckets(self, count: NDArray[np.int64], first: int, here: int) -> None:
        """From the counts of chunks and layers: where layers begin, their rows, and blocks of about equal load."""
        a = self.tasks.arrays
        per_layer = count.sum(axis=0)
        begin, base = a["begin"], a["base"]
        begin[0] = base[0] = 0
        np.cumsum(per_layer, out=begin[1 : here + 1])
        np.cumsum((per_layer + (2 * GAP - 1)) // GAP * GAP, out=base[1 : here + 1])
        a["start"][:, :here] = begin[:here] + np.cumsum(count, axis=0) - count
        low, high = a["low"][:, :here].min(axis=0), a["high"][:, :here].max(axis=0)
        rows = a["rows"]
        rows[:here, 0] = low
        rows[:here, 1] = np.maximum(high - low + 1, 0)
        rows[:here, 2] = np.cumsum(rows[:here, 1]) - rows[:here, 1]
        self._room(rows=int(rows[:here, 1].sum()))
        share = begin[here] * np.arange(self.parts + 1) / self.parts
        a = self.tasks.arrays
        cuts = np.searchsorted(begin[: here + 1], share)
        cuts[0], cuts[-1] = 0, here
        a["layers"][:] = cuts
        pairs = np.unique(np.minimum(cuts[1:-1] + (cuts[1:-1] + first) % 2, here - 1))  # an even layer and the next
        a["sweeps"][0], a["sweeps"][1:] = 0, here - 1
        a["sweeps"][1 : 1 + len(pairs)] = pairs
        a["inner"][:] = np.clip(cuts, 1, here - 1)
