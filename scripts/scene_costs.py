"""What a scene does not contain should cost nothing: what was measured, beside what was aimed at.

    python scripts/scene_costs.py [ROW ...]         rows by name, as C1 C10; all of them take some three minutes

Times are processor times of one core, of two scenes whose steps alternate in one process: medians of ratios, or least
times. Bytes are those that numpy holds after some steps, as tracemalloc counts them, less what was never touched.
"""

import gc
import math
import resource
import statistics
import subprocess
import sys
import time
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.case.config import loads
from hpcpic.core.comm.world import World
from hpcpic.core.tasks.graph import Pool
from hpcpic.core.timers import Timers

TURN = 16  # steps of a scene before the other one has its turn and takes the caches
PLASMA = """
simulation = {{ dimensions = 2; cycles = {cycles}; time_step = 0.1; space_length = [{points}.0, {points}.0]; }};
grid = {{ points = [{points}, {points}]; }};
field = {{ magnetic = {magnetic}; }};
species = ( {{ name = "electrons"; particles = {particles}; charge = -1.0; mass = 1.0; plasma_frequency = 1.0;
              init_method = "random position"; thermal_velocity = 0.5; }} {more} );
"""
WATER = """
simulation = {{ dimensions = {d}; end_time = 1.0; integrator = "{integrator}"; cfl = 0.3; }};
domain = {{ low = {low}; high = {high}; periodic = {periodic}; }};
gravity = {gravity};
fluid = ( {{ name = "water"; shape = {{ box = {{ low = {low}; high = {top}; }}; }}; {more} }} );
eos = {{ sound_speed = 30.0; }};
numerics = {{ spacing = {spacing}; density_flux = "{flux}"; viscosity_form = "{form}"; precision = "{precision}"; }};
{walls}
"""
LATTICE = """
simulation = {{ dimensions = {d}; end_time = 1.0; }};
domain = {{ size = {size}; spacing = 1.0e-4; periodic = {periodic}; }};
fluid = {{ density = 1000.0; kinematic_viscosity = 1.0e-6; relaxation_time = 0.8; storage = "{storage}"; {force} }};
{grains}
"""
SPHERES = """grains = ( {{ name = "grains"; diameter = {diameter}; density = 1500.0; moving = {moving};
                         position = {places}; }} );"""


class Case(NamedTuple):
    program: str
    text: str


class Row(NamedTuple):
    """One line of the table; `kept` is None where nothing was aimed at."""

    name: str
    what: str
    measured: str
    aim: str
    kept: bool | None = None


def listed(values: Any) -> str:
    """A list as case files write it."""
    return "[" + ", ".join(f'"{v}"' if isinstance(v, str) else repr(float(v)) for v in values) + "]"


def plasma(
    points: int = 32, particles: int = 20_000, magnetic: Any = (0, 0, 0), more: str = "", cycles: int = 900
) -> Case:
    sizes = {"points": points, "particles": particles, "cycles": cycles}
    return Case("hpcpic", PLASMA.format(magnetic=listed(magnetic), more=more, **sizes))


def water(
    low: Any = (0, 0), high: Any = (1, 1), top: Any = (0.5, 0.5), spacing: float = 0.01, periodic: str = "",
    integrator: str = "symplectic", flux: str = "none", form: str = "none", precision: str = "double",
    gravity: float = 9.81, more: str = "", walls: str = "",
) -> Case:  # fmt: skip
    """Water in a box from low to top, in a domain from low to high."""
    d = len(low)
    return Case("sph", WATER.format(
        d=d, low=listed(low), high=listed(high), top=listed(top), spacing=spacing, periodic=listed(periodic),
        gravity=listed([0.0] * (d - 1) + [-gravity]) if gravity else "[]", integrator=integrator, flux=flux, form=form,
        precision=precision, more=more, walls=walls,
    ))  # fmt: skip


def flow(nodes: Any = (64, 64), grains: str = "", force: bool = True, storage: str = "double") -> Case:
    """A periodic box of so many nodes."""
    d = len(nodes)
    pushed = f"body_force = {listed([1e-3] + [0.0] * (d - 1))};" if force else ""
    size = listed(1e-4 * n for n in nodes)
    return Case("lbmdem", LATTICE.format(
        d=d, size=size, periodic=listed("xyz"[:d]), force=pushed, grains=grains, storage=storage
    ))  # fmt: skip


