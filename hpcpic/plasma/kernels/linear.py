"""Linear shapes (CIC) by vectors, cell by cell.

The field is a line of coefficients per cell (2D: a and c of E_x and E_y, then their b and d; 3D: one line for each
component, of those of E and, in place of E_y, of what times h adds to them), the charge a line of sums: of parts, times
f, times g, times f g, and in 3D of these times h (f, g, h: place in the cell), from which the corners' charge follows.
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
from hpcpic.plasma.kernels.cell_lines import add_sums, gather_sides, load_sums
from hpcpic.plasma.kernels.lanes import address, bits_of, inlined, kernel
from hpcpic.plasma.kernels.simd_base import (
    MAGIC_BITS,
    P8,
    R8,
    ROW,
    SIZE,
    WIDE,
    F,
    I,
    add_pairs,
    component,
    field_on,
    planes_of,
    widened,
    zero_bytes,
)
from hpcpic.plasma.kernels.storage import TILE
from hpcpic.plasma.kernels.weights import MAGIC, anchor_in, less

DIM = 2  # axes of the grid

CORNERS = 2**DIM
CELLS, PITCH, EDGE, LAYER = TILE**DIM, TILE, TILE, TILE * TILE
LINE, SUM = (2 if DIM == 1 else 8) * SIZE, CORNERS * SIZE  # bytes of a cell's coefficients and corner sums
ALONG = (CELLS + 8) * LINE  # from the lines of an axis to those of the next in 3D
SUM_BYTES = (CELLS + 8) * SUM
REACH = 0  # nodes of the field below the first cell


@inlined
def cell_of(x):
    """Number of the cell along an axis."""
    return floor(x)


@kernel
def spread_field(part, grid, field, lines):
    """Coefficients of the cells of a tile part, and zero ones for parked lanes behind them."""
    parts, scale, width = grid.parts, field.scale, field.e.shape[2] * 8
    row, column, pitch = anchor_in(part, grid, field.origin)
    from_plane, to_plane = planes_of(part, parts)
    for p in range(from_plane, to_plane):
        for r in range(parts[part, 3], parts[part, 4]):
            for c in range(parts[part, 5], parts[part, 6], 8):
                at = (row + p * pitch + r) * width + (column + c) * 8
                to = lines + (p * LAYER + r * PITCH + c) * LINE
                if DIM == 1:
                    from_left = component(field, 0) + at
                    left, right = field_on(from_left, scale), field_on(from_left + 8, scale)
                    store_lines(to, (convert(R8, left), convert(R8, right - left)))
                elif DIM == 2:
                    store_sides(to, coefficients(component(field, 0) + at, width, scale),
                                coefficients(component(field, 1) + at, width, scale))  # fmt: skip
                else:
                    for axis in range(3):
                        spread_cube(component(field, axis) + at, width, pitch * width, scale, to + axis * ALONG)
    for axis in range(3 if DIM == 3 else 1):
        zero_bytes(lines + axis * ALONG + CELLS * LINE, lines + (axis + 1) * ALONG)


@kernel
def coefficients(at, width, scale):
    """a, b, c, d of eight cells whose lower left nodes start at an address: E = a + b f + (c + d f) g."""
    e00, e10 = field_on(at, scale), field_on(at + 8, scale)
    e01, e11 = field_on(at + width, scale), field_on(at + width + 8, scale)
    b, c = e10 - e00, e01 - e00
    return e00, b, c, (e11 - e10) - c


@inlined
def store_sides(to, u, v):
    """Lines of eight cells from two times a, b, c, d, in the precision of particles: a and c of both, then b and d."""
    store_lines(to, (convert(R8, u[0]), convert(R8, v[0]), convert(R8, u[2]), convert(R8, v[2]),
                     convert(R8, u[1]), convert(R8, v[1]), convert(R8, u[3]), convert(R8, v[3])))  # fmt: skip


@kernel
def spread_cube(at, width, plane, scale, to):
    """Store a, b, c, d of eight cells of a plane, and what a, b, c, d of the plane above them have more."""
    low, high = coefficients(at, width, scale), coefficients(at + plane, width, scale)
    store_sides(to, low, less(high, low))


@inlined
def two_at(lines, cells, g):
    """a + b f + (c + d f) g of both that are in the lines; f stands ROW behind `cells`."""
    u = gather_sides(F, lines, cells, cells + ROW)
    return fma(g, u[2], u[0]), fma(g, u[3], u[1])


@inlined
def field_at(lines, cells, place):
    """E of a pack, as many components as there are axes, at (f, g, h) in the cells whose lines are at `lines` +
    (integers at address `cells`); see push.find_lines.
    """
    f, g, h = place
    if DIM == 1:
        u = gather_lines(F, 2, lines, load_at(I, cells, 64))
        e = fma(f, u[1], u[0])
        return e, e, e
    u = two_at(lines, cells, g)
    if DIM == 2:
        return u[0], u[1], u[0]
    v, w = two_at(lines + ALONG, cells, g), two_at(lines + 2 * ALONG, cells, g)
    return fma(h, u[1], u[0]), fma(h, v[1], v[0]), fma(h, w[1], w[0])


@inlined
def add_charge(sums, cells, place, unit, whole):
    """Charge of a pack to the sums of its cells: of parts, times f, times g, times f g, and these times h."""
    f, g, h = place
    along = share_of(f, unit)
    if DIM == 1:
        add_lines(sums, load_at(I, cells, 64), (whole, along))
    elif DIM == 2:
        add_sums(sums, cells, (whole, along, share_of(g, unit), share_of(f, g * unit)))
    else:
        up = h * unit
        add_sums(sums, cells, (whole, along, share_of(g, unit), share_of(f, g * unit),
                               share_of(h, unit), share_of(f, up), share_of(g, up), share_of(f, g * up)))  # fmt: skip


@inlined
def share_of(a, unit):
    """The product of shares and numbers of parts, as whole numbers."""
    return bits_of(fma(a, unit, MAGIC)) - MAGIC_BITS


@inlined
def corners_of(at):
    """Charge at the corners of eight cells from their sums, which are zeroed; those of a plane, then of the next."""
    none = splat(P8, 0)
    if DIM == 1:
        u = gather_lines(P8, 2, at, lane_numbers(WIDE) * SUM)
        low, high = (u[0], u[1], none, none), (none, none, none, none)
    elif DIM == 2:
        low, high = load_sums(P8, at), (none, none, none, none)
    else:
        u = gather_lines(P8, 8, at, lane_numbers(WIDE) * SUM)
        low, high = (u[0], u[1], u[2], u[3]), (u[4], u[5], u[6], u[7])
    for c in range(CORNERS):
        store_at(at + 8 * SIZE * c, none, SUM)
    both, above = four_of(low), four_of(high)
    return less(both, above), above


@inlined
def four_of(sums):
    """Charge at four corners from sums of parts, times f, times g, times f g."""
    whole, along, across, both = widened(sums[0]), widened(sums[1]), widened(sums[2]), widened(sums[3])
    return (whole - along) - (across - both), along - both, across - both, both


@kernel
def gather_sums(part, grid, sums, patch, group, sign):
    """Add the corner sums of the part's cells, times sign, to the nodes of the patch, and zero them."""
    zero_bytes(sums + CELLS * SUM, sums + SUM_BYTES)
    parts, nodes, zero = grid.parts, patch.nodes, splat(WIDE, 0)
    row, column, pitch = anchor_in(part, grid, patch.corner)
    base, width = address(nodes) + group * nodes.shape[1] * nodes.shape[2] * 8, nodes.shape[2] * 8
    from_plane, to_plane = planes_of(part, parts)
    for p in range(from_plane, to_plane):
        for c in range(parts[part, 5], parts[part, 6], 8):
            at = base + (row + p * pitch + parts[part, 3]) * width + (column + c) * 8
            left = right = over_left = over_right = zero  # of the cells in the row below, and in the plane above it
            for r in range(parts[part, 3], parts[part, 4]):
                low, high = corners_of(sums + (p * LAYER + r * PITCH + c) * SUM)
                add_pairs(at, (left + low[0]) * sign, (right + low[1]) * sign)
                left, right = low[2], low[3]
                if DIM == 3:
                    add_pairs(at + pitch * width, (over_left + high[0]) * sign, (over_right + high[1]) * sign)
                    over_left, over_right = high[2], high[3]
                at += width
            if DIM > 1:
                add_pairs(at, left * sign, right * sign)
            if DIM == 3:
                add_pairs(at + pitch * width, over_left * sign, over_right * sign)
