"""The lattice Boltzmann fluid of one rank's slab: its populations, solid nodes, faces and steps."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hpcpic.core.comm.halo import Fill
from hpcpic.core.comm.tags import Channel
from hpcpic.core.comm.world import World
from hpcpic.core.simd.registers import has_masks
from hpcpic.core.space.domain import Domain
from hpcpic.core.space.fields import Field
from hpcpic.core.tasks.arena import Arena
from hpcpic.core.tasks.graph import Bound, Graph, Pool
from lbmdem.fluid import temporal_blocking
from lbmdem.fluid.exchange import Exchange
from lbmdem.fluid.faces import Face, Layer, Slab, complete, wall_ends, wall_ghosts
from lbmdem.fluid.fixed_links import FixedLinks
from lbmdem.fluid.node_kinds import NodeKinds
from lbmdem.fluid.observers import Observers
from lbmdem.fluid.schedule import After, Links, Passes
from lbmdem.fluid.sparse import SparseExchange, SparseLayout, sparse_arena
from lbmdem.kernels.layout import FLUID, Layout
from lbmdem.kernels.sparse import LEAVE, OPENED, sparse_kernel
from lbmdem.kernels.sparse_addresses import take_over
from lbmdem.kernels.sweep import sweep_kernel
from lbmdem.layout import addresses
from lbmdem.physics.collision import COLLISIONS, Collision
from lbmdem.physics.forcing import GUO
from lbmdem.physics.velocity_sets import Lattice
from lbmdem.sizes import SPARSE_BELOW, STORAGE

BLOCKS = 4  # per thread, so that threads with little fluid help the others


class Fluid:
    """Zero-centred populations f - w of the slab at `iteration`, and `step` to the next one; lattice units.

    f: flat array (kernels.layout says where what is); parity: iteration % 2; solid: Field int32 of node ids (FLUID,
    WALL or a grain's number) with one ghost on every axis: after edits of solid.inner call `solid_changed`. hooks are
    called as hook(fluid, parity of the next step) between streaming and the faces. nodes: what the sweep
    knows of them, while those of solids are held too. All ranks make it together.

    stays: set it when solids will be marked once and never again: then a porous medium is held without its solid nodes.
    """

    def __init__(
        self,
        world: World,
        pool: Pool,
        domain: Domain,
        lattice: Lattice,
        *,
        tau: float,
        collision: str = "TRT",
        magic: float = 3 / 16,
        force: ArrayLike | None = None,
        storage: str = "double",
        blocks: int = 0,
        faces: Mapping[str, Face] | None = None,
    ) -> None:
        if collision not in COLLISIONS:
            raise ValueError(f"collision {collision} is none of {', '.join(COLLISIONS)}")
        self.collision = Collision(lattice, COLLISIONS[collision], tau, magic, GUO if force is not None else None)
        self.world, self.pool, self.domain, self.lattice = world, pool, domain, lattice
        self.tau, self.storage = tau, storage
        self.faces = complete(faces or {}, domain.ndim, domain.periodic)
        self.iteration = 0
        self.hooks: list[Callable[[Fluid, int], None]] = []
        self._links: After | None = None
        self._take: Callable[[int], None] | None = None  # of steps whose links keep their momentum
        self._ruled: FixedLinks | None = None  # links that the sweep does
        self._moving: Links | None = None  # links to grains that move
        self._quiet = False  # whether these links ask for nothing but what every sweep does
        self._open = False  # whether it has left them half done (kernels.sparse)
        self.stays, self._blocks = False, blocks
        layout = self._allocate()
        self._numbers = np.zeros(len(self.collision.source.names), self.layout_dtype)
        self._arena.set(numbers=self._numbers)
        self.set_force(force)
        self.nodes = NodeKinds(self._arena, layout, pool)
        self._make_tasks()
        self.solid_changed()

    def _allocate(self) -> Layout:
        """The arrays, as of a fluid that holds its solid nodes too."""
        domain, rank = self.domain, self.world.rank
        self.layout_dtype = np.dtype(STORAGE[self.storage])
        alone = sum(b > a for a, b in zip(domain.cuts, domain.cuts[1:])) == 1
        layout = Layout.of(self.lattice, domain.shape(rank), domain.periodic, alone, self.layout_dtype)
        self.layout: Layout | SparseLayout = layout
        declared = [array for array in layout.arrays(STORAGE[self.storage]) if array.name != "solid"]  # that is a Field
        self._arena = Arena(declared)
        self.f = self._arena["populations"].reshape(-1)
        self.solid = Field(domain, rank, dtype=np.int32, ghosts=((1, 1),) * domain.ndim)
        self.solid.values[...] = FLUID
        shape = self.solid.values.shape
        self.ids = self.solid.values.reshape(shape[0], shape[1] if domain.ndim == 3 else 1, shape[-1])
        self._fill = Fill(self.world, domain, self.solid, Channel.SOLIDS)
        self._arena.set(f=self.f, solid=self.ids, nx=layout.nx)
        self._shift = np.zeros(self.lattice.dimensions)  # of the momentum, see Collision.shift
        self._shift_in_storage = np.zeros(3)
        self.layers: dict[str, Layer] = {}
        return layout

    @property
    def _touches(self) -> tuple[bool, bool]:
        """Whether this slab has the first planes of the box, and the last ones."""
        low, high = self.domain.row_range(self.world.rank)
        return high > low and low == 0, high > low and high == self.domain.points[0]

    def _make_tasks(self) -> None:
        """All that works on `f`."""
        layout, dtype = self.layout, self.layout_dtype
        self._exchange: Exchange | SparseExchange
        if isinstance(layout, SparseLayout):
            kernel = sparse_kernel(self.collision, dtype)
            self._exchange = SparseExchange(self.world, self.domain, layout, self._arena)
        else:
            kernel = sweep_kernel(self.collision, dtype)
            self._exchange = Exchange(self.world, self.domain, layout, self._arena)
        periodic_rows = self.domain.ndim == 3 and self.domain.periodic[1]
        threads = self.pool.threads
        sweep = partial(self._arena.bind, kernel)
        self._passes = Passes(layout, self._exchange, lambda tiles: sweep(tiles=tiles), threads, periodic_rows)
        n_blocks = self._blocks or (BLOCKS * threads if threads > 1 else 1)
        self._steps = [self._passes.step(parity, n_blocks, self._moving) for parity in range(2)]
        self._waves: dict[temporal_blocking.Steps, Graph] = {}
        self._depths: dict[int, int] = {}
        shape, ids = self.domain.shape(self.world.rank), self.ids
        self._observers = Observers(self.pool, layout, shape, f=self.f, ids=ids, shift=self._shift)
        values = {name: layer.values for name, layer in self.layers.items()}
        self._arena.set(shift=self._shift_in_storage, others=wall_ends(self.faces, layout, self._touches))
        slab = Slab(layout, self._touches, self._arena)
        acting = {name: face for name, face in self.faces.items() if _acts(face)}
        walls_first = sorted(acting, key=lambda name: acting[name].kind != "wall")  # an open face reads what walls gave
        self.layers = {name: Layer(slab, name, acting[name]) for name in walls_first}
        for name, given in values.items():
            self.layers[name].values[...] = given

    def solid_changed(self, fill: bool = True) -> None:
        """Take notice of edits of `solid`. With fill (collective) ghosts of other ranks and periodic ones are fetched,
        else the caller has set them; walls of the box are always set here."""
        if fill:
            self._fill.start(self.iteration)
            self._fill.finish()
        if isinstance(self.layout, SparseLayout):
            raise ValueError("solids that stay have been marked again")
        wall_ghosts(self.solid.values, self.faces, self._touches)
        self.nodes.fill()
        if self.stays:
            here = np.array([np.count_nonzero(self.solid.inner == FLUID), not has_masks()])
            wet, without_masks = self.world.sum_int(here)
            if not without_masks and 0 < wet < SPARSE_BELOW * np.prod(self.domain.points):
                self._leave_solids_out()

    def _leave_solids_out(self) -> None:
        """Hold the populations of the fluid nodes alone. Collective."""
        assert isinstance(self.layout, Layout)
        layout = SparseLayout(self.layout, self.ids, self.world, self.domain)
        arena = sparse_arena(layout, STORAGE[self.storage])
        before = {"old": self.f, "old_places": addresses(self.layout), "parity": self.parity, "nx": layout.nx}
        arena.call(take_over, places=addresses(layout), low=0, high=layout.planes, **before)
        arena.set(solid=self.ids, numbers=self._numbers)
        self.layout, self._arena, self.f = layout, arena, arena["f"]
        self._again()
        del self.nodes

    def _again(self) -> None:
        """Collective."""
        self._exchange.free()
        self._make_tasks()

    def leave_to_links(self, links: Links) -> None:
        """From now on these do all links to grains, and find what went out where the grain would have read it.

        So the sweep need not bounce it back, and does vectors beside grains, with what is in these, like any others.
        Populations of solid nodes mean nothing then, and may be no numbers. Collective; `solid_changed` must follow.
        """
        self.nodes.free_grains()
        self._moving = links
        self._again()

    def nodes_changed(self, places: NDArray[np.int64]) -> None:
        """Take notice of edits at these flat places of `solid` alone: ghosts among them, but not those beyond walls."""
        self.nodes.renew(places)

    def set_force(self, force: ArrayLike | None, told: ArrayLike | None = None) -> None:
        """Force per volume for the steps to come; None if the fluid was made without.

        told: that of the end of the next step, if it is another one. Momentum there has the share of that: a force that
        changes enters by the trapezoid then, to second order.
        """
        if (force is not None) != (self.collision.forcing is not None):
            raise ValueError("a fluid made without a force takes none later")
        self.force = None if force is None else np.array(force, float)
        self._shift[...] = self.collision.shift(force if told is None else told)
        self._numbers[...] = self.collision.numbers(force)
        self._shift_in_storage[[2, 1, 0] if self.domain.ndim == 3 else [2, 0]] = self._shift

    def set_face(self, name: str, density: Any = None, velocity: Any = None) -> None:
        """Values of a wall, pressure or velocity face for the steps to come (faces.Layer.set)."""
        self.layers[name].set(density, velocity)

    @property
    def parity(self) -> int:
        return self.iteration % 2

    @property
    def sweep_bytes(self) -> int:
        """What the sweep reads."""
        return sum(self._arena.bytes.values())

    def step(self) -> None:
        """Collide, stream, hooks, faces."""
        if self._links and self._leaves_caches and self._depth(1):  # hooks would wait for memory
            self._pass(1, keep=True)
            return
        self._finish()
        parity = self.parity
        self._exchange.at(self.iteration)
        self.pool.run(self._steps[parity])
        for hook in self.hooks:
            hook(self, 1 - parity)
        for layer in self.layers.values():
            if layer.tasks[1 - parity]:
                self.pool.each(layer.tasks[1 - parity])
        self.iteration += 1

    def carry(
        self,
        links: After | None,
        held: FixedLinks | None = None,
        take: Callable[[int], None] | None = None,
    ) -> None:
        """What hooks do, as tasks links(parity of arrivals, planes from, to, keep), so that waves can: fixed links.

        `held`: these links, which a sweep of the fluid nodes alone does by itself where it can. take(iteration) is
        called after a wave for each step in which links kept their momentum. Collective.
        """
        self._links, self._take = links, take
        self._waves.clear()
        self._quiet = held is not None and not self.world.any(not held.quiet)
        if isinstance(self.layout, SparseLayout) and held and not self.world.any(not held.simple):
            held.hand_over(self._arena, *self._inner_planes)
            self._ruled = held
            self._finishes = [held.finish(parity, *self._inner_planes, self.pool.threads) for parity in range(2)]
            self._again()

    @property
    def _inner_planes(self) -> tuple[int, int]:
        """Own planes without a node at a face that acts: before faces links must be done."""
        if any(layer.axis for layer in self.layers.values()):
            return 0, 0
        ends = [0, self.layout.planes]
        for layer in self.layers.values():
            if layer.values.size:
                ends[layer.side > 0] -= layer.side
        return (ends[0], ends[1]) if ends[1] > ends[0] else (0, 0)

    def _finish(self) -> None:
        """Complete what the sweep has left open."""
        if self._open and self._finishes[self.parity]:
            self.pool.each(self._finishes[self.parity])
        self._open = False

    def _after(self, parity: int, low: int, high: int, keep: bool) -> list[Bound]:
        """Links and faces of some planes."""
        inner, parts = self._inner_planes, [(low, high)]
        if self._ruled and not keep:
            parts = [(low, min(high, inner[0])), (max(low, inner[1]), high)]
        tasks = [task for a, b in parts if self._links and b > a for task in self._links(parity, a, b, keep)]
        return tasks + [bound for layer in self.layers.values() for bound in layer.of_planes(parity, low, high)]

    @property
    def depth(self) -> int:
        """Steps that are done per pass over memory."""
        return max(1, self._depth(self._after_all))

    def _depth(self, after: int) -> int:
        """Depth of a pass with links or faces after so many of its sweeps; 0: these are done after single steps."""
        if self.hooks and not self._links:
            return 0
        if after not in self._depths:
            self._depths[after] = temporal_blocking.possible_depth(self.domain, self.layout, self.pool.threads, after)
        return self._depths[after]

    @property
    def _leaves_caches(self) -> bool:
        return self.layout.plane_bytes * self.domain.points[0] > temporal_blocking.CACHE

    @property
    def _after_all(self) -> int:
        """After how many sweeps of a pass links or faces are done, where no forces are kept."""
        by_themselves = self._links and not self._ruled and not self._quiet
        return temporal_blocking.STEPS_PER_PASS if by_themselves or self.layers else 0

    def leap(self, most: int) -> int:
        """One pass over memory: `depth` steps, or fewer if `most` is less. Returns the steps done, the same bits as
        plain ones. In the last two of `most` steps hooks are called, or the links that they carry keep momentum."""
        depth, keep = self._next_pass(most)
        if depth < 2:
            self.step()
        else:
            self._pass(depth, keep)
        return depth

    def _pass(self, depth: int, keep: bool) -> None:
        steps = self._steps_of_pass(depth, keep)
        if steps not in self._waves:
            self._waves[steps] = self._passes.wave(steps, self._after)
        self._exchange.at(self.iteration)
        self.pool.run(self._waves[steps])
        self._open = bool(steps.flags[-1] & LEAVE)
        self.iteration += depth
        if keep and self._take:
            for iteration in range(self.iteration - min(depth, temporal_blocking.KEPT) + 1, self.iteration + 1):
                self._take(iteration)

    def _next_pass(self, most: int) -> tuple[int, bool]:
        """How many steps it has, and whether links keep momentum in it."""
        depth = temporal_blocking.even_depth(self.depth, most)
        if not self.hooks or most - depth >= temporal_blocking.KEPT:
            return depth, False
        deepest = self._depth(max(self._after_all, temporal_blocking.KEPT))
        if deepest < 2:  # forces only of plain steps
            return temporal_blocking.even_depth(self.depth, max(1, most - temporal_blocking.KEPT)), False
        depth = temporal_blocking.even_depth(deepest, most)
        return depth, most - depth < temporal_blocking.KEPT

    def _steps_of_pass(self, depth: int, keep: bool) -> temporal_blocking.Steps:
        after = max(self._after_all, temporal_blocking.KEPT * keep)
        steps = temporal_blocking.Steps(self.parity, depth, min(after, depth), keep, ())
        leave = [LEAVE * (self._ruled is not None and not steps.keeps(t)) for t in range(depth)]
        opened = [self._open, *leave]
        return steps._replace(flags=tuple(OPENED * bool(was) | now for was, now in zip(opened, leave)))

    def advance(self, n: int) -> None:
        """n steps, several per pass over memory where possible."""
        while n > 0:
            n -= self.leap(n)

    def populations(self) -> NDArray:
        """h[q, rows, ...] = f - w of the slab's nodes at `iteration`, zero in solid nodes; whatever the storage.

        A view of [rows, ..., q].
        """
        self._finish()
        return self._observers.populations(self.parity)

    def set_populations(self, h: NDArray) -> None:
        """The inverse of `populations`, for the parity of `iteration`. Collective the first time."""
        self._finish()
        self._observers.set_populations(h, self.parity)

    def moments(self) -> tuple[NDArray, NDArray]:
        """Density [rows, ...] and velocity [rows, ..., d] with half the force, float64; 1 and 0 in solid nodes."""
        self._finish()
        return self._observers.moments(self.parity)

    def row_sums(self) -> tuple[NDArray, NDArray]:
        """Sums and the largest u^2 of each row of nodes: see `Observers.row_sums`."""
        self._finish()
        return self._observers.row_sums(self.parity)

    def mean_excess(self) -> float:
        """Mean of rho - 1 over the fluid nodes of all ranks. Collective."""
        nodes, excess = self.world.sum_exact(self.row_sums()[0][:, :2])
        return float(excess / nodes) if nodes else 0.0

    def set_equilibrium(self, rho: Any = 1.0, u: Any = None) -> None:
        """Equilibrium of densities [rows, ...] and velocities [rows, ..., d] (or numbers)."""
        self._finish()
        self._observers.set_equilibrium(rho, u, self.parity)

    def rest_bounds(self) -> tuple[float, float]:
        """The least and the largest population at rest (f - w) of fluid nodes, and zero."""
        layout, rest, fluid = self.layout, self.f[: self.layout.slot_stride], np.bool_(True)
        if isinstance(layout, Layout) and self.nodes.grains_are_free:
            used = rest[layout.lanes : layout.lanes + layout.planes * layout.plane_stride]
            rest = used.reshape(layout.planes, layout.stored_rows, layout.row_stride)[:, : layout.rows, : layout.nx]
            fluid = self.solid.inner.reshape(rest.shape) == FLUID
        return float(rest.min(initial=0.0, where=fluid)), float(rest.max(initial=0.0, where=fluid))

    def free(self) -> None:
        """Release what MPI holds (all ranks together)."""
        self._exchange.free()
        self._fill.free()


def _acts(face: Face) -> bool:
    """Does the face need a pass of its own? A wall that cannot move does not."""
    return face.kind in ("pressure", "velocity") or (face.kind == "wall" and bool(np.any(np.asarray(face.velocity))))
