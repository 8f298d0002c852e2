"""Rates of the plasma's kernels on this machine, under the names that `estimate` knows.

Whole steps of small thermal plasmas in this process, which take turns. From many and few particles in a cell follows
the price of a particle in caches, from a plasma larger than these that of one from memory, from one of next to nothing
the price of the launches, from one of empty cells that of a cell, from one with a particle in most tiles that of a tile
that is not empty, and from a wide empty one that of cells in memory; the field has a timer of its own, and LU is tried
alone. On all cores the steps with many particles, of the large plasma and with no particles tell what these gain.
Several ranks have the smallest plasma together, and each has one for itself, and one with many particles.
"""

import itertools
import math
import os
from collections.abc import Mapping
from pathlib import Path
from time import perf_counter

from hpcpic.core.app.rates import CACHES, in_turn, last_cache_mb, undisturbed
from hpcpic.core.case.config import loads
from hpcpic.core.comm.world import World
from hpcpic.core.space.domain import Domain, even_cuts
from hpcpic.core.tasks.graph import Pool
from hpcpic.core.timers import Timers
from hpcpic.plasma.configure import configure
from hpcpic.plasma.forecast.estimate import (
    HELD,
    LEVELS,
    NODE_BYTES,
    STANDARD_BYTES,
    beyond_caches,
    exchanges,
    filled_tiles,
)
from hpcpic.plasma.forecast.plan import factor_nonzeros
from hpcpic.plasma.forecast.rates import DEFAULT
from hpcpic.plasma.physics.poisson import LU
from hpcpic.plasma.physics.shapes import SHAPES
from hpcpic.plasma.sizes import EDGE
from hpcpic.plasma.step import Plasma

SPARSE, DENSE, DENSE_AND_LARGE = 4, 24, 48  # particles per cell of the plasmas "few", "many" and "large"
ROUNDS = {True: 3, False: 6}  # by `quick`
FULL = {2: (128, 128), 1: (8192,), 3: (32, 32, 32)}  # points of the plasma with particles
SCALE = 2  # points along an edge of a large plasma, to those of FULL
EMPTY = {2: (512, 512), 1: (65536,), 3: (64, 64, 64)}  # and of the one with next to none: 2 to LEVELS
WIDE = (2048, 2048)  # and of one that no cache holds
TINY = {2: (16, 16), 1: (256,), 3: (8, 8, 8)}
FACTORED = {2: (64, 64), 1: (4096,), 3: (16, 16, 16)}  # of a field by LU
NEXT_TO_NONE = 16  # particles
GAINS = {  # whose steps tell what all cores gain
    2: {"plasma_core_gain 2D": "many", "memory_core_gain": "large", "mesh_core_gain": "empty"},
    1: {"plasma_core_gain 1D": "many"},
    3: {"plasma_core_gain 3D": "many"},
}
MOST_CACHE = 0.5e-6 * (FULL[2][0] * SCALE) ** 2 * DENSE_AND_LARGE * STANDARD_BYTES / HELD  # MB
STEPS, TINY_STEPS, SAMPLES = 7, 40, 3  # of a turn
COLD_STEPS = 3  # first ones of a turn, which find in the caches what others have left there
CASE = """
simulation = {{ dimensions = {d}; solver = "MFT"; cycles = 1; time_step = 0.2; space_length = {lengths}; }};
grid = {{ points = {points}; }};
species = ( {{ name = "electron"; particles = {n}; charge = -1.0; mass = 1.0; plasma_frequency = 1.0;
              init_method = "random position"; drift_velocity = [0.0, 0.0, 0.0]; thermal_velocity = 0.5; }} );
numerics = {{ shape = "{shape}"; precision = "{precision}"; }};
"""


