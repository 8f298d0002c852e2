"""Cells of a rank: bodies in slots by layer, row and fine cell, and the runs of slots where neighbours are."""

from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.errors import Diverged
from hpcpic.core.tasks import TaskError
from sph.kernels.specialise import specialise
from sph.particles import PADS, SLACK, Bodies, Tasks, even

FINE = 8
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
        self.kernels: ModuleType = specialise("cells", DIM=d)
        self.n_runs = self.kernels.ROWS
        self._layers = self._rows = self._fine = self._bodies = self.slots = -1  # no arrays yet
        tasks.set(
            scale=grid.scale,
            edge=grid.edges,
            shape=np.zeros(6, np.int64),
            chunks=np.zeros(self.parts + 1, np.int64),
            own_chunks=np.zeros(self.parts + 1, np.int64),
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
        n = sizes.get("bodies", 0)
        if n > self._bodies:
            self._bodies = n = n + n // SLACK
            tasks.workspace.need("sort", **dict.fromkeys(("layer", "row", "fine", "bucket"), ((n,), np.int32)))
        n = sizes.get("rows", 0)
        if n > self._rows:
            self._rows = n = n + n // 4
            tasks.set(row_table=np.zeros((n, 6), np.int32))
        n = sizes.get("fine", 0)
        if n > self._fine:
            self._fine = n = n + n // 4
            tasks.set(fine_start=np.zeros(n, np.int32))
        n = sizes.get("slots", 0)
        if n > self.slots:
            self.slots = n = (n + n // SLACK + GAP) // GAP * GAP
            tasks.set(
                body=np.zeros(n, np.int32), slot_class=np.zeros(n, np.int32),
                run_first=np.zeros((self.n_runs, n), np.int32), run_length=np.zeros((self.n_runs, n), np.uint16),
            )  # fmt: skip

    def layer_of(self, bodies: Bodies) -> NDArray[np.int32]:
        """Global layers of the own bodies, in memory that the next `sort` uses."""
        tasks, a = self.tasks, self.tasks.arrays
        self._room(bodies=bodies.n)
        a["shape"][:2] = PADS, self.grid.layers
        a["own_chunks"][:] = even(bodies.n, self.parts)
        tasks.each(self.kernels.layers_of, chunks="own_chunks")
        return a["layer"][: bodies.n]

    def sort(self, bodies: Bodies, layer: NDArray[np.int32], slab: tuple[int, int], radius: float) -> None:
        """Slots of all bodies; neighbours are within `radius`. The own ones are in global layers layer[n] of the slab
        from slab[0] up to slab[1], ghosts also beside it.
        """
        tasks, a, kernels = self.tasks, self.tasks.arrays, self.kernels
        first, here = self._span(bodies, layer, *slab)
        self.here = here
        n = bodies.n + bodies.ghosts
        self._room(layers=here, bodies=n)
        a["shape"][:] = PADS, self.grid.layers, first, here, self.grid.rows, n
        a["edge"][4] = radius
        a["chunks"][:] = even(n, self.parts)
        a["own_chunks"][:] = even(bodies.n, self.parts)
        self._try(kernels.place)
        count = a["count"][:, :here]
        self._buckets(count, here)
        tasks.each(kernels.scatter)
        tasks.each(kernels.extents, blocks="layers")
        fine = a["fine_total"]
        totals = fine[:here].copy()
        fine[0] = 0
        np.cumsum(totals, out=fine[1 : here + 1])
        self._room(fine=int(fine[here]))
        tasks.each(kernels.arrange, blocks="layers")
        self._try(kernels.find, blocks="sweeps")

    def _try(self, kernel: Any, **more: Any) -> None:
        """A kernel that may find the state to be no solution."""
        try:
            self.tasks.each(kernel, **more)
        except TaskError as error:
            if error.code == self.kernels.LOST:
                raise Diverged("a particle moved farther than a layer of cells in a step") from error
            if error.code == self.kernels.CROWDED:
                raise Diverged(f"more than {self.kernels.MOST} particles in one place") from error
            raise

    def _span(self, bodies: Bodies, layer: NDArray[np.int32], low: int, high: int) -> tuple[int, int]:
        """First and number of the layers with bodies, and one more on each side: an empty tank costs nothing."""
        ghosts = self.grid.layer(bodies.x[0, bodies.n : bodies.n + bodies.ghosts])
        first = max(min(layer.min(initial=high), ghosts.min(initial=high)) - 1, low - 1)
        last = min(max(layer.max(initial=low - 1), ghosts.max(initial=low - 1)) + 1, high)
        return (int(first), int(last - first) + 1) if bodies.n + bodies.ghosts else (low - 1, 2)

    def order(self) -> NDArray[np.int64]:
        """All bodies in the order of their slots."""
        begin, base = self.tasks.arrays["begin"], self.tasks.arrays["base"]
        body = self.tasks.arrays["body"]
        n = np.diff(begin[: self.here + 1])
        return np.concatenate([body[base[l] : base[l] + n[l]] for l in range(self.here)]).astype(np.int64)

    def _buckets(self, count: NDArray[np.int64], here: int) -> None:
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
        self._room(rows=int(rows[:here, 1].sum()), slots=int(base[here]) + GAP)
        share = begin[here] * np.arange(self.parts + 1) / self.parts
        a = self.tasks.arrays
        cuts = np.searchsorted(begin[: here + 1], share)
        cuts[0], cuts[-1] = 0, here
        a["layers"][:] = cuts
        a["sweeps"][:] = np.minimum(cuts, here - 1)
        a["inner"][:] = np.clip(cuts, 1, here - 1)
