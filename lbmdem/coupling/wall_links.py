"""Links of obstacles in scenes with grains that move: these cover nodes of the links, and leave them again."""

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.domain import block_ranges
from hpcpic.core.tasks.arena import Arena
from hpcpic.core.tasks.graph import Pool
from lbmdem.fluid.surfaces import NODES, Crossings, Surfaces
from lbmdem.kernels import links as kernels
from lbmdem.kernels.layout import WALL
from lbmdem.sizes import GAINS


class WallLinks:
    """Links of a slab to walls; `run` after the sweep looks at the grains in `solid`.

    arena: that of `Solid`, after `moving_links.set_up_links`; arm: as of Crossings.
    """

    def __init__(self, arena: Arena, surfaces: Surfaces, blocks: int) -> None:
        found = _crossings_of_free_nodes(surfaces)
        self.arm, self.count = found.arm, len(found.way)
        shares = [share for share in block_ranges(self.count, blocks) if share[1] > share[0]]
        self.counters = np.zeros((len(shares), 3), np.int64)
        self._sums = np.zeros((len(shares), len(surfaces.bodies), GAINS), np.int64)
        links = found._replace(local=found.local + surfaces.window.inner[:, 0])
        shared = zip(shares, self.counters, self._sums)
        parts = [{"low": a, "high": b, "counters": counters, "sums": sums} for (a, b), counters, sums in shared]
        self._tasks = [
            [arena.bind(kernels.links_beside_grains, parity=parity, links=links, **part) for part in parts]
            for parity in range(2)
        ]

    def run(self, pool: Pool, parity: int) -> NDArray[np.int64]:
        """Bounce back; force, torque and mass that the fluid gains, [walls, 7] in units of 1 / scale[7]."""
        self.counters[...], self._sums[...] = 0, 0
        if self._tasks[parity]:
            pool.each(self._tasks[parity])
        return self._sums.sum(axis=0)


def _crossings_of_free_nodes(surfaces: Surfaces) -> Crossings:
    """Crossings from all nodes of the slab that are in no wall, whatever grains have them now."""
    inner = tuple(slice(*surfaces.window.inner[axis]) for axis in (2, 1, 0))
    free = surfaces.solid[inner] != WALL
    step = max(1, NODES // max(1, free[:1].size))
    parts = []
    for low in range(0, max(1, len(free)), step):
        nodes = np.argwhere(free[low : low + step])[:, ::-1] + np.array([0, 0, low])
        parts.append(surfaces.crossings(nodes))
    return Crossings(*(np.ascontiguousarray(np.concatenate(column)) for column in zip(*parts)))
