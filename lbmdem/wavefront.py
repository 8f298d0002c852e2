"""Several steps per pass over memory: a wave of steps follows itself through the planes, in cache.

A node may take its next step as soon as it and its neighbours have taken the last one: in place nothing else is needed,
whatever the order. So planes are cut into blocks, one per thread. A block first does what it can alone, step t (0, 1..)
on its planes but t at each end, as a wave in which step t follows t planes behind step 0; then the gaps that are left
around the ends of blocks are filled, t planes on either side. In the same way rows are done in tiles that lean back by a
row per step, so that the planes of a wave stay in the second-level cache. Around the ends of slabs the gaps are filled
step by step with the messages of ordinary steps. Every node does what it does in plain stepping: the bits are the same.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.domain import Domain, block_ranges

DEPTH = {"double": 4, "single": 6}
CACHE = 600e3  # bytes of the second-level cache that the planes of a wave may fill


class Span(NamedTuple):
    """Planes or rows of one piece: [low + t low_slope, high + t high_slope) at step t."""

    low: int
    high: int
    low_slope: int
    high_slope: int

    def at(self, step: int) -> tuple[int, int]:
        return self.low + step * self.low_slope, self.high + step * self.high_slope


def blocks(planes: int, parts: int, open_low: bool, open_high: bool) -> list[Span]:
    """What blocks can do alone. An end of the slab is open when somebody else's planes are beyond it."""
    ranges = block_ranges(planes, parts)
    last = len(ranges) - 1
    return [
        Span(low, high, int(k > 0 or open_low), -int(k < last or open_high)) for k, (low, high) in enumerate(ranges)
    ]


def gap(end: int) -> Span:
    """What is left around an end of blocks."""
    return Span(end, end, -1, 1)


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


def tiles(planes: Span, rows: Iterable[Span], extent: tuple[int, int], depth: int, parity: int) -> NDArray[np.int64]:
    """Sweeps of a piece in order, as the kernel wants them; extent: planes and rows of the slab, at which they wrap."""
    found: list[tuple[int, ...]] = []
    for row in rows:
        first = min(planes.at(t)[0] + t for t in range(depth))
        last = max(planes.at(t)[1] + t for t in range(depth))
        for wave in range(first, last):
            for t in range(depth):
                plane = wave - t
                if planes.at(t)[0] <= plane < planes.at(t)[1]:
                    z = plane % extent[0]
                    found += [((parity + t) % 2, z, z + 1, *part) for part in wrapped(row.at(t), extent[1])]
    return np.array(found, np.int64).reshape(-1, 5)


def wrapped(rows: tuple[int, int], n: int) -> list[tuple[int, int]]:
    """The rows as ranges within 0..n."""
    low, high = rows
    if high <= low:
        return []
    if high <= n:
        return [(low, high)]
    return [(low, n), (0, high - n)] if low < n else [(low - n, high - n)]


def possible_depth(domain: Domain, threads: int, wanted: int) -> int:
    """The most steps, up to `wanted`, for which blocks and their gaps fit every slab; 1 when a wave is not possible."""
    thinnest = min(b - a for a, b in zip(domain.cuts, domain.cuts[1:]) if b > a) // threads
    return max(1, min(wanted, thinnest // 2))
