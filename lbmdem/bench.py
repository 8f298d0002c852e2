"""Rates of the fluid's kernels on this machine, under the names that `estimate` knows.

All that is compared takes turns. Sweeps are timed on a periodic box beyond the caches, one step and several per pass
over memory; what a body force, central moments and solids add, on boxes within the caches; links of solids that stay on
beds of spheres. What grains that move need comes from whole steps of few and many, small and large ones, which several
ranks also do together.
"""

import math
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np

from hpcpic.core.app.rates import in_turn, last_cache_mb, undisturbed
from hpcpic.core.case.config import loads
from hpcpic.core.comm.world import World
from hpcpic.core.simd.registers import has_masks
from hpcpic.core.space.domain import Domain
from hpcpic.core.tasks.graph import Pool
from hpcpic.core.timers import Timers
from lbmdem.configure import configure
from lbmdem.coupling.immersed import Immersed
from lbmdem.fluid.fluid import Fluid
from lbmdem.forecast.node_shares import Shares
from lbmdem.forecast.plan import link_count
from lbmdem.forecast.rates import SHAPES
from lbmdem.kernels.layout import FLUID
from lbmdem.kernels.sweep import MIXED, SKIP
from lbmdem.physics.velocity_sets import D2Q9, D3Q19, Lattice
from lbmdem.step import LbmDem

CACHED = (40, 40, 40)
CACHED_BED = 48  # nodes along an edge
TINY = (16, 16)
BEDS = {"fine": 12, "coarse": 24}  # nodes from sphere to sphere
RADIUS = 5.0 / 12.0  # of that
SIDE = 96  # of the box of a bed
ROUNDS = {True: 3, False: 6}  # by `quick`
GRAINS = {  # that move: how many along an edge, and radius in nodes
    2: {"one": (1, 10.0), "small": (12, 5.0), "large": (6, 10.0)},
    3: {"one": (1, 5.0), "small": (4, 5.0), "large": (2, 10.0)},
}
CONSERVING = 64  # nodes along an edge of a box where the mass of covered nodes is put back
SPEED = 0.02  # nodes in a step, of these grains
SUBSTEPS = 20
CASE = """
simulation = {{ dimensions = {d}; end_time = 1.0; }};
domain = {{ size = {size}; spacing = 1.0; }};
fluid = {{ density = 1.0; kinematic_viscosity = 0.1; time_step = 1.0; }};
grains = ( {{ diameter = {diameter}; density = 2.0; position = ( {places} ); velocity = {speed}; }} );
contact = {{ normal_stiffness = 0.01; }};
coupling = {{ substeps = {substeps}; refill = "{refill}"; }};
"""


def bench(quick: bool) -> Mapping[str, float]:
    """Rate by name; with `quick` the standard sweep only (D3Q19, double)."""
    world = World.alone()
    cores = len(os.sched_getaffinity(0))
    with pools(world, cores) as (pool, *others):
        rates = sweep_rates(world, pool, others, quick)
        if not quick:
            rates |= cached_rates(world, pool, others, rates)
            rates |= bed_rates(world, pool)
            if has_masks():
                rates |= sparse_rates(world, pool, others, rates)
            for d in (2, 3):
                rates |= moving_rates(world, pool, d)
    if cache := last_cache_mb():
        rates["lattice_cache_mb"] = cache
    moved = {"mlups_bytes D3Q19 double": 2 * 8 * D3Q19.q}  # read and written in place
    return rates | {"cores": cores} | moved


@contextmanager
def pools(world: World, cores: int) -> Iterator[list[Pool]]:
    """With one thread and, where there are several cores, with as many."""
    made = [Pool(n, world.cpus(n)) for n in sorted({1, cores})]
    yield made
    for pool in made:
        pool.close()


def box(
    world: World, pool: Pool, lattice: Lattice, shape: tuple[int, ...], storage: str = "double", **kind: Any
) -> Fluid:
    domain = Domain(tuple(map(float, shape)), shape, (True,) * len(shape), (0, shape[0]))
    return Fluid(world, pool, domain, lattice, tau=0.8, storage=storage, **kind)


def together(fluid: Fluid) -> Callable[[], Any]:
    """A step, as one of several per pass over memory, where no forces are read between passes."""
    return lambda: [fluid.leap(2 * fluid.depth) for _ in range(2)]


def per_step(seconds: float, fluid: Fluid) -> float:
    return seconds / (2 * fluid.depth)


