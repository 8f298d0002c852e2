"""Quadratic shapes (TSC) by vectors: the nearest node is the cell, f and g are from -1/2 to 1/2 from it.

Between half-way points E is biquadratic: nine coefficients each of E_x and E_y, of f^a g^b. The first eight are two
lines per node, the ninths a pair (1D: two of three, and the third). The charge goes into a line of sums: of the shares
left, right, below and above of the node, and of their four products, beside one of the parts. What nine nodes get
follows from these without rounding, so that no charge is lost. In 3D there are nine coefficients for each power of h of
each component, and nine sums of the whole and of what goes to the planes on either side.
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
from hpcpic.plasma.kernels.nodal import CELLS, LAYER, PITCH
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
    planes_of,
    widened,
    zero_bytes,
)
from hpcpic.plasma.kernels.weights import MAGIC, anchor_in, parabola, parabolas, tsc_outer_weights

DIM = 2  # axes of the grid

LINE, SUM = (8 if DIM > 1 else 2) * SIZE, (8 if DIM > 1 else 4) * SIZE  # bytes of a line of coefficients, of sums
NINES = (1, 2, 9)[DIM - 1]  # lines of a node: of each component, in 3D of each power of h
ALONG, REST = (CELLS + 8) * LINE, (CELLS + 8) * LINE * NINES  # from line to line, and where the last coefficients start
REST_SHIFT = (1, 2, 3)[DIM - 1]  # from a line's place to that of the rest
REST_ALONG = (CELLS + 8) * SIZE  # from the rest of a line to that of the next, in 3D
PARTS = (CELLS + 8) * SUM  # where the sums of parts start, in 2D and 3D
SET = PARTS + (CELLS + 8) * SIZE  # from the sums of the whole to those of a plane beside, in 3D
SUM_BYTES = SET * (3 if DIM == 3 else 1)
REACH = 1  # nodes of the field below the first cell


@kernel
def spread_field(part, grid, field, lines):
    """Coefficients of the nodes of a tile part, and zero ones for parked lanes behind them."""
    parts, scale, width = grid.parts, field.scale, field.e.shape[2] * 8
    row, column, pitch = anchor_in(part, grid, field.origin)
    from_plane, to_plane = planes_of(part, parts)
    for p in range(from_plane, to_plane + DIM // 3):
        for r in range(parts[part, 3], parts[part, 4] + (DIM > 1)):
            for c in range(parts[part, 5], parts[part, 6] + 1, 8):
                at, cell = (row + p * pitch + r) * width + (column + c) * 8, p * LAYER + r * PITCH + c
                to, rest = lines + cell * LINE, lines + REST + (cell * LINE >> REST_SHIFT)
                if DIM == 1:
                    k = along_row(component(field, 0) + at, scale)
                    store_lines(to, (convert(R8, k[0]), convert(R8, k[1])))
                    store_at(rest, convert(R8, k[2]), SIZE)
                elif DIM == 2:
                    last_x = store_nine(nine_at(component(field, 0) + at, width, scale), to)
                    last_y = store_nine(nine_at(component(field, 1) + at, width, scale), to + ALONG)
                    store_lines(rest, (last_x, last_y))
                else:
                    for axis in range(3):
                        here, more = component(field, axis) + at, 3 * axis
                        spread_cube(here, width, pitch * width, scale, to + more * ALONG, rest + more * REST_ALONG)
    for k in range(NINES):
        zero_bytes(lines + k * ALONG + CELLS * LINE, lines + (k + 1) * ALONG)
    for k in range(9 if DIM == 3 else 1):
        first = lines + REST + k * REST_ALONG
        zero_bytes(first + (CELLS * LINE >> REST_SHIFT), first + ((CELLS + 8) * LINE >> REST_SHIFT))


@inlined
def along_row(at, scale):
    """Coefficients of 1, f, f^2 of eight nodes from an address on."""
    return parabola(field_on(at - 8, scale), field_on(at, scale), field_on(at + 8, scale))


@kernel
def nine_at(at, width, scale):
    """Coefficients of f^a g^b of eight nodes, those of the powers of f first."""
    below, here, above = along_row(at - width, scale), along_row(at, scale), along_row(at + width, scale)
    a, b = parabola(below[0], here[0], above[0]), parabola(below[1], here[1], above[1])
    c = parabola(below[2], here[2], above[2])
    return a[0], b[0], c[0], a[1], b[1], c[1], a[2], b[2], c[2]


@inlined
def store_nine(k, to):
    """Eight coefficients of each of eight nodes to its line, the ones of f^2 g^2 as result."""
    store_lines(to, (convert(R8, k[0]), convert(R8, k[1]), convert(R8, k[2]), convert(R8, k[3]),
                     convert(R8, k[4]), convert(R8, k[5]), convert(R8, k[6]), convert(R8, k[7])))  # fmt: skip
    return convert(R8, k[8])


@kernel
def spread_cube(at, width, plane, scale, to, rest):
    """Coefficients of a component about eight nodes: of 1, h and h^2, nine each."""
    low, mid, high = nine_at(at - plane, width, scale), nine_at(at, width, scale), nine_at(at + plane, width, scale)
    a, b, c = parabolas(low, mid, high)
    store_at(rest, store_nine(a, to), SIZE)
    store_at(rest + REST_ALONG, store_nine(b, to + ALONG), SIZE)
    store_at(rest + 2 * REST_ALONG, store_nine(c, to + 2 * ALONG), SIZE)


@inlined
def field_at(lines, cells, place):
    """E of a pack, as many components as there are axes, at (f, g, h) from the nodes whose lines are at `lines` +
    (integers at address `cells`).
    """
    f, g, h = place
    rest = lines + MAGIC_BITS + REST - (MAGIC_BITS >> REST_SHIFT)
    if DIM == 1:
        u, w = gather_values(F, 2, lines, cells, 0), gather_values(F, 1, rest, cells, REST_SHIFT)
        e = fma(f, fma(f, w[0], u[1]), u[0])
        return e, e, e
    if DIM == 3:
        y, z = 3 * ALONG, 6 * ALONG
        return (cubic_of(lines, rest, cells, f, g, h), cubic_of(lines + y, rest + 3 * REST_ALONG, cells, f, g, h),
                cubic_of(lines + z, rest + 6 * REST_ALONG, cells, f, g, h))  # fmt: skip
    w = gather_values(F, 2, rest, cells, REST_SHIFT)
    ex = biquadratic_of(gather_field(F, lines, cells), w[0], f, g)
    return ex, biquadratic_of(gather_field(F, lines + ALONG, cells), w[1], f, g), ex


@inlined
def cubic_of(lines, rest, cells, f, g, h):
    """A component: the sum of its coefficients times f^a g^b h^c."""
    a, b, c = (nine_of(lines, rest, cells, f, g), nine_of(lines + ALONG, rest + REST_ALONG, cells, f, g),
               nine_of(lines + 2 * ALONG, rest + 2 * REST_ALONG, cells, f, g))  # fmt: skip
    return fma(h, fma(h, c, b), a)


@inlined
def nine_of(lines, rest, cells, f, g):
    """The sum of nine coefficients of each node times f^a g^b."""
    last = gather_values(F, 1, rest, cells, 3)[0]
    return biquadratic_of(gather_field(F, lines, cells), last, f, g)


@inlined
def biquadratic_of(u, last, f, g):
    """Sum of coefficients times f^a g^b."""
    line = fma(f, fma(f, last, u[7]), u[6])
    line = fma(g, line, fma(f, fma(f, u[5], u[4]), u[3]))
    return fma(g, line, fma(f, fma(f, u[2], u[1]), u[0]))


@inlined
def add_charge(sums, cells, place, unit, whole):
    """Charge of a pack to the sums of its nodes."""
    f, g, h = place
    u = tsc_outer_weights(f)
    if DIM == 1:
        add_sums(sums, cells, (whole, share(u[0], unit), share(u[1], unit), splat(I, 0)))
    else:
        v = tsc_outer_weights(g)
        add_nine(sums, cells, u, v, unit, whole)
        if DIM == 3:
            w = tsc_outer_weights(h)
            under, over = w[0] * unit, w[1] * unit
            add_nine(sums + SET, cells, u, v, under, whole_of(under))
            add_nine(sums + 2 * SET, cells, u, v, over, whole_of(over))


@inlined
def add_nine(sums, cells, u, v, unit, whole):
    """Charge of a pack, or what of it goes to a plane, to the sums of its nodes, by the outer weights along x and y."""
    below, above = v[0] * unit, v[1] * unit
    add_sums(sums, cells, (
        share(u[0], unit), share(u[1], unit), whole_of(below), whole_of(above),
        share(u[0], below), share(u[1], below), share(u[0], above), share(u[1], above),
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
    for first in range(sums, sums + SUM_BYTES, SET):
        zero_bytes(first + CELLS * SUM, first + (CELLS + 8) * SUM)
        zero_bytes(first + PARTS + CELLS * SIZE, first + SET)
    parts, nodes = grid.parts, patch.nodes
    row, column, pitch = anchor_in(part, grid, patch.corner)
    row += parts[part, 3]
    base, width = address(nodes) + group * nodes.shape[1] * nodes.shape[2] * 8, nodes.shape[2] * 8
    if DIM == 3:
        gather_planes(part, parts, sums, base + row * width + column * 8, width, pitch * width, sign)
        return
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


@kernel
def gather_planes(part, parts, sums, first, width, plane, sign):
    """gather_sums in 3D, from the address of the node at the part's first row and its anchor's column and plane on."""
    for p in range(parts[part, 9], parts[part, 10] + 1):
        for r in range(parts[part, 3], parts[part, 4] + 1):
            for c in range(parts[part, 5], parts[part, 6] + 1, 8):
                at = first + p * plane + (r - parts[part, 3]) * width + c * 8
                cell = p * LAYER + r * PITCH + c
                under, over = neighbours_of(sums + SET, cell), neighbours_of(sums + 2 * SET, cell)
                all_planes = neighbours_of(sums, cell)
                add_nodes(at - plane, width, under, sign)
                add_nodes(at + plane, width, over, sign)
                add_nodes(at, width, all_planes, sign)
                add_nodes(at, width, under, -sign)
                add_nodes(at, width, over, -sign)


@kernel
def add_nodes(at, width, n, sign):
    """Add what neighbours_of gives, times sign, to the rows about an address."""
    add_triples(at - width, n[0] * sign, n[1] * sign, n[2] * sign)
    add_triples(at, n[3] * sign, n[4] * sign, n[5] * sign)
    add_triples(at + width, n[6] * sign, n[7] * sign, n[8] * sign)
