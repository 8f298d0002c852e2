"""Rates of the fluid's kernels on this machine, under the names that `estimate` knows.

Sweeps are timed on a periodic box beyond the caches, one step per pass over memory; links on a bed of spheres, as the
difference that they make to a step.
"""

import math
import os
import statistics
from collections.abc import Callable, Mapping
from time import perf_counter

import numpy as np

from hpcpic.core.comm.world import World
from hpcpic.core.space.domain import Domain
from hpcpic.core.tasks import Pool
from lbmdem.coupling import Immersed
from lbmdem.fluid import Fluid
from lbmdem.lattices import D2Q9, D3Q19, Lattice

SHAPES = {"D2Q9": (1024, 1024), "D3Q19": (96, 96, 96)}
RADIUS, APART = 5.0, 12  # nodes, of the bed
STEPS = {True: 8, False: 20}  # by `quick`; the first four are not counted


def bench(quick: bool) -> Mapping[str, float]:
    """Rate by name; with `quick` the standard sweep only (D3Q19, double)."""
    world, pool = World.alone(), Pool(1)
    rates = {"mlups D3Q19 double": sweep_rate(world, pool, D3Q19, "double", quick)}
    if not quick:
        for lattice, storage in ((D3Q19, "single"), (D2Q9, "double"), (D2Q9, "single")):
            rates[f"mlups {lattice.name} {storage}"] = sweep_rate(world, pool, lattice, storage, quick)
        rates["wave_gain"] = wave_gain(world, pool)
        rates["lattice_launch_us"] = 1e6 * seconds(box(world, pool, D2Q9, (16, 16), "double").step, quick)
        rates |= link_rates(world, pool)
    pool.close()
    rates["cores"] = len(os.sched_getaffinity(0))
    return rates


def box(world: World, pool: Pool, lattice: Lattice, shape: tuple[int, ...], storage: str) -> Fluid:
    domain = Domain(tuple(map(float, shape)), shape, (True,) * len(shape), (0, shape[0]))
    return Fluid(world, pool, domain, lattice, tau=0.8, storage=storage)


def seconds(action: Callable[[], None], quick: bool) -> float:
    """Median of some calls after the first ones."""
    times = []
    for _ in range(STEPS[quick]):
        begin = perf_counter()
        action()
        times.append(perf_counter() - begin)
    return statistics.median(times[4:])


def wave_gain(world: World, pool: Pool) -> float:
    """How much faster several steps per pass are than one, D3Q19 in double."""
    fluid = box(world, pool, D3Q19, SHAPES["D3Q19"], "double")
    one = seconds(fluid.step, False)
    return one / (seconds(lambda: fluid.leap(fluid.depth), False) / fluid.depth)


def sweep_rate(world: World, pool: Pool, lattice: Lattice, storage: str, quick: bool) -> float:
    """Million node updates per second."""
    shape = SHAPES[lattice.name]
    return 1e-6 * math.prod(shape) / seconds(box(world, pool, lattice, shape, storage).step, quick)


def link_rates(world: World, pool: Pool) -> dict[str, float]:
    """ns per link, of grains that stay and that move."""
    n = 4 * APART
    fluid = box(world, pool, D3Q19, (n, n, n), "double")
    centres = np.stack(np.meshgrid(*[np.arange(0, n, APART) + 0.3] * 3), axis=-1).reshape(-1, 3)
    ids, still = np.arange(len(centres)), np.zeros((len(centres), 3))
    spheres = (ids, centres, np.full(len(centres), RADIUS), still, still)
    immersed = Immersed(fluid, world, pool, fixed=spheres)
    hooks, rates = fluid.hooks, {}
    for kind in ("fixed", "moving"):
        if kind == "moving":
            fluid.hooks = []
            immersed = Immersed(fluid, world, pool)
            immersed.start(*spheres)
            hooks = fluid.hooks
        linked = seconds(fluid.step, False)
        fluid.hooks = []
        alone = seconds(fluid.step, False)
        fluid.hooks = hooks
        rates[f"link_ns {kind}"] = 1e9 * max(0.0, linked - alone) / immersed.counts()["links"]
    return rates
