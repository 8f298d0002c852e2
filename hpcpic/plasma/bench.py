"""Rates of the plasma's kernels on this machine, under the names that `estimate` knows.

Every kernel runs whole steps of a small thermal plasma in this process, with few and with many particles per cell:
the difference is the price of a particle, the rest that of a cell.
"""

import itertools
import math
import os
import statistics
from collections.abc import Mapping
from time import perf_counter

from hpcpic.core.comm.world import World
from hpcpic.core.files.config import loads
from hpcpic.core.files.schema import validate
from hpcpic.core.tasks import Pool
from hpcpic.core.timers import Timers
from hpcpic.plasma.config import PlasmaConfig
from hpcpic.plasma.estimate import DEFAULT
from hpcpic.plasma.step import Plasma

FEW, MANY = 8, 64  # particles per cell
STEPS = {True: 12, False: 40}  # by `quick`; the first four are not counted
CASE = """
simulation = {{ dimensions = {d}; solver = "MFT"; cycles = 1; time_step = 0.2; space_length = {points}; }};
grid = {{ points = {points}; }};
species = ( {{ name = "electron"; particles = {n}; charge = -1.0; mass = 1.0; plasma_frequency = 1.0;
              init_method = "random position"; drift_velocity = [0.0, 0.0, 0.0]; thermal_velocity = 0.5; }} );
numerics = {{ shape = "{shape}"; precision = "{precision}"; }};
"""


def bench(quick: bool) -> Mapping[str, float]:
    """Rate by name; with `quick` the standard kernel only (2D CIC double)."""
    world = World.alone()
    rates: dict[str, float] = {}
    kernels = list(itertools.product((2, 1), ("CIC", "NGP", "TSC"), ("double", "single")))
    for d, shape, precision in kernels[: 1 if quick else None]:
        points = (256, 256) if d == 2 else (16384,)
        few = measure(world, 1, points, FEW, shape, precision, quick)
        many = measure(world, 1, points, MANY, shape, precision, quick)
        cells = points[0] ** d
        particle = (many["step"] - few["step"]) / (cells * (MANY - FEW))
        rates[f"particle_ns {d}D {shape} {precision}"] = 1e9 * particle
        if shape == "CIC" and precision == "double":
            transform = 1e-9 * DEFAULT["fft_ns"] * math.log2(cells)
            cell = (few["step"] - few["launch"]) / cells - FEW * particle - transform
            rates[f"cell_ns {d}D"] = max(0.0, 1e9 * cell)
            rates["launch_us 1"] = 1e6 * few["launch"]
            rates["sample_ns"] = 1e9 * many["sample"] / (cells * MANY)
    rates["cores"] = len(os.sched_getaffinity(0))
    return rates


def measure(
    world: World, threads: int, points: tuple[int, ...], per_cell: int, shape: str, precision: str, quick: bool
) -> dict[str, float]:
    """Seconds of a step and of a sample of the series, and of a step with next to nothing to do."""
    result = {}
    pool = Pool(threads, world.cpus(threads))
    for name, size, n in (("step", points, points[0] ** len(points) * per_cell), ("launch", (16,) * len(points), 16)):
        text = CASE.format(d=len(points), points=list(map(float, size)), n=n, shape=shape, precision=precision)
        text = text.replace(f"points = {list(map(float, size))}", f"points = {list(size)}")
        plasma = Plasma(validate(PlasmaConfig, loads(text)), world, pool, Timers())
        times = []
        for _ in range(STEPS[quick]):
            begin = perf_counter()
            plasma.step()
            times.append(perf_counter() - begin)
        result[name] = statistics.median(times[4:])
        if name == "step":
            plasma.solve()
            begin = perf_counter()
            plasma.scalars()
            result["sample"] = perf_counter() - begin
        plasma.close()
    pool.close()
    return result
