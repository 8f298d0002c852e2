"""Weak scaling: a case that grows with the ranks x threads that run it, so that each core keeps the same work.

    python scripts/weak_scaling.py hpcpic magnetised-thermal-2d --points 1x1,2x1,1x2

The simulator says how its case grows along the slab axis (`hpcpic.plasma.app.grow`): twice the rows, twice the box
length, twice the particles. Efficiency is t(1x1) / t.
"""

from __future__ import annotations

import argparse
import importlib
from pathlib import Path

from scaling import Point, measure_all, parse_points, report, table

GROW = {"hpcpic": "hpcpic.plasma.app"}  # program -> module with grow(case, factor) -> list of key=value


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("app", choices=sorted(GROW))
    parser.add_argument("case", help="a path or a shipped case")
    parser.add_argument("--points", default="1x1,2x1,1x2", help="ranks x threads, comma separated; 1x1 first")
    parser.add_argument("--steps", type=int, default=100)
    parser.add_argument("--repeats", type=int, default=10, help="at most")
    parser.add_argument("--out", type=Path, help="default: benchmarks/weak-CASE")
    a = parser.parse_args()
    grow = importlib.import_module(GROW[a.app]).grow
    points = [
        Point(ranks, threads, tuple(grow(a.case, ranks * threads))) for ranks, threads in parse_points(a.points)
    ]
    measure_all(a.app, a.case, points, a.steps, a.repeats)
    rows = table(points, lambda p, first: first.median() / p.median())
    out = a.out or Path("benchmarks") / f"weak-{Path(a.case).stem}"
    report(f"weak scaling of {Path(a.case).stem}", rows, out)


if __name__ == "__main__":
    main()