def spheres(nodes: tuple[int, ...], apart: int, diameter: float, moving: bool = False) -> str:
    """Grains on a cubic lattice, in nodes."""
    axes = [np.arange(apart / 2, n, apart) + 0.21 for n in nodes]
    places = 1e-4 * np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, len(nodes))
    listing = "( " + ", ".join(listed(place) for place in places) + " )"
    return SPHERES.format(diameter=1e-4 * diameter, moving=str(moving).lower(), places=listing)


def app_and_config(case: Case) -> tuple[Any, Any]:
    app = import_module(f"{case.program}.__main__").load_app()
    return app, app.configure(loads(case.text))


def made(case: Case, pool: Pool, world: World | None = None) -> Any:
    app, config = app_and_config(case)
    return app.load()(config, world or World.alone(), pool, Timers())


@contextmanager
def running(case: Case, pool: Pool) -> Iterator[Any]:
    app = made(case, pool)
    try:
        yield app
    finally:
        app.close()


def unused(cloud: Any) -> int:
    """Bytes that were reserved for particles but never touched: free pages, and boxes of those who leave a tile."""
    arena, pages = cloud.arena, cloud.pages
    reserved = [arena[name] for name in ("pool", "ids", "chain", "free", "moving", "leavers")]
    return sum(a.nbytes for a in reserved) - pages.fresh * (arena["pool"][0].nbytes + arena["ids"][0].nbytes)


def held(case: Case, pool: Pool, steps: int = 2, change: Callable[[Any], None] = lambda app: None) -> int:
    """Bytes after some steps, of the second time that a scene is made, so that compilation does not count.

    change(app) is done before the first step.
    """
    with running(case, pool) as app:
        change(app)
        app.step()
    del app
    gc.collect()
    tracemalloc.start()
    try:
        with running(case, pool) as app:
            change(app)
            for _ in range(steps):
                app.step()
            gc.collect()
            total = tracemalloc.get_traced_memory()[0]
            return total - (unused(app.cloud) if case.program == "hpcpic" else 0)
    finally:
        tracemalloc.stop()


def each(one: Case, two: Case, items: int, pool: Pool) -> float:
    """Bytes of an item, of scenes that differ by so many; what any scene needs is in both."""
    return (held(two, pool) - held(one, pool)) / items


def seconds(work: Callable[[], Any]) -> float:
    begin = time.process_time()
    work()
    return time.process_time() - begin


def timing(work: Callable[..., Any], spent: list[float]) -> Callable[..., None]:
    """A function that does the work and keeps its seconds in `spent`."""
    return lambda *words: spent.append(seconds(partial(work, *words)))


def repeated(work: Callable[[], Any], times: int) -> None:
    for _ in range(times):
        work()


def ratio(one: Callable[[], Any], two: Callable[[], Any], rounds: int = 9) -> float:
    """Processor time of the second over the first, the median of rounds in turn."""
    one(), two()
    return statistics.median(1.0 / (seconds(one) / seconds(two)) for _ in range(rounds))


def step_ratio(one: Case, two: Case, pool: Pool, steps: int = 4, rounds: int = 9) -> float:
    with running(one, pool) as a, running(two, pool) as b:
        return ratio(partial(repeated, a.step, steps), partial(repeated, b.step, steps), rounds)


def least(work: Callable[[], Any], rounds: int = 7) -> float:
    work()
    return min(seconds(work) for _ in range(rounds))


# ---- the rows


def empty_tank(pool: Pool) -> Iterator[Row]:
    small, large = (water(high=(side, side), spacing=0.005) for side in (1.0, 1000.0))
    found = step_ratio(small, large, pool)
    yield Row("C1", "SPH, tank a million times as large: time", f"{found:.3f}", "<= 1.1", bool(found <= 1.1))
    found = held(large, pool) / held(small, pool)
    yield Row("C1", "... bytes", f"{found:.3f}", "<= 1.05", found <= 1.05)


