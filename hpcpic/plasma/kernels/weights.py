"""How a particle reads the field and gives its charge, for every shape and number of axes: one after the other.

`where` = row and column of the anchor of the particle's tile in an array of the slab, and the rows from one plane to
the next there; x = place from the anchor in cells, zero along axes that the scene does not have.
"""

import numpy as np

from hpcpic.core.simd.vector import fma
from hpcpic.plasma.kernels.lanes import inlined

DIM = 2  # axes of the grid
NODES = 2  # of the shape along an axis: 1 NGP, 2 CIC, 3 TSC
REAL = np.float64  # precision of a particle

ZERO, HALF, ONE = REAL(0), REAL(0.5), REAL(1)
MAGIC = REAL(1.5 * 2.0 ** np.finfo(REAL).nmant)  # adding it rounds to a whole number


@inlined
def cell_and_place(x):
    """The cell of x and the place in it, from 0 to 1 (CIC); else the nearest node, and from -1/2 to 1/2."""
    cell = np.floor(x) if NODES == 2 else np.floor(x + HALF)
    return np.int64(cell), x - cell


@inlined
def tsc_outer_weights(d):
    """Weights of the nodes before and after the nearest one of TSC, at d from it."""
    before, after = HALF - d, HALF + d
    return HALF * (before * before), HALF * (after * after)


@inlined
def parabola(before, here, after):
    """Coefficients of 1, d, d^2 of what TSC makes of the values on three nodes."""
    both = before + after
    return fma(both, 0.125, here * 0.75), (after - before) * 0.5, fma(both, 0.5, -here)


@inlined
def along_row_of(e, row, i, scale):
    """Coefficients (see parabola) about node i of a row."""
    return parabola(e[row, i - 1] * scale, e[row, i] * scale, e[row, i + 1] * scale)


@inlined
def quadratic(k, d):
    """k[0] + k[1] d + k[2] d^2."""
    return fma(d, fma(d, REAL(k[2]), REAL(k[1])), REAL(k[0]))


@inlined
def nine_about(e, row, i, scale):
    """Coefficients (see parabola) of g^b f^a about node i of a row, those of f first."""
    low, mid = along_row_of(e, row - 1, i, scale), along_row_of(e, row, i, scale)
    high = along_row_of(e, row + 1, i, scale)
    a, b, c = parabola(low[0], mid[0], high[0]), parabola(low[1], mid[1], high[1]), parabola(low[2], mid[2], high[2])
    return a[0], b[0], c[0], a[1], b[1], c[1], a[2], b[2], c[2]


@inlined
def biquadratic(k, f, g):
    """The sum of coefficients (see nine_about) times f^a g^b."""
    line = quadratic((k[6], k[7], k[8]), f)
    line = fma(g, line, quadratic((k[3], k[4], k[5]), f))
    return fma(g, line, quadratic((k[0], k[1], k[2]), f))


@inlined
def four_about(e, row, i, scale):
    """a, b, c, d of a cell whose lower left node is i of a row: E = a + b f + (c + d f) g."""
    e00, e10, e01, e11 = e[row, i] * scale, e[row, i + 1] * scale, e[row + 1, i] * scale, e[row + 1, i + 1] * scale
    b, c = e10 - e00, e01 - e00
    return e00, b, c, (e11 - e10) - c


@inlined
def bilinear(k, f, g):
    """a + b f + (c + d f) g."""
    return fma(g, fma(f, REAL(k[3]), REAL(k[2])), fma(f, REAL(k[1]), REAL(k[0])))


@inlined
def less(p, q):
    """Four numbers less four others."""
    return p[0] - q[0], p[1] - q[1], p[2] - q[2], p[3] - q[3]


@inlined
def gather(field, axis, where, x):
    """A component of E at the particle (5.14). CIC in the form a + b f + (c + d f) g, in 3D of planes: P + Q h."""
    e, scale = field.e[axis], field.scale
    i, f = cell_and_place(x[0])
    i, j = i + where[1], where[0]
    if DIM == 1 and NODES == 1:
        return REAL(e[j, i] * scale)
    if DIM == 1 and NODES == 2:
        left, right = e[j, i] * scale, e[j, i + 1] * scale
        return fma(f, REAL(right - left), REAL(left))
    if DIM == 1:
        return quadratic(along_row_of(e, j, i, scale), f)
    along_y, g = cell_and_place(x[1])
    j += along_y
    if DIM == 2 and NODES == 1:
        return REAL(e[j, i] * scale)
    if DIM == 2 and NODES == 2:
        return bilinear(four_about(e, j, i, scale), f, g)
    if DIM == 2:
        return biquadratic(nine_about(e, j, i, scale), f, g)
    along_z, h = cell_and_place(x[2])
    pitch = where[2]
    j += along_z * pitch
    if NODES == 1:
        return REAL(e[j, i] * scale)
    if NODES == 2:
        low = four_about(e, j, i, scale)
        return fma(h, bilinear(less(four_about(e, j + pitch, i, scale), low), f, g), bilinear(low, f, g))
    low, mid = nine_about(e, j - pitch, i, scale), nine_about(e, j, i, scale)
    a, b, c = parabolas(low, mid, nine_about(e, j + pitch, i, scale))
    return fma(h, fma(h, biquadratic(c, f, g), biquadratic(b, f, g)), biquadratic(a, f, g))


