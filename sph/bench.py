"""Rates of the SPH kernels on this machine, under the names that `estimate` knows.

Steps of the split scheme with a cube of disordered particles, large and small, in empty space; a step is worth 1.46
evaluations of all pair sums. What a step takes beside them grows with the particles from what its launches take.
"""

import os
from collections.abc import Mapping
from time import perf_counter
from typing import NamedTuple

import numpy as np

from hpcpic.core.cli.rates import undisturbed
from hpcpic.core.comm.world import World
from hpcpic.core.files.config import loads
from hpcpic.core.files.schema import validate
from hpcpic.core.tasks import Pool
from hpcpic.core.timers import Timers
from sph.config import SphConfig
from sph.estimate import SUMS
from sph.step import Sph

ACROSS = {2: 160, 3: 36}  # particles along an edge of the cube
FEW = {2: 8, 3: 5}
STEPS = {True: 4, False: 16}  # by `quick`
CASE = """
simulation = {{ dimensions = {d}; end_time = 1.0; integrator = "symplectic"; cfl = 0.5; }};
domain = {{ low = {low}; high = {high}; }};
eos = {{ sound_speed = 10.0; }};
fluid = ( {{ shape = {{ box = {{ low = {near}; high = {far}; }}; }}; initial_pressure = "zero"; }} );
numerics = {{ spacing = {spacing!r}; density_flux = "molteni"; artificial_viscosity = 0.05;
             precision = "{precision}"; }};
"""


class Costs(NamedTuple):
    """Seconds of the pair sums of a step and of all else in it, directed pairs within the support, particles."""

    sums: float
    rest: float
    pairs: int
    n: int


def bench(quick: bool) -> Mapping[str, float]:
    """Rate by name; with `quick` 3D double only."""
    world, worth = World.alone(), SUMS["symplectic"]
    rates: dict[str, float] = {}
    for d, precision in ((3, "double"), (3, "single"), (2, "double"), (2, "single"))[: 1 if quick else None]:
        many = measure(world, d, precision, ACROSS[d], STEPS[quick])
        few = measure(world, d, precision, FEW[d], 4 * STEPS[quick])
        pair = (many.sums - few.sums) / (many.pairs - few.pairs) / worth
        rates[f"pair_ns {d}D {precision}"] = 1e9 * pair
        if (d, precision) == (3, "double"):
            each = (many.rest - few.rest) / (many.n - few.n)
            launch = max(0.0, few.sums / worth - few.pairs * pair)
            rates |= {"body_ns": 1e9 * each, "step_us": 1e6 * (few.rest - few.n * each), "sum_launch_us": 1e6 * launch}
            if (cores := len(os.sched_getaffinity(0))) > 1:
                all_cores = measure(world, d, precision, ACROSS[d], STEPS[quick], cores)
                rates["pair_core_gain"] = (many.sums + many.rest) / (all_cores.sums + all_cores.rest)
    rates["cores"] = len(os.sched_getaffinity(0))
    return rates


def measure(world: World, d: int, precision: str, across: int, steps: int, threads: int = 1) -> Costs:
    """Of a cube with so many particles along an edge."""
    text = CASE.format(
        d=d, low=[-1.0] * d, high=[2.0] * d, near=[0.0] * d, far=[1.0] * d, spacing=1.0 / across, precision=precision
    )
    pool = Pool(threads, world.cpus(threads))
    sph = Sph(validate(SphConfig, loads(text)), world, pool, Timers())
    sph.bodies.own("x")[:] += np.random.default_rng(1).uniform(0.0, 0.2 / across, (d, sph.bodies.n))
    sph.migrate()
    sph.sort()
    steps_s, sums_s = [], []
    for _ in range(2 + steps):
        sph.timers.reset()
        begin = perf_counter()
        sph.step()
        steps_s.append(perf_counter() - begin)
        sums_s.append(sph.timers.totals()["pairs"][0])
    step, sums, n = undisturbed(steps_s[2:]), undisturbed(sums_s[2:]), sph.bodies.n
    pairs = neighbours(sph, across)
    sph.close()
    pool.close()
    return Costs(sums, step - sums, pairs, n)


def neighbours(sph: Sph, across: int) -> int:
    """Directed pairs within the support, of all particles of the cube on its lattice."""
    reach, d = sph.scene.support / sph.scene.spacing, sph.scene.dimensions
    steps = np.arange(-int(reach), int(reach) + 1)
    grid = np.meshgrid(*[steps] * d)
    inside = (sum(axis**2 for axis in grid) < reach * reach) & (sum(axis**2 for axis in grid) > 0)
    return int(np.prod([across - abs(axis[inside]) for axis in grid], axis=0).sum())
