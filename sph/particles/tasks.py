"""Launches of kernels on the particles of a rank: a task for every part of them."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.tasks.arena import Arena
from hpcpic.core.tasks.graph import Graph, Pool

SLOTS_PER_LINE = 16  # int32 in a cache line, which only one part of a task writes


class Tasks:
    """Kernels run by the pool, their arguments found in the arena by name. The first one is the number of the part.

    A graph is made when a kernel is first run, and told by the arena where arrays are that have grown.
    """

    def __init__(self, pool: Pool, arena: Arena) -> None:
        self.pool, self.arena, self.parts = pool, arena, arena.sizes["parts"]
        self._graphs: dict[Any, Graph] = {}

    def each(self, kernel: Callable, **more: Any) -> None:
        """Run the kernel for every part. `more`: arguments that are numbers, or names of others of the arena."""
        self._run(self._each, kernel, more)

    def alternate(self, kernel: Callable, **more: Any) -> None:
        """Run the kernel for every part with odd = 0, and with odd = 1 once that part and the next one are through: at
        once, while what both read is in the cache.
        """
        self._run(self._alternate, kernel, more)

    def _run(self, make: Callable[..., Graph], kernel: Callable, more: dict[str, Any]) -> None:
        key = (kernel, *more.items())
        if key not in self._graphs:
            self._graphs[key] = make(kernel, more).freeze()
        self.pool.run(self._graphs[key])

    def _each(self, kernel: Callable, more: dict[str, Any]) -> Graph:
        graph, bound = Graph(), self.arena.bind(kernel, self.parts, **more)
        for part in range(self.parts):
            graph.task(bound, part=part)
        return graph

    def _alternate(self, kernel: Callable, more: dict[str, Any]) -> Graph:
        graph = Graph()
        even, odd = (self.arena.bind(kernel, self.parts, odd=odd, **more) for odd in (0, 1))
        for part in range(self.parts):
            graph.task(even, part=part, outs=[part])
        for part in range(self.parts):
            graph.task(odd, part=part, ins=[part, part + 1], priority=1)
        return graph


def equal_parts(n: int, parts: int) -> NDArray[np.int64]:
    """parts + 1 bounds of n slots, in whole cache lines."""
    return np.arange(parts + 1) * (-(-n // SLOTS_PER_LINE)) // parts * SLOTS_PER_LINE
