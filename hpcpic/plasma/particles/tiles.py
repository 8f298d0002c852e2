"""Where the particles of one rank are: tiles of cells, their parts in task blocks, and the pages that hold particles.

Tiles are anchored squares of 16 x 16 cells of the whole grid (256 cells in 1D), whatever the cuts are; the cuts of
slabs and blocks split a tile into parts with the same anchor. Positions are relative to the anchor, so the bits of a
particle's motion depend on neither ranks nor blocks.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import DTypeLike, NDArray

from hpcpic.core.space.domain import Domain, block_ranges
from hpcpic.plasma.sizes import EDGE, PAGE

LINE = 16  # int32 in a cache line
RECORD = 8  # numbers of a particle under way, see kernels.pages


def aligned(shape: Sequence[int], dtype: DTypeLike, to: int = 4096) -> NDArray:
    """Array at an address that is a multiple of `to` bytes; memory is taken from the machine when first touched."""
    dtype = np.dtype(dtype)
    size = int(np.prod(shape)) * dtype.itemsize
    room = np.empty(size + to + 128, np.uint8)  # vectors may read beyond the end
    start = -room.ctypes.data % to
    return room[start : start + size].view(dtype).reshape(shape)


class Tiles:
    """Tile parts of a slab, block after block, each block row by row.

    `parts[part]` = (tile, anchor row, anchor column, rows from and to, columns from and to (relative to the anchor),
    block); `ranges[block]` = its parts, `n_parts[block]` = how many; the part of a global cell is
    column_part[column] + row_part[row] * column_stride[column], where -1 in a table means another rank.
    """

    def __init__(self, domain: Domain, rank: int, n_blocks: int) -> None:
        edge, one = EDGE[domain.ndim], domain.ndim == 1
        low, high = domain.row_range(rank)
        self.points = np.array((1, *domain.points) if one else domain.points, np.int64)
        self.rows = (0, 1) if one else (low, high)
        self.columns = (low, high) if one else (0, domain.points[1])
        first = self.columns[0]
        self.block_columns = [
            (first + a, first + b) for a, b in block_ranges(self.columns[1] - first, n_blocks)
        ]
        tiles = -(-int(self.points[1]) // edge)
        row_pieces = _pieces(*self.rows, edge)
        self.row_part = np.full(self.points[0], -1, np.int32)
        self.column_part = np.full(self.points[1], -1, np.int32)
        self.column_stride = np.zeros(self.points[1], np.int32)
        for k, (a, b) in enumerate(row_pieces):
            self.row_part[a:b] = k
        parts: list[tuple[int, ...]] = []
        self.ranges: list[tuple[int, int]] = []
        for block, (left, right) in enumerate(self.block_columns):
            pieces = _pieces(left, right, edge)
            for k, (a, b) in enumerate(pieces):
                self.column_part[a:b], self.column_stride[a:b] = len(parts) + k, len(pieces)
            begin = len(parts)
            for r0, r1 in row_pieces:
                row = r0 - r0 % edge
                for c0, c1 in pieces:
                    column = c0 - c0 % edge
                    tile = row // edge * tiles + column // edge
                    parts.append((tile, row, column, r0 - row, r1 - row, c0 - column, c1 - column, block))
            self.ranges.append((begin, len(parts)))
        self.parts = np.array(parts, np.int64).reshape(-1, 8)
        self.n_parts = np.array([b - a for a, b in self.ranges], np.int64)


class Patches:
    """Charge of all blocks in one array `values`: group, rows and columns with ghosts, below and above.

    of_block[block] its part [group, row, column], whose first node is corner[block] of the grid; `places` see
    kernels.charge.
    """

    def __init__(self, tiles: Tiles, groups: int, dimensions: int, ghosts: tuple[int, int]) -> None:
        below, above = ghosts
        lead = below if dimensions == 2 else 0
        rows = tiles.rows[1] - tiles.rows[0] + (below + above if dimensions == 2 else 0)
        widths = [b - a + below + above for a, b in tiles.block_columns]
        starts = np.cumsum([0] + [-(-groups * rows * width // 8) * 8 + 8 for width in widths])  # vectors overrun
        self.values = np.zeros(starts[-1], np.int64)
        slab = tiles.columns[0] - below if dimensions == 1 else 0  # first column of the slab's array
        self.places = np.array(
            [(start, a - below - slab, width) for start, (a, _), width in zip(starts, tiles.block_columns, widths)]
        )
        self.of_block = [
            self.values[start : start + groups * rows * width].reshape(groups, rows, width)
            for start, width in zip(starts, widths)
        ]
        self.corner = [np.array([tiles.rows[0] - lead, a - below]) for a, _ in tiles.block_columns]


def _pieces(low: int, high: int, edge: int) -> list[tuple[int, int]]:
    """The ranges into which the tile edges cut low .. high."""
    edges = [low, *range(low - low % edge + edge, high, edge), high]
    return [(a, b) for a, b in pairwise(edges) if b > a]


class Pages:
    """All pages of a rank, the chains of its slots (part x species + species), its boxes; see kernels.pages.

    There is a box and a stack of free pages per block, and a last box for what comes from outside. All of it grows
    between kernels only. Addresses are reserved generously, memory is used when touched. `moved` counts the times
    when arrays changed address.
    """

    GROWING = ("pool", "ids", "chain", "free", "holes", "moving", "words")

    def __init__(self, n_slots: int, n_blocks: int, components: int, dtype: DTypeLike, capacity: int) -> None:
        self.dtype = np.dtype(dtype)
        lanes = 64 // self.dtype.itemsize
        self.shape = (PAGE // lanes, components, lanes)
        self.head = np.full(n_slots, -1, np.int32)
        self.count = np.zeros(n_slots, np.int64)
        self.settled = np.zeros(n_slots, np.int64)  # of these, who did not come last
        self.counters = aligned((n_blocks + 1, 8), np.int64)  # free pages, particles in the box; a cache line each
        self.counters[:] = 0
        lines = -(-(n_blocks + 1) // LINE)  # of each row: cores that write into one line wait for each other
        self.lists = aligned((n_blocks + 1, 2, lines * LINE), np.int32)  # first particle, number of particles
        self.fresh = 0  # pages from this number on were never used
        self.moved = 0
        self._hold(capacity)
        self.room(1024)

    def _hold(self, capacity: int) -> None:
        pool = aligned((capacity, *self.shape), self.dtype)
        ids = aligned((capacity, PAGE), np.uint32)
        chain = np.empty(capacity, np.int32)
        free = np.empty((len(self.lists), capacity), np.int32)
        if self.fresh:
            used = slice(0, self.fresh)
            pool[used], ids[used], chain[used] = self.pool[used], self.ids[used], self.chain[used]
            for block, n in enumerate(self.counters[:, 0]):
                free[block, :n] = self.free[block, :n]
        self.pool, self.ids, self.chain, self.free = pool, ids, chain, free
        self.capacity = capacity
        self.moved += 1

    def room(self, particles: int) -> None:
        """Boxes that can take so many particles each; what is in them is forgotten when they must grow."""
        if particles <= getattr(self, "box_size", 0):
            return
        boxes, n = len(self.lists), particles + particles // 8
        self.box_size = n
        self.moving = aligned((boxes, n, RECORD), self.dtype)
        self.words = self.moving.view(np.int32)
        self.holes = np.empty((boxes, n), np.int64)
        self.clear()
        self.moved += 1

    def clear(self) -> None:
        """Empty all boxes."""
        self.lists[:, 0] = -1
        self.lists[:, 1] = 0
        self.counters[:, 1] = 0

    def drop(self) -> None:
        """Forget all particles."""
        self.head[:], self.count[:] = -1, 0
        self.counters[:, 0] = 0
        self.fresh = 0
        self.clear()

    def need(self, pages: Sequence[int]) -> None:
        """At least pages[block] free pages on each block's stack: unused ones of other blocks, new ones, by growth."""
        spare = self.counters[:, 0].tolist()
        for block, wanted in enumerate(pages):
            spare[block] -= wanted
        for block in [block for block, n in enumerate(spare) if n < 0]:
            for other in [other for other, n in enumerate(spare) if n > 0]:
                n = min(spare[other], -spare[block])
                self.counters[other, 0] -= n
                top = self.counters[other, 0]
                self._push(block, self.free[other, top : top + n])
                spare[other], spare[block] = spare[other] - n, spare[block] + n
            if spare[block] < 0:
                n = -spare[block]
                if self.fresh + n > self.capacity:
                    self._hold(max(self.fresh + n, self.capacity + self.capacity // 2) + 64)
                self._push(block, np.arange(self.fresh + n - 1, self.fresh - 1, -1))
                self.fresh += n

    def _push(self, block: int, pages: NDArray) -> None:
        top = self.counters[block, 0]
        self.free[block, top : top + len(pages)] = pages
        self.counters[block, 0] += len(pages)
