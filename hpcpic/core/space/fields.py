"""Values on the grid points of one slab, with ghosts around them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import DTypeLike, NDArray

from hpcpic.core.space.domain import Domain

ALIGNMENT = 64  # bytes: a cache line, and the widest vector


def aligned_zeros(shape: Sequence[int], dtype: DTypeLike) -> NDArray:
    """C-contiguous zeros that start on a cache line."""
    size = int(np.prod(shape, dtype=np.int64)) * np.dtype(dtype).itemsize
    memory = np.zeros(size + ALIGNMENT, np.uint8)
    start = -memory.ctypes.data % ALIGNMENT
    return memory[start : start + size].view(dtype).reshape(shape)


class Field:
    """Values of the rows of one rank, zero at first.

    values[*leading, rows + ghosts, other axes + ghosts, *trailing] in C order, 64-byte aligned; `inner` is
    the view without ghosts, `ghosts` the (below, above) width per axis, `rows` its (low, high) global rows.
    """

    def __init__(
        self,
        domain: Domain,
        rank: int,
        *,
        dtype: DTypeLike = np.float64,
        leading: Sequence[int] = (),
        trailing: Sequence[int] = (),
        ghosts: Sequence[tuple[int, int]] = (),
    ) -> None:
        self.domain = domain
        self.rank = rank
        self.leading = tuple(leading)
        self.trailing = tuple(trailing)
        self.ghosts = tuple(ghosts) or ((0, 0),) * domain.ndim
        if len(self.ghosts) != domain.ndim:
            raise ValueError(f"{domain.ndim} axes, but ghosts {self.ghosts}")
        self.rows = domain.row_range(rank)
        extents = [n + below + above for n, (below, above) in zip(domain.shape(rank), self.ghosts)]
        self.values = aligned_zeros((*self.leading, *extents, *self.trailing), dtype)
        window = [slice(below, below + n) for n, (below, _) in zip(domain.shape(rank), self.ghosts)]
        self.inner = self.values[(*(slice(None) for _ in self.leading), *window)]

    @property
    def dtype(self) -> np.dtype:
        return self.values.dtype

    def layers(self, axis: int) -> NDArray:
        """View [before, points + ghosts of a grid axis, after] of the values: layer k is [:, k]."""
        at = len(self.leading) + axis
        shape = self.values.shape
        before, after = (int(np.prod(part, dtype=np.int64)) for part in (shape[:at], shape[at + 1 :]))
        return self.values.reshape(before, shape[at], after)
