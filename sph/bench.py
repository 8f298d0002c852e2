"""Rates of the SPH kernels on this machine, under the names that `estimate` knows.

Steps of the split scheme with a cube of disordered particles, large and small, in empty space; a step is worth 1.46
evaluations of all pair sums. What a step takes beside them grows with the particles from what its launches take, which
every integrator tells for itself with next to no particles; others tell what images in mirrors and periodic sides add,
walls of particles, the force on them, and a rigid body and its mooring.
All of them take turns. Several ranks do the same small scenes together, and each has them for itself.
"""

import os
from collections.abc import Mapping
from time import perf_counter

import numpy as np

from hpcpic.core.app.rates import in_turn, undisturbed
from hpcpic.core.case.config import loads
from hpcpic.core.comm.world import World
from hpcpic.core.tasks.graph import Pool
from hpcpic.core.timers import Timers
from sph.configure import configure
from sph.forecast.estimate import around
from sph.physics.integrators import INTEGRATORS
from sph.step import Sph

ACROSS = {2: 100, 3: 36}  # particles along an edge of the cube
FEW = {2: 8, 3: 5}
ROUNDS, SMALL_ROUNDS = {True: 3, False: 6}, {True: 4, False: 8}  # by `quick`
CALLS = 8  # steps of a small scene in a turn
CASE = """
simulation = {{ dimensions = {d}; end_time = 1.0; integrator = "{integrator}"; cfl = 0.5; }};
domain = {{ low = {low}; high = {high}; {periodic} }};
eos = {{ sound_speed = 10.0; }};
fluid = ( {{ shape = {{ box = {{ low = {near}; high = {far}; }}; }}; initial_pressure = "zero"; }} );
numerics = {{ spacing = {spacing!r}; density_flux = "molteni"; artificial_viscosity = 0.05;
             precision = "{precision}"; }};
{wall}
"""
WALL = """wall = ( {{ type = "{}"; {} shape = {{ box = {{ low = [0.0, 0.0]; high = [1.0, 1.0]; }}; }}; }} );"""
BODY = """wall = ( {{ shape = {{ box = {{ low = [0.0, 0.0]; high = [1.0, 1.0]; }}; }}; }},
         {{ solid = true; shape = {{ box = {{ low = [1.5, 1.5]; high = [1.9, 1.9]; }}; }};
            body = {{ density = 1000.0; {} }}; }} );"""
WALLS = {  # of small scenes
    "images": WALL.format("mirror-no-slip", ""),
    "symmetric": WALL.format("point-symmetric-free-slip", ""),
    "walls": WALL.format("pressure-continuity", ""),
    "forces": WALL.format("pressure-continuity", "measure_force = true;"),
    "rigid": BODY.format(""),
    "moored": BODY.format("mooring = ( { at = [1.7, 1.7]; anchor = [1.7, 1.2]; stiffness = 1.0; } );"),
}


class Trial:
    """A cube with so many particles along an edge: seconds of the pair sums of its steps and of all else in them."""

    def __init__(
        self, world: World, d: int, precision: str, across: int, *, threads: int = 1, integrator: str = "symplectic",
        walls: str = "",
    ) -> None:  # fmt: skip
        images = walls in ("images", "symmetric")
        low, high = ([0.0] * d, [1.0] * d) if images else ([-1.0] * d, [2.0] * d)
        text = CASE.format(
            d=d, low=low, high=high, near=[0.0] * d, far=[1.0] * d, spacing=1.0 / across, precision=precision,
            integrator=integrator, periodic='periodic = ["x"];' if images else "", wall=WALLS.get(walls, ""),
        )  # fmt: skip
        self.pool = Pool(threads, world.cpus(threads))
        self.sph = sph = Sph(configure(loads(text)), world, self.pool, Timers())
        sph.storage.x[:] += np.random.default_rng(1).uniform(0.0, 0.2 / across, sph.storage.x.shape)
        sph.migrate()
        sph.sort()
        self.n, self.pairs = sph.work_items, neighbours(sph, across)
        self._sums, self._rest = list[float](), list[float]()

    def step(self) -> None:
        self.sph.timers.reset()
        begin = perf_counter()
        self.sph.step()
        whole, sums = perf_counter() - begin, self.sph.timers.totals()["pairs"][0]
        self._sums.append(sums)
        self._rest.append(whole - sums)

    @property
    def sums(self) -> float:
        return undisturbed(self._sums)

    @property
    def rest(self) -> float:
        return undisturbed(self._rest)

    def close(self) -> None:
        self.sph.close()
        self.pool.close()


class Sampled(Trial):
    """A simulation that takes samples of the series in place of steps; `rest`: seconds of one."""

    def step(self) -> None:
        self.sph.current_forces()
        begin = perf_counter()
        self.sph.scalars()
        self._rest.append(perf_counter() - begin)


def taken(trials: Mapping[str, Trial], rounds: int, calls: int = 4) -> None:
    """Time all trials in turns, then close them."""
    in_turn({name: trial.step for name, trial in trials.items()}, rounds, calls)
    for trial in reversed(list(trials.values())):  # the first pool knows where the caller ran before all
        trial.close()


