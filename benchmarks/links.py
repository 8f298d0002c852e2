"""What moving grains cost: python benchmarks/links.py [nodes per side] [threads].

Prints ns per link of the link pass, and what the steps of grains cost beside the sweep of the fluid, for suspensions of
several densities; all in one process, best of several repetitions.
"""

import math
import sys
import time

import numpy as np

from hpcpic.core.comm.world import World
from hpcpic.core.space.domain import Domain
from hpcpic.core.tasks import Pool
from lbmdem.coupling import Immersed
from lbmdem.fluid import Fluid
from lbmdem.lattices import D3Q19

CASES = [(10, 0.05), (10, 0.2), (10, 0.45), (20, 0.45)]  # diameter in nodes, solid fraction
REPEATS = 5


def suspension(n: int, diameter: float, fraction: float):
    """Spheres on a cubic grid, each displaced within its cell: ids, x, radii, v, omega."""
    rng = np.random.default_rng(0)
    side = max(1, round((fraction * n**3 / (math.pi / 6 * diameter**3)) ** (1 / 3)))
    cell = n / side
    x = (np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), axis=-1).reshape(-1, 3) + 0.5) * cell
    x += rng.uniform(-1, 1, x.shape) * max(0.0, (cell - diameter) / 2)
    v, omega = rng.normal(0, 0.01, x.shape), rng.normal(0, 0.001, x.shape)
    return np.arange(len(x)), x, np.full(len(x), diameter / 2), v, omega


def best(action) -> float:
    """Least time of an action, s."""
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        action()
        times.append(time.perf_counter() - start)
    return min(times)


def measure(n: int, threads: int, diameter: float, fraction: float) -> str:
    world, pool = World.start(), Pool(threads)
    domain = Domain((float(n),) * 3, (n,) * 3, (True,) * 3, (0, n))
    plain = Fluid(world, pool, domain, D3Q19, tau=0.8)
    fluid = Fluid(world, pool, domain, D3Q19, tau=0.8)
    ids, x, radii, v, omega = suspension(n, diameter, fraction)
    immersed = Immersed(fluid, world, pool)
    immersed.start(ids, x, radii, v, omega)
    sign = [1.0]

    def move() -> None:
        x[:] = np.mod(x + sign[0] * v, n)
        sign[0] = -sign[0]
        immersed.move(ids, x, radii, v, omega)

    fluid.step()
    plain.step()
    hook = fluid.hooks.pop()
    sweep, alone = best(fluid.step), best(plain.step)
    links = best(lambda: hook(fluid, fluid.parity))
    moved = best(move)
    count = immersed.counts()["links"]
    pool.close()
    solid = np.count_nonzero(fluid.solid.inner >= 0) / n**3
    whole = sweep + links + moved
    return (
        f"D {diameter:2.0f}  solid {solid:.2f}  grains {len(ids):5d}  links {count:8d}  "
        f"fluid alone {1e3 * alone:6.1f} ms  sweep {1e3 * sweep:6.1f}  "
        f"links {1e3 * links:6.1f} = {1e9 * links / count:5.1f} ns each  "
        f"move {1e3 * moved:6.1f} = {1e6 * moved / len(ids):4.1f} us per grain  step {whole / alone:.2f} x fluid alone"
    )


if __name__ == "__main__":
    size, workers = [*map(int, sys.argv[1:]), *(96, 1)[len(sys.argv) - 1 :]]
    for case in CASES:
        print(measure(size, workers, *case), flush=True)
