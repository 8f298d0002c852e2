"""What a fluid node costs among solids that stay: python benchmarks/pores.py [nodes per side] [diameter in nodes].

Balls at random places, which may overlap, until the porosity is reached; walls are half-way, so that nothing but the
sweep is timed. Processor time of one core per fluid node, rounds of all porosities interleaved, the least of each; one
step per pass over memory, and several. Bytes: populations, and what the sweep has to know of the nodes.
"""

import math
import sys
import time

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.world import World
from hpcpic.core.space.domain import Domain
from hpcpic.core.tasks.graph import Pool
from lbmdem.fluid.fluid import Fluid
from lbmdem.physics.velocity_sets import D3Q19

POROSITIES = (1.0, 0.9, 0.5, 0.35, 0.1)
ROUNDS = 7


def balls(n: int, diameter: float, porosity: float) -> NDArray[np.bool_]:
    """[n, n, n]: nodes within the balls, which are periodic."""
    rng = np.random.default_rng(0)
    reach = math.ceil(diameter / 2) + 1
    near = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    solid = np.zeros((n,) * 3, np.bool_)
    left = (1.0 - porosity) * n**3
    while left > 0:
        centre = rng.uniform(0, n, 3)
        nodes = near + np.rint(centre).astype(np.int64)
        inside = tuple((nodes[((nodes - centre) ** 2).sum(axis=1) <= diameter**2 / 4] % n).T)
        left -= np.count_nonzero(~solid[inside])
        solid[inside] = True
    return solid


def main() -> None:
    n, diameter = [*map(int, sys.argv[1:]), *(96, 10)[len(sys.argv) - 1 :]]
    world, pool = World.start(), Pool(1)
    domain = Domain((float(n),) * 3, (n,) * 3, (True,) * 3, (0, n))
    fluids, times = [], np.full((len(POROSITIES), 2), np.inf)
    for porosity in POROSITIES:
        fluid = Fluid(world, pool, domain, D3Q19, tau=0.8)
        fluid.stays = True
        fluid.solid.inner[balls(n, diameter, porosity)] = 0
        fluid.solid_changed()
        fluids.append(fluid)
    for _ in range(ROUNDS):
        for best, fluid in zip(times, fluids):
            for k, steps in enumerate((2, 2 * fluid.depth)):
                begin = time.thread_time()
                fluid.advance(steps)
                best[k] = min(best[k], (time.thread_time() - begin) / steps)
    for best, fluid in zip(times, fluids):
        count = np.count_nonzero(fluid.solid.inner < 0)
        step, wave = 1e9 * best / count
        print(
            f"porosity {count / n**3:.3f}  {fluid.sweep_bytes / count:4.0f} bytes, ns per fluid node: {step:6.2f} = "
            f"{step * n**3 / (1e9 * times[0, 0]):.2f} x fluid alone; "
            f"{fluid.depth} steps per pass {wave:6.2f} = {wave * n**3 / (1e9 * times[0, 1]):.2f} x",
            flush=True,
        )
    pool.close()


if __name__ == "__main__":
    main()
