"""What moving grains cost: python benchmarks/links.py [nodes per side] [threads].

Prints ns per link, by which a step with links takes longer than that of a fluid alone, and what it costs to move the
grains, for suspensions of several densities. Rounds of all parts alternate in one process; the least processor time of
each is told (with several threads: the least wall time), and the median over the rounds of the whole step over that of
a fluid alone.
"""

import math
import statistics
import sys
import time

import numpy as np

from hpcpic.core.comm.world import World
from hpcpic.core.space.domain import Domain
from hpcpic.core.tasks.graph import Pool
from lbmdem.coupling.immersed import Immersed
from lbmdem.fluid.fluid import Fluid
from lbmdem.physics.velocity_sets import D3Q19

CASES = [(10, 0.05), (10, 0.2), (10, 0.45), (20, 0.45)]  # diameter in nodes, solid fraction
REPEATS = 9
VECTOR = 8  # nodes: boxes are so many of them


def suspension(n: int, diameter: float, fraction: float):
    """Spheres on a cubic grid, each displaced within its cell: nodes per side (about n), ids, x, radii, v, omega."""
    rng = np.random.default_rng(0)
    cell = diameter * (math.pi / 6 / fraction) ** (1 / 3)
    side = max(1, round(n / cell))
    n = VECTOR * round(side * cell / VECTOR)
    cell = n / side
    x = (np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), axis=-1).reshape(-1, 3) + 0.5) * cell
    x += rng.uniform(-1, 1, x.shape) * max(0.0, (cell - diameter) / 2)
    v, omega = rng.normal(0, 0.01, x.shape), rng.normal(0, 0.001, x.shape)
    return n, np.arange(len(x)), x, np.full(len(x), diameter / 2), v, omega


def measure(n: int, threads: int, diameter: float, fraction: float) -> str:
    world, pool = World.start(), Pool(threads)
    n, ids, x, radii, v, omega = suspension(n, diameter, fraction)
    domain = Domain((float(n),) * 3, (n,) * 3, (True,) * 3, (0, n))
    plain = Fluid(world, pool, domain, D3Q19, tau=0.8)
    fluid = Fluid(world, pool, domain, D3Q19, tau=0.8)
    immersed = Immersed(fluid, world, pool)
    immersed.start(ids, x, radii, v, omega)
    clock = time.thread_time if threads == 1 else time.perf_counter
    sign = 1.0

    def move() -> None:
        nonlocal sign
        x[:] = np.mod(x + sign * v, n)
        sign = -sign
        immersed.move(ids, x, radii, v, omega)

    parts = (plain.step, fluid.step, move)
    rounds = []
    for _ in range(REPEATS + 1):
        times = [clock()]
        for part in parts:
            part()
            times.append(clock())
        rounds.append(np.diff(times))
    rounds = rounds[1:]
    alone, linked, moved = np.min(rounds, axis=0)
    whole = statistics.median(t[1:].sum() / t[0] for t in rounds)
    count = immersed.counts()["links"]
    pool.close()
    solid = np.count_nonzero(fluid.solid.inner >= 0) / n**3
    each = 1e9 * (linked - alone) / count
    return (
        f"D {diameter:2.0f}  nodes {n}^3  solid {solid:.2f}  grains {len(ids):5d}  links {count:8d}  "
        f"fluid alone {1e3 * alone:6.1f} ms  with links {1e3 * linked:6.1f}, {each:4.1f} ns each  "
        f"move {1e3 * moved:6.1f} = {1e6 * moved / len(ids):4.1f} us per grain  step {whole:.2f} x fluid alone"
    )


if __name__ == "__main__":
    size, workers = [*map(int, sys.argv[1:]), *(96, 1)[len(sys.argv) - 1 :]]
    for case in CASES:
        print(measure(size, workers, *case), flush=True)
