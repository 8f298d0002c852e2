"""Links of grains that move: found anew at every step from the chords of the grains, plane by plane."""

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.errors import HpcpicError
from hpcpic.core.space.domain import block_ranges
from hpcpic.core.tasks import Bound, Pool, bind
from lbmdem.kernels import links as kernels
from lbmdem.kernels.layout import Layout
from lbmdem.links import GAINS, RULES, Directions
from lbmdem.solid import Images, Table, Window

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
        if RULES[rule] == kernels.QUADRATIC and not window.whole:
            raise HpcpicError("the quadratic rule reads two nodes beyond a slab: it works on one rank only")
        self._window = window
        directions = Directions(layout.lattice)
        lattice = (directions.e, directions.opposite, directions.w6, RULES[rule], open_mass)
        nodes = (solid.reshape(-1), window.shape, window.inner, window.box)
        self._low, self._high = (int(end) for end in window.inner[2])
        shares = block_ranges(max(self._high - self._low, 0), blocks)
        self._shares = [(self._low + a, self._low + b) for a, b in shares if b > a]
        self.counters = np.zeros((len(self._shares), 3), np.int64)
        self._start = np.zeros(self._high - self._low + 1, np.int64)
        self._scale = np.ones(GAINS)
        self._room = dict.fromkeys(("grains", "images", "listed"), 0)
        self._make_room(grains=8, images=8, listed=64)
        self._tasks: list[list[Bound]] = []
        for parity in range(2):
            place = (f, layout.strides, layout.slots, layout.shifts, parity)
            tasks = []
            for k, (a, b) in enumerate(self._shares):
                changing = self._changing(k)
                tasks.append(bind(kernels.moving_links, *place, *lattice, *nodes, a, b, *changing, self.counters[k]))
            self._tasks.append(tasks)

    def _make_room(self, **wanted: int) -> bool:
        """Arrays for so many grains, images and places in the lists of planes. Whether they are new."""
        if all(self._room[name] >= number for name, number in wanted.items()):
            return False
        self._room = {name: max(self._room[name], 2 * number) for name, number in wanted.items()}
        n, images, listed = self._room.values()
        self._table = Table(np.zeros(n, np.int64), np.zeros((n, 3)), np.zeros(n), np.zeros((n, 6)))
        self._images = Images(np.zeros(images, np.int64), np.zeros((images, 3), np.int64))
        self._listed = np.zeros(listed, np.int64)
        self._sums = np.zeros((len(self._shares), n, GAINS), np.int64)
        return True

    def _changing(self, k: int) -> tuple[NDArray, ...]:
        """The arguments of share k that may get new arrays."""
        ids, centres, radii, motion = self._table
        low, high = self._shares[k]
        start = self._start[low - self._low : high - self._low + 1]
        return (centres, radii, ids, motion, *self._images, start, self._listed, self._sums[k], self._scale)

    def place(self, table: Table, images: Images) -> None:
        """The grains are here now."""
        where = (table.centres, table.radii, *images, self._low, self._high, self._start)
        count = kernels.buckets(*where, self._listed)
        if self._make_room(grains=len(table.ids), images=len(images.grain), listed=count):
            kernels.buckets(*where, self._listed)
            for tasks in self._tasks:
                for k, task in enumerate(tasks):
                    for at, value in enumerate(self._changing(k)):
                        task.update(_CENTRES + at, value)
        for kept, now in zip((*self._table, *self._images), (*table, *images)):
            kept[: len(now)] = now
        self._count = len(table.ids)

    def run(self, pool: Pool, parity: int, scale: NDArray[np.float64]) -> NDArray[np.int64]:
        """Bounce back; force, torque and mass that the fluid gains, [grains, 7] in units of 1 / scale[7]."""
        self._sums[:, : self._count] = 0
        self._scale[:] = scale
        self.counters[...] = 0
        if self._shares:
            pool.each(self._tasks[parity])
        return self._sums[:, : self._count].sum(axis=0)
