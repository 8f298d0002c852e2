"""What `estimate` says beside what runs need: seconds per step, and memory of a rank.

    python scripts/estimates.py [PROGRAM ...]

runs shipped cases of each kind, on a core, on two threads and on two ranks, once each for the kernels and once for the
figures. The rates are those of this machine if `PROGRAM bench` has measured them. With --phases, also what the estimate
of a step is made of, in ms.
"""

from __future__ import annotations

import argparse

from scaling import PROGRAMS, Point, ending, measure, parse_points, scene

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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("programs", nargs="*", metavar="PROGRAM", help=f"of {', '.join(PROGRAMS)}")
    parser.add_argument("--phases", action="store_true", help="list what the estimates are made of")
    parser.add_argument("--points", default="1x1,1x2,2x1", help="ranks x threads, comma separated")
    a = parser.parse_args()
    kept = rows = 0
    print("program case                        ranks threads   ms/step  estimate  off by       MiB  estimate  off by")
    for program in a.programs or PROGRAMS:
        for case, steps in CASES[program].items():
            app, config = scene(program, case, [])
            sets = ending(app, config, steps)
            for ranks, threads in parse_points(a.points):
                point = Point(ranks, threads, sets)
                for _ in range(2):
                    facts = measure(program, case, point)
                said = facts["estimate"]
                pairs = (
                    (1e3 * facts["step_seconds"]["median"], 1e3 * said["step_seconds"], TIME),
                    (facts["peak_memory_mib_per_rank"], said["memory_mib_per_rank"], MEMORY),
                )
                kept += sum(abs(expected / found - 1) <= most for found, expected, most in pairs)
                rows += len(pairs)
                figures = (f"{found:9.3f} {e:9.3f} {e / found - 1:+7.0%}" for found, e, _ in pairs)
                print(f"{program:7s} {case:30.30s} {ranks:2d} {threads:7d}", *figures, flush=True)
                if a.phases:
                    phases = app.estimate(config, ranks, threads, read_rates()).phases
                    print("       ", *(f"{name} {1e3 * seconds:.3f}" for name, seconds in phases.items() if seconds))
    print(f"{kept} of {rows} within {TIME:.0%} in time or {MEMORY:.0%} in memory")


if __name__ == "__main__":
    main()
