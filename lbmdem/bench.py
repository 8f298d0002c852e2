"""Rates of the fluid's kernels on this machine, under the names that `estimate` knows.

Sweeps are timed on a periodic box beyond the caches, one step and several per pass over memory; what a body force,
central moments and solids add, on boxes within the caches; links on a bed of spheres, as the difference that they make
to a step; what moving grains need whatever their number, on a single one.
"""

import math
import os
from collections.abc import Callable, Mapping
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np

from hpcpic.core.cli.rates import undisturbed
from hpcpic.core.comm.world import World
from hpcpic.core.space.domain import Domain
from hpcpic.core.tasks import Pool
from lbmdem.coupling import Immersed
from lbmdem.fluid import Fluid
from lbmdem.kernels.sweep import MIXED, SKIP
from lbmdem.lattices import D2Q9, D3Q19, Lattice
from lbmdem.vectors import Shares

SHAPES = {"D2Q9": (1024, 1024), "D3Q19": (96, 96, 96)}
CACHED = (40, 40, 40)
RADIUS, APART = 5.0, 12  # nodes, of the bed
SIDE = 8 * APART  # of its box
SHIFT = 0.02  # nodes in a step, of spheres that move
STEPS = {True: 8, False: 20}  # by `quick`; the first four are not counted


def bench(quick: bool) -> Mapping[str, float]:
    """Rate by name; with `quick` the standard sweep only (D3Q19, double)."""
    world, pool = World.alone(), Pool(1)
    rates = sweep_rates(world, pool, D3Q19, quick)
    if not quick:
        for lattice, storage in ((D3Q19, "single"), (D2Q9, "single")):
            one = seconds(box(world, pool, lattice, SHAPES[lattice.name], storage).step, quick)
            rates[f"mlups {lattice.name} {storage}"] = 1e-6 * math.prod(SHAPES[lattice.name]) / one
        rates |= sweep_rates(world, pool, D2Q9, quick)
        rates["lattice_launch_us"] = 1e6 * seconds(box(world, pool, D2Q9, (16, 16)).step, quick)
        plain, force = (seconds(box(world, pool, D3Q19, CACHED, **kind).step, quick)
                        for kind in ({}, {"force": (1e-6, 0.0, 0.0)}))  # fmt: skip
        central = seconds(box(world, pool, D3Q19, CACHED, collision="central").step, quick)
        rates |= {"forced": force / plain - 1, "central": central / plain - 1}
        rates |= bed_rates(world, pool)
        rates |= moving_rates(world, pool)
    if (cores := len(os.sched_getaffinity(0))) > 1:
        rates |= core_gains(world, cores, rates)
    pool.close()
    rates["cores"] = cores
    return rates


def box(
    world: World, pool: Pool, lattice: Lattice, shape: tuple[int, ...], storage: str = "double", **kind: Any
) -> Fluid:
    domain = Domain(tuple(map(float, shape)), shape, (True,) * len(shape), (0, shape[0]))
    return Fluid(world, pool, domain, lattice, tau=0.8, storage=storage, **kind)


def seconds(action: Callable[[], None], quick: bool) -> float:
    """Of a call, after the first ones."""
    times = []
    for _ in range(STEPS[quick]):
        begin = perf_counter()
        action()
        times.append(perf_counter() - begin)
    return undisturbed(times[4:])


def together(fluid: Fluid) -> float:
    """Seconds of a step, several per pass over memory."""
    return seconds(lambda: fluid.leap(2 * fluid.depth), False) / fluid.depth


def sweep_rates(world: World, pool: Pool, lattice: Lattice, quick: bool) -> dict[str, float]:
    """Million node updates per second, one step per pass over memory; how much faster several are."""
    name = lattice.name
    fluid = box(world, pool, lattice, SHAPES[name])
    one = seconds(fluid.step, quick)
    return {f"mlups {name} double": 1e-6 * math.prod(SHAPES[name]) / one, f"wave_gain {name}": one / together(fluid)}


def core_gains(world: World, cores: int, rates: Mapping[str, float]) -> dict[str, float]:
    """What all cores gain over one, with one step and several per pass."""
    pool = Pool(cores, world.cpus(cores))
    found = sweep_rates(world, pool, D3Q19, False)
    pool.close()
    one, several = (found[name] / rates[name] for name in ("mlups D3Q19 double", "wave_gain D3Q19"))
    return {"sweep_core_gain": one, "wave_core_gain": one * several}


def spheres(centres: np.ndarray) -> tuple[np.ndarray, ...]:
    """At rest, as Immersed takes them."""
    still = np.zeros((len(centres), 3))
    return np.arange(len(centres)), centres, np.full(len(centres), RADIUS), still, still


def bed() -> tuple[np.ndarray, ...]:
    return spheres(np.stack(np.meshgrid(*[np.arange(0, SIDE, APART) + 0.3] * 3), axis=-1).reshape(-1, 3))


def bed_rates(world: World, pool: Pool) -> dict[str, float]:
    """Of a bed of fixed spheres: what nodes beside solids cost more, and ns per link."""
    plain, fluid = (box(world, pool, D3Q19, (SIDE,) * 3) for _ in range(2))
    immersed = Immersed(fluid, world, pool, fixed=bed())
    links = immersed.counts()["links"]
    linked = seconds(fluid.step, False), together(fluid)
    fluid.hooks = []
    fluid.carry(None)
    alone = seconds(fluid.step, False), together(fluid)
    kinds = kind_shares(fluid)
    more = (alone[1] / together(plain) - (1 - kinds.skipped)) / kinds.mixed
    single, several = (1e9 * max(0.0, a - b) / links for a, b in zip(linked, alone))
    return {"mixed": max(0.0, more), "link_ns fixed": several, "link_ns fixed single": single}


def kind_shares(fluid: Fluid) -> Shares:
    """Of the vectors that its sweep goes by."""
    kinds = fluid._kinds
    return Shares(float((kinds == SKIP).mean()), float((kinds == MIXED).mean()))


def moving_rates(world: World, pool: Pool) -> dict[str, float]:
    """ns per link of spheres that move, and what a step with a single one takes beside its links."""
    found = []
    for side, grains in ((SIDE, bed()), (CACHED[0], spheres(np.full((1, 3), CACHED[0] / 2)))):
        fluid = box(world, pool, D3Q19, (side,) * 3)
        immersed = Immersed(fluid, world, pool)
        immersed.start(*grains)
        linked = seconds(partial(moved, fluid, immersed, list(grains)), False)
        fluid.hooks = []
        found.append((max(0.0, linked - seconds(fluid.step, False)), immersed.counts()["links"]))
    (many, links), (one, few) = found
    link = max(0.0, (many - one) / (links - few))
    return {"link_ns moving": 1e9 * link, "moving_us": 1e6 * max(0.0, one - few * link)}


def moved(fluid: Fluid, immersed: Immersed, grains: list[np.ndarray]) -> None:
    """A step with grains that go on by SHIFT."""
    fluid.step()
    immersed.forces(grains[0])
    grains[1] += SHIFT
    immersed.move(*grains)
