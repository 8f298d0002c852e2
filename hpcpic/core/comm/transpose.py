"""Real-to-complex transforms of slabs, built of tasks: rows, transpose, columns, and back.

The grid [N0, N1] (or [N0, N1, N2]) is cut into slabs of rows. A rank transforms its rows block by block and
writes each block transposed to the ranks that own its columns; the columns are contiguous there, and the
spectrum stays in that order (as FFTW_MPI_TRANSPOSED_OUT), so that nothing is transposed twice. The way back
reads the same places. In 3D a row is a plane [N1, N2] and the spectrum is cut along N1.

Inside a node the columns lie in a window that all its ranks share: one copy, straight from the block in cache
to its place. Rank r writes and reads only the part [columns of p, rows of r] of p's columns, and p touches
them only between two tokens: "your rows are in" from r, "your columns are done" to r. So nothing is
overwritten too early: r fills its part anew only after it has read it, which is its own order of tasks, and p
starts only on r's next token. (A token is an MPI message, which orders the stores to shared memory before
it.)

Between nodes the same parts travel as messages, in chunks of columns: the transform of a chunk
runs while the next one arrives, and it leaves while the next one is transformed.
"""

import logging
from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from mpi4py import MPI
from numpy.typing import DTypeLike, NDArray

from hpcpic.core.comm import fftw, shared_memory
from hpcpic.core.comm import transpose_kernels as kernels
from hpcpic.core.comm.messages import Message, Messages
from hpcpic.core.comm.tags import CHANNELS, Channel
from hpcpic.core.comm.world import World
from hpcpic.core.space.domain import block_ranges
from hpcpic.core.space.fields import ALIGNMENT, aligned_zeros
from hpcpic.core.tasks.graph import Graph, Pool, bind

log = logging.getLogger("hpcpic.run")
MIB = 1 << 20
_CACHE = 400_000  # bytes of one block of rows: input and transform stay in the second-level cache
_COLUMN_BLOCK = 1 << 14  # points of one block of columns: some 50 us of work
_CHUNKED = 1 << 17  # bytes for one peer from which messages go in chunks
_TOKEN_ROWS, _TOKEN_COLUMNS, _FORWARD = 0, 1, 2  # channels after Channel.TRANSPOSE; chunks follow _FORWARD


def spectrum_range(points: Sequence[int], ranks: int, rank: int) -> tuple[int, int]:
    """The part (lo, hi) of the second axis of the spectrum that `rank` owns: kx in 2D, ky in 3D."""
    second = points[1] // 2 + 1 if len(points) == 2 else points[1]
    return block_ranges(second, ranks)[rank]


