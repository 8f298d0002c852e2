"""The populations of nodes that grains cover and uncover.

The paper fills an uncovered node with the equilibrium of the mean density and of the velocity of the grain there
("average"; the mean over the fluid nodes of this step). Others take the density of the fluid neighbours ("local"), and
their non-equilibrium too ("non-equilibrium"). "mass-conserving" is "local", and the mass that links and nodes have
gained or lost is put back evenly into all nodes every 20 steps. "conserving" closes the balance of momentum too: a
grain gets that of what it covers and gives that of what it uncovers.

"mass-conserving" is the default in a closed box, "local" elsewhere. The sphere of ten Cate et al. (2002), 7.5 nodes
across, at the Reynolds numbers 1.5, 4.1, 11.6 and 31.9: largest speeds are off by -2.5, +1.1, -0.1, -1.1 % with "local"
and by +0.5, +3.6, +1.2, -2.0 % with "conserving", whose force scatters from step to step by 10, 24, 49, 76 % of its
mean instead of 0.6, 1, 4, 16 %, as momentum comes by whole nodes. "local" loses up to 2e-4 of the mass in a fall, the
conserving ones none, "conserving" for a sixth more time. A disc of ten nodes that a uniform stream carries keeps its
speed to 1e-3 with "local" and "mass-conserving"; with "conserving" it loses 0.6 to 2.8 % and turns, and the fluid has
noise of 2 to 5 % of the speed.
"""

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.halo import Fill
from hpcpic.core.comm.tags import Channel
from hpcpic.core.comm.world import World
from hpcpic.core.space.domain import Domain
from hpcpic.core.space.fields import Field
from hpcpic.core.tasks.arena import Arena
from hpcpic.core.tasks.graph import Bound
from lbmdem.fluid.fixed_links import Directions
from lbmdem.fluid.fluid import Fluid
from lbmdem.fluid.solid_nodes import Change, Window, several_slabs
from lbmdem.kernels import refill as kernels
from lbmdem.kernels.layout import Layout
from lbmdem.kernels.link_arrays import Nodes, Populations
from lbmdem.sizes import STEPS_OWED, parts_of

MODES = {
    "average": kernels.LOCAL,
    "local": kernels.LOCAL,
    "non-equilibrium": kernels.NON_EQUILIBRIUM,
    "mass-conserving": kernels.LOCAL,
    "conserving": kernels.LOCAL,
}


