"""Rates of the SPH kernels on this machine, under the names that `estimate` knows.

Steps of the split scheme in a periodic box of disordered particles; a step is worth 1.46 evaluations of all pair sums.
"""

from collections.abc import Mapping

import numpy as np

from hpcpic.core.comm.world import World
from hpcpic.core.files.config import loads
from hpcpic.core.files.schema import validate
from hpcpic.core.tasks import Pool
from hpcpic.core.timers import Timers
from sph.config import SphConfig
from sph.estimate import SUMS
from sph.step import Sph

ACROSS = {2: 160, 3: 30}  # particles along an edge of the box
STEPS = {True: 4, False: 16}  # by `quick`
CASE = """
simulation = {{ dimensions = {d}; end_time = 1.0; integrator = "symplectic"; cfl = 0.5; }};
domain = {{ low = {low}; high = {high}; periodic = {periodic}; }};
eos = {{ sound_speed = 10.0; }};
fluid = ( {{ shape = {{ box = {{ low = {low}; high = {high}; }}; }}; initial_pressure = "zero"; }} );
numerics = {{ spacing = {spacing!r}; density_flux = "molteni"; artificial_viscosity = 0.05;
             precision = "{precision}"; }};
"""


def bench(quick: bool) -> Mapping[str, float]:
    """Rate by name; with `quick` 3D double only."""
    world = World.alone()
    rates: dict[str, float] = {}
    for d, precision in ((3, "double"), (3, "single"), (2, "double"), (2, "single"))[: 1 if quick else None]:
        pairs, rest = measure(world, d, precision, STEPS[quick])
        rates[f"pair_ns {d}D {precision}"] = pairs
        if (d, precision) == (3, "double"):
            rates["particle_ns"] = rest
    return rates


def measure(world: World, d: int, precision: str, steps: int) -> tuple[float, float]:
    """ns of a directed pair within the support, and of a particle for all else in a step."""
    n = ACROSS[d]
    text = CASE.format(
        d=d, low=[0.0] * d, high=[1.0] * d, periodic='["' + '", "'.join("xyz"[:d]) + '"]', spacing=1.0 / n,
        precision=precision,
    )  # fmt: skip
    pool = Pool(1, world.cpus(1))
    sph = Sph(validate(SphConfig, loads(text)), world, pool, Timers())
    sph.bodies.own("x")[:] += np.random.default_rng(1).uniform(0.0, 0.2 / n, (d, sph.bodies.n))
    sph.migrate()
    sph.sort()
    sph.step()
    sph.timers.reset()
    for _ in range(steps):
        sph.step()
    totals = sph.timers.totals()
    pairs = totals["pairs"][0] / (steps * SUMS["symplectic"] * sph.bodies.n * neighbours(sph))
    rest = sum(seconds for name, (seconds, _) in totals.items() if name != "pairs") / (steps * sph.bodies.n)
    sph.close()
    pool.close()
    return 1e9 * pairs, 1e9 * rest


def neighbours(sph: Sph) -> int:
    """Of a particle of the lattice, within the support."""
    reach = sph.scene.support / sph.scene.spacing
    steps = np.arange(-int(reach), int(reach) + 1)
    grid = np.meshgrid(*[steps] * sph.scene.dimensions)
    return int(np.count_nonzero(sum(axis**2 for axis in grid) < reach * reach)) - 1
