"""Where populations are: the in-place "esoteric pull" (Lehmann 2022), one array for all steps.

Populations are stored without their weight, h = f - w. The array is f[q][plane][row][x], flat, of the storage axes
(z, y, x); in 2D (y, 1, x). Between steps every population f_i(x) of a node x, the one that has ARRIVED there, has one
element of its own, and nobody else reads it:

    arrival(x, i) at parity p = slot[p, i] of the node x + shift[i]

    i odd (pointing to larger storage indices): shift 0,        slot i     when p = 0, i + 1 when p = 1
    i even, not 0 (its opposite, -e[i - 1]):    shift e[i - 1], slot i     when p = 0, i - 1 when p = 1
    i = 0: slot 0, shift 0

p is the parity of the number of steps done. A step takes the arrivals of x at p and writes its post-collision values
g_i(x) to the arrivals at 1 - p

    of (x + e_i, i)                    when x + e_i is fluid,
    of (x, opposite of i)              when x + e_i is solid: bounced back half-way; other wall rules then read this
                                       element (it is g_i(x)) and overwrite it with what they want to arrive at x.

So after the collision of the step from n to n + 1, with p' = (n + 1) % 2, on a link from the fluid node x along e_i to
a solid one, with the next fluid node y = x - e_i and j the opposite of i:

    g_i(x)  =  arrival(x, j) at p'     (to be replaced by the value that arrives at x)
    g_i(y)  =  arrival(x, i) at p'
    g_j(x)  =  arrival(y, j) at p'

and all three are elements that this rank holds, also at the edges of its slab. Elements of solid nodes mean nothing.
What a node collides with is written by nobody else, so nodes may be done in any order and by any thread.

Rows: an element before x = 0 and one after x = nx - 1 (x = -1 and nx) are there, and hold what the formulas above say
when x + shift is outside; periodic copies are made by the step itself. The row axis of the storage wraps, row -1 is the
last stored one. When it is not periodic, one more row is stored than there are, which keeps the walls at both ends
apart. So with planes: one rank that has all planes of a periodic axis stores just these, else there is one more above,
which messages fill when it belongs to another rank. Never one below: shifts point up.
"""

from hpcpic.core.simd.compile import njit
from lbmdem.layout import Layout, storage_order

__all__ = ["FLUID", "WALL", "Layout", "arrival", "element", "place", "storage_order"]

FLUID, WALL = -1, -2  # solid ids; a grain's number is its id


@njit(forceinline=True)
def place(strides, plane, row):
    """Element of x = 0 in a slot; rows wrap, planes too when this rank has all. strides: `Layout.strides`."""
    if plane == strides[4]:
        plane = 0
    if row == strides[5]:
        row = 0
    elif row < 0:
        row = strides[5] - 1
    return plane * strides[1] + row * strides[2] + strides[3]


@njit
def arrival(strides, slots, shifts, parity, z, y, x, i):
    """Index in the flat array of f_i at the node (z, y, x) of this rank, 0 <= z < planes and so on."""
    return slots[parity, i] * strides[0] + place(strides, z + shifts[i, 0], y + shifts[i, 1]) + x + shifts[i, 2]


@njit
def element(strides, slots, shifts, positions, parity, z, y, x, i):
    """Place of a population that arrives, as `arrival`, also where fluid nodes have `positions` (see
    `lbmdem.kernels.sparse`); of a fluid node then.
    """
    if positions.shape[0] == 0:
        return arrival(strides, slots, shifts, parity, z, y, x, i)
    row = y + strides[1]
    if parity:
        there = positions[z + 1 + shifts[i, 0], row + shifts[i, 1], x + 1 + shifts[i, 2]]
        if there >= 0:
            return slots[1, i] * strides[0] + there
    return i * strides[0] + positions[z + 1, row, x + 1]