class Trial:
    """A plasma of n particles, and seconds of its steps, of the field in them, and of samples beside the field."""

    def __init__(
        self, world: World, points: tuple[int, ...], n: int, shape: str = "CIC", precision: str = "double",
        threads: int = 1,
    ) -> None:  # fmt: skip
        lengths, cells = [float(k) for k in points], list(points)
        text = CASE.format(d=len(points), lengths=lengths, points=cells, n=n, shape=shape, precision=precision)
        self.pool, self.timers = Pool(threads, world.cpus(threads)), Timers()
        self.plasma = Plasma(configure(loads(text)), world, self.pool, self.timers)
        self.turn_steps = TINY_STEPS if points == TINY[len(points)] else STEPS
        self.steps, self.fields, self.samples = list[float](), list[float](), list[float]()

    def turn(self) -> None:
        """Some steps, and samples. What finds cold caches does not count, as steps of a run find settled ones."""
        for k in range(self.turn_steps):
            self.timers.reset()
            begin = perf_counter()
            self.plasma.step()
            if k >= COLD_STEPS:
                self.steps.append(perf_counter() - begin)
                self.fields.append(self.timers.totals().get("field", (0.0, 0))[0])
        self.plasma.solve()
        for k in range(SAMPLES):
            begin = perf_counter()
            self.plasma.scalars()
            if k:
                self.samples.append(perf_counter() - begin)

    @property
    def step(self) -> float:
        return undisturbed(self.steps)

    @property
    def field(self) -> float:
        return undisturbed(self.fields)

    @property
    def rest(self) -> float:
        """Seconds of a step without its field."""
        return undisturbed([step - field for step, field in zip(self.steps, self.fields)])

    @property
    def sample(self) -> float:
        return undisturbed(self.samples)

    def close(self) -> None:
        self.plasma.close()
        self.pool.close()


def taken(trials: Mapping[str, Trial], quick: bool) -> None:
    """The turns of all, and their end."""
    for _ in range(ROUNDS[quick]):
        for trial in trials.values():
            trial.turn()
    for trial in reversed(list(trials.values())):  # the first pool knows where the caller ran before all
        trial.close()


def bench(quick: bool) -> Mapping[str, float]:
    """Rate by name; with `quick` the standard kernel only (2D CIC double)."""
    world = World.alone()
    rates: dict[str, float] = {"cores": len(os.sched_getaffinity(0))}
    for d in (2, 1, 3)[: 1 if quick else None]:
        rates |= standard_rates(world, d, quick)
    for d, shape, precision in itertools.product((2, 1, 3), SHAPES, ("double", "single")):
        if not quick and (shape, precision) != ("CIC", "double"):
            trials = {
                name: Trial(world, FULL[d], per_cell * FULL[d][0] ** d, shape, precision)
                for name, per_cell in (("few", SPARSE), ("many", DENSE))
            }
            taken(trials, quick)
            rates[f"particle_ns {d}D {shape} {precision}"] = 1e9 * of_particle(trials, d)
    return rates | {"memory_bytes": 2 * STANDARD_BYTES}  # read and written in place


def of_particle(trials: Mapping[str, Trial], d: int) -> float:
    return (trials["many"].step - trials["few"].step) / (FULL[d][0] ** d * (DENSE - SPARSE))


def standard_rates(world: World, d: int, quick: bool) -> dict[str, float]:
    """Rates of CIC in double precision: particles, tiles, cells, field, launches, samples, and what all cores gain."""
    n, cells = FULL[d][0] ** d, EMPTY[d][0] ** d
    tiles = cells // EDGE[d] ** d
    kinds = {
        "few": (FULL[d], SPARSE * n), "many": (FULL[d], DENSE * n), "tiny": (TINY[d], NEXT_TO_NONE),
        "empty": (EMPTY[d], NEXT_TO_NONE), "spread": (EMPTY[d], tiles),
    }  # fmt: skip
    if d == 2:
        kinds["large"] = tuple(SCALE * points for points in FULL[2]), DENSE_AND_LARGE * SCALE**2 * n
        if not quick:
            kinds["wide"] = WIDE, NEXT_TO_NONE
    trials = {name: Trial(world, *kind) for name, kind in kinds.items()}
    gains = GAINS[d] if (cores := len(world.cpus(1))) > 1 else {}
    together = {what: f"{name} together" for what, name in gains.items()}
    trials |= {together[what]: Trial(world, *kinds[name], threads=cores) for what, name in gains.items()}
    if d == 2 and cores > 1:
        trials["tiny together"] = Trial(world, *kinds["tiny"], threads=cores)
    taken(trials, quick)
    tiny, empty, spread = (trials[name] for name in ("tiny", "empty", "spread"))
    particle, more = of_particle(trials, d), filled_tiles(tiles, tiles) - filled_tiles(NEXT_TO_NONE, tiles)
    rates = {
        f"particle_ns {d}D CIC double": 1e9 * particle,
        f"field_ns {d}D": 1e9 * (empty.field - tiny.field) / cells,
        f"cell_ns {d}D": 1e9 * max(0.0, empty.rest - tiny.rest) / cells,
        f"tile_ns {d}D": 1e9 * max(0.0, spread.rest - empty.rest - tiles * particle) / more,
        f"factor_ns {d}D": 1e9 * lu_solve(world, FACTORED[d]) / factor_nonzeros(FACTORED[d]),
    }
    if d == 2:
        rates |= {
            "plasma_launch_us": 1e6 * tiny.step,
            "plasma_launch_together_us": 1e6 * trials["tiny together" if cores > 1 else "tiny"].step,
            "plasma_sample_us": 1e6 * tiny.sample,
            "sample_ns": 1e9 * max(0.0, more_of_large(trials, "sample")) / (n * SCALE**2 * (DENSE_AND_LARGE - SPARSE)),
            "sample_cell_ns": 1e9 * max(0.0, empty.sample - tiny.sample) / cells,
        }
        found = cache_mb() or DEFAULT["cache_mb"]
        rates |= {"cache_mb": found, "memory_ns": 1e9 * (particle + memory_wait(trials, particle, found))}
        if "wide" in trials:
            rates |= wide_rates(trials, found)
    return rates | {what: trials[name].step / trials[together[what]].step for what, name in gains.items()}