class Refill:
    """Fills uncovered nodes of a fluid. `bind` comes first, then at every move `exchange` and `change`; both are
    collective. frame[3]: acceleration of a shaken frame."""

    def __init__(self, window: Window, fluid: Fluid, world: World, mode: str) -> None:
        self.keeps_mass = mode in ("mass-conserving", "conserving")
        self.counts_momentum = mode == "conserving"
        self.steps_owed = 1 if self.counts_momentum else STEPS_OWED  # of mass, while grains move
        self._average, self._mode = mode == "average", mode
        self._window, self._fluid, self._world = window, fluid, world
        self._fill: Fill | None = None
        self.frame = np.zeros(3)

    def bind(self, arena: Arena) -> None:
        """Make the tasks that fill the nodes which `Solid`, whose arena this is, will uncover. Collective. Not before
        grains move: where all stay, the fluid gives up the populations that are read here.
        """
        fluid, layout, directions = self._fluid, self._fluid.layout, Directions(self._fluid.lattice)
        assert isinstance(layout, Layout)
        self._edges = np.zeros((2, 0, 0, 0))
        if several_slabs(fluid.domain) and not self._average:
            self._share_edges()
        self._populations = Populations(fluid.f, layout.strides, layout.slots, layout.shifts)
        self._nodes = Nodes(fluid.ids.reshape(-1), self._window.shape, self._window.inner, self._window.box)
        sizes = np.array([layout.nx, layout.rows, layout.planes], np.int64)
        source = kernels.Source(sizes, self._edges, directions.e, fluid.lattice.w, MODES[self._mode], self.frame)
        shares = parts_of(fluid.pool.threads)
        given = {"shares": shares, "populations": self._populations, "nodes": self._nodes, "source": source}
        arena.set(density=0.0)
        kernel, self._arena = kernels.fill_average if self._average else kernels.fill, arena
        self._tasks: list[list[Bound]] = [  # by parity
            [arena.bind(kernel, share=share, parity=parity, **given) for share in range(shares)] for parity in range(2)
        ]

    def _share_edges(self) -> None:
        """The first and the last plane of every slab, on a domain of their own, so that neighbours get them."""
        fluid, layout, domain = self._fluid, self._fluid.layout, self._fluid.domain
        held = [2 * (high > low) for low, high in zip(domain.cuts, domain.cuts[1:])]
        cuts = tuple(int(cut) for cut in np.concatenate(([0], np.cumsum(held))))
        shape = (cuts[-1], layout.rows, layout.nx)
        planes = Domain(tuple(map(float, shape)), shape, (domain.periodic[0], False, False), cuts)
        ghosts = ((1, 1), (0, 0), (0, 0))
        self._planes = Field(planes, self._world.rank, leading=(fluid.lattice.q,), ghosts=ghosts)
        self._edges = np.zeros((2, *self._planes.values[:, 0].shape))
        self.free()
        self._fill = Fill(self._world, planes, self._planes, Channel.EDGES)

    def exchange(self) -> None:
        """Get the planes of other ranks beside this slab. Collective."""
        if self._fill is None:
            return
        values, planes = self._planes.values, self._fluid.layout.planes
        if planes:
            for at, plane in ((1, 0), (2, planes - 1)):
                there = np.empty((values.shape[0], 1, *values.shape[2:]))
                kernels.copy_plane(self._populations, self._fluid.parity, plane, there)
                values[:, at : at + 1] = there
        self._fill.start(self._fluid.iteration)
        self._fill.finish()
        self._edges[0], self._edges[1] = values[:, 0], values[:, -1]

    def change(self, change: Change) -> tuple[NDArray, NDArray]:
        """Fill the uncovered nodes. Populations [n, q] of the covered nodes before, which are read only if they are
        counted ("conserving"), and of the uncovered ones now. Collective."""
        parity, q = self._fluid.parity, self._fluid.lattice.q
        covered, filled = np.empty((len(change.covered), q)), np.empty((len(change.uncovered), q))
        if self.keeps_mass and len(change.covered):
            kernels.read(self._populations, parity, self._nodes, change.covered, covered)
        if self._average and self._world.any(len(change.uncovered) > 0):
            self._arena.set(density=self._fluid.mean_excess())
        if len(change.uncovered):
            self._fluid.pool.each(self._tasks[parity])
            if self.keeps_mass:
                kernels.read(self._populations, parity, self._nodes, change.uncovered, filled)
        return covered, filled

    def arms(self, nodes: NDArray[np.int64], centres: NDArray[np.float64]) -> NDArray[np.float64]:
        """Vectors [n, 3] to the nodes from the centres [n, 3] of their nearest images."""
        window = self._window
        nx, rows, _ = window.shape
        at = np.column_stack((nodes % nx, nodes // nx % rows, nodes // (nx * rows))) + window.origin
        turns = np.where(window.periodic, np.rint((at - centres) / window.points), 0).astype(np.int64)
        return (at - turns * window.points) - centres

    def add_evenly(self, mass_per_node: float) -> None:
        """Add mass to every fluid node, at rest."""
        window, fluid = self._window, self._fluid
        low, high = (int(end) for end in window.inner[2])
        kernels.add_to_rest(fluid.f, fluid.layout.strides, fluid.ids, window.inner, low, high, mass_per_node)

    def free(self) -> None:
        """Release what MPI holds (all ranks together)."""
        if self._fill is not None:
            self._fill.free()
