"""Quadratic shapes (TSC) by vectors: the nearest node is the cell, f and g are from -1/2 to 1/2 from it.

Between half-way points E is biquadratic: nine coefficients each of E_x and E_y, of f^a g^b. The first eight are two
lines per node, the ninths a pair (1D: two of three, and the third). The charge goes into a line of sums: of the shares
left, right, below and above of the node, and of their four products, beside one of the parts. What nine nodes get
follows from these without rounding, so that no charge is lost.
"""

from hpcpic.core.simd.vector import (
    convert,
    fma,
    gather_lines,
    lane_numbers,
    load_at,
    splat,
    store_at,
    store_lines,
)
from hpcpic.plasma.kernels.cell_lines import add_sums, add_whole, gather_field, gather_values, load_sums
from hpcpic.plasma.kernels.lanes import address, bits_of, inlined, kernel
from hpcpic.plasma.kernels.nodal import CELLS, PITCH
from hpcpic.plasma.kernels.simd_base import (
    EIGHT,
    MAGIC_BITS,
    P8,
    R8,
    SIZE,
    WIDE,
    F,
    I,
    add_triples,
    component,
    field_on,
    widened,
    zero_bytes,
)
from hpcpic.plasma.kernels.weights import MAGIC, anchor_in, parabola, tsc_outer_weights

DIM = 2  # axes of the grid

LINE, SUM = (8 if DIM == 2 else 2) * SIZE, (8 if DIM == 2 else 4) * SIZE  # bytes of a line of coefficients, of sums
ALONG_Y, REST = (CELLS + 8) * LINE, (CELLS + 8) * LINE * DIM  # where the lines of E_y start, and the last coefficients
REST_SHIFT = 2 if DIM == 2 else 1  # from a line's place to that of the rest
PARTS = (CELLS + 8) * SUM  # where the sums of parts start, in 2D
SUM_BYTES = PARTS + (CELLS + 8) * SIZE
REACH = 1  # nodes of the field below the first cell


@kernel
def spread_field(part, grid, field, lines):
    """Coefficients of the nodes of a tile part, and zero ones for parked lanes behind them."""
    parts, scale, width = grid.parts, field.scale, field.e.shape[2] * 8
    row, column, _ = anchor_in(part, grid, field.origin)
    for r in range(parts[part, 3], parts[part, 4] + DIM - 1):
        for c in range(parts[part, 5], parts[part, 6] + 1, 8):
            at = (row + r) * width + (column + c) * 8
            to, rest = lines + (r * PITCH + c) * LINE, lines + REST + ((r * PITCH + c) * LINE >> REST_SHIFT)
            if DIM == 1:
                k = along_row(component(field, 0) + at, scale)
                store_lines(to, (convert(R8, k[0]), convert(R8, k[1])))
                store_at(rest, convert(R8, k[2]), SIZE)
            else:
                last_x = spread_nine(component(field, 0) + at, width, scale, to)
                store_lines(rest, (last_x, spread_nine(component(field, 1) + at, width, scale, to + ALONG_Y)))
    for first in range(0, DIM * ALONG_Y, ALONG_Y):
        zero_bytes(lines + first + CELLS * LINE, lines + first + (CELLS + 8) * LINE)
    zero_bytes(lines + REST + (CELLS * LINE >> REST_SHIFT), lines + REST + ((CELLS + 8) * LINE >> REST_SHIFT))


@inlined
def along_row(at, scale):
    """Coefficients of 1, f, f^2 of eight nodes from an address on."""
    return parabola(field_on(at - 8, scale), field_on(at, scale), field_on(at + 8, scale))


@kernel
def spread_nine(at, width, scale, to):
    """Coefficients of f^a g^b of eight nodes: eight of each to its line, the ones of f^2 g^2 as result."""
    below, here, above = along_row(at - width, scale), along_row(at, scale), along_row(at + width, scale)
    a, b = parabola(below[0], here[0], above[0]), parabola(below[1], here[1], above[1])
    c = parabola(below[2], here[2], above[2])
    store_lines(to, (convert(R8, a[0]), convert(R8, b[0]), convert(R8, c[0]), convert(R8, a[1]),
                     convert(R8, b[1]), convert(R8, c[1]), convert(R8, a[2]), convert(R8, b[2])))  # fmt: skip
    return convert(R8, c[2])


@inlined
def field_at(lines, cells, place):
    """E of a pack, as many components as there are axes, at (f, g) from the nodes whose lines are at `lines` +
    (integers at address `cells`).
    """
    f, g, _ = place
    rest = lines + MAGIC_BITS + REST - (MAGIC_BITS >> REST_SHIFT)
    if DIM == 1:
        u, w = gather_values(F, 2, lines, cells, 0), gather_values(F, 1, rest, cells, REST_SHIFT)
        e = fma(f, fma(f, w[0], u[1]), u[0])
        return e, e, e
    w = gather_values(F, 2, rest, cells, REST_SHIFT)
    ex = biquadratic_of(gather_field(F, lines, cells), w[0], f, g)
    return ex, biquadratic_of(gather_field(F, lines + ALONG_Y, cells), w[1], f, g), ex


