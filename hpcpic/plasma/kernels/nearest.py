"""Nearest grid point (NGP) by vectors: a node is the cell; a line is its field, a sum the parts of its particles."""

from hpcpic.core.simd.vector import convert, load_at, splat, store_at, store_lines
from hpcpic.plasma.kernels.cell_lines import add_whole, gather_values
from hpcpic.plasma.kernels.lanes import address, inlined, kernel
from hpcpic.plasma.kernels.nodal import CELLS, LAYER, PITCH
from hpcpic.plasma.kernels.simd_base import (
    P8,
    R8,
    SIZE,
    WIDE,
    F,
    component,
    field_on,
    planes_of,
    widened,
    zero_bytes,
)
from hpcpic.plasma.kernels.weights import anchor_in

DIM = 2  # axes of the grid

LINE, SUM = (2 if DIM == 2 else 1) * SIZE, SIZE  # bytes of a node's field and of its sum
ALONG = (CELLS + 8) * LINE  # from the lines of an axis to those of the next in 3D
SUM_BYTES = (CELLS + 8) * SUM
REACH = 0  # nodes of the field below the first cell


@kernel
def spread_field(part, grid, field, lines):
    """The field of the nodes of a tile part, and none for parked lanes behind them."""
    parts, scale, width = grid.parts, field.scale, field.e.shape[2] * 8
    row, column, pitch = anchor_in(part, grid, field.origin)
    from_plane, to_plane = planes_of(part, parts)
    for p in range(from_plane, to_plane + DIM // 3):
        for r in range(parts[part, 3], parts[part, 4] + (DIM > 1)):
            for c in range(parts[part, 5], parts[part, 6] + 1, 8):
                at, to = (row + p * pitch + r) * width + (column + c) * 8, lines + (p * LAYER + r * PITCH + c) * LINE
                if DIM == 2:
                    pair = field_on(component(field, 0) + at, scale), field_on(component(field, 1) + at, scale)
                    store_lines(to, (convert(R8, pair[0]), convert(R8, pair[1])))
                else:
                    for axis in range(DIM):
                        e = field_on(component(field, axis) + at, scale)
                        store_at(to + axis * ALONG, convert(R8, e), SIZE)
    for axis in range(1 if DIM == 2 else DIM):
        zero_bytes(lines + axis * ALONG + CELLS * LINE, lines + (axis + 1) * ALONG)


@inlined
def field_at(lines, cells, place):
    """E of a pack, as many components as there are axes, whose nodes' lines are at `lines` + (integers at address
    `cells`).
    """
    if DIM == 2:
        e = gather_values(F, 2, lines, cells, 0)
        return e[0], e[1], e[0]
    e = gather_values(F, 1, lines, cells, 0)[0]
    if DIM == 1:
        return e, e, e
    y, z = gather_values(F, 1, lines + ALONG, cells, 0), gather_values(F, 1, lines + 2 * ALONG, cells, 0)
    return e, y[0], z[0]


@inlined
def add_charge(sums, cells, place, unit, whole):
    """Charge of a pack to the sums of its nodes."""
    add_whole(sums, cells, 0, whole)


@kernel
def gather_sums(part, grid, sums, patch, group, sign):
    """Add the sums of the part's nodes, times sign, to the patch, and zero them."""
    zero_bytes(sums + CELLS * SUM, sums + SUM_BYTES)
    parts, nodes = grid.parts, patch.nodes
    row, column, pitch = anchor_in(part, grid, patch.corner)
    base, width = address(nodes) + group * nodes.shape[1] * nodes.shape[2] * 8, nodes.shape[2] * 8
    from_plane, to_plane = planes_of(part, parts)
    for p in range(from_plane, to_plane + DIM // 3):
        for r in range(parts[part, 3], parts[part, 4] + (DIM > 1)):
            for c in range(parts[part, 5], parts[part, 6] + 1, 8):
                at = base + (row + p * pitch + r) * width + (column + c) * 8
                found = sums + (p * LAYER + r * PITCH + c) * SUM
                store_at(at, load_at(WIDE, at, 8) + widened(load_at(P8, found, SIZE)) * sign, 8)
                store_at(found, splat(P8, 0), SIZE)
