"""Charge and field of one slab: from the blocks' integer charge to rho, phi and E on the nodes around it."""

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

from hpcpic.core.comm.halo import Exchange, Fill, Fold
from hpcpic.core.comm.tags import Channel
from hpcpic.core.comm.world import World
from hpcpic.core.errors import Diverged
from hpcpic.core.space.domain import Domain, block_ranges
from hpcpic.core.space.fields import Field
from hpcpic.core.tasks.graph import Bound, Graph, Pool, TaskError, bind
from hpcpic.plasma.kernels.charge import OVERFLOW, collect, density
from hpcpic.plasma.kernels.gradient import embed, minus_gradient_1d, minus_gradient_2d
from hpcpic.plasma.particles.tiles import aligned
from hpcpic.plasma.physics.poisson import LU, MFT
from hpcpic.plasma.setup.scene import Scene

CROWDED = "so many particles sit on one node that its charge overflows"
SHIFT = 16  # with which the sum of 2^32 particles of 2^44 parts fits an integer


class Mesh:
    """rho[rows, Nx] C/m^d (rows in 1D: [rows]), phi.inner V, e[d, rows + ghosts, Nx + ghosts] V/m.

    parts[group, rows + ghosts, Nx]: integer charge of the slab; weight[group]: density that one part makes.
    Rows and columns of e reach `below` and `above` nodes beyond the slab, phi one more each.
    """

    def __init__(
        self, world: World, pool: Pool, domain: Domain, scene: Scene, ghosts: tuple[int, int], weight: NDArray
    ) -> None:
        self.world, self.pool, self.domain = world, pool, domain
        d, (below, above) = domain.ndim, ghosts
        self.inside = tuple(slice(below, below + n) for n in domain.shape(world.rank))
        rest = ((0, 0),) * (d - 1)
        self.parts = Field(domain, world.rank, dtype=np.int64, leading=(len(weight),), ghosts=(ghosts, *rest))
        self.phi = Field(domain, world.rank, ghosts=((below + 1, above + 1),) * d)
        self.e = aligned((d, *(n - 2 for n in self.phi.values.shape)), np.float64)
        self.e[:] = 0
        self.rho = np.zeros(domain.shape(world.rank))
        self.uniform = scene.config.field.electric[:d]
        self.weight = np.array(weight, np.float64)
        self.fold = Fold(world, domain, self.parts, Channel.CHARGE)
        numerics, spectral = scene.config.numerics, scene.config.numerics.gradient == "spectral"
        self.solver: LU | MFT
        if scene.config.simulation.solver == "LU":
            self.solver = LU(world, pool, domain, permittivity=scene.permittivity)
        else:
            self.solver = MFT(
                world, pool, domain, permittivity=scene.permittivity, spectral=spectral, gradient=numerics.gradient
            )
        if self.solver.E:
            self.wide = Field(domain, world.rank, leading=(d,), ghosts=(ghosts,) * d)
            self.fill = Fill(world, domain, self.wide, Channel.FIELD)
            self._differentiate = self._spectral
        else:
            self.fill = Fill(world, domain, self.phi, Channel.POTENTIAL)
            self._differentiate = self._difference
            with world.first_on_node():
                self._gradient = self._around(self.fill, [self._embed()], self._minus_gradient(scene.spacing))

    def _embed(self) -> list[Bound]:
        """Tasks: the solver's phi between the ghosts."""
        rows, one = len(self.rho), self.domain.ndim == 1
        values = self.phi.values.reshape(len(self.phi.values), -1)
        (row, _), (column, _) = self.phi.ghosts[0], (0, 0) if one else self.phi.ghosts[1]
        inner = _wide(self.solver.phi, rows)
        return [
            bind(embed, a, b, row, column, self.rho.size // max(rows, 1), inner, values) for a, b in self._shares(rows)
        ]

    def _minus_gradient(self, spacing: tuple[float, ...]) -> list[Bound]:
        per_2d = [0.5 / step for step in spacing]
        kernel = minus_gradient_1d if self.domain.ndim == 1 else minus_gradient_2d
        return [
            bind(kernel, a, b, self.phi.values, self.e, *per_2d, *self.uniform)
            for a, b in self._shares(self.e.shape[1])
        ]

    def _density(self) -> list[Bound]:
        rows, ghosts = len(self.rho), self.parts.ghosts[0]
        parts = self.parts.values.reshape(len(self.weight), rows + sum(ghosts), -1)
        rho, source = _wide(self.rho, rows), _wide(self.solver.rho, rows)
        return [bind(density, a, b, ghosts[0], self.weight, parts, rho, source) for a, b in self._shares(rows)]

    def _around(self, exchange: Exchange, before: Sequence[list[Bound]], after: list[Bound]) -> Graph:
        """Stages of tasks before an exchange of ghosts, the exchange, the tasks `after`."""
        graph = Graph()
        pieces: list[tuple[int, int]] = []
        for stage, tasks in enumerate(before):
            done, pieces = pieces, [(stage, k) for k in range(len(tasks))]
            for piece, bound in zip(pieces, tasks):
                graph.task(bound, ins=done, outs=[piece])
        exchange.add_to(graph, "ghosts", inner=pieces, ghosts=["ghosts"])
        for bound in after:
            graph.task(bound, ins=[*pieces, "ghosts"])
        return graph.freeze()

    def _shares(self, rows: int) -> list[tuple[int, int]]:
        """Ranges of rows for the threads."""
        return [(a, b) for a, b in block_ranges(rows, self.pool.threads) if b > a]

    def collect_from(
        self, patches: NDArray[np.int64], places: NDArray[np.int64], delivery: Sequence[list[Bound]] = ()
    ) -> None:
        """Name the blocks' patches that `deposit` adds up (see kernels.charge).

        delivery: tasks that add charge to them first, in stages, each after the one before.
        """
        one = self.domain.ndim == 1
        groups = len(self.weight)
        slab = self.parts.values.reshape(groups, 1 if one else -1, self.parts.values.shape[-1])
        with self.world.first_on_node():
            tasks = [bind(collect, a, b, not one, patches, places, slab) for a, b in self._shares(slab.shape[1])]
            self._deposit = self._around(self.fold, [tasks], self._density())
            self._deliver = self._around(self.fold, [*delivery, tasks], self._density())

    def deposit(self, iteration: int) -> None:
        """rho (5.1) from the blocks' charge: integers until all is added, so that no order shows. Raises Diverged."""
        self._collect(self._deposit, iteration)

    def deliver_and_deposit(self, iteration: int) -> None:
        """rho (5.1), as `deposit`, after the tasks of `delivery`."""
        self._collect(self._deliver, iteration)

    def _collect(self, graph: Graph, iteration: int) -> None:
        self.fold.at(iteration)
        try:
            self.pool.run(graph)
        except TaskError as error:
            if error.code == OVERFLOW:
                raise Diverged(CROWDED) from error
            raise

    def check(self, charge: NDArray[np.int64]) -> None:
        """Raise Diverged unless the nodes hold charge[group] parts / 2^SHIFT in all: a node beyond 64 bits lacks 2^64.

        For a new state; one that grows step by step is seen by `deposit`. Collective.
        """
        found = self.world.sum_int((self.parts.inner >> SHIFT).reshape(len(self.weight), -1).sum(axis=1))
        if (np.abs(found - charge) > np.prod(self.domain.points)).any():  # each node is rounded down
            raise Diverged(CROWDED)

    def solve(self, iteration: int) -> None:
        """phi from the rho of the last deposit (5.10), E = E_0 - grad phi (5.13). Once for each deposit."""
        self.solver.solve(iteration)
        self._differentiate(iteration)

    def _difference(self, iteration: int) -> None:
        self.fill.at(iteration)
        self.pool.run(self._gradient)

    def _spectral(self, iteration: int) -> None:
        self.phi.inner[...] = self.solver.phi
        for inner, component, uniform in zip(self.wide.inner, self.solver.E, self.uniform):
            np.add(component, uniform, out=inner)
        self.fill.start(iteration)
        self.fill.finish()
        self.e[...] = self.wide.values

    def trouble(self) -> str | None:
        """Why the field of this rank is no solution, or None."""
        if not np.isfinite(self.rho).all() or not np.isfinite(self.phi.inner).all():
            return "the field is not finite"
        return None

    def free(self) -> None:
        """Free what MPI holds (all ranks together)."""
        self.fill.free()
        self.fold.free()
        self.solver.free()


def _wide(rows_of: NDArray, rows: int) -> NDArray:
    """[rows, pitch] in one piece: rows whose first columns are the array."""
    return as_strided(rows_of, (rows, rows_of.strides[0] // rows_of.itemsize))
