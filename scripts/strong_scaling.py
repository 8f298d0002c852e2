"""Strong scaling: the same case on more and more ranks x threads.

    python scripts/strong_scaling.py hpcpic magnetised-thermal-2d --points 1x1,2x1,1x2

takes any case of any simulator (the program's name first) and prints milliseconds per step, the efficiency
t(1x1) / (cores t), and how far the model of `estimate` is off.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from scaling import Point, measure_all, parse_points, report, table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("app", help="hpcpic, sph or lbmdem")
    parser.add_argument("case", help="a path or a shipped case")
    parser.add_argument("--points", default="1x1,2x1,1x2", help="ranks x threads, comma separated; 1x1 first")
    parser.add_argument("--steps", type=int, default=100)
    parser.add_argument("--repeats", type=int, default=10, help="at most")
    parser.add_argument("--set", action="append", default=[], dest="sets", metavar="key=value")
    parser.add_argument("--out", type=Path, help="default: benchmarks/strong-CASE")
    a = parser.parse_args()
    points = [Point(ranks, threads, tuple(a.sets)) for ranks, threads in parse_points(a.points)]
    measure_all(a.app, a.case, points, a.steps, a.repeats)
    rows = table(points, lambda p, first: first.median() * first.cores / (p.cores * p.median()))
    out = a.out or Path("benchmarks") / f"strong-{Path(a.case).stem}"
    report(f"strong scaling of {Path(a.case).stem}", rows, out)


if __name__ == "__main__":
    main()
