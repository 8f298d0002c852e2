"""Rates of the plasma's kernels on this machine, under the names that `estimate` knows.

Whole steps of small thermal plasmas in this process. From many and few particles in a cell follows the price of a
particle, from a plasma of next to nothing that of the launches, from one of empty cells that of a cell; the field has a
timer of its own. On all cores the step with many particles tells what they gain.
"""

import itertools
import os
from collections.abc import Callable, Mapping
from functools import partial
from time import perf_counter
from typing import NamedTuple

from hpcpic.core.cli.rates import undisturbed
from hpcpic.core.comm.world import World
from hpcpic.core.files.config import loads
from hpcpic.core.files.schema import validate
from hpcpic.core.tasks import Pool
from hpcpic.core.timers import Timers
from hpcpic.plasma.config import PlasmaConfig
from hpcpic.plasma.step import Plasma

FEW, MANY = 4, 64  # particles per cell
STEPS = {True: 16, False: 40}  # by `quick`; the first four are not counted
FULL = {2: (128, 128), 1: (8192,)}  # points of the plasma with particles
EMPTY = {2: (512, 512), 1: (65536,)}  # and of the one with next to none
TINY = {2: (16, 16), 1: (256,)}
CASE = """
simulation = {{ dimensions = {d}; solver = "MFT"; cycles = 1; time_step = 0.2; space_length = {lengths}; }};
grid = {{ points = {points}; }};
species = ( {{ name = "electron"; particles = {n}; charge = -1.0; mass = 1.0; plasma_frequency = 1.0;
              init_method = "random position"; drift_velocity = [0.0, 0.0, 0.0]; thermal_velocity = 0.5; }} );
numerics = {{ shape = "{shape}"; precision = "{precision}"; }};
"""


class Costs(NamedTuple):
    """Seconds of a step, of the field in it, and of a sample of the series beside the field."""

    step: float
    field: float
    sample: float


def bench(quick: bool) -> Mapping[str, float]:
    """Rate by name; with `quick` the standard kernel only (2D CIC double)."""
    world = World.alone()
    rates: dict[str, float] = {}
    kernels = list(itertools.product((2, 1), ("CIC", "NGP", "TSC"), ("double", "single")))
    for d, shape, precision in kernels[: 1 if quick else None]:
        made = partial(measure, world, steps=STEPS[quick], shape=shape, precision=precision)
        few, many = (made(FULL[d], per_cell * FULL[d][0] ** d) for per_cell in (FEW, MANY))
        particles = FULL[d][0] ** d * (MANY - FEW)
        particle = (many.step - few.step) / particles
        rates[f"particle_ns {d}D {shape} {precision}"] = 1e9 * particle
        if shape == "CIC" and precision == "double":
            rates |= rates_of_cells(made, d, (many.sample - few.sample) / particles)
            if d == 2 and (cores := len(world.cpus(1))) > 1:
                together = made(FULL[d], MANY * FULL[d][0] ** d, threads=cores)
                rates["plasma_core_gain"] = many.step / together.step
    rates["cores"] = len(os.sched_getaffinity(0))
    return rates


def rates_of_cells(made: Callable[..., Costs], d: int, sample: float) -> dict[str, float]:
    """Of cells without particles, of launches, and of a sample, of which `sample` s per particle are known."""
    tiny, empty = made(TINY[d], 16), made(EMPTY[d], 16)
    cells = EMPTY[d][0] ** d
    rates = {
        f"field_ns {d}D": 1e9 * (empty.field - tiny.field) / cells,
        f"cell_ns {d}D": 1e9 * (empty.step - empty.field - tiny.step + tiny.field) / cells,
    }
    if d == 2:
        rates |= {
            "plasma_launch_us": 1e6 * tiny.step,
            "plasma_sample_us": 1e6 * tiny.sample,
            "sample_ns": 1e9 * sample,
            "sample_cell_ns": 1e9 * (empty.sample - tiny.sample) / cells,
        }
    return rates


def measure(
    world: World, points: tuple[int, ...], n: int, *, steps: int, shape: str, precision: str, threads: int = 1
) -> Costs:
    """Of a plasma of n particles on these points."""
    lengths = [float(k) for k in points]
    text = CASE.format(d=len(points), lengths=lengths, points=list(points), n=n, shape=shape, precision=precision)
    pool, timers = Pool(threads, world.cpus(threads)), Timers()
    plasma = Plasma(validate(PlasmaConfig, loads(text)), world, pool, timers)
    found = []
    for _ in range(steps):
        timers.reset()
        begin = perf_counter()
        plasma.step()
        step, field = perf_counter() - begin, timers.totals().get("field", (0.0, 0))[0]
        sample = 0.0
        if len(found) % 4 == 0:
            plasma.solve()
            begin = perf_counter()
            plasma.scalars()
            sample = perf_counter() - begin
        found.append((step, field, sample))
    plasma.close()
    pool.close()
    usual = [costs for k, costs in enumerate(found[4:]) if k % 4 != 1]  # the step after a sample has no field
    sampled = [costs for k, costs in enumerate(found[4:]) if k % 4 == 0]
    return Costs(*(undisturbed([c[k] for c in usual]) for k in range(2)), undisturbed([c[2] for c in sampled]))
