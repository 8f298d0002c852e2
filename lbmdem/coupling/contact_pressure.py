"""The pressure of the fluid where grains touch, which no link sees.

Round a contact the gap is thinner than a spacing: nodes of the two grains are neighbours there, with no fluid node in
between. Real fluid fills that gap at the pressure of its surroundings and pushes the grains apart, so that a pressure
which falls through a bed acts on the whole of every grain (Terzaghi). Without this force the grains inside a bed
feel too little of it, by their share of the cross-section (some 10 % at ten nodes across, of first order in the
spacing), and those at its ends the rest: the sum over the bed is right either way.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.world import World
from lbmdem.fluid.fluid import Fluid
from lbmdem.kernels.layout import FLUID, storage_order
from lbmdem.kernels.moments import excesses
from lbmdem.layout import addresses

SAMPLE_NODES = 32  # nodes at which the pressure round a grain is taken
SUM_UNIT = 2.0**44  # sums of excess densities are integers, so that no decomposition shows
WEIGHTS = 36.0  # 1 / the smallest weight: weights are whole numbers of it in D2Q9 and D3Q19


class ContactPressure:
    """The force between touching grains that stay where they are in the fluid; radius[n] of all grains. Collective."""

    def __init__(self, fluid: Fluid, world: World, radius: NDArray) -> None:
        self._fluid, self._world, self._number = fluid, world, len(radius)
        self._nodes, owner = self._samples()
        order = np.argsort(owner, kind="stable")
        self._nodes, self._owner = np.ascontiguousarray(self._nodes[order]), owner[order]
        self._count = self._sum(np.bincount(owner, minlength=self._number))
        self._first, self._second, self._area = self._touching()
        self._low, self._high = np.minimum(self._first, self._second), np.maximum(self._first, self._second)
        self._share = radius[self._low] / (radius[self._low] + radius[self._high])

    def _neighbours(self) -> Iterator[tuple[NDArray, NDArray, int]]:
        """Yield for each direction i the ids of own nodes, those of the nodes next to them along e[i], and i."""
        ids = self._fluid.ids
        flat = self._fluid.lattice.dimensions == 2
        inner = ids[1:-1, :, 1:-1] if flat else ids[1:-1, 1:-1, 1:-1]
        for i in range(1, self._fluid.lattice.q):
            z, y, x = storage_order(self._fluid.lattice, i)
            rows = slice(None) if flat else slice(1 + y, ids.shape[1] - 1 + y)
            yield inner, ids[1 + z : ids.shape[0] - 1 + z, rows, 1 + x : ids.shape[2] - 1 + x], i

    def _samples(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Own fluid nodes [m, 3] next to a grain, and that grain: all, or about SAMPLE_NODES, chosen by their place."""
        found = []
        for here, there, _ in self._neighbours():
            at = np.argwhere((here == FLUID) & (there >= 0))
            found.append(np.column_stack([there[tuple(at.T)], at]))
        rows = np.unique(np.concatenate(found).astype(np.int64), axis=0)
        count = self._sum(np.bincount(rows[:, 0], minlength=self._number))
        low, _ = self._fluid.domain.row_range(self._world.rank)
        points = self._fluid.domain.points
        place = (rows[:, 1] + low) * points[-1] * points[-2] + rows[:, 2] * points[-1] + rows[:, 3]
        mixed = (place.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(40)
        chosen = mixed % np.maximum(1, count[rows[:, 0]] // SAMPLE_NODES).astype(np.uint64) == 0
        return rows[chosen, 1:], rows[chosen, 0]

    def _touching(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Pairs (first, second) and 36 x the sum of 2 w e over links from own nodes of the first to the second."""
        lattice, n = self._fluid.lattice, self._number
        keys, areas = [np.zeros(0, np.int64)], [np.zeros((0, lattice.dimensions), np.int64)]
        for here, there, i in self._neighbours():
            on = (here >= 0) & (there >= 0) & (here != there)
            keys.append(here[on].astype(np.int64) * n + there[on])
            area = np.rint(2.0 * WEIGHTS * lattice.w[i] * lattice.e[i]).astype(np.int64)
            areas.append(np.broadcast_to(area, (len(keys[-1]), lattice.dimensions)))
        pairs, back = np.unique(np.concatenate(keys), return_inverse=True)
        total = np.zeros((len(pairs), lattice.dimensions), np.int64)
        np.add.at(total, back, np.concatenate(areas))
        return pairs // n, pairs % n, total

    def _sum(self, values: NDArray) -> NDArray[np.int64]:
        return self._world.sum_int(np.ascontiguousarray(values, np.int64))

    def _at_samples(self) -> NDArray[np.float64]:
        """rho - 1 at the sample nodes."""
        fluid, values = self._fluid, np.empty(len(self._nodes))
        excesses(fluid.f, addresses(fluid.layout), fluid.parity, self._nodes, values)
        return values

    def _excess(self) -> NDArray[np.float64]:
        """Mean of rho - 1 round each grain [number]; 0 round one that no fluid touches. Collective."""
        sums = np.zeros(self._number, np.int64)
        np.add.at(sums, self._owner, np.rint(self._at_samples() * SUM_UNIT).astype(np.int64))
        return self._sum(sums) / SUM_UNIT / np.maximum(self._count, 1)

    def forces(self) -> NDArray[np.float64]:
        """Force [number, d] on the grains, lattice units: equal and opposite in every pair. Collective.

        The pressure at a contact is that between the means round the two grains, as far along as the contact lies.
        """
        mean, d = self._excess(), self._fluid.lattice.dimensions
        between = mean[self._low] + (mean[self._high] - mean[self._low]) * self._share
        excess = np.rint(between * SUM_UNIT / WEIGHTS).astype(np.int64)
        sums = np.zeros((self._number, d), np.int64)
        np.add.at(sums, self._first, -self._area * excess[:, None])
        return self._sum(sums) / SUM_UNIT