def porous(nodes: tuple[int, ...], porosity: float) -> NDArray[np.bool_]:
    """Solid nodes: balls of six nodes radius anywhere, until so much is left to the fluid."""
    rng, solid = np.random.default_rng(7), np.zeros(nodes, bool)
    grid = np.stack(np.meshgrid(*map(np.arange, nodes), indexing="ij"), -1)
    while solid.mean() < 1.0 - porosity:
        d = np.abs(grid - rng.uniform(0, nodes))
        solid |= (np.minimum(d, np.array(nodes) - d) ** 2).sum(-1) < 36.0
    return solid


def solid_lattice(pool: Pool) -> Iterator[Row]:
    from lbmdem.kernels.layout import WALL

    def fill(app: Any, solid: NDArray[np.bool_]) -> None:
        app.fluid.solid.inner[solid] = WALL
        app.fluid.solid_changed()

    nodes, rows = (64, 64, 64), []
    all_nodes = math.prod(nodes)
    with ExitStack() as stack:
        first = stack.enter_context(running(flow(nodes), pool))
        size = held(flow(nodes), pool) / all_nodes
        for porosity in (0.9, 0.5, 0.35, 0.1):
            app, solid = stack.enter_context(running(flow(nodes), pool)), porous(nodes, porosity)
            fill(app, solid)
            rows.append((app, solid))
        for app, solid in rows:
            wet = np.count_nonzero(~solid)
            found = ratio(partial(repeated, first.step, 4), partial(repeated, app.step, 4)) * all_nodes / wet
            share = wet / all_nodes
            what = f"D3Q19, porosity {share:.2f}: time per fluid node"
            yield Row("C2", what, f"{found:.2f}", "<= 1.1", bool(found <= 1.1))
            each = held(flow(nodes), pool, change=partial(fill, solid=solid)) / wet
            told = f"{each:.0f} B, {each / size:.2f} x"
            yield Row("C2", "... bytes per fluid node", told, "<= 1.1 x", bool(each <= 1.1 * size))


def no_magnetic_field(pool: Pool) -> Iterator[Row]:
    without, along, oblique = (
        plasma(128, 1_000_000, magnetic) for magnetic in ((0, 0, 0), (0, 0, 0.3), (0.3, 0.1, 0.2))
    )
    for other, what, aim in ((oblique, "any direction", 1.25), (along, "along z", None)):
        with running(without, pool) as a, running(other, pool) as b:
            spent: dict[Any, list[float]] = {}
            for app in (a, b):
                spent[app] = []
                app.cloud.push = timing(app.cloud.push, spent[app])
            for _ in range(12):
                a.step(), b.step()
            found = statistics.median(y / x for x, y in zip(spent[a][3:], spent[b][3:]))
        told = f">= {aim}" if aim else "-"
        yield Row("C3", f"push, field in {what} / none", f"{found:.2f}", told, found >= aim if aim else None)
    found = each(plasma(64, 200_000, (0.3, 0.1, 0.2)), plasma(64, 400_000, (0.3, 0.1, 0.2)), 200_000, pool)
    less = each(plasma(64, 200_000), plasma(64, 400_000), 200_000, pool)
    yield Row("C3", "bytes of a particle, field / none", f"{found:.1f} / {less:.1f}", "5 / 4 numbers", less < found - 7)


def fixed_grains(pool: Pool) -> Iterator[Row]:
    from lbmdem.kernels.layout import FLUID, WALL

    nodes = (64, 64, 64)
    for rule, apart, diameter in (("cli", 16, 13.0), ("cli", 64, 20.0), ("halfway", 64, 20.0)):
        text = spheres(nodes, apart, diameter) + f'coupling = {{ bounce_back = "{rule}"; }};'
        with running(flow(nodes, text), pool) as fixed, running(flow(nodes), pool) as plain:
            plain.fluid.solid.inner[fixed.fluid.solid.inner != FLUID] = WALL
            plain.fluid.solid_changed()
            links = fixed.immersed.counts()["links"] / np.count_nonzero(fixed.fluid.solid.inner == FLUID)
            what = f"fixed spheres, {rule}, {links:.2f} links a node / walls"
            found = ratio(partial(repeated, plain.step, 6), partial(repeated, fixed.step, 6))
            yield Row("C4", f"{what}: step", f"{found:.3f}", "<= 1.02", found <= 1.02)
            found = ratio(partial(leap, plain, 12), partial(leap, fixed, 12))
            yield Row("C4", "... between outputs (several steps a pass)", f"{found:.3f}", "<= 1.02", found <= 1.02)