def sweep_rates(world: World, pool: Pool, others: list[Pool], quick: bool) -> dict[str, float]:
    """Million node updates per second, one step per pass over memory; how much faster several are, and all cores."""
    rates: dict[str, float] = {}
    for lattice in (D3Q19, D2Q9)[: 1 if quick else None]:
        name, shape = lattice.name, SHAPES[lattice.name]
        fluids = [box(world, each, lattice, shape) for each in (pool, *(others if lattice is D3Q19 else []))]
        actions: dict[str, Callable[[], Any]] = {f"step {k}": fluid.step for k, fluid in enumerate(fluids)}
        actions |= {f"wave {k}": together(fluid) for k, fluid in enumerate(fluids)}
        if not quick:
            actions["single"] = box(world, pool, lattice, shape, "single").step
        spent = in_turn(actions, ROUNDS[quick])
        waves = [per_step(spent[f"wave {k}"], fluid) for k, fluid in enumerate(fluids)]
        updates = 1e-6 * math.prod(shape)
        rates |= {f"mlups {name} double": updates / spent["step 0"], f"wave_gain {name}": spent["step 0"] / waves[0]}
        if not quick:
            rates[f"mlups {name} single"] = updates / spent["single"]
        if len(fluids) > 1:
            rates |= {"sweep_core_gain": spent["step 0"] / spent["step 1"], "wave_core_gain": waves[0] / waves[1]}
    return rates


def cached_rates(world: World, pool: Pool, others: list[Pool], rates: Mapping[str, float]) -> dict[str, float]:
    """What a launch takes, what a small box gains, and what a body force and central moments add to a sweep."""
    kinds: dict[str, dict[str, Any]] = {"plain": {}, "force": {"force": (1e-6, 0.0, 0.0)}}
    kinds["central"] = {"collision": "central"}
    fluids = {name: box(world, pool, D3Q19, CACHED, **kind) for name, kind in kinds.items()}
    if others:
        fluids["threads"] = box(world, others[0], D3Q19, CACHED)
    spent = in_turn({name: together(fluid) for name, fluid in fluids.items()}, 2 * ROUNDS[False])
    actions = {"launch": box(world, pool, D2Q9, TINY).step}
    actions["drive"] = partial(fluids["force"].set_force, (1e-6, 0.0, 0.0))
    for each in others[:1]:
        actions["launch_together"] = box(world, each, D2Q9, TINY).step
    launches = in_turn(actions, ROUNDS[False], 100)
    found = {f"lattice_{name}_us": 1e6 * seconds for name, seconds in launches.items()}
    wave = math.prod(CACHED) * 1e-6 / (rates["mlups D3Q19 double"] * rates["wave_gain D3Q19"])
    found["cached_gain D3Q19"] = wave / per_step(spent["plain"], fluids["plain"])
    if others:
        found["cached_core_gain"] = spent["plain"] / spent["threads"]
    forced, central = (max(0.0, spent[name] / spent["plain"] - 1) for name in ("force", "central"))
    return found | {"forced": forced, "central": central}


