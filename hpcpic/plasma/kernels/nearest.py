"""Nearest grid point (NGP) by vectors: a node is the cell; a line is its field, a sum the parts of its particles."""

from hpcpic.core.simd.vector import convert, load_at, splat, store_at, store_lines
from hpcpic.plasma.kernels.cell_lines import add_whole, gather_values
from hpcpic.plasma.kernels.lanes import address, inlined, kernel
from hpcpic.plasma.kernels.nodal import CELLS, PITCH
from hpcpic.plasma.kernels.simd_base import P8, R8, SIZE, WIDE, F, field_on, widened, zero_bytes

DIM = 2  # axes of the grid

LINE, SUM = DIM * SIZE, SIZE  # bytes of a node's field and of its sum
SUM_BYTES = (CELLS + 8) * SUM
REACH = 0  # nodes of the field below the first cell


@kernel
def spread_field(part, parts, field, lines):
    """The field of the nodes of a tile part, and none for parked lanes behind them."""
    e_x, e_y, scale, origin = field.e_x, field.e_y, field.scale, field.origin
    row, column = parts[part, 1] - origin[0], parts[part, 2] - origin[1]
    width = e_x.shape[1] * 8
    for r in range(parts[part, 3], parts[part, 4] + DIM - 1):
        for c in range(parts[part, 5], parts[part, 6] + 1, 8):
            at = (row + r) * width + (column + c) * 8
            to, along_x = lines + (r * PITCH + c) * LINE, convert(R8, field_on(address(e_x) + at, scale))
            if DIM == 1:
                store_at(to, along_x, SIZE)
            else:
                store_lines(to, (along_x, convert(R8, field_on(address(e_y) + at, scale))))
    zero_bytes(lines + CELLS * LINE, lines + (CELLS + 8) * LINE)


@inlined
def field_at(lines, cells, f, g):
    """E_x, E_y of a pack whose nodes' lines are at `lines` + (integers at address `cells`)."""
    if DIM == 1:
        e = gather_values(F, 1, lines, cells, 0)[0]
        return e, e
    return gather_values(F, 2, lines, cells, 0)


@inlined
def add_charge(sums, cells, f, g, unit, whole):
    """Charge of a pack to the sums of its nodes."""
    add_whole(sums, cells, 0, whole)


@kernel
def gather_sums(part, parts, sums, patch, group, sign):
    """Add the sums of the part's nodes, times sign, to the patch, and zero them."""
    zero_bytes(sums + CELLS * SUM, sums + SUM_BYTES)
    corner = patch.corner
    row, column = parts[part, 1] - corner[0], parts[part, 2] - corner[1]
    nodes = patch.nodes
    base, width = address(nodes) + group * nodes.shape[1] * nodes.shape[2] * 8, nodes.shape[2] * 8
    for r in range(parts[part, 3], parts[part, 4] + DIM - 1):
        for c in range(parts[part, 5], parts[part, 6] + 1, 8):
            at, found = base + (row + r) * width + (column + c) * 8, sums + (r * PITCH + c) * SUM
            store_at(at, load_at(WIDE, at, 8) + widened(load_at(P8, found, SIZE)) * sign, 8)
            store_at(found, splat(P8, 0), SIZE)
