"""What cuts by cost gain over even ones: mpirun -n 2 python -m mpi4py benchmarks/balance.py plasma [--rounds 5]

plasma: four of five particles of two species lie in the first quarter of the box. Blocks of steps with either cuts take
turns; the fastest block of each. Before them what it takes to lay the scene out anew.
"""

import argparse
import sys
from time import perf_counter

import numpy as np

from hpcpic.core.case.config import loads
from hpcpic.core.comm.world import World
from hpcpic.core.run.balance import Movable
from hpcpic.core.space.domain import even_cuts, fullest
from hpcpic.core.tasks.graph import Pool
from hpcpic.core.timers import Timers

PLASMA = """
simulation = { cycles = 1000; time_step = 0.05; space_length = [256.0, 256.0]; random_seed = 7; };
grid = { points = [256, 256]; };
species = (
  { name = "electrons"; particles = 2000000; charge = -1.0; mass = 1.0; plasma_frequency = 1.0;
    thermal_velocity = 0.2; init_method = "dense slab"; },
  { name = "ions"; particles = 2000000; charge = 1.0; mass = 1836.0; plasma_frequency = 0.02334;
    thermal_velocity = 0.01; init_method = "dense slab"; } );
"""


def plasma(world: World) -> Movable:
    from hpcpic.plasma.configure import configure
    from hpcpic.plasma.setup.loaders import Batch, Loader, register
    from hpcpic.plasma.step import Plasma

    class DenseSlab(Loader):
        name = "dense slab"

        def positions(self, batch: Batch) -> np.ndarray:
            x = super().positions(batch)
            x[:, -1] *= np.where(batch.index % 5 < 4, 0.25, 1.0)
            return x

    register(DenseSlab())
    return Plasma(configure(loads(PLASMA)), world, Pool(1), Timers())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", choices=SCENES)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--steps", type=int, default=20, help="of a block")
    options = parser.parse_args()
    world = World.start()
    model = SCENES[options.scene](world)
    cuts = {"by cost": model.domain.cuts, "even": even_cuts(model.domain.points[0], world.size)}
    best = dict.fromkeys(("laying out", *cuts), np.inf)
    load = {}
    for _ in range(options.rounds):
        for name, these in cuts.items():
            world.barrier()
            begin = perf_counter()
            model.balance.move(these)
            world.barrier()
            best["laying out"] = min(best["laying out"], perf_counter() - begin)
            costs = model.row_costs()
            if costs is not None:
                load = {of: fullest(costs, one) * world.size / costs.sum() for of, one in cuts.items()}
            model.step()
            world.barrier()
            begin = perf_counter()
            for _ in range(options.steps):
                model.step()
            world.barrier()
            best[name] = min(best[name], (perf_counter() - begin) / options.steps)
    if world.rank == 0:
        sys.stdout.write(f"laying out  {best['laying out']:8.3f} s\n")
        for name, these in cuts.items():
            sys.stdout.write(
                f"{name:10}  {1e3 * best[name]:8.2f} ms a step, fullest rank {load[name]:.2f} of the mean; "
                f"rows {' '.join(map(str, np.diff(these)))}\n"
            )


SCENES = {"plasma": plasma}

if __name__ == "__main__":
    main()