def bed(apart: int, side: int = SIDE) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Spheres at rest, as Immersed takes them."""
    centres = np.stack(np.meshgrid(*[np.arange(0, side, apart) + 0.3] * 3), axis=-1).reshape(-1, 3)
    still = np.zeros((len(centres), 3))
    return np.arange(len(centres)), centres, np.full(len(centres), RADIUS * apart), still, still


def linked_and_alone(world: World, pool: Pool, side: int) -> tuple[Fluid, Fluid, int]:
    """A bed of fixed spheres in a box, with links and without, and how many these are."""
    linked, alone = (box(world, pool, D3Q19, (side,) * 3) for _ in range(2))
    links = Immersed(linked, world, pool, fixed=bed(BEDS["fine"], side)).counts()["links"]
    alone.solid.inner[...] = linked.solid.inner
    alone.solid_changed()
    return linked, alone, links


def bed_rates(world: World, pool: Pool) -> dict[str, float]:
    """Rates of a bed of fixed spheres: what nodes beside solids cost more, and ns per link."""
    (linked, alone, links), small = (linked_and_alone(world, pool, side) for side in (SIDE, CACHED_BED))
    plain = box(world, pool, D3Q19, (SIDE,) * 3)
    actions: dict[str, Callable[[], Any]] = {"one": linked.step, "one alone": alone.step}
    actions |= {"wave": together(linked), "wave alone": together(alone), "plain": together(plain)}
    actions |= {"small": together(small[0]), "small alone": together(small[1])}
    spent = in_turn(actions, ROUNDS[False])
    in_caches = per_step(spent["small"] - spent["small alone"], small[0])
    several, without, free = (
        per_step(spent[name], fluid) for name, fluid in (("wave", linked), ("wave alone", alone), ("plain", plain))
    )
    kinds = kind_shares(alone)
    more = (without / free - (1 - kinds.skipped)) / kinds.mixed
    return {
        "mixed": max(0.0, more),
        "link_ns fixed": 1e9 * max(0.0, several - without) / links,
        "link_ns cached": 1e9 * max(0.0, in_caches) / small[2],
        "link_ns fixed single": 1e9 * max(0.0, spent["one"] - spent["one alone"]) / links,
    }


def kind_shares(fluid: Fluid) -> Shares:
    """Shares of the vectors that the sweep of a fluid goes by."""
    kinds = fluid.nodes.kinds
    return Shares(float((kinds == SKIP).mean()), float((kinds == MIXED).mean()))


def sparse_rates(world: World, pool: Pool, others: list[Pool], rates: Mapping[str, float]) -> dict[str, float]:
    """Rates of beds that are held without their solid nodes: a node, a link, and what all cores gain."""
    made, found = {}, {}
    for name, (apart, each) in {
        "fine": (BEDS["fine"], pool), "coarse": (BEDS["coarse"], pool), "cores": (BEDS["fine"], (pool, *others)[-1]),
    }.items():  # fmt: skip
        made[name] = fluid = box(world, each, D3Q19, (SIDE,) * 3)
        fluid.stays = True
        links = Immersed(fluid, world, each, fixed=bed(apart)).counts()["links"]
        found[name] = int((fluid.solid.inner == FLUID).sum()), links
    spent = in_turn({name: together(fluid) for name, fluid in made.items()}, ROUNDS[False])
    fine, coarse, cores = (per_step(spent[name], fluid) for name, fluid in made.items())
    node, link = np.linalg.solve([found["fine"], found["coarse"]], [fine, coarse])
    if link < 0.0:
        node, link = coarse / found["coarse"][0], 0.0
    bare = 1e-6 / (rates["mlups D3Q19 double"] * rates["wave_gain D3Q19"])
    gain = {"sparse_core_gain": fine / cores} if others else {}
    return {"sparse": node / bare, "link_ns sparse": 1e9 * link} | gain


class Moving:
    """Grains that move, in a whole program: seconds of the parts of its steps."""

    def __init__(
        self, world: World, pool: Pool, d: int, across: int, radius: float, *, substeps: int = SUBSTEPS,
        size: int = 0, refill: str = "local",
    ) -> None:  # fmt: skip
        apart = 2 * radius
        size = size or math.ceil(across * apart) + 12
        places = np.stack(np.meshgrid(*[(np.arange(across) + 0.5) * apart + 6.3] * d), axis=-1).reshape(-1, d).tolist()
        listed = ", ".join(map(str, places))
        text = CASE.format(d=d, size=[float(size)] * d, diameter=1.001 * apart, places=listed, speed=[SPEED] * d,
                           substeps=substeps, refill=refill)  # fmt: skip
        self.config = configure(loads(text))
        self.app = LbmDem(self.config, world, pool, Timers())
        self.n, self.links = across**d, link_count(self.config)
        assert self.app.fluid and self.app.immersed and self.app.immersed.links
        self.fluid, self.immersed, self.link_tasks = self.app.fluid, self.app.immersed, self.app.immersed.links
        self.fluid.hooks = [partial(self.timed, hook) for hook in self.fluid.hooks]
        self.parts: dict[str, list[float]] = {"step": [], "links": []}
        self._hooks = 0.0

    def timed(self, hook: Callable[..., None], *arguments: Any) -> None:
        begin = perf_counter()
        hook(*arguments)
        self._hooks = perf_counter() - begin

    def links_alone(self) -> float:
        """They are done with the sweep: seconds of doing them once more, which changes the fluid, but not its cost."""
        begin = perf_counter()
        self.app.pool.each(self.link_tasks.tasks(self.fluid.parity))
        return perf_counter() - begin

    def step(self) -> None:
        self.app.timers.reset()
        begin = perf_counter()
        self.app.step()
        self.parts["step"].append(perf_counter() - begin)
        self.parts["links"].append(self._hooks + self.links_alone())
        for name, (seconds, _) in self.app.timers.totals().items():
            self.parts.setdefault(name, []).append(seconds)

    def usual(self, name: str) -> float:
        return undisturbed(self.parts[name])


def moving_rates(world: World, pool: Pool, d: int) -> dict[str, float]:
    """Times of a link, a grain and a step where grains move, and of their contacts."""
    scenes = {name: Moving(world, pool, d, *kind) for name, kind in GRAINS[d].items()}
    alone = partial(Moving, world, pool, d, *GRAINS[d]["one"])
    if d == 2:
        scenes["more"] = alone(substeps=20 * SUBSTEPS)
    else:
        scenes |= {refill: alone(size=CONSERVING, refill=refill) for refill in ("local", "conserving")}
    in_turn({name: scene.step for name, scene in scenes.items()}, 2 * ROUNDS[False], 8)
    one, small, large = (scenes[name] for name in GRAINS[d])
    table = [[scene.links, scene.n, 1.0] for scene in (small, large, one)]
    link, grain, launch = np.linalg.solve(table, [scene.usual("links") for scene in (small, large, one)])
    rates = {f"link_ns moving {d}D": 1e9 * max(0.0, link), f"moving_link_us {d}D": 1e6 * max(0.0, grain)}
    each = (small.usual("solid") - one.usual("solid")) / (small.n - one.n)
    rates[f"moving_grain_us {d}D"] = 1e6 * max(0.0, each)
    if d == 2:
        substep = (scenes["more"].usual("grains") - one.usual("grains")) / (19 * SUBSTEPS)
        contact = (small.usual("grains") - one.usual("grains")) / ((small.n - one.n) * SUBSTEPS)
        rates |= {
            "moving_us": 1e6 * (one.usual("solid") + max(0.0, launch)),
            "substep_us": 1e6 * max(0.0, substep),
            "grain_ns": 1e9 * max(0.0, contact),
            "grains_us": 1e6 * (one.usual("grains") - SUBSTEPS * substep),
        }
    else:
        samples = in_turn({name: scenes[name].app.scalars for name in ("one", "local")}, ROUNDS[False])
        nodes = [math.prod(scenes[name].config.points) for name in samples]
        each = max(0.0, samples["local"] - samples["one"]) / (nodes[1] - nodes[0])
        rates |= {"lattice_sample_ns": 1e9 * each, "lattice_sample_us": 1e6 * (samples["one"] - nodes[0] * each)}
        kept = sum(scenes["conserving"].usual(part) - scenes["local"].usual(part) for part in ("links", "solid"))
        rates["conserving_ns"] = 1e9 * max(0.0, kept) / CONSERVING**3
        cold = sum(scenes["local"].usual(part) - one.usual(part) for part in ("links", "grains", "solid"))
        rates["cold_us"] = 1e6 * max(0.0, cold)
    for scene in scenes.values():
        scene.app.close()
    return rates


def bench_ranks(quick: bool, world: World) -> Mapping[str, float]:
    """What the exchange of populations takes, and that of grains that move. Collective."""
    with pools(world, 1) as (pool,):
        alone, all_ranks = (Moving(here, pool, 2, *GRAINS[2]["one"]) for here in (World.alone(), world))
        shape = (TINY[0] * world.size, TINY[1])
        cuts = tuple(TINY[0] * k for k in range(world.size + 1))
        domain = Domain(tuple(map(float, shape)), shape, (True, True), cuts)
        slabs, tiny = Fluid(world, pool, domain, D2Q9, tau=0.8), box(World.alone(), pool, D2Q9, TINY)
        spent = in_turn({"slabs": slabs.step, "tiny": tiny.step}, ROUNDS[quick], 100)
        in_turn({"alone": alone.step, "all": all_ranks.step}, ROUNDS[quick], 40)
        deep = Moving(world, pool, 3, *GRAINS[3]["one"], size=CONSERVING)
        planes = in_turn({"planes": deep.immersed.refill.exchange}, ROUNDS[quick])["planes"]
        plane_values = 2 * CONSERVING**2 * D3Q19.q
        message = world.max(spent["slabs"] - spent["tiny"])
        parts = alone.usual("fluid") / world.size + alone.usual("grains") + alone.usual("solid")
        grains = world.max(all_ranks.usual("step") - parts)
        planes = world.max(planes)
        for scene in (alone, all_ranks, deep):
            scene.app.close()
        slabs.free()
    return {
        "message_us": 1e6 * max(0.0, message),
        "grain_exchange_us": 1e6 * max(0.0, grains - message),
        "refill_plane_ns": 1e9 * planes / plane_values,
    }
