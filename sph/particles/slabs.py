"""The grid of cells over the domain: layers across the first storage axis, rows of cells in them; and which rank owns
which layers: cuts are made again where one has much more to do than the others.
"""

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.world import World
from hpcpic.core.space.domain import Domain, better_cuts, even_cuts
from sph.kernels.cells import FINE
from sph.setup.scene import Scene

PADS = 2  # layers and rows outside the domain, for walls and images
IMAGES_REACH = 4  # layers from a body to where its image, but for a period, is looked for; with one to spare


class CellGrid:
    """Layers and rows of thickness `edge` m over the domain, with PADS more on each side.

    scale[d]: layers, rows and fine cells per m; edges: what kernels.runs.find is told of them.
    """

    def __init__(self, scene: Scene, edge: float) -> None:
        lengths = (scene.high - scene.low)[list(scene.axes)]
        self.edge = edge
        self.layers, self.rows = (int(np.ceil(length / edge)) + 2 * PADS for length in lengths[:2])
        if len(lengths) == 2:
            self.rows = 1
        self.scale = np.full(len(lengths), 1.0 / edge)
        self.scale[-1] *= FINE
        self.edges = np.array([edge, edge, edge / FINE, PADS, 0.0])

    def layer(self, x: NDArray[np.float64]) -> NDArray[np.int64]:
        """Layer of positions along the first storage axis, m, as the kernels find it."""
        at = np.floor(x * self.scale[0]) + PADS
        return np.clip(at, 0, self.layers - 1).astype(np.int64)


class Slabs:
    """owner[layer]: rank; peers: the other ranks that a body of this one, or an image of it, may be a ghost of, and the
    other way round; spans[k] = (first layer, the one behind the last) of this rank and then of its peers.
    """

    def __init__(self, scene: Scene, grid: CellGrid, world: World) -> None:
        self.grid, self.world = grid, world
        lengths, periodic = (scene.high - scene.low)[list(scene.axes)], scene.periodic[list(scene.axes)]
        points = (grid.layers, *np.ceil(lengths[1:] / grid.edge).astype(int).tolist())
        self.around = bool(periodic[0])  # one end of the domain lies beside the other
        cuts = even_cuts(grid.layers, world.size)
        self.cut(Domain(tuple(lengths), points, tuple(map(bool, periodic)), cuts))

    def cut(self, domain: Domain) -> None:
        """Give the layers to the ranks as the cuts of `domain` say."""
        layers, me = domain.points[0], self.world.rank
        self.domain, self.peers = domain, list[int]()
        self.low, self.high = domain.row_range(me)  # first own layer, and the one behind the last
        self.owner: NDArray[np.int64] = np.broadcast_to(0, layers)  # many in a large tank: without a list for one rank
        if self.world.size > 1:
            self.owner = np.asarray(domain.owner(np.arange(layers)))
            if self.low < self.high:
                self.peers = self._near(self.low, self.high - 1, me)
        self.spans = np.array([domain.row_range(rank) for rank in (me, *self.peers)])

    def _near(self, first: int, last: int, me: int) -> list[int]:
        near = self.owner[max(first - IMAGES_REACH, 0) : last + IMAGES_REACH + 1]
        if self.around:
            ends = self.owner[: IMAGES_REACH + PADS], self.owner[-IMAGES_REACH - PADS :]
            for here, there in (ends, ends[::-1]):
                if me in here:
                    near = np.concatenate([near, there])
        return [int(peer) for peer in np.unique(near) if peer != me]

    def balance(self, costs: NDArray[np.int64]) -> bool:
        """Make cuts of equal cost if the present ones are far from it: costs[layer] of the own particles. True if they
        are new. Collective.
        """
        cuts = better_cuts(self.world.sum_int(costs), self.domain.cuts)
        if cuts:
            self.cut(self.domain.with_cuts(cuts))
        return bool(cuts)
