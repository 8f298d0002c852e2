"""Ours beside what the package index holds: lbmpy (generated C, vectorised, in place) for the lattice Boltzmann step,
LAMMPS (granular, springs with history) for a bed of spheres.

    python scripts/peers.py [--points 128] [--threads 1 2] [--storage double single] [--rounds 5] [--cpu]

Peers are installed into an environment of their own (--environment, kept). Each runs in another process, which takes
steps in turn with ours; the medians of the ratios are told, and what the memory does by itself (an update in place). A
peer that cannot be installed or started is said so, and left out. lbmpy 2.1 wants Python 3.12; with 3.11 it is lbmpy
2.0, and a C++ compiler must be there. --cpu counts processor time instead of time, for a machine that others use too.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Callable, Iterator
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np

from hpcpic.core.comm.world import World
from hpcpic.core.space.domain import Domain
from hpcpic.core.tasks.graph import Pool
from lbmdem.fluid.fluid import Fluid
from lbmdem.grains.dem import Dem
from lbmdem.physics.velocity_sets import D3Q19

ROOT = Path(__file__).resolve().parent.parent
PATTERNS = ("esotwist", "aa")
DTYPE = {"double": "float64", "single": "float32"}
METHOD = {"TRT": "TRT", "BGK": "SRT"}
WANTED = {
    "lbmpy": ("lbmpy>=2.1" if sys.version_info >= (3, 12) else "lbmpy==2.0.*", "py-cpuinfo"),
    "lammps": ("lammps[mpi]", "numpy"),
}
GRAIN_STEPS = 300  # of the small bed, in a turn


class Missing(Exception):
    """A peer that cannot be had here, and why."""


def environment(folder: Path, peer: str) -> Path:
    """The Python of an environment with a peer; made if need be. Raises Missing."""
    python = folder / "bin" / "python"
    try:
        if not python.exists():
            venv.create(folder, with_pip=True)
        if subprocess.run([python, "-m", "pip", "show", "--quiet", peer], capture_output=True).returncode:
            command = [python, "-m", "pip", "install", "--quiet", *WANTED[peer]]
            subprocess.run(command, check=True, capture_output=True, text=True)
    except subprocess.CalledProcessError as error:
        told = (error.stderr or "pip failed").strip().splitlines()
        raise Missing(f"{peer} cannot be installed: {told[-1]}") from error
    return python


class Peer:
    """The other process: prints "ready", then answers each line with seconds and seconds of processor time."""

    def __init__(self, name: str, python: Path, *arguments: object) -> None:
        command = [str(python), str(ROOT / "scripts" / f"peer_{name}.py"), *map(str, arguments)]
        libraries = os.environ | {"LD_LIBRARY_PATH": str(python.parent.parent / "lib"), "OMP_NUM_THREADS": "1"}
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True, env=libraries)
        if self._answer() != "ready":
            told = self._process.communicate()[1].strip().splitlines()
            raise Missing(f"{name} did not start: {told[-1] if told else 'no reason given'}")

    def _answer(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline().strip()

    def seconds(self, line: str, cpu: bool) -> float:
        assert self._process.stdin is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()
        return float(self._answer().split()[cpu])

    def close(self) -> None:
        self._process.communicate()


def clock(cpu: bool) -> Callable[[], float]:
    return time.process_time if cpu else time.perf_counter


def timed(action: Callable[[], object], cpu: bool) -> float:
    begin = clock(cpu)()
    action()
    return clock(cpu)() - begin


def memory(threads: int, rounds: int) -> str:
    """GB/s of an update in place of 512 MiB, by one thread and by all."""
    from benchmarks.lbm import LINE, scale
    from hpcpic.core.space.domain import block_ranges
    from hpcpic.core.space.fields import aligned_zeros
    from hpcpic.core.tasks.graph import bind

    array = aligned_zeros((1 << 26,), np.float64)
    found = []
    for used in sorted({1, threads}):
        pool = Pool(used)
        tasks = [bind(scale, a=array, low=low, high=high) for low, high in block_ranges(array.nbytes // LINE, used)]
        best = min(timed(partial(pool.each, tasks), cpu=False) for _ in range(rounds + 1))
        found.append(f"{2e-9 * array.nbytes / best:.1f} GB/s on {used} thread(s)")
        pool.close()
    return f"memory, update in place: {', '.join(found)}"


def compare(python: Path, points: int, storage: str, threads: int, collision: str, rounds: int, cpu: bool) -> str:
    """One line: million node updates per second of each, ratios of ours to the better of lbmpy's patterns."""
    world, pool = World.alone(), Pool(threads)
    shape = (points,) * 3
    domain = Domain(tuple(map(float, shape)), shape, (True,) * 3, (0, points))
    fluid = Fluid(world, pool, domain, D3Q19, tau=0.8, collision=collision, storage=storage)
    fluid.set_equilibrium(1.0, np.array([0.01, 0.02, 0.03]))
    steps = 2 * fluid.depth

    def plain() -> None:
        for _ in range(steps):
            fluid.step()

    peer = Peer("lbmpy", python, points, DTYPE[storage], threads, METHOD[collision], *PATTERNS)
    samples = []
    for _ in range(rounds + 1):
        ours = [timed(plain, cpu), timed(lambda: fluid.advance(steps), cpu)]
        samples.append((*ours, min(peer.seconds(f"{pattern} {steps // 2}", cpu) for pattern in PATTERNS)))
    peer.close()
    pool.close()
    samples = samples[1:]
    work = 1e-6 * points**3 * steps * (threads if cpu else 1)
    speed = [work / statistics.median(column) for column in zip(*samples)]
    ratios = [statistics.median(sample[2] / sample[k] for sample in samples) for k in range(2)]
    return (
        f"D3Q19 {points}^3 {collision} {storage} {threads} thread(s): lbmpy {speed[2]:.1f}, "
        f"ours {speed[0]:.1f} MLUPS = x {ratios[0]:.2f}, "
        f"{fluid.depth} steps per pass {speed[1]:.1f} = x {ratios[1]:.2f}"
    )


