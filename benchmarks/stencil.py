"""What tasks and messages cost: the 5-point stencil on a periodic N x N grid, and empty tasks.

    mpirun -n 2 -genv MPIR_CVAR_CH4_IPC_CMA_P2P_THRESHOLD 65536 python -m mpi4py benchmarks/stencil.py
        messages in the graph against no communication (MPICH then copies up to 64 KiB without a system call)
    python benchmarks/stencil.py
        1 and 2 threads against one loop, cost of tasks and launches

Each sample is one launch of a graph of many steps beside one plain compiled loop of as many; the two are
interleaved and the median of the ratios is told. Compilation and the first samples are left out.
"""

import statistics
from time import perf_counter

import numpy as np

from hpcpic.core.comm.messages import Message, Messages
from hpcpic.core.comm.world import World
from hpcpic.core.simd.compile import njit
from hpcpic.core.space.domain import block_ranges
from hpcpic.core.tasks.graph import Graph, Pool, bind

SIZES = (256, 512, 1024, 2048)
DEPTHS = (1, 2)  # ghost rows
SAMPLE_S = 4e-3  # of one launch: long against its start, short against the moods of the machine


@njit
def sweep(a, b, first, last):
    """One step of rows first..last of b[rows + 2, N + 2] from a, and their periodic ghost columns."""
    for i in range(first, last):
        below, here, above, new = a[i - 1], a[i], a[i + 1], b[i]
        for j in range(1, here.size - 1):
            new[j] = here[j] + 0.1 * (above[j] + below[j] + here[j + 1] + here[j - 1] - 4.0 * here[j])
        new[0] = new[new.size - 2]
        new[new.size - 1] = new[1]


