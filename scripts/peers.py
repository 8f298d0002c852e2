"""Ours beside what others do with the same work on this machine, in turns: one table of ratios.

    python scripts/peers.py [plasma lattice grains sph] [--narrow] [--rounds 5] [--cpu]

    plasma   whole steps over what memory takes to read and write the particles (an update in place), 64 and 8 per cell
    lattice  D3Q19, TRT, beside lbmpy (generated C, vectorised, in place): 128^3 nodes, and 40^3, which stay in caches
    grains   a bed of spheres at rest, springs with history, beside LAMMPS (granular)
    sph      the dam break of case column-impact-a with 3.8e5 particles beside LAMMPS (sph/taitwater), walls included

--narrow keeps our compiler and lbmpy's vectors from AVX-512, as on a processor without it; LAMMPS is built for any
x86-64. Peers are installed into environments of their own (--environment, kept), and run in other processes, which
take steps in turn with ours. A ratio is the median of those of the rounds, with the least and the most. A peer that
cannot be installed or started is said so, and left out. lbmpy 2.1 wants Python 3.12; with 3.11 it is lbmpy 2.0, and a
C++ compiler must be there. --cpu counts processor time instead of time, for a machine that others use too.
"""

import argparse
import os
import platform
import re
import statistics
import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from llvmlite import binding

ROOT = Path(__file__).resolve().parent.parent
WANTED = {
    "lbmpy": ("lbmpy>=2.1" if sys.version_info >= (3, 12) else "lbmpy==2.0.*", "py-cpuinfo"),
    "lammps": ("lammps[mpi]", "mpi4py", "numpy"),
    "jaxincell": ("jaxincell",),
}
PATTERNS = ("esotwist", "aa")
DTYPE = {"double": "float64", "single": "float32"}
PLASMA_STEPS, GRAIN_STEPS, SPH_STEPS = 10, 300, 4  # of a turn
SPH_PARTICLES = 3e5  # of the fluid


class Missing(Exception):
    """A peer that cannot be had here, and why."""


@dataclass(frozen=True)
class Asked:
    """What the command line asks for."""

    rounds: int
    cpu: bool
    narrow: bool
    environment: Path

    def python(self, peer: str) -> Path:
        """The Python of an environment with a peer; made if need be. Raises Missing."""
        folder = self.environment / peer
        python = folder / "bin" / "python"
        try:
            if not python.exists():
                venv.create(folder, with_pip=True)
            pip = [str(python), "-m", "pip"]
            if subprocess.run([*pip, "show", "--quiet", *WANTED[peer]], capture_output=True).returncode:
                command = [*pip, "install", "--quiet", *WANTED[peer]]
                subprocess.run(command, check=True, capture_output=True, text=True)
        except subprocess.CalledProcessError as error:
            lines = (error.stderr or "pip failed").strip().splitlines()
            raise Missing(f"{peer} cannot be installed: {lines[-1]}") from error
        return python

    def timed(self, action: Callable[[], object]) -> float:
        """Seconds, or seconds of processor time of this process, that an action takes."""
        clock = time.process_time if self.cpu else time.perf_counter
        begin = clock()
        action()
        return clock() - begin

    def turns(self, *works: Callable[[], float]) -> list[tuple[float, ...]]:
        """Seconds of each work, in turns; a first round is dropped."""
        return [tuple(work() for work in works) for _ in range(self.rounds + 1)][1:]


