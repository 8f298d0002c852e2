"""Charge and field of one slab: from the blocks' integer charge to rho, phi and E on its nodes."""

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

from hpcpic.core.comm.halo import Fill
from hpcpic.core.comm.tags import Channel
from hpcpic.core.comm.world import World
from hpcpic.core.errors import Diverged
from hpcpic.core.space.domain import Domain
from hpcpic.core.space.fields import Field
from hpcpic.core.tasks.arena import Arena
from hpcpic.core.tasks.graph import Bound, Graph, Pool, TaskError
from hpcpic.plasma.field.slab_sums import SlabSums, around, shares
from hpcpic.plasma.kernels.mesh import (
    OVERFLOW,
    density,
    embed,
    minus_gradient_1d,
    minus_gradient_2d,
    minus_gradient_3d,
)
from hpcpic.plasma.particles.tiles import Patches, aligned
from hpcpic.plasma.physics.poisson import LU, MFT
from hpcpic.plasma.setup.scene import Scene

CROWDED = "so many particles sit on one node that its charge overflows"
SHIFT = 16  # with which the sum of 2^32 particles of 2^44 parts fits an integer


class Mesh:
    """rho[rows, Nx] C/m^d (1D: [rows], 3D: [planes, Ny, Nx]), phi.inner V, e[d, ..] V/m, as rho but with ghosts.

    charge: integer charge of the slab by groups of equal |q|; weight[group]: density that one part makes.
    e has the `ghosts` below and above the slab that the shape of the particles reaches, on each axis; phi has one more.
    `arena` holds what the kernels take, under the names of their arguments.
    """

    def __init__(
        self, world: World, pool: Pool, domain: Domain, scene: Scene, ghosts: tuple[int, int], weight: NDArray
    ) -> None:
        self.world, self.pool, self.domain = world, pool, domain
        d, (below, above) = domain.ndim, ghosts
        self.inside = tuple(slice(below, below + n) for n in domain.shape(world.rank))
        self.charge = SlabSums(world, pool, domain, len(weight), ghosts, Channel.CHARGE)
        self.phi = Field(domain, world.rank, ghosts=((below + 1, above + 1),) * d)
        self.e = aligned((d, *(n - 2 for n in self.phi.values.shape)), np.float64)
        self.e[:] = 0
        self.rho = np.zeros(domain.shape(world.rank))
        self.uniform = scene.config.field.electric[:d]
        self.solver = self._solver(scene)
        self.arena = self._arena(np.array(weight, np.float64))
        if self.solver.E:
            self.wide = Field(domain, world.rank, leading=(d,), ghosts=(ghosts,) * d)
            self.fill = Fill(world, domain, self.wide, Channel.FIELD)
            self._differentiate = self._spectral
        else:
            self.fill = Fill(world, domain, self.phi, Channel.POTENTIAL)
            self._differentiate = self._difference
            with world.first_on_node():
                self._gradient = self._gradient_graph(scene.spacing)

    def _solver(self, scene: Scene) -> LU | MFT:
        """What the case asks for."""
        numerics, place = scene.config.numerics, (self.world, self.pool, self.domain)
        if scene.config.simulation.solver == "LU":
            return LU(*place, operator=scene.operator, permittivity=scene.permittivity)
        return MFT(
            *place,
            operator=scene.operator,
            permittivity=scene.permittivity,
            spectral=numerics.gradient == "spectral",
            gradient=numerics.gradient,
            cloud_radius=numerics.cloud_radius,
        )

    def _arena(self, weight: NDArray[np.float64]) -> Arena:
        """Arrays of the slab as the kernels see them: rows of columns, one row in 1D; of all planes in 3D."""
        arena, phi, charge, columns = Arena(()), self.phi.values, self.charge.field, self.rho.shape[-1]
        arena.set(
            weight=weight,
            below=first_row(charge),
            left=charge.ghosts[0][0] if self.domain.ndim == 1 else 0,
            plane_rows=plane_rows(self.domain),
            gap=gap(charge),
            phi_gap=gap(self.phi),
            parts=charge.values.reshape(len(weight), -1, charge.values.shape[-1]),
            rho_rows=self.rho.reshape(-1, columns),
            source=_with_pitch(self.solver.rho),
            solved=_with_pitch(self.solver.phi),
            row=first_row(self.phi),
            column=self.phi.ghosts[-1][0],
            n_columns=columns,
            phi=phi,
            phi_rows=phi.reshape(-1, phi.shape[-1]),
            e=self.e,
        )
        return arena

    def _gradient_graph(self, spacing: tuple[float, ...]) -> Graph:
        """phi between its ghosts, the messages that fill these, E."""
        kernel = (minus_gradient_1d, minus_gradient_2d, minus_gradient_3d)[self.domain.ndim - 1]
        for axis, step, uniform in zip("xyz", spacing, self.uniform):
            self.arena.set(**{f"per_2d{axis}": 0.5 / step, f"e0_{axis}": uniform})
        inner = self._of_rows(embed, len(self.arena["rho_rows"]))
        return around(self.fill, [inner], self._of_rows(kernel, self.e.shape[1]))

    def _of_rows(self, kernel: object, rows: int) -> list[Bound]:
        """The kernel bound for the rows of each thread."""
        return [self.arena.bind(kernel, first=a, last=b) for a, b in shares(rows, self.pool)]

    def collect_from(self, patches: Patches, delivery: Sequence[list[Bound]] = ()) -> None:
        """Name the blocks' patches that `deposit` adds up (see kernels.mesh).

        delivery: tasks that add charge to them first, in stages, each after the one before.
        """
        with self.world.first_on_node():
            after = self._of_rows(density, len(self.arena["rho_rows"]))
        self._deposit = self.charge.graph(patches, after=after)
        self._deliver = self.charge.graph(patches, before=delivery, after=after)

    def deposit(self, iteration: int) -> None:
        """rho (5.1) from the blocks' charge: integers until all is added, so that no order shows. Raises Diverged."""
        self._run(self._deposit, iteration)

    def deliver_and_deposit(self, iteration: int) -> None:
        """rho (5.1), as `deposit`, after the tasks of `delivery`."""
        self._run(self._deliver, iteration)

    def _run(self, graph: Graph, iteration: int) -> None:
        self.charge.fold.at(iteration)
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
        parts = self.charge.field.inner
        found = self.world.sum_int((parts >> SHIFT).reshape(len(parts), -1).sum(axis=1))
        if (np.abs(found - charge) > np.prod(self.domain.points)).any():  # each node is rounded down
            raise Diverged(CROWDED)

    def solve(self, iteration: int) -> None:
        """phi from the rho of the last deposit (5.10), E = E_0 - grad phi (5.13). Once for each deposit."""
        if isinstance(self.solver, MFT):
            self.solver.solve(iteration)
        else:
            self.solver.solve()
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
        self.charge.fold.free()
        self.solver.free()


def plane_rows(domain: Domain) -> int:
    """Rows of a plane as kernels.mesh takes them: in 1D and 2D a row is all there is."""
    return domain.points[1] if domain.ndim == 3 else 1


def first_row(field: Field) -> int:
    """The first row of the slab's own nodes in an array with ghosts; in 1D the ghosts are of the only row."""
    below = field.ghosts[0][0]
    if field.domain.ndim < 3:
        return below if field.domain.ndim == 2 else 0
    return below * field.values.shape[-2] + field.ghosts[1][0]


def gap(field: Field) -> int:
    """Ghost rows from plane to plane."""
    return sum(field.ghosts[1]) if field.domain.ndim == 3 else 0


def _with_pitch(array: NDArray) -> NDArray:
    """The array as rows (3D: planes) of its full pitch, C-contiguous: own nodes are the first of each; 1D: one row."""
    if array.ndim == 1:
        return array[None]
    shape = len(array), array.strides[0] // array.itemsize
    return as_strided(array, shape, (array.strides[0], array.itemsize))
