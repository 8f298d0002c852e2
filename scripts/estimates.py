"""What `estimate` says beside what runs need: seconds per step, and memory of a rank.

    python scripts/estimates.py [PROGRAM ...]

runs shipped cases of each kind, on a core, on two threads and on two ranks, once each for the kernels and then for the
figures: the median step of the run. Before each case `PROGRAM bench` measures the machine as it is then, on one rank
and on two; with --kept the rates are those that it found earlier. With --phases, also what the estimate of a step is
made of, in ms.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys

from scaling import PROGRAMS, Point, ending, measure, mpirun, parse_points, scene

from hpcpic.core.cli.rates import read_rates

CASES = {  # case -> steps
    "hpcpic": {
        "two-stream-warm": 300,
        "magnetised-thermal-2d": 60,
        "thesis-1024-on-512": 60,
        "benchmarks/thermal-256.conf": 20,
    },
    "sph": {"water-column": 300, "still-tank": 100, "poiseuille": 300, "column-impact-a": 40},
    "lbmdem": {
        "taylor-green": 3000,
        "sphere-array": 300,
        "permeability": 240,
        "settling-sphere": 60,
        "liquefaction": 100,
    },
}
TIME, MEMORY = 0.25, 0.10  # how far off an estimate may be


def bench(program: str) -> None:
    """The rates of the machine as it is now."""
    for ranks in (1, 2):
        words = [mpirun(), "-n", str(ranks), sys.executable, "-m", program, "bench"]
        subprocess.run(words, check=True, capture_output=True, env=dict(os.environ, OMP_NUM_THREADS="1"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("programs", nargs="*", metavar="PROGRAM", help=f"of {', '.join(PROGRAMS)}")
    parser.add_argument("--phases", action="store_true", help="list what the estimates are made of")
    parser.add_argument("--cases", help="only these, comma separated")
    parser.add_argument("--kept", action="store_true", help="do not measure the rates of the machine")
    parser.add_argument("--points", default="1x1,1x2,2x1", help="ranks x threads, comma separated")
    a = parser.parse_args()
    within, rows = [0, 0], 0
    print("program case                        ranks threads   ms/step  estimate  off by       MiB  estimate  off by")
    for program in a.programs or PROGRAMS:
        for case, steps in CASES[program].items():
            if a.cases and case not in a.cases.split(","):
                continue
            app, config = scene(program, case, [])
            sets = ending(app, config, steps)
            points = [Point(ranks, threads, sets) for ranks, threads in parse_points(a.points)]
            for point in points:
                measure(program, case, point)
            if not a.kept:
                bench(program)
            for point in points:
                ranks, threads, facts = point.ranks, point.threads, measure(program, case, point)
                said = facts["estimate"]
                pairs = (
                    (1e3 * facts["step_seconds"]["median"], 1e3 * said["step_seconds"], TIME),
                    (facts["peak_memory_mib_per_rank"], said["memory_mib_per_rank"], MEMORY),
                )
                within = [n + (abs(e / found - 1) <= most) for n, (found, e, most) in zip(within, pairs)]
                rows += 1
                figures = (f"{found:9.3f} {e:9.3f} {e / found - 1:+7.0%}" for found, e, _ in pairs)
                print(f"{program:7s} {case:30.30s} {ranks:2d} {threads:7d}", *figures, flush=True)
                if a.phases:
                    phases = app.estimate(config, ranks, threads, read_rates()).phases
                    print("       ", *(f"{name} {1e3 * seconds:.3f}" for name, seconds in phases.items() if seconds))
    print(f"of {rows}: {within[0]} within {TIME:.0%} in time, {within[1]} within {MEMORY:.0%} in memory")


if __name__ == "__main__":
    main()
