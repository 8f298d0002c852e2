"""Particle-steps per second of the grains: a dense bed of equal spheres at rest on a wall, periodic sides.

python benchmarks/dem.py             one core, two threads, two ranks (needs mpirun beside this python)
python benchmarks/dem.py N THREADS   one line of N^3 spheres; under mpirun for ranks

The bed is that of LAMMPS' granular benchmarks: m = d = 1, g = 10, k_n = 2e5, step 1.5e-4 (3 % of a collision),
friction 0.5 with tangential springs. `bed` and `rate` are what other scripts may call.
"""

import subprocess
import sys
from pathlib import Path
from time import perf_counter

import numpy as np

from hpcpic.core.comm.world import World
from hpcpic.core.space.domain import Domain, even_cuts
from hpcpic.core.space.rng import uniforms
from hpcpic.core.tasks import Pool
from lbmdem.contacts import Law, Wall
from lbmdem.dem import Dem
from lbmdem.network import contact_count

STEP, STIFFNESS, GRAVITY = 1.5e-4, 2e5, 10.0
LAWS = {
    "history": Law(STIFFNESS, damping=0.16, friction=0.5, viscosity=25.0, shear=2 / 7 * STIFFNESS),
    "regularised": Law(STIFFNESS, damping=0.16, friction=0.5, viscosity=25.0),
}


def bed(world: World, pool: Pool, n: int, law: Law, state: dict | None = None) -> Dem:
    """n^3 spheres: above each other with gaps to fall through, or in the given `state` (x and v in id order)."""
    number, side = n**3, 1.02 * n
    domain = Domain((1.5 * n, side, side), (2 * n, n, n), (False, True, True), even_cuts(2 * n, world.size))
    domain = domain.with_cuts(_cuts(n, world.size))
    ids = np.arange(number)
    places = np.stack([ids % n, ids // n % n, ids // n**2], 1) + 0.5
    x = places * [1.02, 1.02, 1.1] + 0.04 * (uniforms(7, 0, ids, 3) - 0.5)
    columns = {
        "x": x if state is None else state["x"],
        "v": np.zeros((number, 3)) if state is None else state["v"],
        "omega": np.zeros((number, 3)),
        "radius": np.full(number, 0.5),
        "mass": np.ones(number),
        "inertia": np.full(number, 0.1),
        "fixed": np.zeros(number, bool),
    }
    return Dem(world, pool, domain, columns, law, (Wall((0, 0, 0), (0, 0, 1)),), (0.0, 0.0, -GRAVITY))


def _cuts(n: int, ranks: int) -> tuple[int, ...]:
    """Rows of half a diameter and more, equally many grains of the settled bed in each slab."""
    height = 0.9 * n / 0.75
    return (*(round(height * r / ranks) for r in range(ranks)), 2 * n)


def settled(world: World, pool: Pool, n: int, law: Law, steps: int) -> Dem:
    dem = bed(world, pool, n, law)
    for _ in range(steps // 1000):
        dem.advance(STEP, 1000)
        dem.grains.columns["row"][:, 4:7] *= 0.7  # quicker to rest
    return dem


def rate(dem: Dem, steps: int, repeats: int = 5) -> float:
    """The best of some runs, in particle-steps per second."""
    best = np.inf
    for _ in range(repeats):
        dem.world.barrier()
        begin = perf_counter()
        dem.advance(STEP, steps)
        best = min(best, dem.world.max(perf_counter() - begin))
    return dem.grains.number * steps / best


def measure(n: int, threads: int, kind: str, settle: int) -> None:
    """Print one line of the table, on rank 0."""
    world = World.start()
    pool = Pool(threads, world.cpus(threads))
    dem = settled(world, pool, n, LAWS[kind], settle)
    found, lists = rate(dem, max(50, 2_000_000 // n**3)), dem.version
    contacts = 2 * contact_count(dem) / dem.grains.number
    if world.rank == 0:
        print(
            f"{n**3} spheres, {kind:11s} ranks {world.size} threads {threads}: "
            f"{found / 1e6:.2f} M/s, "
            f"{1e9 / found:6.1f} ns per particle-step, {contacts:.2f} contacts per sphere, skin {dem.skin:.3f} d, {lists} lists",
            flush=True,
        )
    pool.close()


def main() -> None:
    """The whole table, each line in processes of its own; or the one line that is asked for."""
    if len(sys.argv) > 1:
        measure(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3], int(sys.argv[4]))
        return
    launcher = str(Path(sys.executable).with_name("mpirun"))
    for kind in LAWS:
        for ranks, threads in ((1, 1), (1, 2), (2, 1)):
            command = [sys.executable, "-m", "mpi4py", __file__, "22", str(threads), kind, "20000"]
            subprocess.run([launcher, "-n", str(ranks), *command], check=True)


if __name__ == "__main__":
    main()