def leap(app: Any, steps: int) -> None:
    until = app.iteration + steps
    while app.iteration < until:
        app.advance(until - app.iteration)


def plane(pool: Pool) -> Iterator[Row]:
    found = step_ratio(flow((256, 256)), flow((256, 256, 1)), pool)
    yield Row("C6", "lattice, 3D one node thick / 2D: time", f"{found:.2f}", ">= 2", found >= 2)
    found = held(flow((256, 256, 1)), pool) / held(flow((256, 256)), pool)
    yield Row("C6", "... bytes", f"{found:.2f}", ">= 2", found >= 2)
    box: dict[str, Any] = {"spacing": 0.005, "gravity": 0.0}
    flat = water(high=(0.5, 0.5), periodic="xy", **box)
    thick = water((0, 0, 0), (0.5, 0.5, 0.03), (0.5, 0.5, 0.03), periodic="xyz", **box)
    found = step_ratio(flat, thick, pool, 2, 5) / 6
    yield Row("C6", "SPH, a layer of 3D (of the 6 that a cell needs) / 2D: time", f"{found:.2f}", ">= 2", found >= 2)


def absent(pool: Pool) -> Iterator[Row]:
    """What a term of SPH costs that a scene may lack. No aim: that it costs nothing when absent is held by its plan."""
    bare: dict[str, Any] = {"low": (0, 0, 0), "high": (0.4, 0.4, 0.4), "spacing": 0.01, "gravity": 0.0}
    free = {**bare, "top": (0.4, 0.4, 0.4), "periodic": "xyz"}
    pool_of_water = {**bare, "top": (0.4, 0.4, 0.2), "periodic": "xy"}
    plane = "plane = { point = [0, 0, 0]; normal = [0, 0, 1]; };"
    floor = f'wall = ( {{ name = "floor"; shape = {{ {plane} }}; type = "%s"; }} );'
    for what, without, more in (
        ("Cleary's viscosity", free, {"form": "cleary", "more": "dynamic_viscosity = 1.0e-3;"}),
        ("Molteni's flux", free, {"flux": "molteni"}),
        ("Rusanov's flux", free, {"flux": "rusanov"}),
        ("TVD-RK3 instead of the split scheme", free, {"integrator": "rk3-tvd"}),
        ("a floor that repels", pool_of_water, {"walls": floor % "repulsive"}),
        ("a floor of mirrored ghosts", pool_of_water, {"walls": floor % "mirror-no-slip"}),
    ):
        one, two = water(**without), water(**{**without, **more})
        time, size = step_ratio(one, two, pool), held(two, pool) / held(one, pool)
        yield Row("C7", f"SPH, {what}: time, bytes", f"{time:.2f}, {size:.2f}", "")


def nothing(pool: Pool) -> Iterator[Row]:
    with running(plasma(256, 0), pool) as empty:
        found = 1e6 * least(lambda: repeated(empty.step, 200)) / 200
    yield Row("C8", "plasma without particles, 256 x 256: us a step", f"{found:.1f}", "<= 20", found <= 20)


def memory(pool: Pool) -> Iterator[Row]:
    pairs = (
        ("plasma 2D, 2 velocities", plasma(64, 300_000), plasma(64, 600_000), 300_000, 4 * 8 + 4),
        ("SPH 2D, split scheme", water(spacing=0.005), water(spacing=0.0025), 30_000, 8 * 8 + 8 + 8),
        ("D2Q9", flow((256, 256)), flow((256, 512)), 256 * 256, 9 * 8 + 4),
        ("D3Q19", flow((64, 64, 64)), flow((64, 64, 128)), 64**3, 19 * 8 + 4),
        ("D3Q19, single", flow((64, 64, 64), storage="single"), flow((64, 64, 128), storage="single"), 64**3, 80),
    )
    for what, one, two, items, bound in pairs:
        found = each(one, two, items, pool)
        told = f"{found:.1f} B, {found / bound:.2f} x"
        yield Row("C10", f"bytes of an item: {what} (least {bound})", told, "<= 1.25 x", found <= 1.25 * bound)


