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

from dataclasses import dataclass

import numpy as np
from numpy.typing import DTypeLike, NDArray

from hpcpic.core.simd.jit import njit
from hpcpic.core.simd.vector import lanes
from lbmdem.lattices import Lattice

FLUID, WALL = -1, -2  # solid ids; a grain's number is its id
_STREAMS_BYTES, _PAGE = 192, 4096  # distance of the slots modulo a page, so that they use different sets of a cache


@dataclass(frozen=True)
class Layout:
    """Sizes of the array; strides are in elements. `stored`: planes with the one above, if any; rows likewise."""

    lattice: Lattice
    planes: int
    rows: int
    nx: int
    stored: int
    stored_rows: int
    itemsize: int
    lanes: int
    whole_planes = False  # waves may do a part of the rows first

    @classmethod
    def of(
        cls, lattice: Lattice, shape: tuple[int, ...], periodic: tuple[bool, ...], alone: bool, dtype: DTypeLike
    ) -> "Layout":
        """For the slab's own shape (storage order); `alone`: this rank has all planes."""
        flat = lattice.dimensions == 2
        planes, rows, nx = (shape[0], 1, shape[1]) if flat else shape
        stored = planes + (not (alone and periodic[0]))
        stored_rows = rows + (not flat and not periodic[1])
        return cls(lattice, planes, rows, nx, stored, stored_rows, np.dtype(dtype).itemsize, lanes(dtype))

    @property
    def vectors(self) -> int:
        """Vectors of a row."""
        return -(-self.nx // self.lanes)

    @property
    def row_stride(self) -> int:
        return (self.vectors + 1) * self.lanes

    @property
    def plane_stride(self) -> int:
        return self.stored_rows * self.row_stride

    @property
    def slot_stride(self) -> int:
        used = (self.stored * self.plane_stride + self.lanes) * self.itemsize
        return (used + (_STREAMS_BYTES - used) % _PAGE) // self.itemsize

    @property
    def plane_bytes(self) -> int:
        """Of all populations of a plane."""
        return self.lattice.q * self.plane_stride * self.itemsize

    @property
    def positions(self) -> NDArray[np.int32]:
        """Nodes have no numbers: their places follow from where they are."""
        return np.empty((0, 0, 0), np.int32)

    @property
    def size(self) -> int:
        """Elements of the array."""
        return self.lattice.q * self.slot_stride

    @property
    def strides(self) -> NDArray[np.int64]:
        """What `arrival` wants: [slot, plane, row stride, element of x = 0 in a row, stored planes, stored rows]."""
        steps = (self.slot_stride, self.plane_stride, self.row_stride)
        return np.array([*steps, self.lanes, self.stored, self.stored_rows], np.int64)

    @property
    def slots(self) -> NDArray[np.int64]:
        """slot[parity, i] of the arrivals."""
        even = np.arange(self.lattice.q)
        return np.array([even, self.lattice.opposite], np.int64)

    @property
    def shifts(self) -> NDArray[np.int64]:
        """shift[i, 3] in storage order (plane, row, x)."""
        shifts = np.zeros((self.lattice.q, 3), np.int64)
        for i, opposite in self.lattice.pairs:
            shifts[opposite] = storage_order(self.lattice, i)
        return shifts


def storage_order(lattice: Lattice, i: int) -> tuple[int, int, int]:
    """e[i] as (plane, row, x)."""
    e = lattice.velocities[i]
    return (e[1], 0, e[0]) if lattice.dimensions == 2 else (e[2], e[1], e[0])


@njit(inline="always")
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
    """As `arrival`, also where fluid nodes have `positions` (see `lbmdem.sparse`); of a fluid node then."""
    if positions.shape[0] == 0:
        return arrival(strides, slots, shifts, parity, z, y, x, i)
    row = y + strides[1]
    if parity:
        there = positions[z + 1 + shifts[i, 0], row + shifts[i, 1], x + 1 + shifts[i, 2]]
        if there >= 0:
            return slots[1, i] * strides[0] + there
    return i * strides[0] + positions[z + 1, row, x + 1]
