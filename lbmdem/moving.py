"""Links of grains that move: found anew at every step, grain by grain."""

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.errors import ConfigError
from hpcpic.core.tasks import Bound, Pool, bind
from lbmdem.kernels import moving as kernels
from lbmdem.kernels.layout import Layout
from lbmdem.kernels.links import QUADRATIC
from lbmdem.links import GAINS, RULES, Directions
from lbmdem.solid import Images, Table, Window

_CENTRES = 18  # place of the first argument of the kernel that changes from step to step


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
        if RULES[rule] == QUADRATIC and not window.whole:
            raise ConfigError("the quadratic rule reads two nodes beyond a slab: it works on one rank only")
        directions = Directions(layout.lattice)
        lattice = (directions.e, directions.opposite, directions.w6, RULES[rule], open_mass)
        nodes = (solid.reshape(-1), window.shape, window.inner, window.box)
        self._low, self._high = (int(end) for end in window.inner[2])
        self.counters = np.zeros((blocks, 3), np.int64)
        self._cuts = np.zeros(blocks + 1, np.int64)
        self._scale = np.ones(GAINS)
        self._room = dict.fromkeys(("grains", "images", "parts"), 0)
        self._make_room(grains=8, images=8, parts=8)
        self._tasks: list[list[Bound]] = []
        for parity in range(2):
            place = (f, layout.strides, layout.slots, layout.shifts, parity, *lattice, *nodes)
            shares = [(share, self.counters[share], self._cuts, self._scale) for share in range(blocks)]
            self._tasks.append([bind(kernels.moving_links, *place, *share, *self._changing()) for share in shares])

    def _make_room(self, **wanted: int) -> bool:
        """Arrays for so many grains, images and parts of images. Whether they are new."""
        if all(self._room[name] >= number for name, number in wanted.items()):
            return False
        self._room = {name: max(self._room[name], 2 * number) for name, number in wanted.items()}
        n, images, parts = self._room.values()
        self._table = Table(np.zeros(n, np.int64), np.zeros((n, 3)), np.zeros(n), np.zeros((n, 6)))
        self._images = Images(np.zeros(images, np.int64), np.zeros((images, 3), np.int64))
        self._parts = tuple(np.zeros(parts, np.int64) for _ in range(3))
        self._gains = np.zeros((parts, GAINS), np.int64)
        return True

    def _changing(self) -> tuple[NDArray, ...]:
        """The arguments that may get new arrays."""
        ids, centres, radii, motion = self._table
        return (centres, radii, ids, motion, *self._images, *self._parts, self._gains)

    def place(self, table: Table, images: Images) -> None:
        """The grains are here now."""
        where = (table.centres, table.radii, *images, self._low, self._high)
        self._n_parts = kernels.windows(*where, *self._parts)
        if self._make_room(grains=len(table.ids), images=len(images.grain), parts=self._n_parts):
            kernels.windows(*where, *self._parts)
            for task in (task for tasks in self._tasks for task in tasks):
                for at, value in enumerate(self._changing()):
                    task.update(_CENTRES + at, value)
        for kept, now in zip((*self._table, *self._images), (*table, *images)):
            kept[: len(now)] = now
        self._count = len(table.ids)
        blocks = len(self._cuts) - 1
        self._cuts[:] = np.arange(blocks + 1) * self._n_parts // blocks

    def run(self, pool: Pool, parity: int, scale: NDArray[np.float64]) -> NDArray[np.int64]:
        """Bounce back; force, torque and mass that the fluid gains, [grains, 7] in units of 1 / scale[7]."""
        self._scale[:] = scale
        self.counters[...] = 0
        pool.each(self._tasks[parity])
        sums = np.empty((self._count, GAINS), np.int64)
        kernels.add_up(self._parts[0], self._images.grain, self._n_parts, self._gains, sums)
        return sums
