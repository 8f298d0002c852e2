"""Nanoseconds per particle and step of the plasma, by phase, beside the memory bandwidth of the same run.

python benchmarks/plasma.py            one core, two threads, two ranks (needs mpirun beside this python)
python benchmarks/plasma.py POINTS PER_CELL PRECISION THREADS   one line; under mpirun for ranks
"""

import subprocess
import sys
from pathlib import Path
from time import perf_counter

import numpy as np
import psutil

CASE = """
simulation = {{ dimensions = 2; cycles = 1000; time_step = 0.2; space_length = [{n}.0, {n}.0]; }};
grid = {{ points = [{n}, {n}]; }};  field = {{ magnetic = [0.0, 0.0, 0.25]; }};
numerics = {{ precision = "{precision}"; }};
species = ( {{ name = "electron"; particles = {particles}; charge = -1.0; mass = 1.0; plasma_frequency = 1.0;
               init_method = "random position"; thermal_velocity = 0.5; }} );
"""
SETTINGS = ((256, 64, "double"), (256, 64, "single"), (512, 8, "double"), (512, 8, "single"))
STEPS = 20


def update_bandwidth() -> float:
    """GB/s of x += 1 in place, read and write, on one core."""
    x = np.zeros(1 << 24)
    best = 0.0
    for _ in range(5):
        begin = perf_counter()
        np.add(x, 1.0, out=x)
        best = max(best, 2 * x.nbytes / (perf_counter() - begin) / 1e9)
    return best


def measure(n: int, per_cell: int, precision: str, threads: int) -> None:
    """Print one line of the table, on rank 0."""
    from hpcpic.core.case.config import loads
    from hpcpic.core.comm.world import World
    from hpcpic.core.tasks.graph import Pool
    from hpcpic.core.timers import Timers
    from hpcpic.plasma.configure import configure
    from hpcpic.plasma.step import Plasma

    world = World.start()
    pool, timers, particles = Pool(threads, world.cpus(threads)), Timers(), n * n * per_cell
    bandwidth = update_bandwidth()
    config = configure(loads(CASE.format(n=n, precision=precision, particles=particles)))
    plasma = Plasma(config, world, pool, timers)
    for _ in range(3):
        plasma.step()
    timers.reset()
    times = []
    for _ in range(STEPS):
        world.barrier()
        begin = perf_counter()
        plasma.step()
        times.append(world.max(perf_counter() - begin))
    pages, arena = plasma.cloud.pages, plasma.cloud.arena
    stored = pages.fresh * (arena["pool"][0].nbytes + arena["ids"][0].nbytes) / max(plasma.cloud.n, 1)
    resident = psutil.Process().memory_info().rss / 2**20
    if world.rank == 0:
        per = 1e9 / particles
        phases = " ".join(f"{name} {t / STEPS * per:.3f}" for name, (t, _) in timers.totals().items())
        print(
            f"{n:5d} {per_cell:4d} {precision:6s} ranks {world.size} threads {threads}: "
            f"best {min(times) * per:.3f} median {np.median(times) * per:.3f} ns | {phases} | "
            f"pages {stored:.1f} B/particle, resident {resident:.0f} MiB | update {bandwidth:.0f} GB/s",
            flush=True,
        )
    plasma.close()
    pool.close()


def main() -> None:
    """The whole table, each line in processes of its own; or the one line that is asked for."""
    if len(sys.argv) > 1:
        n, per_cell, precision, one = sys.argv[1:]
        measure(int(n), int(per_cell), precision, int(one))
        return
    launcher = str(Path(sys.executable).with_name("mpirun"))
    for setting in SETTINGS:
        for ranks, threads in ((1, 1), (1, 2), (2, 1)):
            command = [sys.executable, "-m", "mpi4py", __file__, *map(str, setting), str(threads)]
            subprocess.run([launcher, "-n", str(ranks), *command], check=True)


if __name__ == "__main__":
    main()
