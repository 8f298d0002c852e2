"""What cuts by cost gain over even ones: mpirun -n 2 python -m mpi4py benchmarks/balance.py plasma [--rounds 5]

plasma: four of five particles of two species lie in the first quarter of the box. lbmdem, lbmdem-2d: there is a dense
suspension in that quarter of a box of fluid; dry: such spheres without the fluid. Blocks of steps with either cuts take
turns; the fastest block of each. Before them what it takes to lay the scene out anew.

python benchmarks/balance.py lbmdem --slabs, on one rank: the slabs of two ranks with either cuts as boxes of their own,
by the processor time of their fastest step, for which a machine need not be quiet.
"""

import argparse
import sys
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from time import perf_counter, process_time

import numpy as np

from hpcpic.core.case.config import loads
from hpcpic.core.comm.world import World
from hpcpic.core.space.domain import better_cuts, even_cuts, fullest
from hpcpic.core.tasks.graph import Pool
from hpcpic.core.timers import Timers
from hpcpic.plasma.step import Plasma
from lbmdem.step import LbmDem

PLASMA = """
simulation = { cycles = 1000; time_step = 0.05; space_length = [256.0, 256.0]; random_seed = 7; };
grid = { points = [256, 256]; };
species = (
  { name = "electrons"; particles = 2000000; charge = -1.0; mass = 1.0; plasma_frequency = 1.0;
    thermal_velocity = 0.2; init_method = "dense slab"; },
  { name = "ions"; particles = 2000000; charge = 1.0; mass = 1836.0; plasma_frequency = 0.02334;
    thermal_velocity = 0.01; init_method = "dense slab"; } );
"""


def plasma(world: World) -> Plasma:
    from hpcpic.plasma.configure import configure
    from hpcpic.plasma.setup.loaders import Batch, Loader, register

    class DenseSlab(Loader):
        name = "dense slab"

        def positions(self, batch: Batch) -> np.ndarray:
            x = super().positions(batch)
            x[:, -1] *= np.where(batch.index % 5 < 4, 0.25, 1.0)
            return x

    register(DenseSlab())
    return Plasma(configure(loads(PLASMA)), world, Pool(1), Timers())


SUSPENSION = """
simulation = {{ dimensions = {d}; end_time = 1.0e4; {dry} }};
domain = {{ size = {size}; spacing = 1.0; }};
{wet}
{grains}
contact = {{ normal_stiffness = 0.1; }};
"""
GRAINS = "grains = ({{ diameter = 10.0; density = 2.0; velocity = {velocity}; position = ({places}); }});"
FLUID = "fluid = { density = 1.0; kinematic_viscosity = 0.1; time_step = 1.0; };"
APART = 10.6  # nodes between the centres of its grains, which are 10 nodes across


def suspension(world: World, points: tuple[int, ...], rows: tuple[int, int] | None = None, wet: bool = True) -> LbmDem:
    """Grains in the first quarter of a box along its last axis. rows: of a slab that is to be a box of its own."""
    from lbmdem.configure import configure

    low, high = rows or (0, points[-1])
    sides = [np.arange(0.5 * APART, n - 0.5 * APART, APART) for n in (*points[:-1], points[-1] // 4)]
    heights = sides[-1][(sides[-1] >= low) & (sides[-1] < high)] - low
    sides[-1] = np.clip(heights, 0.5 * APART, high - low - 0.5 * APART)
    places = np.stack(np.meshgrid(*sides, indexing="ij"), -1).reshape(-1, len(points))
    velocity, centres = [1e-3] * len(points), ", ".join(map(str, places.tolist()))
    text = SUSPENSION.format(
        d=len(points),
        size=[float(n) for n in (*points[:-1], high - low)],
        wet=FLUID if wet else "",
        dry="" if wet else "time_step = 0.1;",
        grains=GRAINS.format(velocity=velocity, places=centres) if len(places) else "",
    )
    return LbmDem(configure(loads(text)), world, Pool(1), Timers())


def slabs(scene: Callable[..., LbmDem | Plasma], steps: int) -> None:
    """Tell the processor time of slabs of two ranks, as boxes of their own."""
    world = World.alone()
    costs = scene(world).row_costs()
    assert costs is not None
    even = even_cuts(len(costs), 2)
    for name, cuts in {"by cost": better_cuts(costs, even) or even, "even": even}.items():
        spent = []
        for rows in pairwise(cuts):
            box, best = scene(world, rows=rows), np.inf
            for _ in range(steps):
                begin = process_time()
                box.step()
                best = min(best, process_time() - begin)
            spent.append(best)
        told, forecast = 2 * max(spent) / sum(spent), 2 * fullest(costs, cuts) / costs.sum()
        sys.stdout.write(
            f"{name:10}  {' and '.join(f'{1e3 * one:.2f}' for one in spent)} ms, fullest rank {told:.2f} of the mean, "
            f"by the forecast {forecast:.2f}; rows {' '.join(map(str, np.diff(cuts)))}\n"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", choices=SCENES)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--steps", type=int, default=20, help="of a block")
    parser.add_argument("--slabs", action="store_true", help="of a suspension, on one rank")
    options = parser.parse_args()
    if options.slabs:
        slabs(SCENES[options.scene], options.steps)
        return
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


SCENES: dict[str, Callable[..., LbmDem | Plasma]] = {
    "plasma": plasma,
    "lbmdem": partial(suspension, points=(64, 64, 256)),
    "lbmdem-2d": partial(suspension, points=(512, 512)),
    "dry": partial(suspension, points=(256, 256, 512), wet=False),
}

if __name__ == "__main__":
    main()
