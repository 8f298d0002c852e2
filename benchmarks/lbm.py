"""Lattice Boltzmann steps against the memory they must move: updates per second beside an in-place STREAM.

    python benchmarks/lbm.py [--points 128] [--threads 1 2] [--lattice D3Q19] [--collision TRT] [--storage double]
    mpirun -n 2 python -m mpi4py benchmarks/lbm.py --threads 1

A step of one sweep reads and writes every population once (304 bytes per node for D3Q19 in double). Each round times a
pass over an array of that size that only scales it, then a step, then steps of the wavefront; rounds are interleaved
and medians of the ratios are told, so that the moods of the machine cancel.
"""

import argparse
import statistics
from collections.abc import Callable
from time import perf_counter

import numpy as np

from hpcpic.core.comm.world import World
from hpcpic.core.simd.compile import njit
from hpcpic.core.simd.vector import Vec, address_of, lanes, load_at, prefetch_to_write, store_at
from hpcpic.core.space.domain import Domain, block_ranges, even_cuts
from hpcpic.core.space.fields import aligned_zeros
from hpcpic.core.tasks.graph import Pool, bind
from lbmdem.fluid.fluid import Fluid
from lbmdem.physics.velocity_sets import LATTICES, Lattice

D = Vec(lanes(np.float64), np.float64)
LINE = 8 * lanes(np.float64)


@njit
def scale(a, low, high):
    """a *= 1 for lines low..high: reads and writes as fast as memory goes."""
    start = address_of(a, 0)
    for k in range(low, high):
        place = start + k * LINE
        prefetch_to_write(place + 16 * LINE)
        store_at(place, load_at(D, place, LINE) * 0.999, LINE)


def seconds(world: World, action: Callable[[], None]) -> float:
    """Seconds that an action takes on the slowest rank."""
    world.barrier()
    begin = perf_counter()
    action()
    return world.max(perf_counter() - begin)


def measure(world: World, pool: Pool, lattice: Lattice, shape: tuple, collision: str, storage: str, rounds: int) -> str:
    d = lattice.dimensions
    domain = Domain(tuple(map(float, shape)), shape, (True,) * d, even_cuts(shape[0], world.size))
    fluid = Fluid(world, pool, domain, lattice, tau=0.7, collision=collision, storage=storage)
    fluid.set_equilibrium(1.0, np.linspace(0.01, 0.02, d))
    nodes = int(np.prod(shape))
    moved = 2 * lattice.q * np.dtype(fluid.f.dtype).itemsize * nodes // world.size
    array = aligned_zeros((moved // 16,), np.float64)
    array[...] = 1.0
    lines = block_ranges(array.nbytes // LINE, pool.threads)
    stream = [bind(scale, a=array, low=low, high=high) for low, high in lines]
    deep = fluid.depth
    samples: list[tuple[float, float, float]] = []
    for _ in range(rounds + 1):
        copy = seconds(world, lambda: pool.each(stream))
        step = seconds(world, fluid.step)
        wave = seconds(world, lambda: fluid.advance(deep)) / deep
        samples.append((copy, step, wave))
    samples = samples[1:]
    fluid.free()
    median = [statistics.median(column) for column in zip(*samples)]
    ratio = statistics.median(copy / step for copy, step, _ in samples)
    gain = statistics.median(step / wave for _, step, wave in samples)
    return (
        f"{lattice.name} {'x'.join(map(str, shape))} {collision:8s}{storage:7s} {world.size} x {pool.threads}: "
        f"{1e-6 * nodes / median[1]:7.1f} MLUPS = {100 * ratio:5.1f} % of "
        f"{1e-9 * moved * world.size / median[0]:5.1f} GB/s; "
        f"{deep} steps per sweep {1e-6 * nodes / median[2]:7.1f} MLUPS = x {gain:.2f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=128, help="of an edge (2D: 16 times as many)")
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--lattice", choices=LATTICES, nargs="+", default=["D3Q19"])
    parser.add_argument("--collision", nargs="+", default=["TRT"])
    parser.add_argument("--storage", nargs="+", default=["double", "single"])
    parser.add_argument("--rounds", type=int, default=15)
    options = parser.parse_args()
    world = World.start()
    for threads in options.threads:
        pool = Pool(threads, world.cpus(threads))
        for name in options.lattice:
            lattice = LATTICES[name]
            shape = (options.points * (16 if lattice.dimensions == 2 else 1),) * lattice.dimensions
            for collision in options.collision:
                for storage in options.storage:
                    line = measure(world, pool, lattice, shape, collision, storage, options.rounds)
                    if world.rank == 0:
                        print(line, flush=True)
        pool.close()


if __name__ == "__main__":
    main()
