"""Rates of the SPH kernels on this machine, under the names that `estimate` knows.

Steps of the split scheme with a cube of disordered particles, large and small, in empty space; a step is worth 1.46
evaluations of all pair sums. What a step takes beside them grows with the particles from what its launches take.
"""

import statistics
from collections.abc import Mapping
from time import perf_counter

import numpy as np

from hpcpic.core.comm.world import World
from hpcpic.core.files.config import loads
from hpcpic.core.files.schema import validate
from hpcpic.core.tasks import Pool
from hpcpic.core.timers import Timers
from sph.config import SphConfig
from sph.estimate import SUMS
from sph.step import Sph

ACROSS = {2: 160, 3: 36}  # particles along an edge of the cube
FEW = 10
STEPS = {True: 4, False: 16}  # by `quick`
CASE = """
simulation = {{ dimensions = {d}; end_time = 1.0; integrator = "symplectic"; cfl = 0.5; }};
domain = {{ low = {low}; high = {high}; }};
eos = {{ sound_speed = 10.0; }};
fluid = ( {{ shape = {{ box = {{ low = {near}; high = {far}; }}; }}; initial_pressure = "zero"; }} );
numerics = {{ spacing = {spacing!r}; density_flux = "molteni"; artificial_viscosity = 0.05;
             precision = "{precision}"; }};
"""


def bench(quick: bool) -> Mapping[str, float]:
    """Rate by name; with `quick` 3D double only."""
    world = World.alone()
    rates: dict[str, float] = {}
    for d, precision in ((3, "double"), (3, "single"), (2, "double"), (2, "single"))[: 1 if quick else None]:
        pairs, rest, n = measure(world, d, precision, ACROSS[d], STEPS[quick])
        rates[f"pair_ns {d}D {precision}"] = 1e9 * pairs
        if (d, precision) == (3, "double"):
            _, least, few = measure(world, d, precision, FEW, 4 * STEPS[quick])
            each = (rest - least) / (n - few)
            rates |= {"body_ns": 1e9 * each, "sum_launch_us": 1e6 * (least - few * each) / SUMS["symplectic"]}
    return rates


def measure(world: World, d: int, precision: str, across: int, steps: int) -> tuple[float, float, int]:
    """s of a directed pair within the support, s of all else in a step, and the number of particles."""
    text = CASE.format(
        d=d, low=[-1.0] * d, high=[2.0] * d, near=[0.0] * d, far=[1.0] * d, spacing=1.0 / across, precision=precision
    )
    pool = Pool(1, world.cpus(1))
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
    step, sums, n = statistics.median(steps_s[2:]), statistics.median(sums_s[2:]), sph.bodies.n
    pairs = SUMS["symplectic"] * neighbours(sph, across)
    sph.close()
    pool.close()
    return sums / pairs, step - sums, n


def neighbours(sph: Sph, across: int) -> int:
    """Directed pairs within the support, of all particles of the cube on its lattice."""
    reach, d = sph.scene.support / sph.scene.spacing, sph.scene.dimensions
    steps = np.arange(-int(reach), int(reach) + 1)
    grid = np.meshgrid(*[steps] * d)
    inside = (sum(axis**2 for axis in grid) < reach * reach) & (sum(axis**2 for axis in grid) > 0)
    return int(np.prod([across - abs(axis[inside]) for axis in grid], axis=0).sum())
