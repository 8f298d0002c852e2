"""Weak scaling: a case that grows with the ranks x threads that run it, so that each core keeps about the same work.

    python scripts/weak_scaling.py hpcpic magnetised-thermal-2d --points 1x1,2x1,1x2

takes a case of any simulator, which says how its scene grows: plasma and lattice are made longer along the slab axis,
with as many particles or grains in a volume; SPH takes more particles for the same scene. Efficiency is the work
(particles or nodes) per core and second beside that of 1x1.
"""

from __future__ import annotations

import sys
from pathlib import Path

from scaling import Point, arguments, ending, measure_all, parse_points, report, scene, table


def main() -> None:
    a = arguments(__doc__)
    app, config = scene(a.program, a.case, a.sets)
    points = []
    for ranks, threads in parse_points(a.points):
        try:
            sets = (*a.sets, *app.grow(config, ranks * threads))
        except ValueError as error:
            sys.exit(f"{a.case}: {error}")
        larger = scene(a.program, a.case, list(sets))
        points.append(Point(ranks, threads, (*sets, *ending(*larger, a.steps))))
    measure_all(a.program, a.case, points, a.repeats)

    def efficiency(p: Point, first: Point) -> float:
        return (p.items / (p.cores * p.median())) / (first.items / (first.cores * first.median()))

    out = a.out or Path("benchmarks") / f"weak-{Path(a.case).stem}"
    report(f"weak scaling of {Path(a.case).stem}", table(points, efficiency), out)


if __name__ == "__main__":
    main()
