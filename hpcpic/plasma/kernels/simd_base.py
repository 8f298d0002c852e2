"""What the vector kernels of all shapes are made of: the vectors of a pack, and how charge is added to nodes.

A shape (kernels.nearest, linear, quadratic) tells how the field of a tile part becomes a line of coefficients per
cell, and how the charge is added up in a line of sums per cell: `spread_field`, `field_at`, `add_charge` and
`gather_sums`, with `cell_of` and where a cell's lines are: cell x + PITCH cell y + LAYER cell z, CELLS in all, and
behind them those of lanes that hold no particle or one that left, at rest on EDGE. The nearest node is the cell of odd
orders.
"""

import numpy as np

from hpcpic.core.simd.vector import Vec, convert, load_at, splat, store_at
from hpcpic.plasma.kernels.cell_lines import add_first, add_last, shifted_down, shifted_up
from hpcpic.plasma.kernels.lanes import address, inlined, kernel
from hpcpic.plasma.kernels.storage import LANES, PAGE
from hpcpic.plasma.kernels.weights import MAGIC

DIM = 2  # axes of the grid
REAL = np.float64  # precision of a particle

SIZE = np.dtype(REAL).itemsize
PART = np.int64 if SIZE == 8 else np.int32  # of the sums of a cell
F, I, WIDE = Vec(LANES, REAL), Vec(LANES, PART), Vec(8, np.int64)
HALF_F, HALF_I = Vec(LANES // 2, REAL), Vec(LANES // 2, PART)
E8, R8, P8 = Vec(8, np.float64), Vec(8, REAL), Vec(8, PART)
MAGIC_BITS = int(np.array(MAGIC).view(PART))
EIGHT, ROW = 8 * SIZE, PAGE * SIZE  # bytes: eight numbers, one for each particle of a page
UNSIGNED = 2**32 - 1 if SIZE == 4 else -1  # bits of a sum


@inlined
def position_at(kind, at):
    """x, y, z of one pack, or as many of its lanes as the vectors `kind` have; zero along axes that the scene does not
    have.
    """
    y = z = splat(kind, 0.0)
    if DIM > 1:
        y = load_at(kind, at + 64, 32)
    if DIM == 3:
        z = load_at(kind, at + 128, 32)
    return load_at(kind, at, 32), y, z


@inlined
def planes_of(part, parts):
    """The planes of a part from and to, relative to its anchor; one where the scene has no third axis."""
    if DIM == 3:
        return parts[part, 9], parts[part, 10]
    return np.int64(0), np.int64(1)


@inlined
def component(field, axis):
    """Address of E along an axis."""
    return address(field.e) + axis * field.e.shape[1] * field.e.shape[2] * 8


@inlined
def field_on(at, scale):
    """E of eight nodes from an address on, in the units of the kernels."""
    return load_at(E8, at, 8) * scale


@inlined
def widened(a):
    """Eight sums as integers of 64 bits."""
    return convert(WIDE, a) & UNSIGNED


@kernel
def zero_bytes(first, last):
    """Zeros from one address to another, eight values at a time."""
    for at in range(first, last, EIGHT):
        store_at(at, splat(P8, 0), EIGHT)


@inlined
def add_pairs(at, left, right):
    """Add to nine nodes what eight cells between them have for the left and for the right one."""
    store_at(at, load_at(WIDE, at, 8) + left + shifted_up(right), 8)
    add_last(at + 64, right)


@inlined
def add_triples(at, left, middle, right):
    """Add to eight nodes, and to one on either side, what each of the eight has for its neighbours and itself."""
    store_at(at, load_at(WIDE, at, 8) + middle + (shifted_up(right) + shifted_down(left)), 8)
    add_first(at - 8, left)
    add_last(at + 64, right)
