"""What the sweep knows of the nodes: bits of fluid nodes and kinds of vectors, filled from the ids of solids."""

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.domain import block_ranges
from hpcpic.core.tasks.arena import Arena
from hpcpic.core.tasks.graph import Bound, Pool
from lbmdem.kernels.node_kinds import Vectors, classify, look_ahead, mark, renew
from lbmdem.kernels.sweep import AHEAD
from lbmdem.layout import Layout

NO_GRAIN = np.iinfo(np.int32).max  # more than the numbers of all grains


class NodeKinds:
    """The arrays `wet`, `kinds` and `hops` of an arena (fluid.layout says what they hold), by the ids `solid` in it.

    `free` is as `wet`, of the nodes from which the sweep need not bounce anything back; `inside`: bits of the nodes
    that belong to a row.
    """

    def __init__(self, arena: Arena, layout: Layout, pool: Pool) -> None:
        self._arena, self._layout, self._pool = arena, layout, pool
        flat = layout.lattice.dimensions == 2
        columns = layout.nx - layout.lanes * np.arange(layout.vectors)
        arena.set(
            inside=((1 << np.minimum(columns, layout.lanes)) - 1).astype(np.int32),
            free=arena["wet"],
            ghosts=int(not flat),
            flat=flat,
            n=layout.lanes,
            strides=layout.strides,
            bytes_per_element=layout.itemsize,
            ahead=AHEAD,
        )
        arena.group(vectors=Vectors)
        self.grains_are_free = False
        self._bind()

    def _bind(self) -> None:
        def shares(planes: int) -> list[tuple[int, int]]:
            return [share for share in block_ranges(planes, self._pool.threads) if share[1] > share[0]]

        bind, planes = self._arena.bind, self._layout.planes
        marked = [("wet", NO_GRAIN), ("free", 0)][: 1 + self.grains_are_free]
        self._renew: list[Bound] = []
        self._tasks: list[list[Bound]] = [
            [bind(mark, words=words, least=ids, low=a, high=b) for words, ids in marked for a, b in shares(planes + 2)],
            [bind(classify, low=a, high=b) for a, b in shares(planes)],
            [bind(look_ahead, low=a, high=b) for a, b in shares(planes)],
        ]

    @property
    def kinds(self) -> NDArray[np.uint8]:
        """Kind of each vector [plane, row, vector]: see `kernels.sweep`."""
        return self._arena["kinds"]

    def free_grains(self) -> None:
        """From now on the sweep need not bounce anything back from grains."""
        self._arena.set(free=np.zeros_like(self._arena["wet"]))
        self.grains_are_free = True
        self._bind()
        self._bind_renew()

    def _bind_renew(self) -> None:
        self._arena.set(changed=np.zeros(0, np.int64))
        self._renew = [self._arena.bind(renew, same=not self.grains_are_free)]

    def fill(self) -> None:
        """After edits of the ids."""
        for tasks in self._tasks:
            if tasks:
                self._pool.each(tasks)

    def renew(self, changed: NDArray[np.int64]) -> None:
        """After edits of the ids at these flat places alone, ghosts among them."""
        if not self._renew:
            self._bind_renew()
        self._arena.set(changed=changed)
        self._pool.each(self._renew)