@inlined
def biquadratic_of(u, last, f, g):
    """Sum of coefficients times f^a g^b."""
    line = fma(f, fma(f, last, u[7]), u[6])
    line = fma(g, line, fma(f, fma(f, u[5], u[4]), u[3]))
    return fma(g, line, fma(f, fma(f, u[2], u[1]), u[0]))


@inlined
def add_charge(sums, cells, place, unit, whole):
    """Charge of a pack to the sums of its nodes."""
    f, g, _ = place
    left, right = tsc_outer_weights(f)
    parts_left, parts_right = whole_of(left * unit), whole_of(right * unit)
    if DIM == 1:
        add_sums(sums, cells, (whole, parts_left, parts_right, splat(I, 0)))
    else:
        below, above = tsc_outer_weights(g)
        below, above = below * unit, above * unit
        add_sums(sums, cells, (
            parts_left, parts_right, whole_of(below), whole_of(above),
            share(left, below), share(right, below), share(left, above), share(right, above),
        ))  # fmt: skip
        add_whole(sums + MAGIC_BITS + PARTS - (MAGIC_BITS >> 3), cells, 3, whole)


@inlined
def share(a, b):
    """The product of shares and numbers of parts, as whole numbers."""
    return bits_of(fma(a, b, MAGIC)) - MAGIC_BITS


@inlined
def whole_of(a):
    """Numbers of parts as whole numbers."""
    return bits_of(a + MAGIC) - MAGIC_BITS


@inlined
def neighbours_of(sums, cell):
    """Charge for the nodes left, at and right of eight nodes, in the rows below, here and above; sums are zeroed."""
    at = sums + cell * SUM
    if DIM == 1:
        whole, left, right, _ = load_sums(P8, at)
        for c in range(4):
            store_at(at + EIGHT * c, splat(P8, 0), SUM)
        whole, left, right, zero = widened(whole), widened(left), widened(right), splat(WIDE, 0)
        return zero, zero, zero, left, whole - left - right, right, zero, zero, zero
    u = gather_lines(P8, 8, at, lane_numbers(WIDE) * SUM)
    whole = widened(load_at(P8, sums + PARTS + cell * SIZE, SIZE))
    for c in range(8):
        store_at(at + SUM * c, splat(P8, 0), SUM)
    store_at(sums + PARTS + cell * SIZE, splat(P8, 0), SIZE)
    below, above = widened(u[2]), widened(u[3])
    low_left, low_right, high_left, high_right = widened(u[4]), widened(u[5]), widened(u[6]), widened(u[7])
    left, right = widened(u[0]) - low_left - high_left, widened(u[1]) - low_right - high_right
    return (low_left, below - low_left - low_right, low_right,
            left, whole - left - right - below - above, right,
            high_left, above - high_left - high_right, high_right)  # fmt: skip


@kernel
def gather_sums(part, grid, sums, patch, group, sign):
    """Add the charge that the part's nodes have for their neighbours, times sign, to the patch, and zero the sums."""
    zero_bytes(sums + CELLS * SUM, sums + (CELLS + 8) * SUM)
    zero_bytes(sums + PARTS + CELLS * SIZE, sums + PARTS + (CELLS + 8) * SIZE)
    parts, nodes = grid.parts, patch.nodes
    row, column, _ = anchor_in(part, grid, patch.corner)
    row += parts[part, 3]
    base, width = address(nodes) + group * nodes.shape[1] * nodes.shape[2] * 8, nodes.shape[2] * 8
    zero = splat(WIDE, 0)
    for c in range(parts[part, 5], parts[part, 6] + 1, 8):
        at = base + (row + 1 - DIM) * width + (column + c) * 8
        l0 = m0 = r0 = l1 = m1 = r1 = zero  # of the rows below, for the row at `at` and for the next
        for r in range(parts[part, 3], parts[part, 4] + DIM - 1):
            n = neighbours_of(sums, r * PITCH + c)
            if DIM == 2:
                add_triples(at, (l0 + n[0]) * sign, (m0 + n[1]) * sign, (r0 + n[2]) * sign)
                l0, m0, r0, l1, m1, r1 = l1 + n[3], m1 + n[4], r1 + n[5], n[6], n[7], n[8]
            else:
                add_triples(at, n[3] * sign, n[4] * sign, n[5] * sign)
            at += width
        if DIM == 2:
            add_triples(at, l0 * sign, m0 * sign, r0 * sign)
            add_triples(at + width, l1 * sign, m1 * sign, r1 * sign)
