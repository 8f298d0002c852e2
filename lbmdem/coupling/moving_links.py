"""Links of grains that move: found anew at every step, grain by grain."""

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.tasks.arena import Arena
from hpcpic.core.tasks.graph import Bound, Pool
from lbmdem.fluid.fixed_links import Directions, rule_in
from lbmdem.fluid.solid_nodes import Window
from lbmdem.kernels import moving as kernels
from lbmdem.kernels.grain_rasters import GRAINS
from lbmdem.kernels.layout import Layout
from lbmdem.kernels.link_arrays import BounceBack, LinkDirections, Nodes, Parts, Populations


def set_up_links(
    arena: Arena, window: Window, layout: Layout, f: NDArray, solid: NDArray[np.int32], rule: str, open_mass: float
) -> None:
    """Give the arena of `Solid` what the kernels of links need where grains move.

    open_mass: 1 to count the fluid that a wall sweeps over as its momentum, 0 where nodes are counted themselves.
    """
    directions = Directions(layout.lattice)
    arena.group(parts=Parts)
    arena.set(
        populations=Populations(f, layout.strides, layout.slots, layout.shifts),
        nodes=Nodes(solid.reshape(-1), window.shape, window.inner, window.box),
        directions=LinkDirections(directions.e, directions.opposite, directions.w6),
        bounce_back=BounceBack(rule_in(window, rule).number, open_mass),
    )


class MovingLinks:
    """Links of the slab's moving grains: `place` after they have moved, tasks `of_planes` after the sweep, `gains`.

    arena: that of `Solid`; first_plane: of the slab, in planes of `solid`.
    """

    def __init__(self, arena: Arena, pool: Pool, first_plane: int) -> None:
        self._arena, self._pool, self._first_plane = arena, pool, first_plane
        arena["ends"][:] = first_plane
        self._shares: dict[tuple[int, int], list[Bound]] = {}  # tasks by parity
        self._find, self._add = [arena.bind(kernels.find_parts)], [arena.bind(kernels.add_up)]

    def of_planes(self, parity: int, low: int, high: int) -> Bound:
        """The task on the links that start in own planes from, to; arrivals are at `parity`.

        Ask for all planes, share by share in their order, before `place`.
        """
        if (low, high) not in self._shares:
            share = len(self._shares)
            self._arena["ends"][share + 1 :] = self._first_plane + high
            tasks = [self._arena.bind(kernels.moving_links, share=share, parity=parity) for parity in range(2)]
            self._shares[low, high] = tasks
        return self._shares[low, high][parity]

    def tasks(self, parity: int) -> list[Bound]:
        """Tasks on all links, for arrivals at `parity`."""
        return [share[parity] for share in self._shares.values()]

    def place(self) -> None:
        """The grains are where `Solid` has them now."""
        self._pool.each(self._find)
        if self._arena.reserve(parts=int(self._arena["cuts"][-1])):
            self._pool.each(self._find)

    def gains(self) -> NDArray[np.int64]:
        """Force, torque and mass that the fluid gains of the links that have been done, [grains, 7] of 1 / scale[7]."""
        self._pool.each(self._add)
        return self._arena["sums"][: self._arena["lengths"][GRAINS]].copy()

    @property
    def counters(self) -> NDArray[np.int64]:
        """Counters (see kernels.links) of every share."""
        return self._arena["counters"][: len(self._shares)]