def bench(quick: bool) -> Mapping[str, float]:
    """Rate by name; with `quick` 3D double only."""
    world, cores = World.alone(), len(os.sched_getaffinity(0))
    rates = standard_rates(world, cores, quick)
    for d, precision in ((3, "single"), (2, "double"), (2, "single")):
        if not quick:
            trials = {name: Trial(world, d, precision, across[d]) for name, across in (("few", FEW), ("many", ACROSS))}
            taken(trials, ROUNDS[quick])
            rates[f"pair_ns {d}D {precision}"] = 1e9 * of_pair(trials)
            if (d, precision) == (2, "double"):
                rates["body_ns 2D"] = 1e9 * of_body(trials)
    of_2d = (rates["pair_ns 2D double"], rates["body_ns 2D"]) if not quick else (0.0, 0.0)
    return rates | small_rates(world, quick, *of_2d) | {"cores": cores}


def of_pair(trials: Mapping[str, Trial]) -> float:
    """Seconds of a directed pair within the support."""
    few, many = trials["few"], trials["many"]
    return (many.sums - few.sums) / (many.pairs - few.pairs) / INTEGRATORS["symplectic"].work


def of_body(trials: Mapping[str, Trial]) -> float:
    """Seconds of a particle beside its pairs."""
    few, many = trials["few"], trials["many"]
    return (many.rest - few.rest) / (many.n - few.n)


def standard_rates(world: World, cores: int, quick: bool) -> dict[str, float]:
    """Rates of pairs and particles in 3D and double precision, and what all cores gain."""
    kinds = {"few": FEW[3], "many": ACROSS[3]}
    trials = {name: Trial(world, 3, "double", across) for name, across in kinds.items()}
    if cores > 1:
        trials["together"] = Trial(world, 3, "double", ACROSS[3], threads=cores)
    taken(trials, ROUNDS[quick])
    rates = {"pair_ns 3D double": 1e9 * of_pair(trials), "body_ns 3D": 1e9 * of_body(trials)}
    if cores > 1:
        many, both = trials["many"], trials["together"]
        rates["pair_core_gain"] = (many.sums + many.rest) / (both.sums + both.rest)
    return rates


def small_rates(world: World, quick: bool, pair_ns: float, body_ns: float) -> dict[str, float]:
    """What the launches of a step of each integrator take, in its sums and beside them, images of particles, walls and
    forces on them, a rigid body and a sample.
    """
    kinds = tuple(INTEGRATORS) if not quick else ("symplectic",)
    trials = {kind: Trial(world, 2, "double", FEW[2], integrator=kind) for kind in kinds}
    if not quick:
        trials |= {walls: Trial(world, 2, "double", FEW[2], walls=walls) for walls in WALLS}
        trials["sample"] = Sampled(world, 2, "double", FEW[2])
    bodies = {name: np.count_nonzero(trial.sph.storage.flags) for name, trial in trials.items()}
    taken(trials, SMALL_ROUNDS[quick], CALLS)
    rates = {}
    for kind in kinds:
        trial = trials[kind]
        rates[f"step_us {kind}"] = 1e6 * trial.rest
        rates[f"sums_us {kind}"] = 1e6 * max(0.0, trial.sums - 1e-9 * INTEGRATORS[kind].work * trial.pairs * pair_ns)
    if not quick:
        plain = trials["symplectic"]
        beside = {walls: trials[walls].rest - plain.rest - 1e-9 * body_ns * (bodies[walls] - plain.n)
                  for walls in WALLS}  # fmt: skip
        rates["images_us"] = 1e6 * max(0.0, beside["images"])
        rates["symmetric_us"] = 1e6 * max(0.0, beside["symmetric"])
        refresh = (trials["images"].sums - plain.sums) / INTEGRATORS["symplectic"].evaluations
        rates["image_refresh_us"] = 1e6 * max(0.0, refresh)
        rates["walls_us"] = 1e6 * max(0.0, beside["walls"])
        rates["force_us"] = 1e6 * max(0.0, beside["forces"] - beside["walls"])
        walls, rigid, moored = (beside[name] + trials[name].sums for name in ("walls", "rigid", "moored"))
        rates["rigid_us"] = max(0.0, 1e6 * (rigid - walls) - rates["force_us"])
        rates["mooring_us"] = 1e6 * max(0.0, moored - rigid)
        rates["sph_sample_us"] = 1e6 * trials["sample"].rest
    return rates


def bench_ranks(quick: bool, world: World) -> Mapping[str, float]:
    """What ranks tell each other in a step, whatever the particles. Collective."""
    here = World.alone()
    kinds = {"plain": "", "images": "images"}
    alone = {name: Trial(here, 2, "double", FEW[2], walls=walls) for name, walls in kinds.items()}
    ranks = {f"{name} ranks": Trial(world, 2, "double", FEW[2] * world.size, walls=walls)
             for name, walls in kinds.items()}  # fmt: skip
    taken(alone | ranks, SMALL_ROUNDS[quick], CALLS)
    more = {name: world.max(ranks[f"{name} ranks"].rest - alone[name].rest) for name in kinds}
    refresh = world.max(ranks["plain ranks"].sums - alone["plain"].sums) / INTEGRATORS["symplectic"].evaluations
    return {
        "ghost_exchange_us": 1e6 * max(0.0, more["plain"]),
        "image_exchange_us": 1e6 * max(0.0, more["images"] - more["plain"]),
        "refresh_us": 1e6 * max(0.0, refresh),
    }


def neighbours(sph: Sph, across: int) -> int:
    """Directed pairs within the support, of all particles of the cube on its lattice."""
    steps = around(sph.scene.support / sph.scene.spacing, sph.scene.dimensions)
    return int(np.prod(across - np.abs(steps), axis=1).sum())