@njit
def plain(a, b, steps):
    """Steps without tasks and without communication (steps is even)."""
    for _ in range(steps // 2):
        sweep(a, b, 1, a.shape[0] - 1)
        sweep(b, a, 1, a.shape[0] - 1)


@njit
def nothing(x):
    pass


@njit
def spend(x, rounds):
    """About a nanosecond per round."""
    for _ in range(rounds):
        x[0] = x[0] * 0.5 + 1.0


class Stencil:
    """Two buffers of one slab with `depth` ghost rows, and the graph of `steps` steps.

    Ghosts are exchanged every `depth` steps; in between the valid rows shrink by one on each side per step,
    so some rows are computed by both neighbours. A step has one block at each edge (the first to be computed)
    and `bands` between them.
    """

    def __init__(self, world: World, n: int, bands: int, depth: int, steps: int) -> None:
        self.world, self.depth = world, depth
        self.rows = block_ranges(n, world.size)[world.rank]
        n_rows = self.rows[1] - self.rows[0]
        self.buffers = [np.zeros((n_rows + 2 * depth, n + 2)) for _ in range(2)]
        inner = block_ranges(n_rows - 2 * depth, bands)
        self.cuts = [2 * depth + low for low, _ in inner] + [n_rows]
        self.messages = [self._exchange(buffer, 2 * which) for which, buffer in enumerate(self.buffers)]
        self.graph = self._graph(steps)

    def _exchange(self, a: np.ndarray, channel: int) -> Messages:
        comm, d = self.world.comm, self.depth
        up, down = (self.world.rank + 1) % self.world.size, (self.world.rank - 1) % self.world.size
        if self.world.size == 1:
            return Messages(comm)
        receives = [Message(up, channel, a[-d:]), Message(down, channel + 1, a[:d])]
        sends = [Message(down, channel, a[d : 2 * d]), Message(up, channel + 1, a[-2 * d : -d])]
        return Messages(comm, sends=sends, receives=receives)

    def _graph(self, steps: int) -> Graph:
        graph, last = Graph(), len(self.cuts)
        for step in range(steps):
            old, new, lost = step % 2, 1 - step % 2, 1 + step % self.depth
            if lost == 1:
                self._ghosts(graph, old, last)
            limits = [lost, *self.cuts, self.buffers[0].shape[0] - lost]
            for block in (0, last, *range(1, last)):
                first, end = limits[block : block + 2]
                kernel = bind(sweep, a=self.buffers[old], b=self.buffers[new], first=first, last=end)
                near = [(old, k) for k in (block - 1, block, block + 1)]
                mine = [(new, block)]
                if block in (0, last) and lost < self.depth:
                    mine.append((new, -1 if block == 0 else last + 1))
                graph.task(kernel, ins=near, outs=mine, priority=block in (0, last))
        return graph.freeze()

    def _ghosts(self, graph: Graph, old: int, last: int) -> None:
        """Ghost rows are blocks -1 and last + 1."""
        edges, ghosts = [(old, 0), (old, last)], [(old, -1), (old, last + 1)]
        if self.world.size > 1:
            graph.message(self.messages[old], ins=edges, outs=ghosts)
        else:
            graph.task(bind(wrap, a=self.buffers[old], depth=self.depth), ins=edges, outs=ghosts, priority=1)

    def start(self, values: np.ndarray) -> None:
        """Inner values of the whole grid; ghost columns are set, ghost rows come by message."""
        inner = self.buffers[0][self.depth : -self.depth]
        inner[:, 1:-1] = values[self.rows[0] : self.rows[1]]
        inner[:, 0], inner[:, -1] = inner[:, -2], inner[:, 1]

    def free(self) -> None:
        for messages in self.messages:
            messages.free()


@njit
def wrap(a, depth):
    n = a.shape[0]
    for k in range(depth):
        a[k] = a[n - 2 * depth + k]
        a[n - depth + k] = a[depth + k]


def check(world: World, pool: Pool, depth: int) -> None:
    """The graph computes what whole-array arithmetic does, bit for bit."""
    grid = np.random.default_rng(1).random((64, 64))
    stencil = Stencil(world, 64, 3, depth, 2 * depth)
    stencil.start(grid)
    for launch in range(2):
        pool.run(stencil.graph)
        for _ in range(2 * depth):
            near = np.roll(grid, -1, 0) + np.roll(grid, 1, 0) + np.roll(grid, -1, 1) + np.roll(grid, 1, 1)
            grid = grid + 0.1 * (near - 4.0 * grid)
        mine = grid[stencil.rows[0] : stencil.rows[1]]
        assert np.array_equal(stencil.buffers[0][depth:-depth, 1:-1], mine), f"wrong result in launch {launch}"
    stencil.free()


def seconds(world: World, action, *arguments) -> float:
    """Seconds that an action takes on the slowest rank."""
    world.barrier()
    begin = perf_counter()
    action(*arguments)
    return world.max(perf_counter() - begin)


def compare(world: World, pool: Pool, n: int, depth: int, samples: int = 60) -> tuple[float, float]:
    """Medians of plain over graph time, and of the graph's time of a step [s]."""
    steps = 4 * max(1, int(SAMPLE_S / (n * n / world.size * 0.3e-9) / 4))
    bands = 1 if pool.threads == 1 else 4 * pool.threads
    stencil = Stencil(world, n, bands, depth, steps)
    stencil.start(np.random.default_rng(1).random((n, n)))
    rows = slice(depth - 1, stencil.buffers[0].shape[0] - depth + 1)  # the same memory for both
    slabs = [buffer[rows] for buffer in stencil.buffers]
    ratios, times = [], []
    for _ in range(samples + 3):
        ideal = seconds(world, plain, *slabs, steps)
        ours = seconds(world, pool.run, stencil.graph)
        ratios.append(ideal / ours)
        times.append(ours / steps)
    stencil.free()
    return statistics.median(ratios[3:]), statistics.median(times[3:])


def cost_of_tasks(pool: Pool) -> None:
    """Empty tasks, launches, and what tasks of 100 us lose."""
    x = np.zeros(1)
    empty = bind(nothing, x=x)
    for what, n_before in (("independent", 0), ("chained", 1), ("with 3 predecessors", 3)):
        graph = Graph()
        for k in range(10_000):
            handles = [(k + shift) % 10 for shift in range(n_before)]
            graph.task(empty, ins=handles[1:], inouts=handles[:1])
        graph.freeze()
        times = []
        for _ in range(30):
            begin = perf_counter()
            pool.run(graph)
            times.append((perf_counter() - begin) / 10_000)
        print(f"  {statistics.median(times) * 1e6:7.3f} us per empty task, {what}")
    for count in (1, 2):
        bounds, times = [bind(nothing, x=x) for _ in range(count)], []
        for _ in range(2000):
            begin = perf_counter()
            pool.each(bounds)
            times.append(perf_counter() - begin)
        print(f"  {statistics.median(times) * 1e6:7.2f} us to launch {count} empty task(s) and return")


def loss_of_long_tasks(pool: Pool) -> None:
    x, n_tasks = np.zeros((64, 8)), 64
    bounds = [bind(spend, x=row, rounds=60_000) for row in x]
    ratios = []
    spend(x[0], 1)
    for _ in range(25):
        begin = perf_counter()
        spend(x[0], n_tasks * 60_000)
        middle = perf_counter()
        pool.each(bounds)
        ratios.append((perf_counter() - middle) / (middle - begin))
    each = (middle - begin) / n_tasks * 1e6
    loss = statistics.median(ratios) * pool.threads - 1.0
    print(f"  {100 * loss:7.2f} % lost in {n_tasks} tasks of {each:.0f} us, against one loop shared perfectly")


def main() -> None:
    world = World.start()
    for threads in [1] if world.size > 1 else [1, 2]:
        pool = Pool(threads, world.cpus(threads))
        for depth in DEPTHS:
            check(world, pool, depth)
        if world.rank == 0:
            print(f"{world.size} rank(s) x {threads} thread(s): speed of the plain loop, us per step")
        for n in SIZES:
            for depth in DEPTHS:
                ratio, step = compare(world, pool, n, depth)
                if world.rank == 0:
                    print(f"  {n:5d}^2, {depth} ghost row(s): {ratio:6.3f} {step * 1e6:10.2f}", flush=True)
        if world.size == 1:
            cost_of_tasks(pool)
            loss_of_long_tasks(pool)
        pool.close()


if __name__ == "__main__":
    main()
