"""What `estimate` says beside what runs need: seconds per step, and memory of a rank.

    python scripts/estimates.py [PROGRAM ...]

runs shipped cases of each kind, on a core, on two threads and on two ranks, once each for the kernels and then in
rounds: `PROGRAM bench` on one rank and on two, all cases, and so on, with a bench at the end. The estimate of a round
has the means of the rates before and after it. Told are the medians of the rounds: of the median step of a run, of
the estimate, of how far it is off, and of how far it is off beside the common factor: what the machine was slower in
the runs of a round than in its benches, as the median of them all. With --phases, also what the estimate of the last
round is made of, in ms.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from statistics import median
from typing import Any

from scaling import MPIRUN, PROGRAMS, Point, ending, measure, parse_points, scene

from hpcpic.core.app.rates import read_rates

CASES = {  # case -> steps
    "hpcpic": {
        "two-stream-warm": 300,
        "magnetised-thermal-2d": 60,
        "thesis-1024-on-512": 60,
        "thesis-10240-on-64": 300,
        "benchmarks/thermal-256.conf": 20,
    },
    "sph": {
        "water-column": 300,
        "still-tank": 100,
        "poiseuille": 300,
        "column-impact-a": 40,
        "moored-buoy": 200,
        "carried-box": 200,
        "floating-box": 200,
    },
    "lbmdem": {
        "taylor-green": 3000,
        "sphere-array": 300,
        "permeability": 600,
        "settling-sphere": 60,
        "liquefaction": 100,
    },
}
TIME, MEMORY = 0.25, 0.10  # how far off an estimate may be


@dataclass
class Row:
    """A case at ranks x threads: what its runs took and what the estimates of the rounds say, in s and MiB."""

    app: Any
    case: str
    point: Point
    config: Any
    said: list[float] = field(default_factory=list)
    memory: tuple[float, float] = (0.0, 0.0)
    phases: Mapping[str, float] = field(default_factory=dict)

    def run(self, program: str) -> None:
        facts = measure(program, self.case, self.point)
        self.memory = facts["peak_memory_mib_per_rank"], facts["estimate"]["memory_mib_per_rank"]

    def estimate(self, rates: Mapping[str, float]) -> None:
        told = self.app.estimate(self.config, self.point.ranks, self.point.threads, rates)
        self.said.append(told.step_seconds)
        self.phases = told.phases

    @property
    def ratios(self) -> list[float]:
        return [said / found for said, found in zip(self.said, self.point.seconds)]


def bench(program: str) -> dict[str, float]:
    """The rates of the machine as it is now."""
    for ranks in (1, 2):
        words = [MPIRUN, "-n", str(ranks), sys.executable, "-P", "-m", program, "bench"]
        subprocess.run(words, check=True, capture_output=True, env=dict(os.environ, OMP_NUM_THREADS="1"))
    return read_rates()


def rows_of(program: str, cases: Collection[str], shapes: list[tuple[int, int]]) -> list[Row]:
    """Each has run once, and what it compiled is there."""
    rows = []
    for case, steps in CASES[program].items():
        if not cases or case in cases:
            app, config = scene(program, case, [])
            sets = ending(app, config, steps)
            config = scene(program, case, list(sets))[1]
            rows += [Row(app, case, Point(ranks, threads, sets), config) for ranks, threads in shapes]
    for row in rows:
        row.run(program)
        row.point.seconds.clear()
    return rows


def in_rounds(program: str, rows: list[Row], rounds: int) -> list[float]:
    """The common factor of each round: how much slower the machine was in its runs than in its benches."""
    bench(program)  # compiles
    factors, before = [], bench(program)
    for _ in range(rounds):
        for row in rows:
            row.run(program)
        after = bench(program)
        for row in rows:
            row.estimate({name: 0.5 * (before.get(name, rate) + rate) for name, rate in after.items()})
        factors.append(1 / median(row.ratios[-1] for row in rows))
        before = after
    return factors


def told(program: str, row: Row, factors: list[float]) -> tuple[float, ...]:
    """How far off the estimate is: in time, in time beside the common factor, in memory. Prints its line."""
    errors = (
        median(row.ratios) - 1, median(ratio * factor for ratio, factor in zip(row.ratios, factors)) - 1,
        row.memory[1] / row.memory[0] - 1,
    )  # fmt: skip
    times = f"{1e3 * row.point.median():9.3f} {1e3 * median(row.said):9.3f} {errors[0]:+7.0%} {errors[1]:+7.0%}"
    sizes = f"{row.memory[0]:9.3f} {row.memory[1]:9.3f} {errors[2]:+7.0%}"
    print(f"{program:7s} {row.case:30.30s} {row.point.ranks:2d} {row.point.threads:7d} {times} {sizes}", flush=True)
    return errors


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("programs", nargs="*", metavar="PROGRAM", help=f"of {', '.join(PROGRAMS)}")
    parser.add_argument("--phases", action="store_true", help="list what the estimates are made of")
    parser.add_argument("--cases", default="", help="only these, comma separated")
    parser.add_argument("--points", default="1x1,1x2,2x1", help="ranks x threads, comma separated")
    parser.add_argument("--rounds", type=int, default=3)
    a = parser.parse_args()
    known, asked = {case for program in CASES.values() for case in program}, set(filter(None, a.cases.split(",")))
    if not asked <= known:
        parser.error(f"no such case: {', '.join(sorted(asked - known))}; there are {', '.join(sorted(known))}")
    errors = []
    print("program case                        ranks threads   ms/step  estimate  off by  beside"
          "       MiB  estimate  off by")  # fmt: skip
    for program in a.programs or PROGRAMS:
        if rows := rows_of(program, asked, parse_points(a.points)):
            factors = in_rounds(program, rows, a.rounds)
            print(f"{program}: runs slower than benches by the common factors", *(f"{f:.2f}" for f in factors))
            for row in rows:
                errors.append(told(program, row, factors))
                if a.phases:
                    print("       ", *(f"{name} {1e3 * spent:.3f}" for name, spent in row.phases.items() if spent))
    within = [sum(abs(error[k]) <= most for error in errors) for k, most in enumerate((TIME, TIME, MEMORY))]
    print(
        f"of {len(errors)}: {within[0]} within {TIME:.0%} in time, {within[1]} beside the common factor, "
        f"{within[2]} within {MEMORY:.0%} in memory"
    )


if __name__ == "__main__":
    main()
