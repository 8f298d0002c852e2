"""Speed of the SPH engine: python benchmarks/sph_speed.py [--particles 300000] [--threads 2] [--steps 6] [--rounds 3]

Whole steps of a three-dimensional dam break with walls of particles, TVD-RK3 (three evaluations of all pair sums a
step, Wendland C2, Molteni's flux, artificial viscosity), in double and single precision, on one thread and on several,
interleaved; medians of rounds, and ratios of medians. `evaluations` are particles (walls included) times evaluations of
all pair sums per second; the split scheme, which evaluates momentum and continuity apart, is told in steps.
"""

import argparse
import os
import statistics
import sys
from time import perf_counter

from hpcpic.core.comm.world import World
from hpcpic.core.files.config import loads
from hpcpic.core.files.schema import validate
from hpcpic.core.tasks import Pool
from hpcpic.core.timers import Timers
from sph.config import SphConfig
from sph.step import Sph

CASE = """
simulation = {{ dimensions = 3; end_time = 1.0; integrator = "{integrator}"; cfl = {cfl}; }};
domain = {{ low = [0.0, 0.0, 0.0]; high = [1.6, 0.61, 0.75]; }};
gravity = [0.0, 0.0, -9.81];
fluid = ( {{ name = "water"; shape = {{ box = {{ low = [0.0, 0.0, 0.0]; high = [0.4, 0.61, 0.3]; }}; }}; }} );
numerics = {{ spacing = {spacing!r}; kernel = "wendland2"; density_flux = "molteni"; artificial_viscosity = 0.05;
             precision = "{precision}"; }};
wall = ( {{ name = "tank";
           shape = {{ box = {{ low = [0.0, 0.0, 0.0]; high = [1.6, 0.61, 0.75]; open = ["z+"]; }}; }}; }} );
"""
VOLUME = 0.4 * 0.61 * 0.3  # of the fluid, m3
OVERHEAD = ("sort", "ghosts", "migrate")
CFL = {"rk3-tvd": 0.6, "symplectic": 0.6}


def engine(integrator: str, precision: str, threads: int, particles: float) -> Sph:
    world = World.start()
    spacing = (VOLUME / (0.78 * particles)) ** (1 / 3)
    text = CASE.format(integrator=integrator, cfl=CFL[integrator], precision=precision, spacing=spacing)
    return Sph(validate(SphConfig, loads(text)), world, Pool(threads, world.cpus(threads)), Timers())


def seconds_per_step(sph: Sph, steps: int) -> float:
    begin = perf_counter()
    for _ in range(steps):
        sph.step()
    return (perf_counter() - begin) / steps


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--particles", type=float, default=3e5)
    parser.add_argument("--threads", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--steps", type=int, default=6)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    kinds = [
        (integrator, precision, threads)
        for integrator in CFL for precision in ("double", "single") for threads in sorted({1, options.threads})
    ]  # fmt: skip
    times: dict[tuple, list[float]] = {kind: [] for kind in kinds}
    shares: dict[tuple, float] = {}
    bodies = {}
    for k in range(options.rounds):
        for kind in kinds:
            sph = engine(*kind, options.particles)
            seconds_per_step(sph, 2)
            sph.timers.reset()
            times[kind].append(seconds_per_step(sph, options.steps))
            totals = sph.timers.totals()
            shares[kind] = sum(totals[name][0] for name in OVERHEAD) / (times[kind][-1] * options.steps)
            bodies[kind] = sph.bodies.n
            sph.close()
        sys.stderr.write(f"round {k + 1} of {options.rounds}\n")
    out = sys.stdout.write
    out(f"{'integrator':12} {'pairs':8} threads  particles  s/step  steps Mp/s  evaluations M/s  sort+halo\n")
    medians = {kind: statistics.median(found) for kind, found in times.items()}
    for kind, t in medians.items():
        integrator, precision, threads = kind
        rate = bodies[kind] / t / 1e6
        each = 3 * rate if integrator == "rk3-tvd" else rate
        out(f"{integrator:12} {precision:8} {threads:7d} {bodies[kind]:10d} {t:7.4f} {rate:11.2f} {each:16.2f}"
            f" {100 * shares[kind]:9.1f} %\n")  # fmt: skip
    for integrator in CFL:
        for threads in sorted({1, options.threads}):
            ratio = medians[integrator, "double", threads] / medians[integrator, "single", threads]
            out(f"{integrator}, {threads} threads: single is {ratio:.2f} times as fast as double\n")
        for precision in ("double", "single") if options.threads > 1 else ():
            ratio = medians[integrator, precision, 1] / medians[integrator, precision, options.threads]
            out(f"{integrator}, {precision}: {options.threads} threads are {ratio:.2f} times as fast as 1\n")


if __name__ == "__main__":
    main()
