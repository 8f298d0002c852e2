"""Where the particles of one rank are: tiles of cells, their parts in task blocks, and the charge of the blocks.

Tiles are anchored squares of 16 x 16 cells of the whole grid (256 cells in 1D), whatever the cuts are; the cuts of
slabs and blocks split a tile into parts with the same anchor. Positions are relative to the anchor, so the bits of a
particle's motion depend on neither ranks nor blocks.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import DTypeLike, NDArray

from hpcpic.core.space.domain import Domain, block_ranges
from hpcpic.plasma.kernels.groups import PatchArrays
from hpcpic.plasma.sizes import EDGE


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

    of_block[block] is its part, as kernels take it; `places` see kernels.mesh.collect.
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
            PatchArrays(
                self.values[start : start + groups * rows * width].reshape(groups, rows, width),
                np.array([tiles.rows[0] - lead, a - below]),
            )
            for start, width, (a, _) in zip(starts, widths, tiles.block_columns)
        ]


def _pieces(low: int, high: int, edge: int) -> list[tuple[int, int]]:
    """The ranges into which the tile edges cut low .. high."""
    edges = [low, *range(low - low % edge + edge, high, edge), high]
    return [(a, b) for a, b in pairwise(edges) if b > a]
