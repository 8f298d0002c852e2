"""Links of grains that move: found anew at every step, grain by grain."""

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.tasks.arena import Arena
from hpcpic.core.tasks.graph import Bound
from lbmdem.coupling.arrays import MOVING_LINKS
from lbmdem.fluid.fixed_links import Directions, rule_in
from lbmdem.fluid.solid_nodes import Images, Table, Window
from lbmdem.kernels import moving as kernels
from lbmdem.kernels.layout import Layout
from lbmdem.kernels.link_arrays import BounceBack, LinkDirections, Nodes, Parts, Populations
from lbmdem.sizes import GAINS


def link_arena(
    window: Window, layout: Layout, f: NDArray, solid: NDArray[np.int32], rule: str, open_mass: float
) -> Arena:
    """The arrays of kernels that do links where grains move.

    open_mass: 1 to count the fluid that a wall sweeps over as its momentum, 0 where nodes are counted themselves.
    """
    sizes = {"shares": layout.planes, "cuts": layout.planes + 1, "grains": 8, "images": 8, "parts": 8}
    arena, directions = Arena(MOVING_LINKS, **sizes), Directions(layout.lattice)
    arena.group(table=Table, images=Images, parts=Parts)
    arena.set(
        populations=Populations(f, layout.strides, layout.slots, layout.shifts),
        nodes=Nodes(solid.reshape(-1), window.shape, window.inner, window.box),
        directions=LinkDirections(directions.e, directions.opposite, directions.w6),
        bounce_back=BounceBack(rule_in(window, rule).number, open_mass),
    )
    return arena


class MovingLinks:
    """Links of the slab's moving grains: `place` after they have moved, tasks `of_planes` after the sweep, `gains`.

    first_plane: of the slab, in planes of `solid`.
    """

    def __init__(self, arena: Arena, first_plane: int) -> None:
        self._arena, self._first_plane = arena, first_plane
        arena["ends"][:] = first_plane
        self._shares: dict[tuple[int, int], list[Bound]] = {}  # tasks by parity
        self._count = 0  # grains

    def of_planes(self, parity: int, low: int, high: int) -> Bound:
        """The task on the links that start in own planes from, to; arrivals are at `parity`.

        Ask for all planes, share by share in their order, before `place`.
        """
        if (low, high) not in self._shares:
            share = len(self._shares)
            self._arena["ends"][share + 1] = self._first_plane + high
            tasks = [self._arena.bind(kernels.moving_links, share=share, parity=parity) for parity in range(2)]
            self._shares[low, high] = tasks
        return self._shares[low, high][parity]

    def tasks(self, parity: int) -> list[Bound]:
        """Tasks on all links, for arrivals at `parity`."""
        return [share[parity] for share in self._shares.values()]

    def place(self, table: Table, images: Images) -> None:
        """The grains are here now."""
        arena, n = self._arena, len(self._shares)
        ends, cuts = arena["ends"][: n + 1], arena["cuts"][: n + 1]
        kernels.find_parts(table, images, ends, cuts, arena.value("parts"))
        if arena.reserve(grains=len(table.ids), images=len(images.grain), parts=int(cuts[n])):
            kernels.find_parts(table, images, ends, cuts, arena.value("parts"))
        for group in (table, images):
            for name, values in group._asdict().items():
                arena[name][: len(values)] = values
        self._count = len(table.ids)

    def gains(self) -> NDArray[np.int64]:
        """Force, torque and mass that the fluid gains of the links that have been done, [grains, 7] of 1 / scale[7]."""
        arena, sums = self._arena, np.empty((self._count, GAINS), np.int64)
        n = int(arena["cuts"][len(self._shares)])
        kernels.add_up(arena.value("parts"), arena["grain"], n, sums)
        return sums

    @property
    def counters(self) -> NDArray[np.int64]:
        """Counters (see kernels.links) of every share."""
        return self._arena["counters"][: len(self._shares)]
