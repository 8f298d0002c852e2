"""Strong scaling: the same case on more and more ranks x threads.

    python scripts/strong_scaling.py hpcpic magnetised-thermal-2d --points 1x1,2x1,1x2

takes any case of any simulator (the program's name first) and prints milliseconds per step, the efficiency
t(1x1) / (cores t), and how far the model of `estimate` is off.
"""

from __future__ import annotations

from pathlib import Path

from scaling import Point, arguments, ending, measure_all, parse_points, report, scene, table


def main() -> None:
    a = arguments(__doc__)
    sets = (*a.sets, *ending(*scene(a.program, a.case, a.sets), a.steps))
    points = [Point(ranks, threads, sets) for ranks, threads in parse_points(a.points)]
    measure_all(a.program, a.case, points, a.repeats)
    rows = table(points, lambda p, first: first.median() * first.cores / (p.cores * p.median()))
    out = a.out or Path("benchmarks") / f"strong-{Path(a.case).stem}"
    report(f"strong scaling of {Path(a.case).stem}", rows, out)


if __name__ == "__main__":
    main()
