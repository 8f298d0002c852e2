"""Links of grains that move: found anew at every step from the chords of the grains, plane by plane."""

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.errors import HpcpicError
from hpcpic.core.space.domain import block_ranges
from hpcpic.core.tasks import Bound, Pool, bind
from lbmdem.kernels import links as kernels
from lbmdem.kernels.layout import Layout
from lbmdem.links import GAINS, RULES, Directions
from lbmdem.solid import Window, find_images

_CENTRES = 16  # place of the first argument of the kernel that changes from step to step


class MovingLinks:
    """Links of the slab's moving grains; `place` after they have moved, `run` after the sweep of the fluid.

    open_mass: 1 to count the fluid that a wall sweeps over as its momentum, 0 where nodes are counted themselves.
    """

    def __init__(
        self,
        window: Window,
        layout: Layout,
        f: NDArray,
        solid: NDArray[np.int32],
        rule: str,
        open_mass: float,
        blocks: int,
    ) -> None:
        if RULES[rule] == kernels.QUADRATIC and layout.stored != layout.planes:
            raise HpcpicError("the quadratic rule reads two nodes beyond a slab: it works on one rank only")
        self._window = window
        directions = Directions(layout.lattice)
        lattice = (directions.e, directions.opposite, directions.w6, RULES[rule], open_mass)
        nodes = (solid.reshape(-1), window.shape, window.inner, window.box)
        self._low, self._high = (int(end) for end in window.inner[2])
        shares = block_ranges(max(self._high - self._low, 0), blocks)
        self._shares = [(self._low + a, self._low + b) for a, b in shares if b > a]
        self.counters = np.zeros((len(self._shares), 3), np.int64)
        self._tasks: list[list[Bound]] = []
        for parity in range(2):
            place = (f, layout.strides, layout.slots, layout.shifts, parity)
            self._tasks.append(
                [
                    bind(kernels.moving_links, *place, *lattice, *nodes, a, b, *_nobody(b - a), self.counters[k])
                    for k, (a, b) in enumerate(self._shares)
                ]
            )

    def place(
        self, ids: NDArray[np.int64], centres: NDArray, radii: NDArray[np.float64], motion: NDArray[np.float64]
    ) -> None:
        """Grains in the order of ids: centres[n, 3] and motion[n, 6] (velocity, angular velocity), kernel axes."""
        images = find_images(self._window, centres, radii, 1.0)
        start = np.zeros(self._high - self._low + 1, np.int64)
        where = (centres, radii, images.grain, images.offset, self._low, self._high, start)
        listed = np.empty(kernels.buckets(*where, np.empty(0, np.int64)), np.int64)
        kernels.buckets(*where, listed)
        self._sums = np.zeros((len(self._shares), len(ids), GAINS), np.int64)
        self._scale = np.ones(GAINS)
        for k, (low, high) in enumerate(self._shares):
            planes = start[low - self._low : high - self._low + 1]
            changed = (centres, radii, ids, motion, images.grain, images.offset, planes, listed)
            for tasks in self._tasks:
                for at, value in enumerate((*changed, self._sums[k], self._scale)):
                    tasks[k].update(_CENTRES + at, value)

    def run(self, pool: Pool, parity: int, scale: NDArray[np.float64]) -> NDArray[np.int64]:
        """Bounce back; force, torque and mass that the fluid gains, [grains, 7] in units of 1 / scale[7]."""
        self._sums[...] = 0
        self._scale[:] = scale
        self.counters[...] = 0
        if self._shares:
            pool.each(self._tasks[parity])
        return self._sums.sum(axis=0)


def _nobody(planes: int) -> tuple:
    """Arguments for no grains."""
    whole, real = np.zeros(0, np.int64), np.zeros(0)
    grains = (np.zeros((0, 3)), real, whole, np.zeros((0, 6)))
    images = (whole, np.zeros((0, 3), np.int64), np.zeros(planes + 1, np.int64), whole)
    return (*grains, *images, np.zeros((0, GAINS), np.int64), np.ones(GAINS))
