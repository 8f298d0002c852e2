"""Where the particles of one rank are: tiles of cells, their parts in task blocks, and the charge of the blocks.

Tiles are anchored cubes of 8 x 8 x 8 cells of the whole grid (16 x 16 in 2D, 256 in 1D), whatever the cuts are; the
cuts of slabs and blocks split a tile into parts with the same anchor. Positions are relative to the anchor, so the bits
of a particle's motion depend on neither ranks nor blocks.
"""

import itertools
from collections.abc import Sequence

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
    """Tile parts of a slab, block after block, each block plane by plane and row by row.

    `parts[part]` = (tile, anchor row, anchor column, rows from and to, columns from and to (relative to the anchor),
    block, and in 3D anchor plane, planes from and to); `ranges[block]` = its parts, `n_parts[block]` = how many; the
    part of a global cell is column_part[column] + row_part[row] * column_stride[column], where -1 in a table means
    another rank; in 3D behind the rows of row_part stand the planes, whose entries add to those of rows. points: rows,
    columns (and planes) of the grid; pitch: rows from plane to plane of arrays with so many `ghosts` in all.
    """

    def __init__(self, domain: Domain, rank: int, n_blocks: int, ghosts: int = 0) -> None:
        edge, d, own = EDGE[domain.ndim], domain.ndim, domain.row_range(rank)
        planes, rows, columns = (1,) * (3 - d) + domain.points
        self.points = np.array((rows, columns, planes)[: max(d, 2)], np.int64)
        self.planes = own if d == 3 else (0, 1)
        self.rows = own if d == 2 else (0, rows)
        self.columns = own if d == 1 else (0, columns)
        self.pitch = rows + ghosts if d == 3 else 0
        first = self.columns[0]
        self.block_columns = [(first + a, first + b) for a, b in block_ranges(self.columns[1] - first, n_blocks)]
        tiles, layer = -(-columns // edge), -(-columns // edge) * -(-rows // edge)
        row_pieces, plane_pieces = _pieces(*self.rows, edge), _pieces(*self.planes, edge)
        self.row_part = np.full(rows + (planes if d == 3 else 0), -1, np.int32)
        self.column_part = np.full(self.points[1], -1, np.int32)
        self.column_stride = np.zeros(self.points[1], np.int32)
        for k, (a, b) in enumerate(row_pieces):
            self.row_part[a:b] = k
        for k, (a, b) in enumerate(plane_pieces if d == 3 else ()):
            self.row_part[rows + a : rows + b] = k * len(row_pieces)
        parts: list[tuple[int, ...]] = []
        self.ranges: list[tuple[int, int]] = []
        for block, (left, right) in enumerate(self.block_columns):
            pieces = _pieces(left, right, edge)
            for k, (a, b) in enumerate(pieces):
                self.column_part[a:b], self.column_stride[a:b] = len(parts) + k, len(pieces)
            begin = len(parts)
            for (p0, p1), (r0, r1), (c0, c1) in itertools.product(plane_pieces, row_pieces, pieces):
                plane, row, column = (low - low % edge for low in (p0, r0, c0))
                tile = plane // edge * layer + row // edge * tiles + column // edge
                above = (plane, p0 - plane, p1 - plane) if d == 3 else ()
                parts.append((tile, row, column, r0 - row, r1 - row, c0 - column, c1 - column, block, *above))
            self.ranges.append((begin, len(parts)))
        self.parts = np.array(parts, np.int64).reshape(-1, 11 if d == 3 else 8)
        self.n_parts = np.array([b - a for a, b in self.ranges], np.int64)


class Patches:
    """Charge of all blocks in one array `values`: group, rows (of all planes) and columns with ghosts, below and above.

    of_block[block] is its part, as kernels take it; `places` see kernels.mesh.collect.
    """

    def __init__(self, tiles: Tiles, groups: int, dimensions: int, ghosts: tuple[int, int]) -> None:
        (below, above), flat = ghosts, dimensions == 1
        rows = tiles.rows[1] - tiles.rows[0] + (0 if flat else below + above)
        if dimensions == 3:
            rows *= tiles.planes[1] - tiles.planes[0] + below + above
        first = first_node(tiles, dimensions, below)
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
                np.array((first[0], a - below, *first[2:])),
            )
            for start, width, (a, _) in zip(starts, widths, tiles.block_columns)
        ]


def first_node(tiles: Tiles, dimensions: int, below: int) -> tuple[int, ...]:
    """Row, column (and plane) of the grid of the first node in arrays of the slab with `below` ghosts."""
    row, column, plane = tiles.rows[0], tiles.columns[0] - below, tiles.planes[0] - below
    return (row if dimensions == 1 else row - below, column, plane)[: max(dimensions, 2)]


def _pieces(low: int, high: int, edge: int) -> list[tuple[int, int]]:
    """The ranges into which the tile edges cut low .. high."""
    edges = [low, *range(low - low % edge + edge, high, edge), high]
    return [(a, b) for a, b in itertools.pairwise(edges) if b > a]
