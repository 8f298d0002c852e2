"""bench: what this machine does, kept for `estimate`: memory bandwidth and the simulator's own kernels."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import click

from hpcpic.core.app.app import AppLoader
from hpcpic.core.app.text import shown, table

TRIAD_BYTES = 24  # STREAM's convention: two reads and a write of float64, the fetch before the write not counted
UPDATE_BYTES = 16


def make_bench_command(app_loader: AppLoader) -> click.Command:
    @click.command("bench")
    @click.option("--quick", is_flag=True, help="Small arrays and few repeats: about five seconds.")
    @click.option("--threads", type=click.IntRange(1), help="Threads per rank.  [default: the node's cores shared]")
    def bench(quick: bool, threads: int | None) -> int:
        """Measure bandwidth and kernel rates of this machine and keep them for `estimate`.

        Under mpirun every rank measures at the same time, and the slowest rank counts; instead of the kernels, what the
        ranks need for each other.
        """
        from hpcpic.core.comm.world import World
        from hpcpic.core.run.failure import guarded

        world = World.start()
        return guarded(world, lambda failure: _measure(app_loader, world, quick, threads))

    return bench


def _measure(app_loader: AppLoader, world: Any, quick: bool, threads: int | None) -> int:
    from hpcpic.core.app.rates import MEASURED, keep_rates

    most = threads or world.default_threads()
    rates: dict[str, float] = {}
    rows: list[tuple[object, ...]] = []
    for n in sorted({1, most}):
        for name, rate in bandwidth(world, n, quick).items():
            rates[name if n == 1 else f"{name}_{n}_threads"] = rate
            every = shown(rate * world.size / 1e9, ".2f", "GB/s")
            rows.append((name, n, shown(rate / 1e9, ".2f", "GB/s"), every))
    app = app_loader()
    kernels: Mapping[str, float] = {}
    if world.size == 1:
        kernels = app.bench(quick) if app.bench else {}
    elif app.bench_ranks:
        kernels = app.bench_ranks(quick, world)
    if world.rank == 0:
        table(
            ("stream", "threads", "per rank", "all ranks"),
            rows,
            right=("per rank", "all ranks"),
        )
        if found := _kernel_rows(kernels, rates["update"]):
            table(("kernel", "rate", "of the memory bound"), found, right=("rate", "of the memory bound"))
        known = {name: rate for name, rate in kernels.items() if "_bytes" not in name}
        kept = rates | known | {MEASURED.format(app.name): 1.0} if world.size == 1 else known
        click.echo(f"kept for `estimate`: {keep_rates(kept)}")
    return 0


def _kernel_rows(kernels: Mapping[str, float], bandwidth: float) -> list[tuple[object, ...]]:
    """Rates as the simulator names them. Beside `push_ns` with `push_bytes` and `mlups A` with `mlups_bytes A`, the
    fraction of the memory bound: the time of these bytes at this bandwidth over that which was measured.
    """
    rows: list[tuple[object, ...]] = []
    for name, rate in kernels.items():
        if "_bytes" in name:
            continue
        of_bytes = name.replace("_ns", "_bytes").replace("mlups", "mlups_bytes")
        size = kernels.get(of_bytes, 0.0) if of_bytes != name else 0.0
        seconds = 1e-6 / rate if name.startswith("mlups") and rate else 1e-9 * rate
        rows.append((name, shown(rate), shown(size / bandwidth / seconds, ".0%") if size and seconds else ""))
    return rows


def bandwidth(world: Any, threads: int, quick: bool) -> dict[str, float]:
    """Bytes per second of one rank for a = b + s c (triad) and a = s a (update), best of several sweeps."""
    import numpy as np

    from hpcpic.core.simd.compile import njit
    from hpcpic.core.space.domain import block_ranges
    from hpcpic.core.tasks.graph import Pool, bind

    @njit
    def triad(a, b, c, s):
        for i in range(a.size):
            a[i] = b[i] + s * c[i]

    @njit
    def update(a, b, c, s):
        for i in range(a.size):
            a[i] = s * a[i]

    n = (16 if quick else 32) << 20  # arrays that no cache holds
    arrays = {name: np.ones(n) for name in "abc"}
    with_bytes = {"triad": (triad, TRIAD_BYTES), "update": (update, UPDATE_BYTES)}
    pool = Pool(threads, world.cpus(threads))
    result = {}
    try:
        for name, (kernel, size) in with_bytes.items():
            parts = [
                bind(kernel, s=1.0 + 1e-9, **{name: array[low:high] for name, array in arrays.items()})
                for low, high in block_ranges(n, threads)
            ]
            best = float("inf")
            for _ in range(5 if quick else 15):
                world.barrier()
                start = time.perf_counter()
                pool.each(parts)
                best = min(best, time.perf_counter() - start)
            result[name] = n * size / world.max(best)
    finally:
        pool.close()
    return result
