"""The pages that hold the particles of a rank, the chains of its slots, and the boxes of those under way."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.tasks.arena import Arena


class Pages:
    """Free pages and room in boxes, in the arrays of an arena (see particles.arrays and kernels.storage).

    There is a box and a stack of free pages per block, and a last box for what comes from outside. All of it grows
    between kernels only. Addresses are reserved generously, memory is used when touched.
    """

    def __init__(self, arena: Arena) -> None:
        self.arena = arena
        self.fresh = 0  # pages from this number on were never used
        arena.set(words=arena["moving"].view(np.int32))
        self.drop()

    def room(self, particles: int) -> None:
        """Boxes that can take so many particles each; what is in them is forgotten when they must grow."""
        if self.arena.reserve(box_size=particles):
            self.arena.set(words=self.arena["moving"].view(np.int32))
            self.clear()

    def clear(self) -> None:
        """Empty all boxes."""
        lists = self.arena["lists"]
        lists[:, 0], lists[:, 1] = -1, 0
        self.arena["counters"][:, 1] = 0

    def drop(self) -> None:
        """Forget all particles."""
        self.arena["head"][:], self.arena["count"][:] = -1, 0
        self.arena["counters"][:, 0] = 0
        self.fresh = 0
        self.clear()

    def need(self, pages: Sequence[int]) -> None:
        """At least pages[block] free pages on each block's stack: unused ones of other blocks, new ones, by growth."""
        counters = self.arena["counters"]
        spare = counters[:, 0].tolist()
        for block, wanted in enumerate(pages):
            spare[block] -= wanted
        for block in [block for block, n in enumerate(spare) if n < 0]:
            for other in [other for other, n in enumerate(spare) if n > 0]:
                n = min(spare[other], -spare[block])
                counters[other, 0] -= n
                top = counters[other, 0]
                self._push(block, self.arena["free"][other, top : top + n])
                spare[other], spare[block] = spare[other] - n, spare[block] + n
            if spare[block] < 0:
                n, capacity = -spare[block], self.arena.sizes["pages"]
                if self.fresh + n > capacity:
                    self.arena.reserve(pages=max(self.fresh + n, capacity + capacity // 2) + 64)
                self._push(block, np.arange(self.fresh + n - 1, self.fresh - 1, -1))
                self.fresh += n

    def _push(self, block: int, pages: NDArray) -> None:
        """Put pages on a block's stack of free ones."""
        counters = self.arena["counters"]
        top = counters[block, 0]
        self.arena["free"][block, top : top + len(pages)] = pages
        counters[block, 0] += len(pages)
