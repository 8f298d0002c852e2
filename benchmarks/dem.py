"""Particle-steps per second of the grains: a dense bed of equal spheres at rest on a wall, periodic sides.

python benchmarks/dem.py                         one core, two threads, two ranks (needs mpirun beside this python)
python benchmarks/dem.py STATE TILES KIND THREADS   one line; under mpirun for ranks

The bed is that of LAMMPS' granular benchmarks: m = d = 1, g = 10, k_n = 2e5, step 1.5e-4 (3 % of a collision),
friction 0.5. `settled`, `bed` and `rate` are what other scripts may call.
"""

import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.world import World
from hpcpic.core.physics.contact_law import ContactLaw
from hpcpic.core.space.domain import Domain
from hpcpic.core.space.rng import uniforms
from hpcpic.core.tasks.graph import Pool
from lbmdem.grains.contact_network import contact_count
from lbmdem.grains.dem import Dem
from lbmdem.grains.packing import everywhere
from lbmdem.physics.plane_walls import PlaneWall

STEP, STIFFNESS, GRAVITY = 1.5e-4, 2e5, 10.0
PER_SIDE, APART = 22, 1.02  # spheres along x and y, and their distance at the start
LAWS = {
    "history": ContactLaw(STIFFNESS, damping=0.16, friction=0.5, viscosity=25.0, shear=2 / 7 * STIFFNESS),
    "regularised": ContactLaw(STIFFNESS, damping=0.16, friction=0.5, viscosity=25.0),
}


def bed(world: World, pool: Pool, law: ContactLaw, x: NDArray, v: NDArray, tiles: int = 1) -> Dem:
    """Spheres at x[n, 3] with v[n, 3], the periodic bed repeated `tiles` times along x and y."""
    side = APART * PER_SIDE
    shifts = [(i * side, j * side, 0.0) for i in range(tiles) for j in range(tiles)]
    x, v = np.concatenate([x + shift for shift in shifts]), np.tile(v, (tiles**2, 1))
    n, rows, height = len(x), 4 * PER_SIDE, 1.5 * PER_SIDE
    cuts = [round(np.quantile(x[:, 2], rank / world.size) / height * rows) for rank in range(1, world.size)]
    columns = {
        "x": x,
        "v": v,
        "omega": np.zeros((n, 3)),
        "radius": np.full(n, 0.5),
        "mass": np.ones(n),
        "inertia": np.full(n, 0.1),
        "fixed": np.zeros(n, bool),
    }
    lengths = (height, tiles * side, tiles * side)
    domain = Domain(lengths, (rows, PER_SIDE, PER_SIDE), (False, True, True), (0, *cuts, rows))
    return Dem(world, pool, domain, columns, law, (PlaneWall((0, 0, 0), (0, 0, 1)),), (0.0, 0.0, -GRAVITY))


def settled(world: World, pool: Pool, law: ContactLaw, steps: int = 20000) -> tuple[NDArray, NDArray]:
    """Positions and velocities of a bed that fell from a loose lattice."""
    ids = np.arange(PER_SIDE**3)
    places = np.stack([ids % PER_SIDE, ids // PER_SIDE % PER_SIDE, ids // PER_SIDE**2], 1) + 0.5
    x = places * [APART, APART, 1.1] + 0.04 * (uniforms(7, 0, ids, 3) - 0.5)
    dem = bed(world, pool, law, x, np.zeros_like(x))
    for _ in range(steps // 1000):
        dem.advance(STEP, 1000)
        dem.grains.columns["row"][:, 4:7] *= 0.7  # quicker to rest
    return everywhere(dem), np.zeros_like(x)


def rate(dem: Dem, steps: int, repeats: int = 5) -> float:
    """The best of some runs, in particle-steps per second. Collective."""
    best = np.inf
    for _ in range(repeats):
        dem.world.barrier()
        begin = perf_counter()
        dem.advance(STEP, steps)
        best = min(best, dem.world.max(perf_counter() - begin))
    return dem.grains.number * steps / best


def measure(state: Mapping[str, NDArray], tiles: int, kind: str, threads: int) -> None:
    """Print one line of the table, on rank 0."""
    world = World.start()
    pool = Pool(threads, world.cpus(threads))
    dem = bed(world, pool, LAWS[kind], state["x"], state["v"], tiles)
    n = dem.grains.number
    dem.advance(STEP, 200)
    lists, steps = dem.list.builds, max(50, 2_000_000 // n)
    found, contacts = rate(dem, steps), 2 * contact_count(dem) / n
    if world.rank == 0:
        print(
            f"{n:7d} spheres, {kind:11s} {world.size} rank(s) x {threads} thread(s): {found / 1e6:6.2f} M/s, "
            f"{1e9 / found:5.1f} ns per particle-step; {contacts:.2f} contacts, a list every "
            f"{5 * steps / max(dem.list.builds - lists, 1):.0f} steps",
            flush=True,
        )
    pool.close()


def main() -> None:
    """The whole table, each line in processes of its own; or the one line that is asked for."""
    if len(sys.argv) > 1:
        saved, *setting = sys.argv[1:]
        measure(np.load(saved), int(setting[0]), setting[1], int(setting[2]))
        return
    launcher = str(Path(sys.executable).with_name("mpirun"))
    with tempfile.TemporaryDirectory() as folder:
        path, pool = str(Path(folder, "bed.npz")), Pool(1)
        x, v = settled(World.alone(), pool, LAWS["history"])
        np.savez(path, x=x, v=v)
        for tiles, kind in ((1, "history"), (1, "regularised"), (3, "history")):
            for ranks, threads in ((1, 1), (1, 2), (2, 1)):
                command = [sys.executable, "-m", "mpi4py", __file__, path, str(tiles), kind, str(threads)]
                subprocess.run([launcher, "-n", str(ranks), *command], check=True)


if __name__ == "__main__":
    main()