def wide_rates(trials: Mapping[str, Trial], cache: float) -> dict[str, float]:
    """What nodes that no cache holds take more than those of the empty plasma."""
    wide, empty, tiny, cells = trials["wide"], trials["empty"], trials["tiny"], math.prod(WIDE)
    away, times = beyond_caches(cells, NODE_BYTES, 1.0, {"cache_mb": cache}) / NODE_BYTES, cells / math.prod(EMPTY[2])
    work = times * math.log2(cells) / LEVELS[2] * (empty.field - tiny.field)
    return {
        "field_memory_ns": 1e9 * max(0.0, wide.field - work) / away,
        "cell_memory_ns": 1e9 * max(0.0, wide.rest - tiny.rest - times * (empty.rest - tiny.rest)) / away,
    }


def lu_solve(world: World, points: tuple[int, ...]) -> float:
    """Seconds of a field by LU."""
    edges, pool = tuple(float(n) for n in points), Pool(1)
    solver = LU(world, pool, Domain(edges, points, (True,) * len(points), even_cuts(points[0], 1)))
    pool.close()
    return in_turn({"LU": solver.solve}, rounds=4)["LU"]


def more_of_large(trials: Mapping[str, Trial], what: str) -> float:
    """Seconds of the particles that the large plasma has more than SCALE^2 of those with few, in `rest` or `sample`."""
    few, tiny, large = (getattr(trials[name], what) for name in ("few", "tiny", "large"))
    return large - tiny - SCALE**2 * (few - tiny)


def memory_wait(trials: Mapping[str, Trial], particle: float, cache: float) -> float:
    """Seconds that a standard particle which no cache holds takes more than one in caches."""
    n, more = FULL[2][0] ** 2 * SCALE**2, more_of_large(trials, "rest")
    away = beyond_caches(n * DENSE_AND_LARGE, STANDARD_BYTES, 1.0, {"cache_mb": cache}) / STANDARD_BYTES
    return max(0.0, more - n * (DENSE_AND_LARGE - SPARSE) * particle) / away


def cache_mb(caches: Path = CACHES) -> float:
    """Size of the last-level cache, but no more than leaves half of the large plasma outside: how fast the rest is must
    be seen. 0 where the system does not tell.
    """
    return min(MOST_CACHE, last_cache_mb(caches))


def bench_ranks(quick: bool, world: World) -> Mapping[str, float]:
    """What one exchange between ranks takes. Collective."""
    points = (TINY[2][0] * world.size, TINY[2][1])
    trials = {"alone": Trial(World.alone(), TINY[2], NEXT_TO_NONE), "all": Trial(world, points, NEXT_TO_NONE)}
    trials["all"].turn_steps = TINY_STEPS
    taken(trials, quick)
    more = world.max(trials["all"].step - trials["alone"].step)
    rates = {"plasma_exchange_us": 1e6 * max(0.0, more) / exchanges(2, world.size)}
    if len(world.cpus(1)) == 1:  # the ranks fill the node
        rates["plasma_rank_gain"] = rank_gain(quick, world)
    return rates


def rank_gain(quick: bool, world: World) -> float:
    """How much more all ranks do than one alone, each with its own particles. Collective."""
    alone, beside = (Trial(World.alone(), FULL[2], DENSE * math.prod(FULL[2])) for _ in range(2))
    for _ in range(ROUNDS[quick]):
        world.barrier()
        beside.turn()
        world.barrier()
        if world.rank == 0:
            alone.turn()
    gain = world.size * world.max(alone.step if world.rank == 0 else 0.0) / world.max(beside.step)
    for trial in (beside, alone):
        trial.close()
    return gain
