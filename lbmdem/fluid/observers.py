"""What is seen of the populations of a slab, and what sets them; the order of storage does not show."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.domain import block_ranges
from hpcpic.core.tasks.arena import Arena
from hpcpic.core.tasks.graph import Bound, Pool
from lbmdem.fluid.sparse import SparseLayout
from lbmdem.kernels import moments as kernels
from lbmdem.layout import Layout, addresses
from lbmdem.physics.velocity_sets import equilibrium


class Observers:
    """Reads and writes populations f of a layout; solid: ids of nodes with ghosts, shift[d]: see Collision.shift.

    Results have the slab's `shape` in storage order.
    """

    def __init__(self, pool: Pool, layout: Layout | SparseLayout, shape: tuple[int, ...], **arrays: NDArray) -> None:
        self._pool, self._layout, self._shape = pool, layout, shape
        self._nodes = (layout.planes, layout.rows, layout.nx)
        self._arena = arena = Arena(())
        arena.set(**arrays, ghosts=int(len(shape) == 3), places=addresses(layout), e=layout.lattice.e, first=0)
        self._none = {name: np.empty((0,) * ndim) for name, ndim in (("rho", 3), ("u", 4), ("sums", 3), ("fastest", 2))}
        self._none["h"] = np.empty((0,) * 4, arena["f"].dtype)
        arena.set(parity=0, row=0, after=0, **self._none)
        shares = [share for share in block_ranges(layout.planes, pool.threads) if share[1] > share[0]]
        self._tasks: dict[str, list[Bound]] = {
            name: [arena.bind(getattr(kernels, name), low=a, high=b) for a, b in shares]
            for name in ("write", "row_sums", "moments", "read")
        }
        self._write_row = [arena.bind(kernels.write, first="row", low="row", high="after")]

    def _each(self, name: str, parity: int, **arrays: NDArray) -> None:
        """Run a kernel on all planes; the arrays are those that it fills or reads."""
        self._arena.set(parity=parity, **arrays)
        self._pool.each(self._tasks[name])
        self._arena.set(**self._none)  # a task holds its arrays, which may be as many bytes as the populations

    def populations(self, parity: int) -> NDArray:
        """h[q, rows, ...] = f - w, zero in solid nodes; a view of [rows, ..., q]."""
        q = self._layout.lattice.q
        h = np.empty((*self._nodes, q), self._arena["f"].dtype)
        self._each("read", parity, h=h)
        return np.moveaxis(h.reshape(*self._shape, q), -1, 0)

    def set_populations(self, h: NDArray, parity: int) -> None:
        """The inverse of `populations`."""
        rows = np.ascontiguousarray(np.moveaxis(h, 0, -1), self._arena["f"].dtype)
        self._each("write", parity, h=rows.reshape(*self._nodes, self._layout.lattice.q))

    def moments(self, parity: int) -> tuple[NDArray, NDArray]:
        """Density [rows, ...] and velocity [rows, ..., d], float64; 1 and 0 in solid nodes."""
        d = self._layout.lattice.dimensions
        rho, u = np.empty(self._nodes), np.empty((*self._nodes, d))
        self._each("moments", parity, rho=rho, u=u)
        return rho.reshape(self._shape), u.reshape(*self._shape, d)

    def row_sums(self, parity: int) -> tuple[NDArray, NDArray]:
        """Sums of each row of nodes [rows of x, ...]: number of fluid nodes, sum of rho - 1, momentum (physical order),
        rho u^2 and u; and the largest u^2. Bits of a row depend on the row alone."""
        sums = np.empty((*self._nodes[:2], 3 + 2 * self._layout.lattice.dimensions))
        fastest = np.empty(sums.shape[:2])
        self._each("row_sums", parity, sums=sums, fastest=fastest)
        return sums.reshape(fastest.size, sums.shape[2]), fastest.reshape(fastest.size)

    def set_equilibrium(self, rho: Any, u: Any, parity: int) -> None:
        """Equilibrium of densities [rows, ...] and velocities [rows, ..., d] (or numbers), as `moments` then read them:
        under a force the populations have half a step of it less momentum.
        """
        lattice = self._layout.lattice
        rho = np.broadcast_to(np.asarray(rho, float), self._shape)
        u = np.zeros(lattice.dimensions) if u is None else np.asarray(u, float)
        u = np.broadcast_to(u, (*self._shape, lattice.dimensions))
        h = np.empty((1, *self._nodes[1:], lattice.q), self._arena["f"].dtype)
        self._arena.set(parity=parity, h=h)
        for row in range(self._shape[0]):  # one at a time: on the way are several arrays of its size
            before = u[row] - self._arena["shift"] / rho[row][..., None]
            h[...] = np.moveaxis(equilibrium(lattice, rho[row], before), 0, -1).reshape(h.shape)
            self._arena.set(row=row, after=row + 1)
            self._pool.each(self._write_row)
        self._arena.set(**self._none)
