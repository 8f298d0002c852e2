"""Which nodes are solid: grains by their centres and radii on the nodes of one slab, kept up to date as they move.

A node belongs to a grain when its centre is inside; of two grains that claim one node the lower id keeps it. Between
steps only the ends of the runs of nodes along x change (a small part of the nodes), so only these are visited.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hpcpic.core.space.domain import Domain
from lbmdem.kernels import runs
from lbmdem.kernels.layout import FLUID

_FAR = 1 << 40
_NOWHERE = 1e9  # nodes; a place that is never near


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


@dataclass(frozen=True, slots=True)
class Window:
    """The padded array of one rank on the box: arrays of three in the order (x, row, plane)."""

    origin: NDArray[np.int64]  # node of the box at the first place of the array
    shape: NDArray[np.int64]
    inner: NDArray[np.int64]  # [3, 2] places that are not ghosts
    points: NDArray[np.int64]
    periodic: NDArray[np.bool_]

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
        )


    @property
    def box(self) -> NDArray[np.int64]:
        """[3, 2] places [first, last + 1) of the array that are in the box; no limit along periodic axes."""
        ends = np.stack((np.zeros(3, np.int64), self.points), axis=-1) - self.origin[:, None]
        return np.where(self.periodic[:, None], np.array([-_FAR, _FAR]), ends)


@dataclass(slots=True)
class Images:
    """Grains as they are seen in a window: row of the grain, and what to add to its nodes to get local ones."""

    grain: NDArray[np.int64]
    offset: NDArray[np.int64]  # [m, 3]


def find_images(window: Window, centres: NDArray, radii: NDArray, margin: float) -> Images:
    """Images of grains [n, 3] within `margin` nodes of the window, in the order of the grains."""
    place = (window.origin, window.shape, window.points, window.periodic)
    grain, offset = np.empty(len(radii), np.int64), np.empty((len(radii), 3), np.int64)
    count = runs.images(centres, radii, margin, *place, grain, offset)
    if count > len(grain):
        grain, offset = np.empty(count, np.int64), np.empty((count, 3), np.int64)
        runs.images(centres, radii, margin, *place, grain, offset)
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

    def __init__(self, window: Window, nodes: NDArray[np.int32]) -> None:
        self.window = window
        self.nodes = nodes.reshape(tuple(window.shape[::-1]))
        assert np.shares_memory(self.nodes, nodes)
        self._ids = np.empty(0, np.int64)
        self._centres, self._radii = np.empty((0, 3)), np.empty(0)
        self._suspects = np.empty(0, np.int64)
        self._unsettled = np.empty(0, np.int64)
        self._room = 64

    def rebuild(self, ids: NDArray[np.int64], centres: NDArray[np.float64], radii: NDArray[np.float64]) -> None:
        """Forget all grains and mark these: ids ascending, centres[n, d] and radii in nodes."""
        self.nodes[self.nodes >= 0] = FLUID
        centres = kernel_axes(centres)
        images = find_images(self.window, centres, radii, 0.0)
        lost = np.zeros(len(ids), np.bool_)
        planes = 0, self.nodes.shape[0]
        runs.mark(self.nodes, centres, radii, ids, images.grain, images.offset, *planes, lost)
        self._remember(ids, centres, radii, lost)

    def update(self, ids: NDArray[np.int64], centres: NDArray[np.float64], radii: NDArray[np.float64]) -> Change:
        """Move the grains that were there to their new places; others come and go. The same nodes as `rebuild`, but
        nodes that become fluid are marked LEFT until `settle`, so that one can tell them from their neighbours."""
        before = (self._ids, self._centres[:, _physical(centres)], self._radii)
        while True:
            change = self._try_update(ids, kernel_axes(centres), radii)
            if change is not None:
                return change
            self.rebuild(*before)
            self._room *= 4

    def _try_update(self, ids: NDArray, centres: NDArray, radii: NDArray) -> Change | None:
        """None when the lists have no room: then the nodes are in between."""
        nodes, ranks = np.empty((2, self._room), np.int64), np.empty((2, self._room), np.int32)
        planes = 0, self.nodes.shape[0]
        here, old = (self._centres, self._radii, self._ids), find_images(self.window, self._centres, self._radii, 0.0)
        there, new = (centres, radii, ids), find_images(self.window, centres, radii, 0.0)
        went = self._elsewhere(old, self._ids, self._centres, ids, centres)
        n_left = runs.leave(self.nodes, *here, old.grain, old.offset, *went, *planes, nodes[0], ranks[0])
        came = self._elsewhere(new, ids, centres, self._ids, self._centres)
        lost = np.zeros(len(ids), np.bool_)
        n_taken = runs.enter(self.nodes, *there, new.grain, new.offset, *came, *planes, nodes[1], ranks[1], lost)
        if max(n_left, n_taken) > self._room:
            self.nodes[self.nodes == runs.LEFT] = FLUID
            return None
        again = np.isin(ids[new.grain], self._suspects)
        runs.mark(self.nodes, *there, new.grain[again], new.offset[again], *planes, lost)
        self._remember(ids, centres, radii, lost)
        kept = runs.keep(self.nodes, runs.LEFT, nodes[0, :n_left], ranks[0, :n_left])
        self._unsettled = nodes[0, :kept]
        taken = runs.keep_inner(self.nodes, nodes[1, :n_taken], ranks[1, :n_taken], self.window.inner)
        free, by = self._unsettled.copy(), ranks[0, :kept].copy()
        own = runs.keep_inner(self.nodes, free, by, self.window.inner)
        return Change(free[:own], by[:own], nodes[1, :taken], ranks[1, :taken])

    def settle(self) -> None:
        """The nodes that the last update freed are fluid from now on."""
        self.nodes.reshape(-1)[self._unsettled] = FLUID

    def _remember(self, ids: NDArray, centres: NDArray, radii: NDArray, lost: NDArray) -> None:
        self._ids, self._centres, self._radii = ids.copy(), centres.copy(), radii.copy()
        self._suspects = ids[lost]

    def _elsewhere(
        self, images: Images, ids: NDArray, centres: NDArray, other_ids: NDArray, others: NDArray
    ) -> tuple[NDArray, NDArray]:
        """Where the grain of each image is in another list: centre[m, 3] and offset[m, 3] of the nearest image."""
        wanted = ids[images.grain]
        at = np.searchsorted(other_ids, wanted)
        at[at == len(other_ids)] = 0
        found = other_ids[at] == wanted if len(other_ids) else np.zeros(len(wanted), np.bool_)
        place, offset = np.full((len(wanted), 3), _NOWHERE), images.offset.copy()
        place[found] = others[at[found]]
        turns = np.rint((centres[images.grain[found]] - place[found]) / self.window.points).astype(np.int64)
        offset[found] += np.where(self.window.periodic, turns * self.window.points, 0)
        return place, offset


def _physical(vectors: NDArray) -> list[int]:
    """Columns of (x, row, plane) that make (x, y[, z])."""
    return [0, 1, 2] if vectors.shape[1] == 3 else [0, 2]