@inlined
def parabolas(low, mid, high):
    """Coefficients of 1, of h and of h^2 from those of nine_about in three planes, one above the other."""
    p, q, r = parabola(low[0], mid[0], high[0]), parabola(low[1], mid[1], high[1]), parabola(low[2], mid[2], high[2])
    s, t, u = parabola(low[3], mid[3], high[3]), parabola(low[4], mid[4], high[4]), parabola(low[5], mid[5], high[5])
    v, w, x = parabola(low[6], mid[6], high[6]), parabola(low[7], mid[7], high[7]), parabola(low[8], mid[8], high[8])
    return ((p[0], q[0], r[0], s[0], t[0], u[0], v[0], w[0], x[0]),
            (p[1], q[1], r[1], s[1], t[1], u[1], v[1], w[1], x[1]),
            (p[2], q[2], r[2], s[2], t[2], u[2], v[2], w[2], x[2]))  # fmt: skip


@inlined
def parts_of(a, b):
    """The product of a share and a number of parts, as a whole number."""
    return np.int64(fma(a, b, MAGIC) - MAGIC)


@inlined
def deposit(patch, group, unit, where, x):
    """Charge of one particle (5.1), `unit` parts in all, exactly."""
    whole, nodes = REAL(unit), patch[group]
    i, f = cell_and_place(x[0])
    j, g = (np.int64(0), ZERO) if DIM == 1 else cell_and_place(x[1])
    i, j = i + where[1], j + where[0]
    if DIM == 3:
        along_z, h = cell_and_place(x[2])
        deposit_planes(nodes, unit, j + along_z * where[2], i, where[2], f, g, h)
    elif NODES == 1:
        nodes[j, i] += unit
    elif NODES == 2 and DIM == 1:
        along = parts_of(f, whole)
        nodes[j, i] += unit - along
        nodes[j, i + 1] += along
    elif NODES == 2:
        add_four(nodes, j, i, shares_of_four(unit, whole, f, g))
    else:
        deposit_nine(nodes, unit, whole, j, i, f, g, 1)


@inlined
def deposit_planes(nodes, unit, j, i, pitch, f, g, h):
    """Charge of one particle in 3D. The plane at j gets what the others, `pitch` rows away, leave of the whole."""
    whole = REAL(unit)
    if NODES == 1:
        nodes[j, i] += unit
    elif NODES == 2:
        low, high = shares_of_four(unit, whole, f, g), shares_of_four(parts_of(h, whole), h * whole, f, g)
        add_four(nodes, j, i, less(low, high))
        add_four(nodes, j + pitch, i, high)
    else:
        deposit_nine(nodes, unit, whole, j, i, f, g, 1)
        for w, step in zip(tsc_outer_weights(h), (-pitch, pitch)):
            share = w * whole
            parts = parts_of(share, ONE)
            deposit_nine(nodes, parts, share, j + step, i, f, g, 1)
            deposit_nine(nodes, parts, share, j, i, f, g, -1)


@inlined
def shares_of_four(unit, whole, f, g):
    """Parts for the corners (0, 0), (1, 0), (0, 1), (1, 1) of `unit` parts, which are `whole` before rounding."""
    along, across, both = parts_of(f, whole), parts_of(g, whole), parts_of(f, g * whole)
    return unit - along - across + both, along - both, across - both, both


@inlined
def add_four(nodes, j, i, k):
    """Add four numbers of parts to the corners of a cell whose lower left node is (j, i)."""
    nodes[j, i] += k[0]
    nodes[j, i + 1] += k[1]
    nodes[j + 1, i] += k[2]
    nodes[j + 1, i + 1] += k[3]


@inlined
def deposit_nine(nodes, unit, whole, j, i, f, g, sign):
    """Charge of one particle by TSC about node (j, i), times sign: what the node and those in line with it get are
    differences. `unit` parts in all, which are `whole` before rounding.
    """
    u = tsc_outer_weights(f)
    left, right = parts_of(u[0], whole), parts_of(u[1], whole)
    if DIM > 1:
        for w, step in zip(tsc_outer_weights(g), (-1, 1)):
            share = w * whole
            row, at_left, at_right = parts_of(share, ONE), parts_of(u[0], share), parts_of(u[1], share)
            nodes[j + step, i - 1] += sign * at_left
            nodes[j + step, i] += sign * (row - at_left - at_right)
            nodes[j + step, i + 1] += sign * at_right
            unit, left, right = unit - row, left - at_left, right - at_right
    nodes[j, i - 1] += sign * left
    nodes[j, i] += sign * (unit - left - right)
    nodes[j, i + 1] += sign * right


@inlined
def anchor_in(part, grid, first):
    """Row and column of a part's anchor in an array of the slab (see groups) whose first node is `first`, and the rows
    between its planes.
    """
    row = grid.parts[part, 1] - first[0]
    if DIM == 3:
        row += (grid.parts[part, 8] - first[2]) * grid.pitch
    return row, grid.parts[part, 2] - first[1], np.int64(grid.pitch)