def grains(python: Path, rounds: int, cpu: bool) -> Iterator[str]:
    """A line for each of two beds: million particle-steps per second on one core, and the ratio of ours to LAMMPS."""
    from benchmarks import dem as bench

    world, pool = World.alone(), Pool(1)
    settled = bench.settled(world, pool, bench.LAWS["history"], steps=10000)
    for tiles in (1, 3):
        dem = bench.bed(world, pool, bench.LAWS["history"], *settled, tiles)
        yield beds(python, dem, tiles, rounds, cpu)
    pool.close()


def beds(python: Path, dem: Dem, tiles: int, rounds: int, cpu: bool) -> str:
    from benchmarks import dem as bench
    from lbmdem.grains.contact_network import contact_count
    from lbmdem.grains.packing import everywhere

    law, n, reduced, steps = bench.LAWS["history"], dem.grains.number, 0.5, GRAIN_STEPS // tiles**2
    x = everywhere(dem)
    facts = {
        "side": bench.APART * bench.PER_SIDE * tiles,
        "height": 2.0 * bench.PER_SIDE,
        "stiffness": law.stiffness,
        "normal": 2.0 * law.damping * (law.stiffness / reduced) ** 0.5,
        "shear": law.viscosity / reduced,
        "friction": law.friction,
        "gravity": bench.GRAVITY,
        "step": bench.STEP,
    }
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bed.npz"
        np.savez(path, x=x, v=np.zeros_like(x), **facts)
        peer = Peer("lammps", python, path)
        samples = []
        for _ in range(rounds + 1):
            ours = timed(lambda: dem.advance(bench.STEP, steps), cpu)
            samples.append((ours, peer.seconds(f"{steps}", cpu)))
        peer.close()
    contacts = 2 * contact_count(dem) / n
    samples = samples[1:]
    ours, theirs = (1e-6 * n * steps / statistics.median(column) for column in zip(*samples))
    ratio = statistics.median(sample[1] / sample[0] for sample in samples)
    return (
        f"{n} spheres at rest, {contacts:.1f} contacts, springs with history, 1 core: LAMMPS {theirs:.2f}, "
        f"ours {ours:.2f} million particle-steps/s = x {ratio:.2f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=128)
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--storage", nargs="+", default=["double", "single"])
    parser.add_argument("--collision", nargs="+", default=["TRT"], choices=METHOD)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--cpu", action="store_true", help="count processor time")
    parser.add_argument("--environment", type=Path, default=Path.home() / ".cache" / "hpcpic" / "peers")
    options = parser.parse_args()
    sys.path.insert(0, str(ROOT))
    print(memory(max(options.threads), options.rounds), flush=True)
    try:
        for line in grains(environment(options.environment, "lammps"), 3 * options.rounds, options.cpu):
            print(line, flush=True)
    except Missing as error:
        print(error, flush=True)
    try:
        python = environment(options.environment, "lbmpy")
        for collision, storage, threads in product(options.collision, options.storage, options.threads):
            line = compare(python, options.points, storage, threads, collision, options.rounds, options.cpu)
            print(line, flush=True)
    except Missing as error:
        print(error, flush=True)


if __name__ == "__main__":
    main()
