"""Linear shapes (CIC) by vectors, cell by cell.

The field is a line of coefficients per cell (2D: a, b, c, d of E_x, then of E_y), the charge a line of sums: of parts,
times f, times g, times f g (f, g: place in the cell), from which the corners' charge follows.
"""

from hpcpic.core.simd.vector import (
    add_lines,
    convert,
    floor,
    fma,
    gather_lines,
    lane_numbers,
    load_at,
    splat,
    store_at,
    store_lines,
)
from hpcpic.plasma.kernels.cell_lines import add_sums, gather_field, load_sums
from hpcpic.plasma.kernels.lanes import address, bits_of, inlined, kernel
from hpcpic.plasma.kernels.plain import MAGIC
from hpcpic.plasma.kernels.simd_base import (
    MAGIC_BITS,
    P8,
    R8,
    SIZE,
    WIDE,
    F,
    I,
    add_pairs,
    field_on,
    widened,
    zero_bytes,
)
from hpcpic.plasma.kernels.storage import TILE

DIM = 2  # axes of the grid

CORNERS = 4 if DIM == 2 else 2
CELLS, PITCH, EDGE = 256, TILE, TILE
LINE, SUM = 2 * CORNERS * SIZE // (3 - DIM), CORNERS * SIZE  # bytes of a cell's coefficients and corner sums
SUM_BYTES = (CELLS + 8) * SUM
REACH = 0  # nodes of the field below the first cell


@inlined
def cell_of(x):
    """Number of the cell along an axis."""
    return floor(x)


@kernel
def spread_field(part, parts, field, lines):
    """Coefficients of the cells of a tile part, and zero ones for parked lanes behind them."""
    e_x, e_y, scale, origin = field.e_x, field.e_y, field.scale, field.origin
    row, column = parts[part, 1] - origin[0], parts[part, 2] - origin[1]
    width = e_x.shape[1] * 8
    for r in range(parts[part, 3], parts[part, 4]):
        for c in range(parts[part, 5], parts[part, 6], 8):
            at = (row + r) * width + (column + c) * 8
            to = lines + (r * PITCH + c) * LINE
            if DIM == 1:
                left, right = field_on(address(e_x) + at, scale), field_on(address(e_x) + at + 8, scale)
                store_lines(to, (convert(R8, left), convert(R8, right - left)))
            else:
                store_lines(to, (*coefficients(address(e_x) + at, width, scale),
                                 *coefficients(address(e_y) + at, width, scale)))  # fmt: skip
    zero_bytes(lines + CELLS * LINE, lines + (CELLS + 8) * LINE)


@kernel
def coefficients(at, width, scale):
    """a, b, c, d of eight cells whose lower left nodes start at an address: E = a + b f + (c + d f) g."""
    e00, e10 = field_on(at, scale), field_on(at + 8, scale)
    e01, e11 = field_on(at + width, scale), field_on(at + width + 8, scale)
    b, c = e10 - e00, e01 - e00
    return convert(R8, e00), convert(R8, b), convert(R8, c), convert(R8, (e11 - e10) - c)


@inlined
def field_at(lines, cells, f, g):
    """E_x, E_y of a pack at (f, g) in the cells whose lines are at `lines` + (integers at address `cells`)."""
    if DIM == 1:
        u = gather_lines(F, 2, lines, load_at(I, cells, 64))
        e = fma(f, u[1], u[0])
        return e, e
    u = gather_field(F, lines, cells)
    return fma(g, fma(f, u[3], u[2]), fma(f, u[1], u[0])), fma(g, fma(f, u[7], u[6]), fma(f, u[5], u[4]))


@inlined
def add_charge(sums, cells, f, g, unit, whole):
    """Charge of a pack to the sums of its cells: of parts, times f, times g, times f g."""
    along = bits_of(fma(f, unit, MAGIC)) - MAGIC_BITS
    if DIM == 1:
        add_lines(sums, load_at(I, cells, 64), (whole, along))
    else:
        across, both = bits_of(fma(g, unit, MAGIC)), bits_of(fma(f, g * unit, MAGIC))
        add_sums(sums, cells, (whole, along, across - MAGIC_BITS, both - MAGIC_BITS))


@inlined
def corners_of(at):
    """Charge at the corners of eight cells from their sums, which are zeroed."""
    if DIM == 1:
        whole, along = gather_lines(P8, 2, at, lane_numbers(WIDE) * SUM)
        across = both = splat(P8, 0)
    else:
        whole, along, across, both = load_sums(P8, at)
    for c in range(CORNERS):
        store_at(at + 8 * SIZE * c, splat(P8, 0), SUM)
    whole, along, across, both = widened(whole), widened(along), widened(across), widened(both)
    return (whole - along) - (across - both), along - both, across - both, both


@kernel
def gather_sums(part, parts, sums, patch, group, sign):
    """Add the corner sums of the part's cells, times sign, to the nodes of the patch, and zero them."""
    zero_bytes(sums + CELLS * SUM, sums + SUM_BYTES)
    corner = patch.corner
    row, column = parts[part, 1] - corner[0] + parts[part, 3], parts[part, 2] - corner[1]
    nodes = patch.nodes
    base, width = address(nodes) + group * nodes.shape[1] * nodes.shape[2] * 8, nodes.shape[2] * 8
    zero = splat(WIDE, 0)
    for c in range(parts[part, 5], parts[part, 6], 8):
        at, left, right = base + row * width + (column + c) * 8, zero, zero  # of the cells in the row below
        for r in range(parts[part, 3], parts[part, 4]):
            corners = corners_of(sums + (r * PITCH + c) * SUM)
            add_pairs(at, (left + corners[0]) * sign, (right + corners[1]) * sign)
            left, right = corners[2], corners[3]
            at += width
        if DIM == 2:
            add_pairs(at, left * sign, right * sign)