class Peer:
    """The other process: prints "ready", then answers each line with seconds and seconds of processor time."""

    def __init__(self, asked: Asked, name: str, *arguments: object, ranks: int = 1) -> None:
        python = asked.python(name)
        command = [python, ROOT / "scripts" / f"peer_{name}.py", *arguments]
        if ranks > 1:
            command = [python.with_name("mpiexec"), "-n", ranks, *command]
        libraries = os.environ | {"LD_LIBRARY_PATH": str(python.parent.parent / "lib"), "OMP_NUM_THREADS": "1"}
        pipe = subprocess.PIPE
        words = list(map(str, command))
        self._process = subprocess.Popen(words, stdin=pipe, stdout=pipe, stderr=pipe, text=True, env=libraries)
        self._cpu = asked.cpu
        if self._answer() != "ready":
            lines = self._process.communicate()[1].strip().splitlines()
            raise Missing(f"{name} did not start: {lines[-1] if lines else 'no reason given'}")

    def _answer(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline().strip()

    def seconds(self, line: str) -> float:
        assert self._process.stdin is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()
        return float(self._answer().split()[self._cpu])

    def close(self) -> None:
        self._process.communicate()


def row(work: str, peer: str, rates: tuple[str, str], ratios: list[float], aim: float, most: bool = False) -> str:
    """A line of the table. ratios: of each round; aim: what the median is to be at least, or at most."""
    found = statistics.median(ratios)
    good = found <= aim if most else found >= aim
    spread = f"{found:.2f} ({min(ratios):.2f} .. {max(ratios):.2f})"
    verdict = "reached" if good else "missed"
    return f"| {work} | {rates[0]} | {peer} {rates[1]} | {spread} | {'<=' if most else '>='} {aim} | {verdict} |"


HEAD = "| work | ours | beside | ratio (of rounds) | aim | |\n| --- | --- | --- | --- | --- | --- |"


def plasma(asked: Asked) -> Iterator[str]:
    """Steps over an update in place of as many bytes as x and v of the particles have, two components each."""
    from lbm import LINE, scale
    from plasma import CASE

    from hpcpic.core.case.config import loads
    from hpcpic.core.comm.world import World
    from hpcpic.core.space.fields import aligned_zeros
    from hpcpic.core.tasks.graph import Pool
    from hpcpic.core.timers import Timers
    from hpcpic.plasma.configure import configure
    from hpcpic.plasma.step import Plasma

    for (points, per_cell, aim), precision in product(((256, 64, 2.0), (512, 8, 3.0)), DTYPE):
        n = points**2 * per_cell
        pool = Pool(1)
        config = configure(loads(CASE.format(n=points, precision=precision, particles=n)))
        simulation = Plasma(config, World.alone(), pool, Timers())
        array = aligned_zeros((4 * n,), np.dtype(DTYPE[precision]))
        array[...] = 1.0

        def steps(simulation: Plasma = simulation) -> None:
            for _ in range(PLASMA_STEPS):
                simulation.step()

        rounds = asked.turns(
            partial(asked.timed, steps),
            partial(asked.timed, partial(scale, array, 0, array.nbytes // LINE)),
        )
        ours, update = (1e9 * statistics.median(column) / n for column in zip(*rounds))
        rates = f"{ours / PLASMA_STEPS:.2f} ns", f"{update:.2f} ns"
        ratios = [one / PLASMA_STEPS / other for one, other in rounds]
        work = f"plasma, {points}^2 cells, {per_cell} particles each, {precision}, 1 core"
        yield row(work, "update in place", rates, ratios, aim, most=True)
        simulation.close()
        pool.close()


def lattice(asked: Asked) -> Iterator[str]:
    """Million node updates per second, beside the better of lbmpy's patterns; one step a sweep and several."""
    from hpcpic.core.comm.world import World
    from hpcpic.core.space.domain import Domain
    from hpcpic.core.tasks.graph import Pool
    from lbmdem.fluid.fluid import Fluid
    from lbmdem.physics.velocity_sets import D3Q19

    for (points, cores, aim), storage in product(((128, 1, 1.0), (128, 2, 1.0), (40, 1, 1.1)), DTYPE):
        pool, shape = Pool(cores), (points,) * 3
        domain = Domain(tuple(map(float, shape)), shape, (True,) * 3, (0, points))
        fluid = Fluid(World.alone(), pool, domain, D3Q19, tau=0.8, collision="TRT", storage=storage)
        fluid.set_equilibrium(1.0, np.array([0.01, 0.02, 0.03]))
        steps = 2 * fluid.depth * (128 // points) ** 3
        peer = Peer(asked, "lbmpy", points, DTYPE[storage], cores, "AVX" if asked.narrow else "widest", *PATTERNS)

        def single(fluid: Fluid = fluid, steps: int = steps) -> None:
            for _ in range(steps):
                fluid.step()

        def theirs(peer: Peer = peer, steps: int = steps) -> float:
            return min(peer.seconds(f"{pattern} {steps // 2}") for pattern in PATTERNS)

        several = partial(fluid.advance, steps)
        rounds = asked.turns(partial(asked.timed, single), partial(asked.timed, several), theirs)
        peer.close()
        pool.close()
        work = 1e-6 * points**3 * steps * (cores if asked.cpu else 1)
        speed = [f"{work / statistics.median(column):.1f} MLUPS" for column in zip(*rounds)]
        name = f"D3Q19 TRT, {points}^3 nodes, {storage}, {cores} core{'s' * (cores > 1)}"
        yield row(name, "lbmpy", (speed[0], speed[2]), [last / first for first, _, last in rounds], aim)
        if points == 128:
            ratios = [last / second for _, second, last in rounds]
            yield row(f"... {fluid.depth} steps a pass", "lbmpy", (speed[1], speed[2]), ratios, 1.5)


def grains(asked: Asked) -> Iterator[str]:
    """Million particle-steps per second on one core."""
    import dem as bench

    from hpcpic.core.comm.world import World
    from hpcpic.core.tasks.graph import Pool
    from lbmdem.grains.packing import everywhere

    world, pool, law = World.alone(), Pool(1), bench.LAWS["history"]
    settled = bench.settled(world, pool, law, steps=10000)
    for tiles in (1, 3):
        dem = bench.bed(world, pool, law, *settled, tiles)
        n, reduced, steps, x = dem.grains.number, 0.5, GRAIN_STEPS // tiles**2, everywhere(dem)
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
            peer = Peer(asked, "lammps", "bed", path)
        rounds = asked.turns(
            partial(asked.timed, partial(dem.advance, bench.STEP, steps)), partial(peer.seconds, f"{steps}")
        )
        peer.close()
        ours, theirs = (f"{1e-6 * n * steps / statistics.median(column):.2f} M/s" for column in zip(*rounds))
        ratios = [last / first for first, last in rounds]
        yield row(f"{n} spheres at rest, double, 1 core", "LAMMPS", (ours, theirs), ratios, 1.3)
    pool.close()


def sph(asked: Asked) -> Iterator[str]:
    """Million particles (walls too) times steps per second; theirs in double, with as many neighbours."""
    import sph_speed as bench

    from hpcpic.core.comm.world import World
    from hpcpic.core.tasks.graph import Pool

    for cores, (precision, aim) in product((1, 2), (("double", 4.0), ("single", 6.0))):
        pool = Pool(cores)
        ours = bench.engine(World.alone(), pool, "symplectic", precision, SPH_PARTICLES, "output.walls=true")
        for _ in range(bench.WARM):
            bench.step(ours)
        found, scene = ours.particles(), ours.scene
        wet = {fluid.section.name for fluid in scene.fluids}
        facts: dict[str, Any] = {
            "box": np.array([scene.config.domain.low, scene.config.domain.high]),
            "support": scene.support, "rho0": scene.eos.rho0, "c0": scene.eos.c0, "alpha": 0.02, "gravity": 9.81,
            "mass": scene.eos.rho0 * scene.config.numerics.spacing**3, "step": ours.clock.time_step,
        }  # fmt: skip
        with tempfile.TemporaryDirectory() as folder:
            path, x = Path(folder) / "tank.npz", [particles.position for particles in found.values()]
            kinds = [np.full(len(places), 1 if name in wet else 2) for name, places in zip(found, x)]
            np.savez(path, x=np.concatenate(x), kind=np.concatenate(kinds), **facts)
            peer = Peer(asked, "lammps", "tank", path, ranks=cores)

        def steps(simulation: bench.Sph = ours) -> None:
            for _ in range(SPH_STEPS):
                bench.step(simulation)

        rounds = asked.turns(partial(asked.timed, steps), partial(peer.seconds, f"{SPH_STEPS}"))
        peer.close()
        n = sum(map(len, x))
        work = 1e-6 * n * SPH_STEPS
        speeds = [f"{work / statistics.median(column):.2f} M/s" for column in zip(*rounds)]
        name = f"SPH, {n} particles, {precision}, {cores} core{'s' * (cores > 1)}"
        yield row(name, "LAMMPS, double,", (speeds[0], speeds[1]), [last / first for first, last in rounds], aim)
        ours.close()
        pool.close()


WORKS = {work.__name__: work for work in (plasma, lattice, grains, sph)}


def narrowed() -> dict[str, str]:
    """The settings by which numba makes code for this processor without AVX-512."""
    features = binding.get_host_cpu_features().flatten()
    return {"NUMBA_CPU_FEATURES": re.sub(r"\+(avx512|avx10)", r"-\1", features)}


def processor() -> str:
    """The name that Linux tells, or what Python knows."""
    told = re.search(r"^model name\s*:\s*(.*)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    return told[1] if told else platform.processor()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("works", nargs="*", metavar="work", help=", ".join(WORKS))
    parser.add_argument("--narrow", action="store_true", help="without AVX-512")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--cpu", action="store_true", help="count processor time")
    parser.add_argument("--environment", type=Path, default=Path.home() / ".cache" / "hpcpic" / "peers")
    options = parser.parse_args()
    unknown = set(options.works) - set(WORKS)
    if unknown:
        parser.error(f"no work is called {', '.join(sorted(unknown))}: {', '.join(WORKS)}")
    if options.narrow and "NUMBA_CPU_FEATURES" not in os.environ:
        sys.exit(subprocess.run([sys.executable, *sys.argv], env=os.environ | narrowed()).returncode)
    sys.path.insert(0, str(ROOT / "benchmarks"))
    wide = "+avx512f" in os.environ.get("NUMBA_CPU_FEATURES", binding.get_host_cpu_features().flatten())
    print(f"{processor()}, {'with' if wide else 'without'} AVX-512{', forced' if options.narrow else ''}\n\n{HEAD}")
    asked = Asked(options.rounds, options.cpu, options.narrow, options.environment)
    for name in options.works or WORKS:
        try:
            for line in WORKS[name](asked):
                print(line, flush=True)
        except Missing as error:
            print(error, flush=True)


if __name__ == "__main__":
    main()
