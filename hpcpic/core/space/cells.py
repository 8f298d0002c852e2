"""Cell lists: points in two or three dimensions sorted by (cell, id), and the pairs of close ones."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.simd.compile import njit


class CellList:
    """Points x[n, d] of the box [low, high) in cells of at least `size`; empty cells take no memory.

    order[n]: point numbers by (cell, id), so the same whatever order the points came in.
    cells[m]: numbers of the occupied cells, ascending, first axis slowest; start[m + 1]: ranges in `order`.
    """

    def __init__(
        self,
        low: Sequence[float],
        high: Sequence[float],
        size: float,
        periodic: Sequence[bool],
    ) -> None:
        self.low = np.asarray(low, np.float64)
        self.lengths = np.asarray(high, np.float64) - self.low
        self.periodic = np.asarray(periodic, np.bool_)
        self.shape = np.maximum(1, np.floor(self.lengths / size)).astype(np.int64)
        self.size = size
        if self.shape.astype(object).prod() >= 1 << 62:
            raise ValueError(f"cells {self.shape} are more than can be numbered")
        if np.any(self.periodic & (self.shape < 3)):
            raise ValueError(f"a periodic axis needs 3 cells of {size}: it has {self.shape}")
        offsets = np.array(np.meshgrid(*[(-1, 0, 1)] * len(self.shape), indexing="ij"))
        self._offsets = np.ascontiguousarray(offsets.reshape(len(self.shape), -1).T)

    def build(self, x: NDArray[np.float64], ids: NDArray[np.int64]) -> None:
        """Sort points x[n, d], in the box, with distinct ids[n]."""
        self.x = np.ascontiguousarray(x)
        place = np.floor((self.x - self.low) * (self.shape / self.lengths)).astype(np.int64)
        place = np.clip(place, 0, self.shape - 1)  # rounding at the upper edge
        number = np.ravel_multi_index(tuple(place.T), tuple(self.shape)).astype(np.int64)
        self.order = np.lexsort((ids, number))
        self.cells, first = np.unique(number[self.order], return_index=True)
        self.start = np.append(first, len(number)).astype(np.int64)

    def pairs(self, radius: float) -> NDArray[np.int64]:
        """Ordered pairs [m, 2] of different points closer than radius <= size, by the cell of the first."""
        if radius > self.size:
            raise ValueError(f"radius {radius} is beyond the cell size {self.size}")
        arguments = (
            *(self.x, self.order, self.cells, self.start, self.shape, self.periodic),
            *(self.lengths, self._offsets, radius * radius),
        )
        count = _find_pairs(*arguments, np.empty((0, 2), np.int64))
        found = np.empty((count, 2), np.int64)
        _find_pairs(*arguments, found)
        return found


@njit
def neighbour_cell(cell, offset, shape, periodic):
    """Number of the cell `offset` away, around periodic axes; -1 beyond the box."""
    number, stride, rest = np.int64(0), np.int64(1), cell
    for back in range(shape.size):
        axis = shape.size - 1 - back
        place = rest % shape[axis] + offset[axis]
        rest //= shape[axis]
        if place < 0 or place >= shape[axis]:
            if not periodic[axis]:
                return np.int64(-1)
            place %= shape[axis]
        number += place * stride
        stride *= shape[axis]
    return number


@njit
def distance_sq(x, a, b, lengths, periodic):
    """Square of the distance of points a and b, to the nearest image on periodic axes."""
    total = 0.0
    for axis in range(lengths.size):
        d = x[a, axis] - x[b, axis]
        if periodic[axis]:
            d -= lengths[axis] * np.rint(d / lengths[axis])
        total += d * d
    return total


@njit
def _find_pairs(x, order, cells, start, shape, periodic, lengths, offsets, radius_sq, found):
    """Number of pairs closer than the radius; they are stored in found[m, 2] if it has room."""
    count = 0
    for k in range(cells.size):
        for o in range(offsets.shape[0]):
            other = neighbour_cell(cells[k], offsets[o], shape, periodic)
            at = np.searchsorted(cells, other)
            if at == cells.size or cells[at] != other:
                continue
            for i in range(start[k], start[k + 1]):
                for j in range(start[at], start[at + 1]):
                    a, b = order[i], order[j]
                    if a != b and distance_sq(x, a, b, lengths, periodic) < radius_sq:
                        if count < found.shape[0]:
                            found[count, 0] = a
                            found[count, 1] = b
                        count += 1
    return count
