"""Speed of whole SPH steps: python benchmarks/sph_speed.py [--particles 1e5 3e5 1e6] [--rounds 3] [--launcher mpirun]

The dam break against a column (case column-impact-a, with its walls and its series) with as many particles of fluid,
in double and single precision, on one core, two threads and two ranks; with TVD-RK3, three evaluations of all pair
sums a step, for the second of the sizes. Rounds of one core and two threads are interleaved; medians. Columns:

    evaluations  particles (of walls too) times evaluations of all pair sums, millions per second of whole steps;
                 momentum and continuity of the split scheme are one together, though they cost half as much again
    overhead     share of sorting, ghosts, migration and the series (with its energies and forces) in a step
    bytes        of all arrays, per particle

Before them the speed of memory: a = b + 2 c, 24 bytes counted. --balance measures instead how evenly dynamic cuts, cuts
made once and even cuts load two ranks while the water runs through the tank.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
from time import perf_counter

import numpy as np

from hpcpic.core.case.config import load
from hpcpic.core.comm.world import World
from hpcpic.core.simd.compile import njit
from hpcpic.core.space.domain import even_cuts
from hpcpic.core.tasks.graph import Pool, bind
from hpcpic.core.timers import Timers
from sph.app import shipped_cases
from sph.configure import configure
from sph.step import Sph

VOLUME = 0.4 * 0.61 * 0.3 + 1.2 * 0.61 * 0.01  # of the water, m3
OVERHEAD = ("sort", "ghosts", "migrate", "scalars")
WARM = 8  # steps before: until a sample has been taken, whose kernels are loaded then
STEPS = 4  # of a round
EVALUATIONS = {"symplectic": 1, "rk3-tvd": 3}


def engine(world: World, pool: Pool, integrator: str, precision: str, particles: float, *more: str) -> Sph:
    spacing = (VOLUME / particles) ** (1 / 3)
    settings = (
        f"numerics.spacing={spacing!r}", f'numerics.precision="{precision}"',
        f'simulation.integrator="{integrator}"', "simulation.cfl=0.6", *more,
    )  # fmt: skip
    return Sph(configure(load(shipped_cases()["column-impact-a"], settings)), world, pool, Timers())


def step(sph: Sph) -> None:
    """A step, and a line of the series if it is due; what the series evaluates the next step has not to."""
    period = sph.time_periods["series"]
    before = sph.time // period
    sph.step()
    if sph.time // period > before:
        sph.current_forces()
        sph.scalars()


def measured(world: World, kinds: list[tuple], rounds: int) -> list[dict]:
    """Seconds of a step and more for each (threads, integrator, precision, particles), on all ranks of `world`."""
    found = []
    for integrator, precision, particles in dict.fromkeys(kind[1:] for kind in kinds):
        threads = [kind[0] for kind in kinds if kind[1:] == (integrator, precision, particles)]
        pools = [Pool(n, world.cpus(n)) for n in threads]
        runs = [engine(world, pool, integrator, precision, particles) for pool in pools]
        seconds: list[list[float]] = [[] for _ in runs]
        for _ in range(rounds + 1):
            for sph, times in zip(runs, seconds):
                if not times:
                    for _ in range(WARM):
                        step(sph)
                    sph.timers.reset()
                world.barrier()
                begin = perf_counter()
                for _ in range(STEPS):
                    step(sph)
                times.append(world.max(perf_counter() - begin) / STEPS)
        for n, sph, times in zip(threads, runs, seconds):
            totals = sph.timers.totals()
            bodies, held = world.sum_int(np.array([sph.storage.n, nbytes(sph)]))
            found.append({
                "integrator": integrator, "precision": precision, "ranks": world.size, "threads": n,
                "bodies": int(bodies), "seconds": statistics.median(times[1:]), "bytes": int(held) / int(bodies),
                "overhead": sum(totals[name][0] for name in OVERHEAD if name in totals) / (sum(times) * STEPS),
            })  # fmt: skip
            sph.close()
        for pool in pools:
            pool.close()
    return found


def nbytes(sph: Sph) -> int:
    """Bytes of the arrays of a rank; views of one memory count once."""
    held = {}
    for array in map(sph.tasks.arena.__getitem__, sph.tasks.arena.declared):
        while isinstance(array, np.ndarray) and isinstance(array.base, np.ndarray):
            array = array.base
        held[id(array)] = getattr(array, "nbytes", 0)
    return sum(held.values())


@njit
def triad(a, b, c, low, high):
    for k in range(np.uint64(low), np.uint64(high)):
        a[k] = b[k] + 2.0 * c[k]


def stream(threads: int) -> float:
    """GB/s of a = b + 2 c, best of five."""
    pool, n = Pool(threads, World.alone().cpus(threads)), 16_000_000
    a, b, c = (np.ones(n) for _ in range(3))
    tasks = [bind(triad, a=a, b=b, c=c, low=n * k // threads, high=n * (k + 1) // threads) for k in range(threads)]
    best = np.inf
    for _ in range(5):
        begin = perf_counter()
        pool.each(tasks)
        best = min(best, perf_counter() - begin)
    pool.close()
    return 24e-9 * n / best


def load_of_ranks(particles: float, end: float) -> None:
    """Mean over a run of the cost of the fuller of two ranks over the mean: what two ranks wait for."""
    world = World.start()
    for name, period in (("dynamic cuts", 100), ("cuts made once", 0), ("even cuts", 0)):
        sph = engine(world, Pool(1), "symplectic", "double", particles, f"numerics.balance_period={period}")
        if name == "even cuts":
            sph.slabs.cut(sph.domain.with_cuts(even_cuts(sph.grid.layers, world.size)))
            sph.migrate()
            sph.sort()
        loads, begin = [], perf_counter()
        while sph.time < end:
            sph.step()
            if sph.iteration % 10 == 0:
                loads.append(sph.cells.costs().sum())
        mean = np.mean(world.sum_int(np.array(loads)) / world.size)
        worst = np.mean([world.max(float(load)) for load in loads])
        if world.rank == 0:
            say(f"{name:16} fuller rank {worst / mean:.3f} of the mean over {sph.iteration} steps: "
                f"efficiency at most {100 * mean / worst:.0f} %; {perf_counter() - begin:.1f} s\n")  # fmt: skip
        sph.close()


def say(text: str) -> None:
    sys.stdout.write(text)
    sys.stdout.flush()


def table(found: list[dict]) -> None:
    say("integrator  pairs   ranks x threads  particles   s/step  evaluations  overhead  bytes\n")
    alone = {(r["integrator"], r["precision"], r["bodies"]): r for r in found if r["ranks"] * r["threads"] == 1}
    for r in found:
        rate = 1e-6 * EVALUATIONS[r["integrator"]] * r["bodies"] / r["seconds"]
        one = alone.get((r["integrator"], r["precision"], r["bodies"]), r)
        times = f"  x {one['seconds'] / r['seconds']:.2f}" if one is not r else ""
        say(f"{r['integrator']:11} {r['precision']:7} {r['ranks']:5} x {r['threads']} {r['bodies']:17} "
            f"{r['seconds']:8.4f} {rate:12.2f} {100 * r['overhead']:7.1f} % {r['bytes']:6.0f}{times}\n")  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--particles", type=float, nargs="+", default=[1e5, 3e5, 1e6])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--launcher", default="mpirun")
    parser.add_argument("--balance", action="store_true", help="under mpirun -n 2")
    parser.add_argument("--kinds", help=argparse.SUPPRESS)  # of the ranks that this program starts
    options = parser.parse_args()
    if options.balance:
        return load_of_ranks(options.particles[0], 0.8)
    if options.kinds:
        world = World.start()
        found = measured(world, [tuple(kind) for kind in json.loads(options.kinds)], options.rounds)
        return say(json.dumps(found)) if world.rank == 0 else None
    sizes = [("symplectic", n) for n in options.particles] + [("rk3-tvd", n) for n in options.particles[1:2]]
    scenes = [(integrator, precision, n) for integrator, n in sizes for precision in ("double", "single")]
    threads = sorted({1, len(os.sched_getaffinity(0))})
    for n in threads:
        say(f"memory, {n} threads: {stream(n):.1f} GB/s\n")
    found = measured(World.alone(), [(n, *scene) for scene in scenes for n in threads], options.rounds)
    command = [options.launcher, "-n", "2", sys.executable, "-m", "mpi4py", __file__, "--rounds", str(options.rounds)]
    command += ["--kinds", json.dumps([(1, *scene) for scene in scenes])]
    found += json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    table(sorted(found, key=lambda r: (r["integrator"], r["bodies"], r["precision"], r["ranks"], r["threads"])))
    return None


if __name__ == "__main__":
    main()
