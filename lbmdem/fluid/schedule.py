"""Task graphs of a fluid: one step, and several steps per pass over memory (wavefront)."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.domain import block_ranges
from hpcpic.core.tasks.graph import Bound, Graph
from lbmdem.fluid.exchange import Exchange
from lbmdem.fluid.sparse import SparseExchange, SparseLayout
from lbmdem.fluid.temporal_blocking import Span, Steps, gap, order, row_tiles, row_width, sheet, wrapped
from lbmdem.fluid.temporal_blocking import blocks as blocks_of
from lbmdem.kernels.layout import Layout

Sweep = Callable[[NDArray[np.int64]], Bound]
After = Callable[[int, int, int, bool], list[Bound]]
"""Tasks on the arrivals at a parity of planes from, to: links and faces; do links keep what went out and came back?"""
Links = Callable[[int, int, int], Bound]
"""The task on the links that start in planes from, to, for arrivals at a parity."""
ENDS = [("end", 0), ("end", 1)]
LINKED = 9e6  # bytes of planes that are swept before links, which then find them in caches; more than REACH planes
REACH = 2  # planes to both sides of which links read something: the quadratic rule does


class Passes:
    """Makes the graphs of one slab; sweep(tiles) is the kernel's task."""

    def __init__(
        self,
        layout: Layout | SparseLayout,
        exchange: Exchange | SparseExchange,
        sweep: Sweep,
        threads: int,
        periodic_rows: bool,
    ) -> None:
        self._layout, self._exchange, self._sweep = layout, exchange, sweep
        self._threads, self._periodic_rows = threads, periodic_rows

    def step(self, parity: int, n_blocks: int, links: Links | None = None) -> Graph:
        """Edge planes, messages, inner planes while these are on their way, what arrived; links while their planes are
        in caches."""
        graph, planes = Graph(), self._layout.planes
        low, high = 0, planes
        if links and (together := int(LINKED / self._layout.plane_bytes)) > REACH:
            n_blocks = max(n_blocks, planes // together)
        if any(self._exchange.open):
            self._ends(graph, parity, sorted({(k, k + 1) for k in (0, planes - 1)}))
            low, high = 1, planes - 1
        blocks = [(low + a, low + b) for a, b in block_ranges(max(high - low, 0), n_blocks) if b > a]
        for a, b in blocks:
            graph.task(self._planes(parity, a, b), inouts=[("plane", p) for p in range(a, b)], name=f"planes {a}..{b}")
        if links and planes:
            self._links(graph, 1 - parity, links, [b for _, b in blocks])
        return graph.freeze()

    def _links(self, graph: Graph, parity: int, links: Links, swept: list[int]) -> None:
        """Tasks on the links of all planes, as soon as each block up to `swept` is swept; those around both ends for
        themselves.
        """
        planes = self._layout.planes
        inner = {end - REACH for end in swept if end - REACH > REACH} if len(swept) > 1 else set()
        for a, b in pairwise(sorted({0, *inner, planes} | ({REACH} if inner else set()))):
            beside = {("plane", p % planes) for p in range(a - REACH, b + REACH)}
            at_ends = ENDS if a <= REACH or b >= planes - REACH else []
            graph.task(links(parity, a, b), ins=[*beside, *at_ends], priority=1, name=f"links {a}..{b}")

    def _planes(self, modes: int, low: int, high: int) -> Bound:
        return self._sweep(np.array([[modes, low, high, 0, self._layout.rows]], np.int64))

    def _ends(self, graph: Graph, parity: int, ends: list[tuple[int, int]], flags: int = 0) -> None:
        """A step of planes at the ends of the slab, and what crosses these."""
        for handle, (low, high) in zip(ENDS, ends):
            task = self._planes(parity | flags, low, high)
            graph.task(task, inouts=[handle], priority=1, name=f"planes {low}..{high}")
        graph.message(self._exchange.messages[parity].messages, inouts=ENDS, name="populations")
        for bound in self._exchange.unpacks[parity]:
            graph.task(bound, inouts=ENDS, priority=1)

    def wave(self, steps: Steps, after: After) -> Graph:
        """Blocks, then the gaps between them, and step by step what is around the ends of the slab."""
        graph, layout = Graph(), self._layout
        if not layout.planes:
            return graph.freeze()
        below, above = self._exchange.open
        wraps = layout.stored == layout.planes  # the last block's neighbour is the first
        pieces = blocks_of(layout.planes, self._threads, wraps or below, wraps or above)
        for k, piece in enumerate(pieces):
            ends = [ENDS[0]] * (k == 0) + [ENDS[1]] * (k == len(pieces) - 1)
            self._piece(graph, piece, steps, after, [], [("block", k), *ends])
        for k, piece in enumerate(pieces):
            if k < len(pieces) - 1 or wraps:
                blocks = [("block", k), ("block", (k + 1) % len(pieces))]
                self._piece(graph, gap(piece.high), steps, after, blocks, [("gap", k)])
        if any(self._exchange.open):
            self._ends_of_wave(graph, steps, after)
        return graph.freeze()

    def _ends_of_wave(self, graph: Graph, steps: Steps, after: After) -> None:
        """What is around the ends that other ranks share."""
        planes, (below, above) = self._layout.planes, self._exchange.open
        for width, (t, swept) in enumerate(steps.operations):
            ends = [(0, width)] * bool(below and width) + [(planes - width, planes)] * bool(above and width)
            if swept:
                self._ends(graph, steps.parity_at(t), ends, steps.flags[t])
                continue
            for low, high in ends:
                for bound in after(steps.parity_at(t + 1), low, high, steps.keeps(t)):
                    graph.task(bound, inouts=ENDS, priority=1)

    def _piece(self, graph: Graph, planes: Span, steps: Steps, after: After, ins: list, chain: list) -> None:
        """The steps of a piece, one task after the other; one task in all when nothing comes between its sweeps."""
        layout = self._layout
        whole = steps.after or layout.whole_planes
        width = layout.rows
        if isinstance(layout, Layout) and not whole:
            width = row_width(layout, self._threads, steps.depth)
        rows = row_tiles(layout.rows, self._periodic_rows, width, steps.depth)
        waiting: list[tuple[int, ...]] = []

        def sweep() -> None:
            if waiting:
                name = f"wave {planes.low}..{planes.high}"
                graph.task(self._sweep(np.array(waiting, np.int64)), ins=ins, inouts=chain, name=name)
                waiting.clear()

        for row in rows:
            for t, swept, low, high in order(planes, steps.operations, sheet(layout)):
                ranges = wrapped((low, high), layout.planes)
                if swept:
                    modes, parts = steps.parity_at(t) | steps.flags[t], wrapped(row.at(t), layout.rows)
                    waiting += [(modes, *range_, *part) for range_ in ranges for part in parts]
                    continue
                for bound in (b for r in ranges for b in after(steps.parity_at(t + 1), *r, steps.keeps(t))):
                    sweep()
                    graph.task(bound, ins=ins, inouts=chain)
        sweep()