def outputs(pool: Pool) -> Iterator[Row]:
    for what, case in (
        ("plasma, a run of a second", plasma(64, 262_144)),
        ("plasma, a run of an hour", plasma(64, 262_144, cycles=5_000_000)),
        ("SPH", water(spacing=0.005)),
        ("lattice, 1000 steps in all", flow((256, 256))),
    ):
        with running(case, pool) as app:
            step = least(lambda: repeated(app.step, 4)) / 4
            sample = least(lambda: (app.step(), app.scalars())) - step
            every = app.periods.get("series") or app.time_periods["series"] / app.time_step
        found = sample / (every * step)
        what = f"{what}: the default series, a sample of {sample / step:.1f} steps in {every:.0f}"
        yield Row("C11", what, f"{found:.1%} of a step", "<= 5 %", found <= 0.05)


def words(_: Pool) -> Iterator[Row]:
    for words in (["--help"], ["check", "landau-damping", "--plan"], ["check", "nowhere.conf"]):
        found = 1e3 * min(command_seconds(words) for _ in range(3))
        yield Row("C12", f"hpcpic {' '.join(words)}: ms", f"{found:.0f}", "<= 100", found <= 100)


def command_seconds(words: list[str]) -> float:
    """Processor time of a command."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-P", "-m", "hpcpic", *words], capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def growth(pool: Pool) -> Iterator[Row]:
    pairs = (
        ("particles of a plasma", 2, plasma(64, 400_000), plasma(64, 800_000)),
        ("nodes of a plasma", 4, plasma(512, 1000), plasma(1024, 1000)),
        ("particles of SPH", 2, water(spacing=0.005), water(high=(1, 2), top=(0.5, 1.0), spacing=0.005)),
        ("nodes of a lattice", 2, flow((128, 64, 64)), flow((128, 64, 128))),
    )
    for what, factor, one, two in pairs:
        planned = np.log(planned_seconds(two) / planned_seconds(one)) / np.log(factor)
        found = np.log(step_ratio(one, two, pool, TURN)) / np.log(factor)
        told = f"{found:.2f}, planned {planned:.2f}"
        yield Row("C14", f"{factor} times the {what}: exponent of time", told, "+- 0.1", abs(found - planned) <= 0.1)
        sizes = planned_bytes, partial(held, pool=pool)
        planned, found = (np.log(size(two) / size(one)) / np.log(factor) for size in sizes)
        told = f"{found:.2f}, planned {planned:.2f}"
        yield Row("C14", "... of bytes", told, "+- 0.1", abs(found - planned) <= 0.1)


def planned_seconds(case: Case) -> float:
    app, config = app_and_config(case)
    return app.estimate(config, 1, 1, {}).step_seconds


def planned_bytes(case: Case) -> float:
    """Bytes of the arrays while it runs."""
    app, config = app_and_config(case)
    memory = app.estimate(config, 1, 1, {}).memory
    apart = ("Python and libraries", "state in order")  # the latter at the end of a run only
    return sum(value for name, value in memory.items() if not name.startswith(apart))


TABLE: dict[str, Callable[[Pool], Iterator[Row]]] = {
    "C1": empty_tank, "C2": solid_lattice, "C3": no_magnetic_field, "C4": fixed_grains, "C6": plane, "C7": absent,
    "C8": nothing, "C10": memory, "C11": outputs, "C12": words, "C14": growth,
}  # fmt: skip


def main() -> None:
    pool = Pool(1)
    for name in sys.argv[1:] or TABLE:
        for row in TABLE[name](pool):
            verdict = {True: "kept", False: "MISSED", None: ""}[row.kept]
            print(f"{row.name:<4} {row.what:<68} {row.measured:>20}   {row.aim:<14} {verdict}", flush=True)
    pool.close()


if __name__ == "__main__":
    main()
