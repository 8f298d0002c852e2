"""Sizes of the array of populations: `kernels.layout` says what is where in it. Light, so that forecasts ask it too."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from hpcpic.core.simd.registers import lanes
from hpcpic.core.space.declared import Array
from lbmdem.physics.velocity_sets import Lattice

_STREAMS_BYTES, _PAGE = 192, 4096  # distance of the slots modulo a page, so that they use different sets of a cache


class Addresses(NamedTuple):
    """What `kernels.layout.element` needs to find a population: see the properties of a layout."""

    strides: NDArray[np.int64]
    slots: NDArray[np.int64]
    shifts: NDArray[np.int64]
    positions: NDArray[np.int32]


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
        """Bytes of all populations of a plane."""
        return self.lattice.q * self.plane_stride * self.itemsize

    def places(self, local: NDArray[np.int64]) -> NDArray[np.int64]:
        """Places in a slot of nodes (x, row, plane) of this slab or one beyond."""
        x, row, plane = local.T
        row = row % self.stored_rows
        if self.stored == self.planes:
            plane = plane % self.planes
        return plane * self.plane_stride + row * self.row_stride + self.lanes + x

    def arrays(self, real: str) -> tuple[Array, ...]:
        """What a rank holds of its nodes, with populations of the type `real`."""
        around = (self.planes + 2, self.rows + (0 if self.lattice.dimensions == 2 else 2), self.nx + 2)
        vectors = (self.planes, self.rows, self.vectors)
        bits = (self.planes + 2, self.rows + 2, self.vectors)
        return (
            Array("populations", (self.lattice.q, self.slot_stride), real, "", "f - w"),
            Array("solid", around, "int32", "", "ids of nodes: fluid, wall or the number of a grain"),
            Array("wet", bits, "int32", "", "bit b of a vector: its node b - 1 is fluid"),
            Array("kinds", vectors, "uint8", "", "of vectors: without fluid, all fluid, or mixed"),
            Array("hops", vectors, "int32", "", "vectors to the next with fluid, or bytes to what is fetched"),
        )

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


def place_type(elements: int) -> str:
    """Type of the places in an array, or in a part of it, of so many elements."""
    return "int32" if elements < 1 << 31 else "int64"


def sparse_arrays(lattice: Lattice, around: tuple[int, ...], real: str, places: str) -> tuple[Array, ...]:
    """What a rank holds of fluid nodes alone; see `kernels.sparse`. around: nodes of the slab with ghosts; real: type
    of the populations; places: of places among them.

    Sizes: "slot" elements for each direction, "planes" and the end of the last one, "vectors" of nodes, "blocks" of
    these, "pieces" of memory beside the first of a direction, "ruled" vectors with links that the sweep does, "ends" of
    the links of vectors, "links" and one more.
    """
    ways, mask = lattice.q - 1, "uint8" if lanes(real) <= 8 else "uint16"
    return (
        Array("populations", (lattice.q, "slot"), real, "", "f - w"),
        Array("solid", around, "int32", "", "ids of nodes: fluid, wall or the number of a grain"),
        Array("positions", around, "int32", "", "of fluid nodes, -1 of others"),
        Array("first", ("planes",), "int64", "", "vector of each plane"),
        Array("blocks", ("planes",), "int64", "", "first block of each plane"),
        Array("kinds", ("vectors",), "int8", "", "of vectors: neighbours in one piece each, or not"),
        Array("masks", ("vectors", ways, 2), mask, "", "lanes of the first piece, lanes that bounce back"),
        Array("shifts", ("vectors", ways), "int32", "", "elements from a vector to the first piece"),
        Array("rest", ("blocks",), "int64", "", "first of the other pieces of each block"),
        Array("where", ("pieces",), places, "", "element for lane 0"),
        Array("code", ("pieces",), "uint32", "", "lanes, and the place in the buffer of a block"),
        Array("ruled", ("ruled", ways), mask, "", "lanes with a link"),
        Array("linked", ("ends",), "int64", "", "first link of each vector"),
        Array("kappa", ("links",), real, "", "factors of the links"),
    )


def addresses(layout: Any) -> Addresses:
    """The addresses of a layout or a sparse layout."""
    return Addresses(layout.strides, layout.slots, layout.shifts, layout.positions)


def storage_order(lattice: Lattice, i: int) -> tuple[int, int, int]:
    """e[i] as (plane, row, x)."""
    e = lattice.velocities[i]
    return (e[1], 0, e[0]) if lattice.dimensions == 2 else (e[2], e[1], e[0])
