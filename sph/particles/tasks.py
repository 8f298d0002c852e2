"""Launches of kernels on the particles of a rank: a task for every part of them."""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.declared import Array
from hpcpic.core.tasks.arena import Arena
from hpcpic.core.tasks.graph import Graph, Pool
from sph.setup.scene import Scene

FIRST_SLOTS = 1024
PARTICLES_PER_PART = 24_000  # of a launch: odd layers of a part find in the cache what its even ones have left there
PARTS_PER_THREAD = 4, 16  # at least and at most
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
        self.pool.run(self._graph(self._each, kernel, more))

    def alternate(self, kernel: Callable, **more: Any) -> None:
        """Run the kernel for every part with odd = 0, and with odd = 1 once that part and the next one are through: at
        once, while what both read is in the cache.
        """
        self.pool.run(self._graph(self._alternate, kernel, more))

    def permute(self, gather: Callable, put_back: Callable, n: int, **more: Any) -> None:
        """For lines k = 0 .. n - 1 run `gather` for every part, and `put_back` for a part once all have gathered."""

        def make(kernels: tuple[Callable, Callable], more: dict[str, Any]) -> Graph:
            graph, parts = Graph(), range(self.parts)
            for k in range(n):
                there, back = (self.arena.bind(kernel, self.parts, k=k, **more) for kernel in kernels)
                for part in parts:
                    graph.task(there, part=part, ins=[(k, other) for other in parts], outs=[part])
                for part in parts:
                    graph.task(back, part=part, ins=[part], outs=[(k, part)])
            return graph

        self.pool.run(self._graph(make, (gather, put_back), more))

    def foresee(self, *kernels: Callable, odd: bool = False, **more: Any) -> None:
        """Make the graphs of `each`, or of `alternate`, so that other processes compile these kernels meanwhile."""
        for kernel in kernels:
            self._graph(self._alternate if odd else self._each, kernel, more)

    def _graph(self, make: Callable[..., Graph], kernel: Any, more: dict[str, Any]) -> Graph:
        key = (kernel, *more.items())
        if key not in self._graphs:
            self._graphs[key] = make(kernel, more).freeze()
        return self._graphs[key]

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


def arena_of(scene: Scene, declared: Iterable[Array], parts: int, **more: Any) -> Arena:
    """The arrays of a rank, nearly empty, with what kernels read of the scene: `external` acceleration [d] m/s2 and
    `period` [d] m, 0 where there is none, in storage axes; and `more` of its values.
    """
    axes, sizes = list(scene.axes), {"slots": FIRST_SLOTS, "layers": 0, "rows": 0, "cells": 0}
    arena = Arena(declared, **sizes, parts=parts, ends=parts + 1, walls=len(scene.walls))
    period = np.where(scene.periodic, scene.high - scene.low, 0.0)[axes]
    arena.set(external=np.ascontiguousarray(scene.acceleration[axes]), period=period, **more)
    return arena


def parts_of(n: int, threads: int) -> int:
    """How many parts a launch on n particles has."""
    return threads * min(max(n // (PARTICLES_PER_PART * threads), PARTS_PER_THREAD[0]), PARTS_PER_THREAD[1])


def equal_parts(n: int, parts: int) -> NDArray[np.int64]:
    """parts + 1 bounds of n slots, in whole cache lines."""
    return np.arange(parts + 1) * (-(-n // SLOTS_PER_LINE)) // parts * SLOTS_PER_LINE
