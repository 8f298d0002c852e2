"""Several steps per pass over memory: a wave of steps follows itself through the planes, in cache.

A node may take its next step as soon as it and its neighbours have taken the last one: in place nothing else is needed,
whatever the order. So planes are cut into blocks, one per thread. A block first does what it can alone, step t (0, 1..)
on its planes but t at each end, as a wave in which step t follows t planes behind step 0; then the gaps that are left
around the ends of blocks are filled, t planes on either side. In the same way rows are done in tiles that lean back by
a row per step, so that the planes of a wave stay in cache. Around the ends of slabs the gaps are
filled step by step with the messages of ordinary steps. Every node does what it does in plain stepping: the bits are
the same.

Links and faces come after a sweep: those of a plane when it and its neighbours are swept, and before these are swept
again. A wave with them therefore lags a plane more for each time that they come, and has whole planes.
"""

from collections.abc import Iterator
from typing import NamedTuple

from hpcpic.core.space.domain import Domain, block_ranges
from lbmdem.fluid.sparse import SparseLayout
from lbmdem.kernels.layout import Layout
from lbmdem.sizes import CACHE, CACHE_OF_WHOLE_PLANES, STEPS_PER_PASS

SHEET = 5e5  # bytes of planes that are done in one go
KEPT = 2  # steps, the last ones before a look, whose forces on solids can be asked for


class Span(NamedTuple):
    """Planes or rows of one piece: [low + t low_slope, high + t high_slope) at step t, for a lag of one."""

    low: int
    high: int
    low_slope: int
    high_slope: int

    def at(self, step: int) -> tuple[int, int]:
        return self.low + step * self.low_slope, self.high + step * self.high_slope


class Steps(NamedTuple):
    """The steps of a pass from a parity: links or faces come after the last `after` sweeps. keep: links keep what their
    forces follow from in the last steps. flags: of each sweep, besides the parity (kernels.sparse).
    """

    parity: int
    depth: int
    after: int
    keep: bool
    flags: tuple[int, ...]

    @property
    def operations(self) -> list[tuple[int, bool]]:
        return operations(self.depth, self.after)

    def parity_at(self, step: int) -> int:
        return (self.parity + step) % 2

    def keeps(self, step: int) -> bool:
        return self.keep and step >= self.depth - KEPT


def blocks(planes: int, parts: int, open_low: bool, open_high: bool) -> list[Span]:
    """What blocks can do alone. An end of the slab is open when planes of another rank are beyond it."""
    ranges = block_ranges(planes, parts)
    last = len(ranges) - 1
    return [
        Span(low, high, int(k > 0 or open_low), -int(k < last or open_high)) for k, (low, high) in enumerate(ranges)
    ]


def gap(end: int) -> Span:
    """What is left around an end of blocks."""
    return Span(end, end, -1, 1)


def operations(depth: int, after: int) -> list[tuple[int, bool]]:
    """(step, swept?) of what is done at a plane one after the other, where something comes after the last `after`
    sweeps. Each follows a plane behind the one before it."""
    return [(t, swept) for t in range(depth) for swept in (True, False) if swept or t >= depth - after]


def order(planes: Span, operations: list[tuple[int, bool]], sheet: int) -> Iterator[tuple[int, bool, int, int]]:
    """(step, swept?, planes from, to) of a piece in the order of a wave, `sheet` planes at a time."""
    ranges = [planes.at(k) for k in range(len(operations))]
    first = min(low + k for k, (low, _) in enumerate(ranges))
    last = max(high + k for k, (_, high) in enumerate(ranges))
    for wave in range(first, last, sheet):
        for k, (low, high) in enumerate(ranges):
            a, b = max(low, wave - k), min(high, wave - k + sheet)
            if b > a:
                yield *operations[k], a, b


def sheet(layout: Layout | SparseLayout) -> int:
    """Planes that are done in one go."""
    return max(1, int(SHEET // max(1, layout.plane_bytes)))


def row_width(layout: Layout, threads: int, depth: int) -> int:
    """Rows of a tile whose planes stay in cache."""
    return int(CACHE / (layout.lattice.q * layout.row_stride * layout.itemsize * (depth + 1) * threads))


def row_tiles(rows: int, periodic: bool, width: int, depth: int) -> list[Span]:
    """Tiles of rows in the order in which they are done; all rows at every step when one tile is enough."""
    n_tiles = max(1, rows // max(width, 2 * depth))
    if n_tiles == 1:
        return [Span(0, rows, 0, 0)]
    ranges = block_ranges(rows, n_tiles)
    tiles = [Span(low, high, -int(k > 0), -1) for k, (low, high) in enumerate(ranges)]
    if periodic:
        tiles[0] = tiles[0]._replace(low_slope=1)
        return [*tiles, gap(rows)]
    tiles[-1] = tiles[-1]._replace(high_slope=0)
    return tiles


def wrapped(rows: tuple[int, int], n: int) -> list[tuple[int, int]]:
    """The rows or planes as ranges within 0..n."""
    low, high = rows
    if high <= low:
        return []
    if high <= n:
        return [(low, high)]
    return [(low, n), (0, high - n)] if low < n else [(low - n, high - n)]


def even_depth(depth: int, most: int) -> int:
    """Steps of the next pass where `most` are to be done in passes of nearly the same, and at most so many."""
    return -(-most // -(-most // depth))


def possible_depth(domain: Domain, layout: Layout | SparseLayout, threads: int, after: int) -> int:
    """Steps per pass for which blocks and their gaps fit every slab, and planes the caches; 0: not one. Same on all
    ranks."""
    thinnest = min(b - a for a, b in zip(domain.cuts, domain.cuts[1:]) if b > a) // threads
    most = thinnest // 2
    if (after or layout.whole_planes) and layout.plane_bytes:
        most = min(most, int(CACHE_OF_WHOLE_PLANES / (layout.plane_bytes * threads) - 1))
    return max((depth for depth in range(1, STEPS_PER_PASS + 1) if len(operations(depth, after)) <= most), default=0)
