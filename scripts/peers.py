"""Ours beside what the package index holds: lbmpy (generated C, vectorised, in place) for the lattice Boltzmann step.

    python scripts/peers.py [--points 128] [--threads 1 2] [--storage double single] [--rounds 9] [--cpu]

lbmpy is installed into an environment of its own (--environment, kept). It runs in another process, which takes steps
in turn with ours; the medians of the ratios are told. lbmpy 2.1 wants Python 3.12; with 3.11 it is lbmpy 2.0. A C++
compiler must be there. --cpu counts processor time instead of time, for a machine that others use too.
"""

import argparse
import statistics
import subprocess
import sys
import time
import venv
from pathlib import Path

import numpy as np

from hpcpic.core.comm.world import World
from hpcpic.core.space.domain import Domain
from hpcpic.core.tasks import Pool
from lbmdem.fluid import Fluid
from lbmdem.lattices import D3Q19

PATTERNS = ("esotwist", "aa")
DTYPE = {"double": "float64", "single": "float32"}
METHOD = {"TRT": "TRT", "BGK": "SRT"}


def environment(folder: Path) -> Path:
    """The Python of an environment with lbmpy; made if need be."""
    python = folder / "bin" / "python"
    if not python.exists():
        venv.create(folder, with_pip=True)
    if subprocess.run([python, "-c", "import lbmpy"], capture_output=True).returncode:
        wanted = "lbmpy>=2.1" if sys.version_info >= (3, 12) else "lbmpy==2.0.*"
        subprocess.run([python, "-m", "pip", "install", "--quiet", wanted, "py-cpuinfo"], check=True)
    return python


class Lbmpy:
    """The other process."""

    def __init__(self, python: Path, points: int, storage: str, threads: int, collision: str) -> None:
        script = Path(__file__).parent / "peer_lbmpy.py"
        command = [python, script, str(points), DTYPE[storage], str(threads), METHOD[collision], *PATTERNS]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        if self._answer() != "ready":
            raise SystemExit("lbmpy did not start")

    def _answer(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline().strip()

    def seconds(self, pattern: str, steps: int, cpu: bool) -> float:
        assert self._process.stdin is not None
        self._process.stdin.write(f"{pattern} {steps // 2}\n")
        self._process.stdin.flush()
        return float(self._answer().split()[cpu]) / steps

    def close(self) -> None:
        self._process.communicate()


def compare(python: Path, points: int, storage: str, threads: int, collision: str, rounds: int, cpu: bool) -> str:
    """One line: million node updates per second of each, ratios of ours to the better of lbmpy's patterns."""
    world, pool = World.alone(), Pool(threads)
    shape = (points,) * 3
    domain = Domain(tuple(map(float, shape)), shape, (True,) * 3, (0, points))
    fluid = Fluid(world, pool, domain, D3Q19, tau=0.8, collision=collision, storage=storage)
    fluid.set_equilibrium(1.0, np.array([0.01, 0.02, 0.03]))
    steps = 2 * fluid.depth
    clock = time.process_time if cpu else time.perf_counter

    def plain() -> None:
        for _ in range(steps):
            fluid.step()

    def timed(action) -> float:
        begin = clock()
        action()
        return (clock() - begin) / steps

    peer = Lbmpy(python, points, storage, threads, collision)
    samples = []
    for _ in range(rounds + 1):
        ours = [timed(plain), timed(lambda: fluid.advance(steps))]
        samples.append((*ours, min(peer.seconds(pattern, steps, cpu) for pattern in PATTERNS)))
    peer.close()
    pool.close()
    samples = samples[1:]
    speed = [1e-6 * points**3 * (threads if cpu else 1) / statistics.median(column) for column in zip(*samples)]
    ratios = [statistics.median(sample[2] / sample[k] for sample in samples) for k in range(2)]
    return (
        f"D3Q19 {points}^3 {collision} {storage} {threads} thread(s): lbmpy {speed[2]:.1f}, "
        f"ours {speed[0]:.1f} MLUPS = x {ratios[0]:.2f}, "
        f"{fluid.depth} steps per pass {speed[1]:.1f} = x {ratios[1]:.2f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=128)
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--storage", nargs="+", default=["double", "single"])
    parser.add_argument("--collision", nargs="+", default=["TRT"], choices=METHOD)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--cpu", action="store_true", help="count processor time")
    parser.add_argument("--environment", type=Path, default=Path.home() / ".cache" / "hpcpic" / "peers")
    options = parser.parse_args()
    python = environment(options.environment)
    for collision in options.collision:
        for storage in options.storage:
            for threads in options.threads:
                line = compare(python, options.points, storage, threads, collision, options.rounds, options.cpu)
                print(line, flush=True)


if __name__ == "__main__":
    main()