def padded(n: int, dtype: DTypeLike) -> int:
    """n items rounded up so that every row starts a cache line: FFTW treats all of them alike then.

    Never a multiple of 4096 bytes: such rows would fall into few sets of the cache.
    """
    per_line = ALIGNMENT // np.dtype(dtype).itemsize
    lines = -(-n // per_line)
    return (lines + (lines % (4096 // ALIGNMENT) == 0)) * per_line


def blocks_of(lo: int, hi: int, block: int) -> list[tuple[int, int]]:
    return [(first, min(hi, first + block)) for first in range(lo, hi, block)]


class SlabFFT:
    """Transform of real rows [n0, N1(, N2)] of this rank into its part of the transposed spectrum, and back.

    real, results[k]   real[n0, N1(, N2)] views: input, and what `solve` and `backward` give
    spectrum           complex[m1, N0] in 2D, kx-major; complex[m1, M, N0] in 3D; M = N_last // 2 + 1;
                       m1 by `spectrum_range`. Valid between forward() and the next call.
    multiplier         [m1, N0] ([m1, M, N0]) real or complex, or several stacked in front: `solve` gives one
                       result for each. It holds the normalisation 1 / (N0 N1 ...), transforms do not.

    cuts: ranks + 1 row numbers, slabs may be empty. messages: use no shared window (for tests).
    All ranks must make the same calls. The bits of a result depend neither on ranks, threads nor cuts.
    """

    def __init__(
        self,
        world: World,
        pool: Pool,
        points: Sequence[int],
        cuts: Sequence[int],
        dtype: DTypeLike = np.float64,
        multiplier: NDArray | None = None,
        *,
        messages: bool = False,
    ) -> None:
        self._world, self._pool = world, pool
        self._n0, self._row_shape = points[0], tuple(points[1:])
        self._real_type = np.dtype(dtype)
        self._type = np.dtype(np.complex64 if self._real_type == np.float32 else np.complex128)
        stacked = multiplier is not None and multiplier.ndim == len(points) + 1
        outputs = len(multiplier) if stacked and multiplier is not None else 1
        inner = self._cut(points, cuts)
        self._window: MPI.Win | None = None
        self._allocate(outputs, messages)
        shape = (-1, points[0]) if len(points) == 2 else (-1, inner, points[0])
        self.spectrum = self._spectrum[0, :, : points[0]].reshape(shape)
        self._plan()
        self._connect()
        self._exposed = False
        self._graphs: dict[str, Graph] = {}
        if multiplier is not None:
            kind = self._type if np.iscomplexobj(multiplier) else self._real_type
            self._multiplier = np.ascontiguousarray(multiplier, kind).reshape(outputs, -1, points[0])
            self._prepare("solve")

    def at(self, iteration: int) -> None:
        """The next call belongs to this iteration; those after it to the following ones."""
        for messages in self._sets.values():
            messages.at(iteration)

    def forward(self) -> None:
        """real -> spectrum."""
        self._world.barrier()  # a neighbour may still read the spectrum that we are about to replace
        self._run("forward")
        self._exposed = True

    def backward(self) -> None:
        """spectrum -> results[0], not normalised; the spectrum is lost."""
        self._world.barrier()
        self._run("backward")

    def solve(self) -> None:
        """real -> results[k], each through multiplier[k]: one launch, and no barrier."""
        if self._exposed:
            self._world.barrier()
            self._exposed = False
        self._run("solve")

    def free(self) -> None:
        """Free the window (all ranks together)."""
        for messages in self._sets.values():
            messages.free()
        if self._window is not None:
            del self.spectrum  # its memory goes
            self._window.Unlock_all()
            self._window.Free()
            self._window = None

    def _run(self, what: str) -> None:
        if what not in self._graphs:
            self._prepare(what)
        self._pool.run(self._graphs[what])

    def _prepare(self, what: str) -> None:
        with self._world.first_on_node():  # it compiles
            self._graphs[what] = self._build(what).freeze()

    def _cut(self, points: Sequence[int], cuts: Sequence[int]) -> int:
        """Rows and (flattened) columns of every rank; the columns to an index of the second axis."""
        world = self._world
        inner = 1 if len(points) == 2 else points[2] // 2 + 1
        self._rows = [(cuts[p], cuts[p + 1]) for p in range(world.size)]
        ranges = [spectrum_range(points, world.size, p) for p in range(world.size)]
        self._columns = [(inner * lo, inner * hi) for lo, hi in ranges]
        self._width = self._columns[-1][1]
        return inner

    def _node_ranks(self) -> tuple[int, ...]:
        """Ranks of this node in the order of its communicator."""
        if self._world.node_size == 1:
            return ()
        ranks = np.empty(self._world.node_size, np.int64)
        self._world.node.Allgather(np.array([self._world.rank], np.int64), ranks)
        return tuple(map(int, ranks))

    def _room(self, shape: tuple[int, ...]) -> bool:
        """True if every node has shared memory for the columns of its ranks; one warning where it has not."""
        wanted = np.array([self._bytes(shape) + shared_memory.SPARE], np.int64)
        several = self._world.node_size > 1
        if several:
            self._world.node.Allreduce(MPI.IN_PLACE, wanted)
        if not self._world.any(several and bool(wanted[0] > shared_memory.free())):
            return True
        log.warning(
            "a node has less than the %.0f MiB in %s that its ranks want to share for a transform: the columns travel "
            "as messages, which is slower (a container is given more by --shm-size)",
            *(wanted[0] / MIB, shared_memory.FOLDER),
        )
        return False

    def _bytes(self, shape: tuple[int, ...]) -> int:
        return int(np.prod(shape)) * self._type.itemsize + ALIGNMENT

    def _allocate(self, outputs: int, messages: bool) -> None:
        """Rows, columns (shared with the ranks of the node, but for `messages`) and message buffers."""
        rank = self._world.rank
        lo, hi = self._rows[rank]
        row = int(np.prod(self._row_shape))
        shape = (hi - lo, padded(row, self._real_type))
        arrays = [aligned_zeros(shape, self._real_type) for _ in range(1 + outputs)]
        views = [array[:, :row].reshape(hi - lo, *self._row_shape) for array in arrays]
        self._real_rows, self._result_rows = arrays[0], arrays[1:]
        self.real, self.results = views[0], views[1:]
        pitch = padded(self._n0, self._type)
        shapes = {p: (outputs, b - a, pitch) for p, (a, b) in enumerate(self._columns)}
        node = self._node_ranks() if not messages and self._room(shapes[rank]) else ()
        homes = self._shared(shapes, node) if node else {rank: aligned_zeros(shapes[rank], self._type)}
        self._homes = homes
        self._spectrum: NDArray = homes[rank]
        self._near = [p for p in homes if p != rank]
        far = [p for p in range(self._world.size) if p not in homes]
        heights = {p: self._rows[p][1] - self._rows[p][0] for p in far}
        self._sent = {p: aligned_zeros((outputs, shapes[p][1], hi - lo), self._type) for p in far}
        self._got = {p: aligned_zeros((outputs, shapes[rank][1], heights[p]), self._type) for p in far}

    def _shared(self, shapes: dict[int, tuple[int, int, int]], node: tuple[int, ...]) -> dict[int, NDArray]:
        """The columns of every rank of the node in one shared window, each on pages of its own."""
        item = self._type.itemsize
        info = MPI.Info.Create({"alloc_shared_noncontig": "true"})
        size = self._bytes(shapes[self._world.rank])
        window = MPI.Win.Allocate_shared(size, 1, info, cast(MPI.Intracomm, self._world.node))
        info.Free()
        window.Lock_all()
        homes = {}
        for place, p in enumerate(node):
            memory, _ = window.Shared_query(place)
            raw = np.asarray(memory)
            skip = -raw.ctypes.data % ALIGNMENT
            homes[p] = raw[skip : skip + int(np.prod(shapes[p])) * item].view(self._type).reshape(shapes[p])
        homes[self._world.rank][:] = 0  # touched once here: 4 KiB pages are slow to come
        self._world.node.Barrier()  # nobody's columns may come before these zeros
        self._window = window
        return homes

    def _plan(self) -> None:
        self._to_rows = fftw.complex_to_real(self._row_shape, self._real_type)
        self._from_rows = fftw.real_to_complex(self._row_shape, self._real_type)
        self._forward = fftw.complex_to_complex(self._n0, -1, self._type)
        self._backward = fftw.complex_to_complex(self._n0, 1, self._type)
        threads = self._pool.threads
        self._block_pitch = padded(self._width, self._type)
        n_rows, real_pitch = self._real_rows.shape
        row_bytes = self._block_pitch * self._type.itemsize + real_pitch * self._real_type.itemsize
        wanted = max(8, min(_CACHE // row_bytes, -(-n_rows // (4 * threads)), 64))
        self._row_blocks = blocks_of(0, n_rows, wanted // 8 * 8)
        height = max((last - first for first, last in self._row_blocks), default=0)
        size = max(height * self._block_pitch, 2 * padded(self._n0, self._type))
        workspace = aligned_zeros((threads, padded(size, self._type)), self._type)
        self._work = {"workspace": workspace, "busy": np.zeros(8 * threads, np.int64)}

    def _connect(self) -> None:
        """Messages by (what, number of the chunk), and the chunks of our columns."""
        peer_bytes = self._n0 * self._width * self._type.itemsize // self._world.size**2
        self._n_chunks = 4 if self._sent and peer_bytes >= _CHUNKED else 1
        columns = {p: block_ranges(b - a, self._n_chunks) for p, (a, b) in enumerate(self._columns)}
        own = columns[self._world.rank]
        n_own = self._spectrum.shape[1]
        size = max(1, min(_COLUMN_BLOCK // self._n0, -(-n_own // (4 * self._pool.threads))))
        self._column_blocks = [blocks_of(lo, hi, size) for lo, hi in own]
        self._token = np.zeros(1 + self._world.size, np.int64)  # what tokens carry is never read
        self._sets: dict[Any, Messages] = {}
        for what, channel in (("rows in", _TOKEN_ROWS), ("columns done", _TOKEN_COLUMNS)):
            pairs = [(p, [self._token[:1]], [self._token[1 + p : 2 + p]]) for p in self._near]
            self._request(what, 0, channel, pairs)
        for j in range(self._n_chunks):
            to = {p: [plane[slice(*columns[p][j])] for plane in self._sent[p]] for p in self._sent}
            back = {p: [plane[slice(*own[j])] for plane in self._got[p]] for p in self._got}
            channel = _FORWARD + j
            self._request("forward", j, channel, [(p, to[p][:1], back[p][:1]) for p in to])
            channel += self._n_chunks
            self._request("backward", j, channel, [(p, back[p], to[p]) for p in to], step=self._n_chunks)

    def _request(self, what: str, j: int, channel: int, pairs: list[tuple], step: int = 1) -> None:
        """Messages of one exchange from (peer, arrays to send, to receive); empty arrays are not sent."""
        comm = self._world.comm

        def message(p: int, k: int, array: NDArray) -> Message:
            assert Channel.TRANSPOSE + channel + k * step < CHANNELS
            return Message(p, Channel.TRANSPOSE + channel + k * step, array)

        sends = [message(p, k, a) for p, s, _ in pairs for k, a in enumerate(s) if a.size]
        receives = [message(p, k, a) for p, _, r in pairs for k, a in enumerate(r) if a.size]
        if sends:
            self._sets[f"send {what}", j] = Messages(comm, sends=sends)
        if receives:
            self._sets[f"receive {what}", j] = Messages(comm, receives=receives)

    def _build(self, what: str) -> Graph:
        graph = Graph()
        if what != "backward":
            self._add_rows_forward(graph)
        self._add_columns(graph, what)
        if what != "forward":
            self._add_rows_backward(graph)
        return graph

    def _message(self, graph: Graph, what: str, j: int, **handles: Any) -> None:
        if (what, j) in self._sets:
            graph.message(self._sets[what, j], name=f"{what} {j} of a transform", **handles)

    def _home_table(self, output: int) -> NDArray[np.int64]:
        """int64[ranks, 5] as `rows_forward` wants it: where the columns of each rank are written and read."""
        lo, _ = self._rows[self._world.rank]
        table = []
        for step in range(self._world.size):
            p = (self._world.rank + step) % self._world.size  # not all ranks at one rank's memory
            near = p in self._homes
            home = (self._homes if near else self._sent)[p][output]
            if home.size:
                table.append((home.ctypes.data, home.shape[1], lo if near else 0, *self._columns[p]))
        return np.array(table, np.int64).reshape(-1, 5)

    def _add_rows_forward(self, graph: Graph) -> None:
        for j in range(self._n_chunks):
            self._message(graph, "receive forward", j, outs=[("in", j)])
        self._message(graph, "receive rows in", 0, outs=["near rows"])
        rows = {"real": self._real_rows, "plan": self._from_rows, "width": self._block_pitch}
        homes = self._home_table(0)
        for first, last in self._row_blocks:
            task = bind(kernels.rows_forward, first=first, last=last, homes=homes, **rows, **self._work)
            graph.task(task, outs=[("row", first)])
        handles = [("row", first) for first, _ in self._row_blocks]
        graph.task(bind(kernels.join), ins=handles, outs=["rows"])
        self._message(graph, "send rows in", 0, ins=["rows"])
        for j in range(self._n_chunks):
            self._message(graph, "send forward", j, ins=["rows"], outs=[("sent", j)])

    def _add_columns(self, graph: Graph, what: str) -> None:
        parts = [(a.ctypes.data, a.shape[2], self._rows[p][0]) for p, a in self._got.items() if a.shape[2]]
        table = np.array(parts, np.int64).reshape(-1, 3)
        columns = {"spectrum": self._spectrum, "n": self._n0, "parts": table, **self._work}
        if what == "forward":
            kernel, more = kernels.columns_forward, {"plan": self._forward}
        elif what == "backward":
            kernel, more = kernels.columns_backward, {"plan": self._backward}
        else:
            kernel, more = kernels.columns_solve, {"forward": self._forward, "backward": self._backward}
            columns["multiplier"] = self._multiplier
        for j, blocks in enumerate(self._column_blocks):
            for first, last in blocks:
                task = bind(kernel, first=first, last=last, **columns, **more)
                graph.task(task, ins=["rows", "near rows", ("in", j)], outs=[("column", first)])

    def _add_rows_backward(self, graph: Graph) -> None:
        done = [[("column", first) for first, _ in blocks] for blocks in self._column_blocks]
        for j, columns in enumerate(done):
            self._message(graph, "receive backward", j, ins=[("sent", j)], outs=[("back", j)])
            self._message(graph, "send backward", j, ins=columns)
        own = [handle for columns in done for handle in columns]
        graph.task(bind(kernels.join), ins=own, outs=["columns"])
        self._message(graph, "send columns done", 0, ins=["columns"])
        self._message(graph, "receive columns done", 0, outs=["near columns"])
        needed = ["columns", "near columns", *(("back", j) for j in range(self._n_chunks))]
        for k, result in enumerate(self._result_rows):
            rows = {"real": result, "plan": self._to_rows, "width": self._block_pitch, "homes": self._home_table(k)}
            for first, last in self._row_blocks:
                graph.task(bind(kernels.rows_backward, first=first, last=last, **rows, **self._work), ins=needed)
