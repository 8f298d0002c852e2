"""Which nodes are solid: grains by their centres and radii on the nodes of one slab, kept up to date as they move.

A node belongs to a grain when its centre is inside; of two grains that claim one node the lower id keeps it. Between
steps only the ends of the runs of nodes along x change (a small part of the nodes), so only these are visited.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hpcpic.core.space.domain import Domain
from lbmdem.kernels import runs
from lbmdem.kernels.layout import FLUID

_FAR = 1 << 40


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
    """Whether more than one rank has rows."""
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
    count = runs.images(*place, grain, offset)
    if count > len(grain):
        grain, offset = np.empty(count, np.int64), np.empty((count, 3), np.int64)
        runs.images(*place, grain, offset)
    return Images(grain[:count], offset[:count])


@dataclass(slots=True)
class Change:
    """Own nodes (flat places in the padded array) that an update has freed or covered, and by which grain id.

    Views, which the next update overwrites.
    """

    uncovered: NDArray[np.int64]
    left_by: NDArray[np.int32]
    covered: NDArray[np.int64]
    taken_by: NDArray[np.int32]


class Solid:
    """The ids of grains in an int32 array [planes, rows, x] with ghosts (rows left out in 2D), written in place."""

    def __init__(self, window: Window, nodes: NDArray[np.int32]) -> None:
        self.window = window
        self.nodes = nodes.reshape(tuple(window.shape[::-1]))
        assert np.shares_memory(self.nodes, nodes)
        self._planes = (0, int(window.shape[2]))
        self._suspects = np.empty(0, np.int64)
        self._lists = np.empty((2, 64), np.int64), np.empty((2, 64), np.int32)
        self._left = self._taken = self._lists[0][0, :0]

    def rebuild(self, table: Table) -> Images:
        """Forget all grains and mark these."""
        self.nodes[self.nodes >= 0] = FLUID
        self._table, self.images = table, find_images(self.window, table)
        lost = np.zeros(len(table.ids), np.bool_)
        runs.mark(self.nodes, table.centres, table.radii, table.ids, *self.images, *self._planes, lost)
        self._suspects = table.ids[lost]
        return self.images

    def update(self, table: Table) -> Change:
        """Move the grains that were there to their new places; others come and go. The same nodes as `rebuild`, but
        nodes that become fluid are marked LEFT until `settle`, so that one can tell them from their neighbours."""
        before, suspects = self._table, self._suspects
        while True:
            change = self._try_update(table)
            if change is not None:
                return change
            self._lists = tuple(np.empty((2, 4 * part.shape[1]), part.dtype) for part in self._lists)
            self.rebuild(before)
            assert np.array_equal(self._suspects, suspects)

    def _try_update(self, table: Table) -> Change | None:
        """None when the lists have no room: then the nodes are in between."""
        (left, taken), (left_by, taken_by) = self._lists
        old, was = self._table, self.images
        new, now = table, find_images(self.window, table)
        went = self._elsewhere(old, was, new)
        lost = np.zeros(len(new.ids), np.bool_)
        here = (self.nodes, old.centres, old.radii, old.ids, *was)
        n_left = runs.change(*here, *went, *self._planes, False, left, left_by, lost)
        came = self._elsewhere(new, now, old)
        there = (self.nodes, new.centres, new.radii, new.ids)
        n_taken = runs.change(*there, *now, *came, *self._planes, True, taken, taken_by, lost)
        if max(n_left, n_taken) > len(left):
            self.nodes[self.nodes == runs.LEFT] = FLUID
            return None
        if len(self._suspects):
            again = np.isin(new.ids[now.grain], self._suspects)
            runs.mark(*there, now.grain[again], now.offset[again], *self._planes, lost)
        self._table, self.images, self._suspects = table, now, new.ids[lost]
        n_left = runs.keep(self.nodes, runs.LEFT, left[:n_left], left_by[:n_left])
        self._left, self._taken = left[:n_left].copy(), taken[:n_taken].copy()
        inner = self.window.inner
        n_left = runs.keep_inner(self.nodes, left[:n_left], left_by[:n_left], inner)
        n_taken = runs.keep_inner(self.nodes, taken[:n_taken], taken_by[:n_taken], inner)
        return Change(left[:n_left], left_by[:n_left], taken[:n_taken], taken_by[:n_taken])

    def settle(self) -> NDArray[np.int64]:
        """The nodes that the last update freed are fluid from now on. Flat places of all that have changed, of ghosts
        too."""
        self.nodes.reshape(-1)[self._left] = FLUID
        return np.concatenate((self._left, self._taken))

    def _elsewhere(self, table: Table, images: Images, other: Table) -> tuple[NDArray, NDArray]:
        """Where the grain of each image is in another table: centre[m, 3] and offset[m, 3] of the nearest image."""
        place, offset = np.empty((len(images.grain), 3)), np.empty((len(images.grain), 3), np.int64)
        grains = (table.centres, table.ids, *images, other.centres, other.ids)
        runs.elsewhere(*grains, self.window.points, self.window.periodic, place, offset)
        return place, offset
