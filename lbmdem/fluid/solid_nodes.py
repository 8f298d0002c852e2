"""Which nodes are solid: grains by their centres and radii on the nodes of one slab, kept up to date as they move.

A node belongs to a grain when its centre is inside; of two grains that claim one node the lower id keeps it. Between
steps only the ends of the runs of nodes along x change (a small part of the nodes), so only these are visited.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hpcpic.core.space.domain import Domain
from hpcpic.core.tasks.arena import Arena
from hpcpic.core.tasks.graph import Pool
from lbmdem.fluid.arrays import MOVED_NODES
from lbmdem.kernels import grain_rasters
from lbmdem.kernels.layout import FLUID

_FAR = 1 << 40
_BLOCKS = 4  # per thread
_FEW = 64  # images that cost less than to wake a thread


def kernel_axes(vectors: ArrayLike) -> NDArray[np.float64]:
    """Vectors [n, d] (x, y[, z]) as [n, 3] (x, row, plane): the last axis is the slab axis, rows are 0 in 2D."""
    vectors = np.asarray(vectors, np.float64)
    if vectors.shape[1] == 3:
        return np.ascontiguousarray(vectors)
    return np.column_stack((vectors[:, 0], np.zeros(len(vectors)), vectors[:, 1]))


def kernel_rotation(vectors: ArrayLike) -> NDArray[np.float64]:
    """Angular velocities or torques [n, 1 or 3] in the axes of the kernels [n, 3]: in 2D the row axis is -z."""
    vectors = np.asarray(vectors, np.float64)
    if vectors.shape[1] == 3:
        return np.ascontiguousarray(vectors)
    return np.column_stack((np.zeros(len(vectors)), -vectors[:, 0], np.zeros(len(vectors))))


def several_slabs(domain: Domain) -> bool:
    """True when more than one rank has rows."""
    return sum(high > low for low, high in zip(domain.cuts, domain.cuts[1:])) > 1


@dataclass(frozen=True, slots=True)
class Window:
    """The padded array of one rank on the box: arrays of three in the order (x, row, plane)."""

    origin: NDArray[np.int64]  # node of the box at the first place of the array
    shape: NDArray[np.int64]
    inner: NDArray[np.int64]  # [3, 2] places that are not ghosts
    points: NDArray[np.int64]
    periodic: NDArray[np.bool_]
    whole: bool  # this rank has all planes

    @classmethod
    def of(cls, domain: Domain, rank: int, ghosts: tuple[tuple[int, int], ...]) -> "Window":
        """The rows of a rank with ghosts (below, above) on each axis, in storage order."""
        starts = (domain.cuts[rank], *[0] * (domain.ndim - 1))
        axes = zip(starts, domain.shape(rank), ghosts, domain.points, domain.periodic)
        rows = [(s - g[0], n + g[0] + g[1], g[0], g[0] + n, points, p) for s, n, g, points, p in axes]
        plane, *others = rows
        row, x = others if len(others) == 2 else ((0, 1, 0, 1, 1, False), others[0])
        columns = np.array([x, row, plane], np.int64)
        return cls(
            origin=columns[:, 0].copy(),
            shape=columns[:, 1].copy(),
            inner=columns[:, 2:4].copy(),
            points=columns[:, 4].copy(),
            periodic=columns[:, 5].astype(np.bool_),
            whole=not several_slabs(domain),
        )

    @property
    def box(self) -> NDArray[np.int64]:
        """[3, 2] places [first, last + 1) of the array that are in the box; no limit along periodic axes."""
        ends = np.stack((np.zeros(3, np.int64), self.points), axis=-1) - self.origin[:, None]
        return np.where(self.periodic[:, None], np.array([-_FAR, _FAR]), ends)


class Table(NamedTuple):
    """Grains in the order of ids: centres[n, 3], motion[n, 6] (velocity, angular velocity) in the axes of kernels."""

    ids: NDArray[np.int64]
    centres: NDArray[np.float64]
    radii: NDArray[np.float64]
    motion: NDArray[np.float64]


class Images(NamedTuple):
    """Grains as they are seen in a window: row of the grain, and what to add to its nodes to get local ones."""

    grain: NDArray[np.int64]
    offset: NDArray[np.int64]  # [m, 3]


def find_images(window: Window, table: Table) -> Images:
    """Images of grains within a node of the window, in the order of the grains."""
    place = (table.centres, table.radii, 1.0, window.origin, window.shape, window.points, window.periodic)
    grain, offset = np.empty(len(table.radii), np.int64), np.empty((len(table.radii), 3), np.int64)
    count = grain_rasters.images(*place, grain, offset)
    if count > len(grain):
        grain, offset = np.empty(count, np.int64), np.empty((count, 3), np.int64)
        grain_rasters.images(*place, grain, offset)
    return Images(grain[:count], offset[:count])


@dataclass(slots=True)
class Change:
    """Own nodes (flat places in the padded array) that an update has freed or covered, and by which grain id."""

    uncovered: NDArray[np.int64]
    left_by: NDArray[np.int32]
    covered: NDArray[np.int64]
    taken_by: NDArray[np.int32]


class Solid:
    """The ids of grains in an int32 array [planes, rows, x] with ghosts (rows left out in 2D), written in place."""

    def __init__(self, window: Window, nodes: NDArray[np.int32], pool: Pool) -> None:
        self.window, self._pool = window, pool
        self.nodes = nodes.reshape(tuple(window.shape[::-1]))
        assert np.shares_memory(self.nodes, nodes)
        blocks = _BLOCKS * pool.threads if pool.threads > 1 else 1
        self._arena = arena = Arena(MOVED_NODES, images=64, changes=64, blocks=blocks, block_ends=blocks + 1)
        arena.set(solid=self.nodes, points=window.points, periodic=window.periodic, inner=window.inner)
        self._tasks = [arena.bind(grain_rasters.list_changes, share=share) for share in range(blocks)]
        self._suspects = np.empty(0, np.int64)
        self._changed = np.empty(0, np.int64)

    def rebuild(self, table: Table) -> Images:
        """Forget all grains and mark these."""
        self.nodes[self.nodes >= 0] = FLUID
        self._table, self.images = table, find_images(self.window, table)
        lost = np.zeros(len(table.ids), np.bool_)
        self._mark(self.images, lost)
        self._suspects = table.ids[lost]
        return self.images

    def _mark(self, images: Images, lost: NDArray[np.bool_]) -> None:
        self._arena.call(grain_rasters.mark, **self._table._asdict(), **images._asdict(), lost=lost)

    def update(self, table: Table) -> Change:
        """Move the grains that were there to their new places; others come and go. The same nodes as `rebuild`, but
        nodes that become fluid are marked LEFT until `settle`, so that one can tell them from their neighbours."""
        arena, counts, was = self._arena, self._arena["counts"], self.images
        self.images = find_images(self.window, table)
        arena.reserve(images=len(was.grain) + len(self.images.grain))
        now = {"table": table, "images": self.images}
        moved = arena.call(grain_rasters.moved_images, old=self._table, old_images=was, **now)
        blocks = len(self._tasks) if moved > _FEW else 1
        counts[:, 0] = np.minimum(np.arange(len(counts)) * moved // blocks, moved)
        counts[:, 1:] = 0
        self._pool.each(self._tasks[:blocks])
        if arena.reserve(changes=int(counts[:, 1:].max())):  # start again
            self.images = was
            return self.update(table)
        self._table = table
        self._claim()
        return self._joined()

    def _claim(self) -> None:
        """Nodes go to the grains that have come to them, or have wanted them before."""
        ids, images = self._table.ids, self.images
        lost = np.zeros(len(ids), np.bool_)
        self._arena.call(grain_rasters.claim, ids=ids, lost=lost)
        if len(self._suspects):
            again = np.isin(ids[images.grain], self._suspects)
            self._mark(Images(images.grain[again], images.offset[again]), lost)
        self._suspects = ids[lost]

    def _joined(self) -> Change:
        """The lists of all blocks as one."""
        number = int(self._arena["counts"][:, 1:].sum())
        nodes, own, by = np.empty(number, np.int64), np.empty((2, number), np.int64), np.empty((2, number), np.int32)
        changed, left, taken = self._arena.call(grain_rasters.join_lists, nodes=nodes, own=own, own_by=by)
        self._changed = nodes[:changed]
        return Change(own[0, :left], by[0, :left], own[1, :taken], by[1, :taken])

    def settle(self) -> NDArray[np.int64]:
        """The nodes that the last update freed are fluid from now on. Flat places of all that have changed, of ghosts
        too."""
        grain_rasters.free_left_nodes(self.nodes, self._changed)
        return self._changed
