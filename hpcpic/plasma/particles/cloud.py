"""All particles of one rank, and the kernels of the scene that move them."""

import inspect
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.migrate import Migrate, send_anywhere
from hpcpic.core.comm.tags import Channel, tag
from hpcpic.core.comm.world import World
from hpcpic.core.errors import Diverged
from hpcpic.core.space.domain import Domain
from hpcpic.core.tasks.graph import Bound, Graph, Pool, TaskError, bind
from hpcpic.plasma.particles.push_spec import PushSpec
from hpcpic.plasma.particles.tiles import Pages, Patches, Tiles, aligned
from hpcpic.plasma.sizes import PAGE

CHUNK = 1 << 16  # particles placed or read at a time


class Cloud:
    """Particles of one rank in pages; `patches` holds the charge of each block after `push` and `deliver`.

    e[axis] is E of the slab [rows, columns] with the ghosts of the shape on the axes that have neighbours, scaled in
    the kernels by `scale`, a power of two; mover[species, 10] see kernels.plain.boris; charge[species] =
    (group, parts of one particle with sign).
    """

    def __init__(
        self,
        world: World,
        pool: Pool,
        domain: Domain,
        spec: PushSpec,
        blocks: int,
        mover: NDArray,
        charge: NDArray[np.int64],
        e: NDArray[np.float64],
        scale: float,
        capacity: int,
        plain: bool = False,
    ) -> None:
        self.world, self.pool, self.spec = world, pool, spec
        self.n_species = len(charge)
        self.tiles = tiles = Tiles(domain, world.rank, blocks)
        self.blocks = blocks
        slots = len(tiles.parts) * self.n_species
        pages = (capacity + capacity // 8 + CHUNK) // PAGE + 2 * slots  # memory is used when touched
        self.pages = Pages(slots, blocks, spec.components, spec.dtype, pages)
        self.record_bytes = spec.components * np.dtype(spec.dtype).itemsize + 8
        self.near = Migrate(world, self.record_bytes, Channel.PARTICLES, cuts=domain.cuts)
        self.owner = np.asarray(domain.owner(np.arange(domain.points[0])), np.int32)
        groups = int(charge[:, 0].max(initial=0)) + 1  # a case without species has one, of zeros
        self._patch = Patches(tiles, groups, domain.ndim, spec.shape.ghosts)
        self.patches, self.places = self._patch.values, self._patch.places
        self.names = self._names(np.ascontiguousarray(mover, spec.dtype), charge, e, float(scale))
        self.kernels = spec.kernels(plain)
        self._bounds: list[tuple[Bound, list[tuple[int, str]]]] = []
        with world.first_on_node():
            self._compile()
        self._version = self.pages.moved

    def _names(self, mover: NDArray, charge: NDArray[np.int64], e: NDArray[np.float64], scale: float) -> dict[str, Any]:
        """Arguments of the kernels that stay where they are."""
        tiles, pages, one = self.tiles, self.pages, self.spec.dimensions == 1
        below, _ = self.spec.shape.ghosts
        return {
            "n_species": self.n_species,
            "points": tiles.points,
            "origin": np.array([tiles.rows[0] - (0 if one else below), tiles.columns[0] - below]),
            "row_part": tiles.row_part,
            "column_part": tiles.column_part,
            "column_stride": tiles.column_stride,
            "parts": tiles.parts,
            "e_x": e if one else e[0],
            "e_y": e if one else e[1],
            "scale": scale,
            "mover": mover,
            "charge": charge,
            "head": pages.head,
            "count": pages.count,
            "counters": pages.counters,
            "lists": pages.lists,
        }

    def _compile(self) -> None:
        """Bind the kernels of the step, and load those that Python calls."""
        self._lines = aligned((self.blocks, self.spec.shape.field_scratch), self.spec.dtype)
        self._sums = aligned((self.blocks, self.spec.shape.charge_scratch), f"i{np.dtype(self.spec.dtype).itemsize}")
        self._cells = aligned((self.blocks, PAGE), self._sums.dtype)
        self._push = self._of_blocks(self.kernels.push)
        self._deliver = self._of_blocks(self.kernels.deliver)
        self._rewind = self._of_blocks(self.kernels.rewind)
        self._deposit = self._of_blocks(self.kernels.deposit_all)
        self._records = np.zeros((0, self.record_bytes), np.uint8)
        self._ends, self._arrived = np.zeros(self.world.size, np.int64), np.zeros(1, np.int64)
        records = self._views(self._records)
        self._pack = [self._bound(self.kernels.pack, **records, ends=self._ends, owner=self.owner)]
        self._unpack = [self._bound(self.kernels.unpack, **records, n=self._arrived)]
        self._short, self._most = np.zeros(1, np.int64), np.zeros(1, np.int64)
        slots = self.tiles.n_parts * self.n_species
        self._lacks = self._bound(self.kernels.lacks_pages, slots=slots, short=self._short)
        self.delivery = [self._deliver, [self._bound(self.kernels.empty, slots=slots, most=self._most)]]
        self._bind_letters()
        self._motion = self._graph_of_motion()
        self.place(0, np.zeros((0, self.spec.dimensions)), np.zeros((0, self.spec.velocities)), np.zeros(0))
        if self.n_species:
            next(self.export(0), None)

    def _of_blocks(self, kernel, **more) -> list[Bound]:
        """The kernel bound for each block."""
        return [
            self._bound(
                kernel, block=b, first=first, last=last, corner=self._patch.corner[b], patch=self._patch.of_block[b],
                lines=self._lines[b], sums=self._sums[b], cells=self._cells[b], **more,
            )
            for b, (first, last) in enumerate(self.tiles.ranges)
        ]  # fmt: skip

    def _bind_letters(self) -> None:
        """Tasks that fill the letters to the neighbours, and those that read theirs."""
        near, kernels = self.near, self.kernels
        self._write = [
            self._bound(kernels.pack_near, **self._views(letter.records), filled=letter.n, peer=peer, owner=self.owner)
            for peer, letter in zip(near.peers, near.outgoing)
        ]
        self._read = [
            self._bound(kernels.unpack, **self._views(letter.records), n=letter.n) for letter in near.incoming
        ]
        self._any_left = self._bound(kernels.any_left, wants=near.wants)

    def _renew_letters(self) -> None:
        """Tell the tasks where the letters are since they have grown."""
        for bound, letter in zip(self._write + self._read, self.near.outgoing + self.near.incoming):
            for k, view in enumerate((*self._views(letter.records).values(), letter.n)):  # the first arguments
                bound.update(k, view)
        self._motion = self._graph_of_motion()

    def _graph_of_motion(self) -> Graph:
        """Push, then letters to the neighbours and from them."""
        near, graph = self.near, Graph()
        boxes = [*range(self.blocks)]
        for block, bound in enumerate(self._push):
            graph.task(bound, outs=[block])
        for peer, bound in zip(near.peers, self._write):
            graph.task(bound, inouts=boxes, outs=[("to", peer)])
        if self.world.size > 1:
            graph.task(self._any_left, ins=boxes, outs=["wants"])
            written = ["wants", *(("to", peer) for peer in near.peers)]
            near.add_to(graph, written=written, arrived="arrived")
        for bound in self._read:
            graph.task(bound, ins=["arrived"], inouts=["box from outside"])
        graph.task(self._lacks, ins=[*boxes, "box from outside"])
        return graph.freeze()

    def _bound(self, kernel, **more) -> Bound:
        """The kernel with its arguments by name: `more`, those of this object, or arrays of the pages."""
        values = self.names | more
        names = list(inspect.signature(kernel.py_func).parameters)
        bound = bind(kernel, *(values[name] if name in values else getattr(self.pages, name) for name in names))
        self._bounds.append((bound, [(k, name) for k, name in enumerate(names) if name in Pages.GROWING]))
        return bound

    def _tell(self) -> None:
        """Tell the tasks where the arrays of the pages are now."""
        if self._version != self.pages.moved:
            for bound, places in self._bounds:
                for k, name in places:
                    bound.update(k, getattr(self.pages, name))
            self._version = self.pages.moved

    def _run(self, run: Callable, tasks: Graph | list[Bound]) -> None:
        """Run tasks made by this object. Raises Diverged."""
        self._tell()
        try:
            run(tasks)
        except TaskError as error:
            if error.code == self.kernels.DIVERGED:
                raise Diverged("a particle's position is not a number, or it moved 2^31 cells in a step") from error
            raise

    def each(self, bounds: list[Bound]) -> None:
        """Run independent tasks made by this object. Raises Diverged."""
        self._run(self.pool.each, bounds)

    @property
    def n(self) -> int:
        """Particles of this rank."""
        return int(self.pages.count.sum())

    def place(self, species: int, x: NDArray, v: NDArray, numbers: NDArray) -> None:
        """Take in new particles: x[n, d] in cells of the grid, v[n, v] in cells per step; migrate and deliver next."""
        self._make_room(len(x))
        code = self.kernels.place(
            np.ascontiguousarray(x, np.float64), np.ascontiguousarray(v, self.spec.dtype),
            np.ascontiguousarray(numbers, np.uint32), species, *self._grid, *self._box(-1), self.pages.counters[-1],
        )  # fmt: skip
        if code:
            raise Diverged("an initial position is not a finite number")

    def push(self, iteration: int) -> None:
        """x^n, v^(n-1/2) -> x^(n+1), v^(n+1/2); charge of those who stay in their tile part; the others wait in boxes
        of the rank where they belong, and `delivery`, tasks in stages, is ready to run. Collective.
        """
        near = self.near
        self.pages.room(max(int(self._most[0]), len(near.peers) * near.capacity))
        near.at(iteration)
        self._run(self.pool.run, self._motion)
        if near.wants[0]:
            capacity = near.capacity
            self._admit_all(near.rest(iteration, self._outgoing()))
            if near.capacity != capacity:
                self._renew_letters()
        if near.wants[0] or self._short[0]:
            self._find_pages()
            self._tell()

    def rewind(self, mover: NDArray) -> None:
        """v^0 -> v^(-1/2) with a mover of half a step backwards."""
        forwards = self.names["mover"].copy()
        self.names["mover"][:] = mover
        self.each(self._rewind)
        self.names["mover"][:] = forwards

    def bind_moments(self, **arrays: NDArray) -> list[Bound]:
        """Tasks of kernels.moments, one per block."""
        values = np.zeros((self.blocks, 4, PAGE))
        with self.world.first_on_node():
            return [
                self._bound(
                    self.kernels.moments, block=b, first=first, last=last, values=values, lines=self._lines[b],
                    cells=self._cells[b], **arrays,
                )
                for b, (first, last) in enumerate(self.tiles.ranges)
            ]  # fmt: skip

    def clear(self) -> None:
        """No particles."""
        self.pages.drop()

    def deposit_all(self) -> None:
        """The charge of all particles, whatever the patches hold: after placing and delivering."""
        self.each(self._deposit)

    def records(self, species: int, numbers: NDArray, tiles: NDArray, x: NDArray, v: NDArray) -> NDArray[np.uint8]:
        """Records (see kernels.pages.pack) of particles by tile and position in it."""
        records = np.empty((len(numbers), self.record_bytes), np.uint8)
        real, whole = self._views(records).values()
        real[:, : x.shape[1]], real[:, x.shape[1] : self.spec.components] = x, v
        whole[:, -2], whole[:, -1] = tiles * self.n_species + species, numbers.astype(np.uint32).view(np.int32)
        return records

    def migrate(self, iteration: int) -> None:
        """Particles that were placed or admitted go to the boxes of the rank where they belong. Collective."""
        label = tag(iteration, Channel.PARTICLES_FAR)
        self._admit_all(send_anywhere(self.world, self._outgoing(), self.record_bytes, label))

    def _admit_all(self, arrivals: list[NDArray[np.uint8]]) -> None:
        for records in arrivals:
            self.admit(records)

    def admit(self, records: NDArray[np.uint8]) -> None:
        """Records (see kernels.pages.pack) into the box from outside; when it is full, what is there goes first.

        Migrate and deliver next.
        """
        n = self._arrived[0] = len(records)
        self._make_room(n)
        self._room_for_records(n)
        self._records[:n] = records
        self.each(self._unpack)

    def _make_room(self, n: int) -> None:
        """Room for n more in the box from outside."""
        if int(self.pages.counters[-1, 1]) + n > self.pages.box_size:
            self.deliver()
            self.pages.room(n)

    def deliver(self) -> None:
        """Particles from all boxes into their slots, with their charge; the boxes are empty then."""
        self._find_pages()
        for tasks in self.delivery:
            self.each(tasks)

    def _find_pages(self) -> None:
        """Free pages for all who are in boxes, and a quarter more: the next steps find enough."""
        arrivals = self.pages.lists[:, 1, : self.blocks].sum(axis=0)
        wanted = arrivals // PAGE + np.minimum(arrivals, self.tiles.n_parts * self.n_species)
        self.pages.need((wanted + wanted // 4).tolist())

    def _box(self, box: int) -> tuple[NDArray, ...]:
        pages = self.pages
        return pages.moving[box], pages.words[box], pages.lists[box]

    @property
    def _grid(self) -> tuple:
        tiles = self.tiles
        return (
            self.n_species, tiles.points, tiles.row_part, tiles.column_part, tiles.column_stride, tiles.parts,
        )  # fmt: skip

    def _room_for_records(self, n: int) -> None:
        """The memory of records under way to other ranks, and then of those that come: forgets what it holds."""
        if n <= len(self._records):
            return
        self._records = np.empty((n + n // 2, self.record_bytes), np.uint8)
        for k, view in enumerate(self._views(self._records).values()):  # the first two arguments
            for bound in (*self._pack, *self._unpack):
                bound.update(k, view)

    def _views(self, records: NDArray[np.uint8]) -> dict[str, NDArray]:
        """The same memory as arguments of kernels."""
        return {"records_real": records.view(self.spec.dtype), "records_int": records.view(np.int32)}

    def _outgoing(self) -> dict[int, NDArray[np.uint8]]:
        """Records by rank of all that is bound for other ranks, valid until others are taken in."""
        self._room_for_records(int(self.pages.lists[:, 1, -1].sum()))
        self.each(self._pack)
        starts = [0, *self._ends.tolist()]
        return {rank: self._records[a:b] for rank, (a, b) in enumerate(pairwise(starts)) if b > a}

    def free(self) -> None:
        """Free what MPI holds (all ranks together)."""
        self.near.free()

    def count(self, species: int) -> int:
        """Particles of a species on this rank."""
        return int(self.pages.count[species :: self.n_species].sum())

    def export(self, species: int) -> Iterator[tuple[NDArray, NDArray, NDArray]]:
        """Numbers[m], tiles[m] and components[m, c] of this rank's particles of a species, in any order.

        Chunk after chunk; each is valid until the next.
        """
        pages, cursor = self.pages, np.array([0, -1])
        numbers, tiles = np.empty(CHUNK, np.int64), np.empty(CHUNK, np.int32)
        components = np.empty((CHUNK, self.spec.components), self.spec.dtype)
        while n := self.kernels.export(
            species, self.n_species, self.tiles.parts, pages.pool, pages.ids, pages.chain, pages.head, pages.count,
            cursor, numbers, tiles, components,
        ):  # fmt: skip
            yield numbers[:n], tiles[:n], components[:n]
