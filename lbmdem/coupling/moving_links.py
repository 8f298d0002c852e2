"""Links of grains that move: found anew at every step, grain by grain."""

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.tasks.graph import Bound, bind
from lbmdem.fluid.fixed_links import GAINS, Directions, rule_in
from lbmdem.fluid.solid_nodes import Images, Table, Window
from lbmdem.kernels import moving as kernels
from lbmdem.kernels.layout import Layout

_CENTRES = 18  # place of the first argument of the kernel that changes from step to step


def first_arguments(
    window: Window, layout: Layout, f: NDArray, solid: NDArray[np.int32], rule: str, open_mass: float
) -> list[tuple]:
    """Of kernels that do links where grains move, by the parity of arrivals.

    open_mass: 1 to count the fluid that a wall sweeps over as its momentum, 0 where nodes are counted themselves.
    """
    directions = Directions(layout.lattice)
    lattice = (directions.e, directions.opposite, directions.w6, rule_in(window, rule).number, open_mass)
    nodes = (solid.reshape(-1), window.shape, window.inner, window.box)
    return [(f, layout.strides, layout.slots, layout.shifts, parity, *lattice, *nodes) for parity in range(2)]


class MovingLinks:
    """Links of the slab's moving grains: `place` after they have moved, tasks `of_planes` after the sweep, `gains`.

    head: `first_arguments`.
    """

    def __init__(self, head: list[tuple], window: Window, layout: Layout) -> None:
        self._head = head
        self._first_plane = int(window.inner[2, 0])
        self._ends = np.full(layout.planes + 1, self._first_plane)  # of the shares, in planes of `solid`
        self._cuts = np.zeros(layout.planes + 1, np.int64)
        self._counters = np.zeros((layout.planes, 3), np.int64)
        self._scale = np.ones(GAINS)
        self._shares: dict[tuple[int, int], list[Bound]] = {}  # tasks by parity
        self._room = dict.fromkeys(("grains", "images", "parts"), 0)
        self._make_room(grains=8, images=8, parts=8)

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

    def of_planes(self, parity: int, low: int, high: int) -> Bound:
        """The task on the links that start in own planes from, to; arrivals are at `parity`.

        Ask for all planes, share by share in their order, before `place`.
        """
        if (low, high) not in self._shares:
            share = len(self._shares)
            self._ends[share + 1] = self._first_plane + high
            mine = (share, self._counters[share], self._cuts, self._scale, *self._changing())
            self._shares[low, high] = [bind(kernels.moving_links, *head, *mine) for head in self._head]
        return self._shares[low, high][parity]

    def tasks(self, parity: int) -> list[Bound]:
        """On all links, for arrivals at `parity`."""
        return [share[parity] for share in self._shares.values()]

    def place(self, table: Table, images: Images, scale: NDArray[np.float64]) -> None:
        """The grains are here now; sums are to be in units of 1 / scale[7]."""
        self._scale[:] = scale
        n = len(self._shares)
        where = (table.centres, table.radii, *images, self._ends[: n + 1], self._cuts[: n + 1])
        kernels.windows(*where, *self._parts)
        if self._make_room(grains=len(table.ids), images=len(images.grain), parts=int(self._cuts[n])):
            kernels.windows(*where, *self._parts)
            for task in (*self.tasks(0), *self.tasks(1)):
                for at, value in enumerate(self._changing()):
                    task.update(_CENTRES + at, value)
        for kept, now in zip((*self._table, *self._images), (*table, *images)):
            kept[: len(now)] = now
        self._count = len(table.ids)

    def gains(self) -> NDArray[np.int64]:
        """Force, torque and mass that the fluid gains of the links that have been done, [grains, 7]."""
        sums = np.empty((self._count, GAINS), np.int64)
        n = int(self._cuts[len(self._shares)])
        kernels.add_up(self._parts[0], self._images.grain, n, self._gains, sums)
        return sums

    @property
    def counters(self) -> NDArray[np.int64]:
        """See kernels.links, of every share."""
        return self._counters[: len(self._shares)]
