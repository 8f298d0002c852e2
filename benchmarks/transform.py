"""Time of one field solve (transform, multiply, back) on an N x N grid: ranks and threads side by side.

    python benchmarks/transform.py [512,1024,2048,4096] [--single]

Starts two ranks by itself. Columns, ms: 1 rank with 1 thread, 1 rank with 2 threads, 2 ranks through the
shared window, 2 ranks by messages, and for comparison the same FFTW calls alone on 2 ranks, array by array,
with nothing moved between them (the solve can be faster: its blocks stay in cache). All are measured in turn,
round after round; the best round counts, gains are medians over rounds. The last column is 2 ranks (window)
over the time of FFTW-MPI as once measured on a machine of this kind (two cores, FFTW 3.3.10 with Open MPI,
MEASURE, transposed output): a stored figure to compare with, not a measurement.
"""

import argparse
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

FFTW_MPI_MS = {512: 0.62, 1024: 3.1, 2048: 26.4, 4096: 160.0}  # double precision, 2 ranks
SECONDS = 2.0  # per size


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sizes", nargs="?", default="256,512,1024,2048,4096")
    parser.add_argument("--single", action="store_true", help="float32")
    return parser.parse_args()


def launch() -> int:
    """This script on two ranks."""
    mpirun = Path(sys.prefix, "bin", "mpirun")
    return subprocess.call([mpirun, "-n", "2", sys.executable, "-m", "mpi4py", *sys.argv])


def fft_calls(world: Any, n: int, dtype: Any) -> Callable[[], None]:
    """The FFTW calls of one solve on this rank's share, without transpose or product."""
    import numpy as np

    from hpcpic.core.comm import fftw
    from hpcpic.core.comm.transpose import padded, spectrum_range
    from hpcpic.core.comm.transpose_kernels import line
    from hpcpic.core.simd.compile import njit
    from hpcpic.core.space.domain import block_ranges
    from hpcpic.core.space.fields import aligned_zeros

    @njit(cache=False)
    def rows(plan, source, target):
        for i in range(source.shape[0]):
            line(plan, source[i], target[i])

    kind = np.dtype(np.complex64 if dtype == np.float32 else np.complex128)
    low, high = block_ranges(n, world.size)[world.rank]
    first, last = spectrum_range((n, n), world.size, world.rank)
    real = aligned_zeros((high - low, padded(n, dtype)), dtype)
    half = aligned_zeros((high - low, padded(n // 2 + 1, kind)), kind)
    columns = [aligned_zeros((last - first, padded(n, kind)), kind) for _ in range(2)]
    plans = [
        (fftw.real_to_complex((n,), dtype), real, half),
        (fftw.complex_to_complex(n, -1, kind), columns[0], columns[1]),
        (fftw.complex_to_complex(n, 1, kind), columns[1], columns[0]),
        (fftw.complex_to_real((n,), dtype), half, real),
    ]

    def calls() -> None:
        for plan, source, target in plans:
            rows(plan, source, target)

    return calls


def candidates(world: Any, n: int, dtype: Any) -> tuple[dict[str, tuple[bool, Callable[[], None]]], list[Any]]:
    """Name -> (rank 0 alone?, what to time), and the solvers to free."""
    import numpy as np
    from mpi4py import MPI

    from hpcpic.core.comm.transpose import SlabFFT, spectrum_range
    from hpcpic.core.comm.world import World
    from hpcpic.core.space.domain import even_cuts
    from hpcpic.core.tasks.graph import Pool

    alone = World(MPI.COMM_SELF, MPI.COMM_SELF)
    cores = sorted(os.sched_getaffinity(0))

    def solver(where: Any, pool: Any, messages: bool = False) -> Any:
        low, high = spectrum_range((n, n), where.size, where.rank)
        factor = np.full((high - low, n), 1 / n**2)
        fft = SlabFFT(where, pool, (n, n), even_cuts(n, where.size), dtype, factor, messages=messages)
        fft.real[:] = np.random.default_rng(where.rank).standard_normal(fft.real.shape)
        return fft

    two = Pool(2, cores[:2]) if world.rank == 0 else Pool(1)
    one = Pool(1, [cores[world.rank % len(cores)]])
    solvers = [solver(alone, one), solver(alone, two), solver(world, one), solver(world, one, messages=True)]
    names = ["1 x 1", "1 x 2", "2 x 1", "2 x 1 messages"]
    timed = {name: (k < 2, fft.solve) for k, (name, fft) in enumerate(zip(names, solvers, strict=True))}
    return timed | {"calls only": (False, fft_calls(world, n, dtype))}, [*solvers, one, two]


def rest(world: Any) -> None:
    """Barrier that leaves the cores to the others while waiting."""
    request = world.comm.Ibarrier()
    while not request.Test():
        time.sleep(2e-3)


def measure(world: Any, n: int, dtype: Any) -> dict[str, list[float]]:
    """Seconds of every candidate in every round, as rank 0 sees them."""
    timed, owned = candidates(world, n, dtype)
    times: dict[str, list[float]] = {name: [] for name in timed}
    for first_rank_only, run in timed.values():
        if world.rank == 0 or not first_rank_only:
            run()  # compiles, touches memory
    end = time.perf_counter() + SECONDS
    go = True
    while go:
        for name, (first_rank_only, run) in timed.items():
            rest(world)
            if first_rank_only and world.rank > 0:
                continue
            best = []
            for _ in range(1 if n > 1024 else 5):
                if not first_rank_only:
                    world.barrier()
                start = time.perf_counter()
                run()
                if not first_rank_only:
                    world.barrier()
                best.append(time.perf_counter() - start)
            times[name].append(min(best))
        go = not world.any(time.perf_counter() > end)
    for thing in owned:
        (thing.free if hasattr(thing, "free") else thing.close)()
    return times


def report(n: int, times: dict[str, list[float]], single: bool) -> None:
    def gain(name: str) -> float:
        return statistics.median(a / b for a, b in zip(times["1 x 1"], times[name], strict=True))

    cells = [f"{min(values) * 1e3:8.3f} {name}" for name, values in times.items()]
    stored = FFTW_MPI_MS.get(n)
    ratio = "-" if stored is None or single else f"{min(times['2 x 1']) * 1e3 / stored:.2f}"
    gains = f"2 threads {gain('1 x 2'):.2f}x, 2 ranks {gain('2 x 1'):.2f}x of one"
    print(f"{n:5d}  " + " | ".join(cells) + f" | {gains} | {ratio} of stored FFTW-MPI", flush=True)


def main() -> int:
    options = arguments()
    if "PMI_RANK" not in os.environ and "OMPI_COMM_WORLD_RANK" not in os.environ:
        return launch()
    import numpy as np

    from hpcpic.core.comm.world import World

    world = World.start()
    if world.size != 2:
        raise SystemExit("two ranks wanted")
    dtype = np.dtype(np.float32 if options.single else np.float64)
    if world.rank == 0:
        print(f"ms per solve, {dtype.name}; ranks x threads")
    for n in map(int, options.sizes.split(",")):
        times = measure(world, n, dtype)
        if world.rank == 0:
            report(n, times, options.single)
    return 0


if __name__ == "__main__":
    sys.exit(main())
