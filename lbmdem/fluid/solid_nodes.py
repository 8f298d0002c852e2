"""Which nodes are solid: grains by their centres and radii on the nodes of one slab, kept up to date as they move.

A node belongs to a grain when its centre is inside; of two grains that claim one node the lower id keeps it. Between
steps only the ends of the runs of nodes along x change (a small part of the nodes), so only these are visited.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hpcpic.core.space.declared import Array
from hpcpic.core.space.domain import Domain
from hpcpic.core.tasks.arena import Arena
from hpcpic.core.tasks.graph import Bound, Graph, Pool
from lbmdem.fluid.arrays import MOVED_NODES
from lbmdem.kernels import grain_rasters as kernels
from lbmdem.kernels.grain_rasters import Before, Images, Lists, Table
from lbmdem.kernels.layout import FLUID

_FAR = 1 << 40
_BLOCKS = 4  # per thread


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


class Window(NamedTuple):
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


@dataclass(frozen=True, slots=True)
class Change:
    """Own nodes (flat places in the padded array) that an update has freed or covered, and by which grain id.

    The next update overwrites them.
    """

    uncovered: NDArray[np.int64]
    left_by: NDArray[np.int32]
    covered: NDArray[np.int64]
    taken_by: NDArray[np.int32]


class Solid:
    """The ids of grains in an int32 array [planes, rows, x] with ghosts (rows left out in 2D), written in place.

    `arena` holds the grains (`table`), their `images`, what has changed, and arrays of those who read these (`more`).
    """

    def __init__(
        self, window: Window, nodes: NDArray[np.int32], pool: Pool, more: tuple[Array, ...] = (), **sizes: int
    ) -> None:
        self.window, self._pool = window, pool
        self.nodes = nodes.reshape(tuple(window.shape[::-1]))
        assert np.shares_memory(self.nodes, nodes)
        self._blocks = blocks = _BLOCKS * pool.threads if pool.threads > 1 else 1
        sizes |= {"grains": 8, "images": 64, "changes": 64, "changed": 64, "blocks": blocks, "block_ends": blocks + 1}
        self.arena = arena = Arena((*MOVED_NODES, *more), **sizes)
        arena.set(solid=self.nodes, window=window)
        arena.group(table=Table, images=Images, before=Before, lists=Lists)
        self._mark, self._update = [arena.bind(kernels.mark)], Graph()
        self._free: list[Bound] = []

    def expect_updates(self) -> None:
        """Make the tasks of updates, each of which compares the images, block by block, with those before."""
        if self._free:
            return
        bind, graph = self.arena.bind, self._update
        graph.task(bind(kernels.find_moved), outs=["moved"])
        for share in range(self._blocks):
            graph.task(bind(kernels.list_changes, share=share), ins=["moved"], outs=[share])
        graph.task(bind(kernels.claim), ins=range(self._blocks))
        graph.freeze()
        self._free = [bind(kernels.free_left_nodes)]

    def rebuild(self, table: Table) -> None:
        """Forget all grains and mark these."""
        self.nodes[self.nodes >= 0] = FLUID
        self._put(table)
        self._pool.each(self._mark)
        if self.arena.reserve(images=int(self.arena["lengths"][kernels.IMAGES])):
            self._pool.each(self._mark)

    def _put(self, table: Table) -> None:
        arena = self.arena
        arena.reserve(grains=len(table.ids))
        for name, values in table._asdict().items():
            arena[name][: len(values)] = values
        arena["lengths"][kernels.GRAINS] = len(table.ids)

    def update(self, table: Table) -> Change:
        """Move the grains that were there to their new places; others come and go. The same nodes as `rebuild`, but
        nodes that become fluid are marked LEFT until `settle`, so that one can tell them from their neighbours."""
        self.expect_updates()
        arena, lengths, full = self.arena, self.arena["lengths"], True
        for name in ("ids", "centres", "radii", "grain", "offset"):
            arena[f"{name}_before"][...] = arena[name]
        lengths[kernels.IMAGES_BEFORE] = lengths[kernels.IMAGES]
        self._put(table)
        while full:
            self._pool.run(self._update)
            images = int(lengths[kernels.IMAGES] + lengths[kernels.IMAGES_BEFORE])
            longest, changed = int(lengths[kernels.LONGEST]), int(lengths[kernels.CHANGED])
            full = arena.reserve(images=images, changes=longest, changed=changed)
        left, taken = lengths[kernels.UNCOVERED], lengths[kernels.COVERED]
        own, own_by = arena["own"], arena["own_by"]
        return Change(own[0, :left], own_by[0, :left], own[1, :taken], own_by[1, :taken])

    def settle(self) -> NDArray[np.int64]:
        """The nodes that the last update freed are fluid from now on. Flat places of all that have changed, of ghosts
        too."""
        self._pool.each(self._free)
        return self.arena["changed"][: self.arena["lengths"][kernels.CHANGED]]
