"""All particles of one rank, and the kernels of the scene that move them."""

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
from hpcpic.core.tasks.arena import Arena
from hpcpic.core.tasks.graph import Bound, Graph, Pool, TaskError
from hpcpic.plasma.kernels import groups
from hpcpic.plasma.particles.arrays import LINE, declared
from hpcpic.plasma.particles.pages import Pages
from hpcpic.plasma.particles.push_spec import PushSpec
from hpcpic.plasma.particles.tiles import Patches, Tiles, first_node
from hpcpic.plasma.sizes import PAGE, record_numbers

CHUNK = 1 << 16  # particles placed or read at a time
FIRST_BOX_SIZE = 1024  # particles


class Cloud:
    """Particles of one rank in pages; `patches` hold the charge of each block after `push` and `deliver`.

    e[axis] is E of the slab [planes, rows, columns] with the ghosts of the shape on all axes, scaled in the kernels by
    `scale`, a power of two; mover[species, 16] see physics.boris; charge[species] =
    (group, parts of one particle with sign). `arena` holds the arrays of particles.arrays.
    """

    def __init__(
        self,
        world: World,
        pool: Pool,
        domain: Domain,
        spec: PushSpec,
        *,
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
        below, above = spec.shape.ghosts
        self.tiles = tiles = Tiles(domain, world.rank, blocks, below + above)
        self.blocks = blocks
        self.record_bytes = spec.components * np.dtype(spec.dtype).itemsize + 8
        self.arena = self._arena(capacity)
        self.pages = Pages(self.arena)
        self.near = Migrate(world, self.record_bytes, Channel.PARTICLES, cuts=domain.cuts)
        group_count = int(charge[:, 0].max(initial=0)) + 1  # a case without species has one, of zeros
        self.patches = Patches(tiles, group_count, domain.ndim, spec.shape.ghosts)
        self.arena.set(
            n_species=self.n_species,
            points=tiles.points,
            pitch=tiles.pitch,
            row_part=tiles.row_part,
            column_part=tiles.column_part,
            column_stride=tiles.column_stride,
            parts=tiles.parts,
            e=e.reshape(spec.dimensions, -1, e.shape[-1]),
            origin=np.array(first_node(tiles, spec.dimensions, below)),
            scale=float(scale),
            mover=np.ascontiguousarray(mover, spec.dtype),
            charge=charge,
            owner=np.asarray(domain.owner(np.arange(domain.points[0])), np.int32),
            slots=tiles.n_parts * self.n_species,
            ends=np.zeros(world.size, np.int64),
            short=np.zeros(1, np.int64),
            most=np.zeros(1, np.int64),
            wants=self.near.wants,
            moment=np.zeros(3),
            own=np.zeros((self.n_species, 3, 3, 3)),
            records=self._views(self.arena["records_bytes"]),
        )
        self.arena.group(
            grid=groups.GridArrays,
            field=groups.FieldArrays,
            pages=groups.PageArrays,
            boxes=groups.BoxArrays,
            species=groups.SpeciesArrays,
            scratch=groups.ScratchArrays,
            moment_sums=groups.SumArrays,
        )
        self.kernels = spec.kernels(plain)
        with world.first_on_node():
            self._compile()

    def _arena(self, capacity: int) -> Arena:
        """Arrays for so many particles, with room to spare: memory is used when touched."""
        spec, slots = self.spec, len(self.tiles.parts) * self.n_species
        dtype = np.dtype(spec.dtype)
        lanes = 64 // dtype.itemsize
        return Arena(
            declared(dtype.name),
            pages=(capacity + capacity // 8 + CHUNK) // PAGE + 2 * slots,
            packs=PAGE // lanes,
            components=spec.components,
            lanes=lanes,
            slots=slots,
            blocks=self.blocks,
            boxes=self.blocks + 1,
            box_size=FIRST_BOX_SIZE,
            list_length=-(-(self.blocks + 1) // LINE) * LINE,  # cores that write into one line wait for each other
            field_scratch=spec.shape.field_scratch(spec.dimensions),
            charge_scratch=spec.shape.charge_scratch(spec.dimensions),
            species=max(self.n_species, 1),
            moments=spec.n_moments,
            axes=spec.dimensions,
            record_numbers=record_numbers(spec.components, dtype.itemsize),
            records=0,
            record_bytes=self.record_bytes,
        )

    def _compile(self) -> None:
        """Bind the kernels of the step, and load those that Python calls."""
        kernels, bind = self.kernels, self.arena.bind
        self._push = self._of_blocks(kernels.push)
        self._deliver = self._of_blocks(kernels.deliver)
        self._rewind = [bind(kernels.rewind, first=first, last=last) for first, last in self.tiles.ranges]
        self._deposit = [
            bind(kernels.deposit_all, first=first, last=last, patch=patch)
            for (first, last), patch in zip(self.tiles.ranges, self.patches.of_block)
        ]
        self._arrived = np.zeros(1, np.int64)
        self._pack, self._unpack = [bind(kernels.pack)], [bind(kernels.unpack, n=self._arrived)]
        self._lacks, self._any_left = bind(kernels.lacks_pages), bind(kernels.any_left)
        self.delivery = [self._deliver, [bind(kernels.empty)]]
        self._bind_messages()
        self.place(0, np.zeros((0, self.spec.dimensions)), np.zeros((0, self.spec.velocities)), np.zeros(0))
        if self.n_species:
            next(self.export(0), None)

    def _of_blocks(self, kernel: Any) -> list[Bound]:
        """The kernel bound for each block."""
        return [
            self.arena.bind(kernel, block=b, first=first, last=last, patch=patch)
            for b, ((first, last), patch) in enumerate(zip(self.tiles.ranges, self.patches.of_block))
        ]

    def _bind_messages(self) -> None:
        """Tasks that fill the message buffers to the neighbours and read theirs, and the graphs with them."""
        near, kernels = self.near, self.kernels
        self._write = [
            self.arena.bind(kernels.pack_near, records=self._views(buffer.records), filled=buffer.n, peer=peer)
            for peer, buffer in zip(near.peers, near.outgoing)
        ]
        self._read = [
            self.arena.bind(kernels.unpack, records=self._views(buffer.records), n=buffer.n) for buffer in near.incoming
        ]
        self._motion = self._graph_of_motion()

    def _graph_of_motion(self) -> Graph:
        """Push, then messages to the neighbours and from them."""
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

    def _run(self, run: Callable, tasks: Graph | list[Bound]) -> None:
        """Run tasks made by this object. Raises Diverged."""
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
        return int(self.arena["count"].sum())

    def place(self, species: int, x: NDArray, v: NDArray, numbers: NDArray) -> None:
        """Take in new particles: x[n, d] in cells of the grid, v[n, v] in cells per step; migrate and deliver next."""
        self._make_room(len(x))
        outside = groups.BoxArrays(*(array[-1] for array in self.arena.value("boxes")))
        code = self.kernels.place(
            np.ascontiguousarray(x, np.float64), np.ascontiguousarray(v, self.spec.dtype),
            np.ascontiguousarray(numbers, np.uint32), species, self.arena.value("grid"), outside,
        )  # fmt: skip
        if code:
            raise Diverged("an initial position is not a finite number")

    def push(self, iteration: int) -> None:
        """x^n, v^(n-1/2) -> x^(n+1), v^(n+1/2); charge of those who stay in their tile part; the others wait in boxes
        of the rank where they belong, and `delivery`, tasks in stages, is ready to run. Collective.
        """
        near = self.near
        self.pages.room(max(int(self.arena["most"][0]), len(near.peers) * near.capacity))
        near.at(iteration)
        self._run(self.pool.run, self._motion)
        if near.wants[0]:
            capacity = near.capacity
            self._admit_all(near.rest(iteration, self._outgoing()))
            if near.capacity != capacity:
                self._bind_messages()
        if near.wants[0] or self.arena["short"][0]:
            self._find_pages()

    def rewind(self, mover: NDArray) -> None:
        """v^0 -> v^(-1/2) with a mover of half a step backwards."""
        forwards = self.arena["mover"].copy()
        self.arena["mover"][:] = mover
        self.each(self._rewind)
        self.arena["mover"][:] = forwards

    def bind_driven(self, kernel: Callable) -> list[Bound]:
        """Tasks of an acceleration of the user's own, one per block."""
        return [self.arena.bind(kernel, first=first, last=last) for first, last in self.tiles.ranges]

    def bind_moments(self) -> list[Bound]:
        """Tasks of kernels.moments, one per block."""
        with self.world.first_on_node():
            return self._of_ranges(self.kernels.moments)

    def bind_counts(self, histogram: groups.HistogramArrays) -> list[Bound]:
        """Tasks of kernels.histogram, one per block."""
        return self._of_ranges(self.kernels.count_particles, histogram=histogram)

    def _of_ranges(self, kernel: Any, **more: Any) -> list[Bound]:
        """A kernel that leaves the charge alone, bound for each block."""
        ranges = enumerate(self.tiles.ranges)
        return [self.arena.bind(kernel, block=b, first=first, last=last, **more) for b, (first, last) in ranges]

    def clear(self) -> None:
        """No particles."""
        self.pages.drop()

    def deposit_all(self) -> None:
        """The charge of all particles, whatever the patches hold: after placing and delivering."""
        self.each(self._deposit)

    def records(self, species: int, numbers: NDArray, tiles: NDArray, x: NDArray, v: NDArray) -> NDArray[np.uint8]:
        """Records (see kernels.storage.pack) of particles by tile and position in it."""
        records = np.empty((len(numbers), self.record_bytes), np.uint8)
        real, whole = self._views(records)
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
        """Records (see kernels.storage.pack) into the box from outside; when it is full, what is there goes first.

        Migrate and deliver next.
        """
        n = self._arrived[0] = len(records)
        self._make_room(n)
        self._room_for_records(n)
        self.arena["records_bytes"][:n] = records
        self.each(self._unpack)

    def _make_room(self, n: int) -> None:
        """Room for n more in the box from outside."""
        if int(self.arena["counters"][-1, 1]) + n > self.arena.sizes["box_size"]:
            self.deliver()
            self.pages.room(n)

    def deliver(self) -> None:
        """Particles from all boxes into their slots, with their charge; the boxes are empty then."""
        self._find_pages()
        for tasks in self.delivery:
            self.each(tasks)

    def _find_pages(self) -> None:
        """Free pages for all who are in boxes, and a quarter more: the next steps find enough."""
        arrivals = self.arena["lists"][:, 1, : self.blocks].sum(axis=0)
        wanted = arrivals // PAGE + np.minimum(arrivals, self.tiles.n_parts * self.n_species)
        self.pages.need((wanted + wanted // 4).tolist())

    def _room_for_records(self, n: int) -> None:
        """Memory of records under way to other ranks, and then of those that come."""
        if self.arena.reserve(records=n):
            self.arena.set(records=self._views(self.arena["records_bytes"]))

    def _views(self, records: NDArray[np.uint8]) -> groups.RecordArrays:
        """Records[n, record_bytes] as kernels take them."""
        return groups.RecordArrays(records.view(self.spec.dtype), records.view(np.int32))

    def _outgoing(self) -> dict[int, NDArray[np.uint8]]:
        """Records by rank of all that is bound for other ranks, valid until others are taken in."""
        self._room_for_records(int(self.arena["lists"][:, 1, -1].sum()))
        self.each(self._pack)
        starts, records = [0, *self.arena["ends"].tolist()], self.arena["records_bytes"]
        return {rank: records[a:b] for rank, (a, b) in enumerate(pairwise(starts)) if b > a}

    def free(self) -> None:
        """Free what MPI holds (all ranks together)."""
        self.near.free()

    def count(self, species: int) -> int:
        """Particles of a species on this rank."""
        return int(self.arena["count"][species :: self.n_species].sum())

    def export(self, species: int) -> Iterator[tuple[NDArray, NDArray, NDArray]]:
        """Numbers[m], tiles[m] and components[m, c] of this rank's particles of a species, in any order.

        Chunk after chunk; each is valid until the next.
        """
        cursor, grid, pages = np.array([0, -1]), self.arena.value("grid"), self.arena.value("pages")
        numbers, tiles = np.empty(CHUNK, np.int64), np.empty(CHUNK, np.int32)
        components = np.empty((CHUNK, self.spec.components), self.spec.dtype)
        while n := self.kernels.export(species, grid, pages, cursor, numbers, tiles, components):
            yield numbers[:n], tiles[:n], components[:n]
