"""Task graphs of a fluid: one step, and several steps per pass over memory (wavefront)."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.domain import block_ranges
from hpcpic.core.tasks import Bound, Graph
from lbmdem import wavefront
from lbmdem.exchange import Exchange
from lbmdem.kernels.layout import Layout
from lbmdem.sparse import SparseExchange, SparseLayout
from lbmdem.wavefront import Span

Sweep = Callable[[NDArray[np.int64]], Bound]
After = Callable[[int, int, int], list[Bound]]
"""Tasks on the arrivals at a parity of planes from, to: links and faces."""
Flags = list[int]
"""What the sweep is told besides the parity at each step of a pass (kernels.sparse)."""
ENDS = [("end", 0), ("end", 1)]


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

    def step(self, parity: int, n_blocks: int, flags: int = 0) -> Graph:
        """Edge planes, messages, inner planes while these are on their way, what arrived."""
        graph, planes = Graph(), self._layout.planes
        low, high = 0, planes
        if any(self._exchange.open):
            self._ends(graph, parity, sorted({(k, k + 1) for k in (0, planes - 1)}), flags)
            low, high = 1, planes - 1
        for first, last in block_ranges(max(high - low, 0), n_blocks):
            if last > first:
                a, b = low + first, low + last
                graph.task(self._planes(parity | flags, a, b), name=f"planes {a}..{b}")
        return graph.freeze()

    def _planes(self, modes: int, low: int, high: int) -> Bound:
        return self._sweep(np.array([[modes, low, high, 0, self._layout.rows]], np.int64))

    def _ends(self, graph: Graph, parity: int, ends: list[tuple[int, int]], flags: int) -> None:
        """A step of planes at the ends of the slab, and what crosses these."""
        for handle, (low, high) in zip(ENDS, ends):
            task = self._planes(parity | flags, low, high)
            graph.task(task, inouts=[handle], priority=1, name=f"planes {low}..{high}")
        graph.message(self._exchange.messages[parity].requests, inouts=ENDS, name="populations")
        for bound in self._exchange.unpacks[parity]:
            graph.task(bound, inouts=ENDS, priority=1)

    def wave(self, parity: int, depth: int, after: After | None, flags: Flags) -> Graph:
        """`depth` steps: blocks, then the gaps between them, and step by step those around the ends of the slab."""
        graph, layout = Graph(), self._layout
        if not layout.planes:
            return graph.freeze()
        below, above = self._exchange.open
        wraps = layout.stored == layout.planes  # the last block's neighbour is the first
        pieces = wavefront.blocks(layout.planes, self._threads, wraps or below, wraps or above)
        for k, piece in enumerate(pieces):
            ends = [ENDS[0]] * (k == 0) + [ENDS[1]] * (k == len(pieces) - 1)
            self._piece(graph, piece, parity, depth, after, flags, [], [("block", k), *ends])
        for k, piece in enumerate(pieces):
            if k < len(pieces) - 1 or wraps:
                blocks = [("block", k), ("block", (k + 1) % len(pieces))]
                self._piece(graph, wavefront.gap(piece.high), parity, depth, after, flags, blocks, [("gap", k)])
        if any(self._exchange.open):
            for t in range(depth):
                self._ends_of_step(graph, (parity + t) % 2, t, after, flags[t])
        return graph.freeze()

    def _ends_of_step(self, graph: Graph, parity: int, t: int, after: After | None, flags: int) -> None:
        """Step t of a wave around the ends that other ranks share."""
        planes, (below, above) = self._layout.planes, self._exchange.open

        def ends(width: int) -> list[tuple[int, int]]:
            return [(0, width)] * bool(below and width) + [(planes - width, planes)] * bool(above and width)

        self._ends(graph, parity, ends(t * wavefront.lag(after)), flags)
        if after:
            for low, high in ends(2 * t + 1):
                for bound in after(1 - parity, low, high):
                    graph.task(bound, inouts=ENDS, priority=1)

    def _piece(
        self,
        graph: Graph,
        planes: Span,
        parity: int,
        depth: int,
        after: After | None,
        flags: Flags,
        ins: list,
        chain: list,
    ) -> None:
        """The steps of a piece, one task after the other; one task in all when nothing comes between its sweeps."""
        layout, lag = self._layout, wavefront.lag(after)
        whole = after is not None or layout.whole_planes
        width = layout.rows if whole else wavefront.row_width(layout, self._threads, depth)
        rows = wavefront.row_tiles(layout.rows, self._periodic_rows, width, depth)
        waiting: list[tuple[int, ...]] = []

        def sweep() -> None:
            if waiting:
                name = f"wave {planes.low}..{planes.high}"
                graph.task(self._sweep(np.array(waiting, np.int64)), ins=ins, inouts=chain, name=name)
                waiting.clear()

        for row in rows:
            for t, plane, swept in wavefront.order(planes, depth, lag):
                z = plane % layout.planes
                if swept:
                    parts = wavefront.wrapped(row.at(t), layout.rows)
                    waiting += [((parity + t) % 2 | flags[t], z, z + 1, *part) for part in parts]
                else:
                    assert after is not None
                    for bound in after((parity + t + 1) % 2, z, z + 1):
                        sweep()
                        graph.task(bound, ins=ins, inouts=chain)
        sweep()
