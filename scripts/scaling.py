"""Scaling of a case of any simulator over ranks x threads: repeated until the mean is known, tabulated, drawn.

    python scripts/scaling.py strong hpcpic magnetised-thermal-2d --points 1x1,2x1,1x2
    python scripts/scaling.py weak sph hydrostatic --points 1x1,2x1,1x2

strong: the same case on more and more cores; efficiency is t(1x1) / (cores t). weak: a case that grows with the cores
that run it, and says itself how: plasma and lattice are made longer along the slab axis, with as many particles or
grains in a volume; SPH takes more particles for the same scene. Efficiency is the work (particles or nodes) per core
and second beside that of 1x1. Both tell how far the model of `estimate` is off.

What the machine itself allows is measured beside them: as many runs of 1x1 at once as a point has cores, which exchange
nothing. Cores share memory, caches and clock, and two that a cloud lends may be threads of one. A code gains no more,
but where its share of a scene fits into caches and the whole does not.

A point is repeated until the standard error of the mean step time is 1 % of the mean (the rule of the thesis,
`stop_SEM`) or the repeats are used up. The points of one table are interleaved, so that a slow minute of the machine
hits all of them. The first steps of each run (cold caches, first touch) are dropped by the run itself.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from hpcpic.core.app.read import read_case
from hpcpic.core.cli.launch import launcher
from hpcpic.core.errors import HpcpicError
from hpcpic.core.files.atomic import write_json

PROGRAMS = ("hpcpic", "sph", "lbmdem")
STANDARD_ERROR = 0.01
MPIRUN = launcher() or "mpirun"


@dataclass
class Point:
    """One ranks x threads setting and the step times [s] its repeats measured. copies: such runs at the same time."""

    ranks: int
    threads: int
    sets: tuple[str, ...]
    copies: int = 1
    estimate: float = float("nan")  # s per step, predicted before the runs
    seconds: list[float] = field(default_factory=list)
    items: int = 0  # particles or nodes

    @property
    def cores(self) -> int:
        return self.ranks * self.threads

    def median(self) -> float:
        return statistics.median(self.seconds)

    def half_interval(self) -> float:
        """Half the 95 % interval of the mean, Student's t."""
        n = len(self.seconds)
        if n < 2:
            return float("inf")
        from scipy.stats import t

        return float(t.ppf(0.975, n - 1)) * statistics.stdev(self.seconds) / n**0.5

    def settled(self) -> bool:
        n = len(self.seconds)
        return n >= 3 and statistics.stdev(self.seconds) / n**0.5 < STANDARD_ERROR * statistics.mean(self.seconds)


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("law", choices=("strong", "weak"))
    parser.add_argument("program", choices=PROGRAMS)
    parser.add_argument("case", help="a path or a shipped case")
    parser.add_argument("--points", default="1x1,2x1,1x2", help="ranks x threads, comma separated; 1x1 first")
    parser.add_argument("--steps", type=int, default=100, help="of each run, about")
    parser.add_argument("--repeats", type=int, default=10, help="at most")
    parser.add_argument("--set", action="append", default=[], dest="sets", metavar="key=value")
    parser.add_argument("--out", type=Path, help="without ending; default: benchmarks/strong-CASE or weak-CASE")
    return parser.parse_args()


def scene(program: str, case: str, sets: list[str]) -> tuple[Any, Any]:
    """The program and the case as it reads it."""
    app = import_module(f"{program}.__main__").load_app()
    try:
        return app, read_case(app, case, tuple(sets)).config
    except HpcpicError as error:
        sys.exit(str(error))


def ending(app: Any, config: Any, steps: int) -> tuple[str, ...]:
    """The --set list of a run of about so many steps."""
    return app.until(config, steps * app.time_step(config))


def measure(program: str, case: str, point: Point) -> dict[str, Any]:
    """Run the case once at this point, all copies at the same time, and append the mean of their median step times.

    Returns what run.json of the first says.
    """
    with tempfile.TemporaryDirectory(prefix="scaling-") as folder:
        outs = [Path(folder) / f"run-{copy}" for copy in range(point.copies)]
        sets = [argument for s in point.sets for argument in ("--set", s)]
        command = [MPIRUN, "-n", str(point.ranks), sys.executable, "-P", "-m", program, "run", case]
        command += ["--threads", str(point.threads), *sets]
        pipes = partial(subprocess.Popen, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        runs = [pipes([*command, "-o", str(out)], env=dict(os.environ, OMP_NUM_THREADS="1")) for out in outs]
        for run in runs:
            said, _ = run.communicate()
            if run.returncode != 0:
                sys.exit(f"{' '.join(command)}\nended with {run.returncode}\n{said[-4000:]}")
        summaries = [json.loads((out / "run.json").read_text()) for out in outs]
    point.seconds.append(statistics.mean(summary["step_seconds"]["median"] for summary in summaries))
    point.estimate = summaries[0]["estimate"]["step_seconds"]
    point.items = summaries[0]["work_items"]
    return summaries[0]


def measure_all(program: str, case: str, points: list[Point], repeats: int) -> None:
    """Interleave the points until each is settled or the repeats are used up."""
    for repeat in range(repeats):
        for point in points:
            if not point.settled():
                measure(program, case, point)
                at_once = f", {point.copies} runs at once" if point.copies > 1 else ""
                print(
                    f"  repeat {repeat + 1}: {point.ranks} ranks x {point.threads} threads{at_once}  "
                    f"{1e3 * point.seconds[-1]:.3f} ms per step",
                    flush=True,
                )


def table(points: list[Point], alone: dict[int, Point], weak: bool) -> list[dict]:
    """One row a point; efficiency is the work per core and second beside that of the first point, possible that of
    runs which exchange nothing, `alone` by how many there were at once.
    """

    def rate(p: Point) -> float:
        return (p.items if weak else 1) / (p.cores * p.median())

    def possible(cores: int) -> float:
        return points[0].median() / alone[cores].median() if cores in alone else 1.0

    return [
        {
            "ranks": p.ranks,
            "threads": p.threads,
            "step_ms": 1e3 * p.median(),
            "interval_ms": 1e3 * p.half_interval(),
            "repeats": len(p.seconds),
            "efficiency": rate(p) / rate(points[0]),
            "possible": possible(p.cores),
            "estimate_ms": 1e3 * p.estimate,
            "estimate_error": p.estimate / p.median() - 1,
        }
        for p in points
    ]


def report(title: str, rows: list[dict], out: Path) -> None:
    """Print the table and write it as JSON and as a picture beside each other."""
    print(f"\n{title}\nranks threads   ms per step   +- (95 %)   efficiency   possible   estimate ms   off by")
    for r in rows:
        print(
            f"{r['ranks']:5d} {r['threads']:7d} {r['step_ms']:13.3f} {r['interval_ms']:12.3f} {r['efficiency']:11.1%}"
            f" {r['possible']:10.1%} {r['estimate_ms']:13.3f} {r['estimate_error']:+8.1%}"
        )
    out.parent.mkdir(parents=True, exist_ok=True)
    write_json(out.with_suffix(".json"), {"title": title, "rows": rows})
    draw(title, rows, out.with_suffix(".png"))
    print(f"\nwritten: {out.with_suffix('.json')}  {out.with_suffix('.png')}")


def draw(title: str, rows: list[dict], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.ticker import MaxNLocator

    figure, axes = plt.subplots(figsize=(6, 3.6), layout="constrained")
    for kind, marker, keep in (
        ("MPI ranks, one thread each", "o-", lambda r: r["threads"] == 1),
        ("one rank, threads", "s--", lambda r: r["ranks"] == 1),
        ("ranks x threads", "^", lambda r: r["ranks"] > 1 and r["threads"] > 1),
    ):
        chosen = [r for r in rows if keep(r)]
        if chosen:
            cores = [r["ranks"] * r["threads"] for r in chosen]
            efficiency = [r["efficiency"] for r in chosen]
            spread = [e * r["interval_ms"] / r["step_ms"] for e, r in zip(efficiency, chosen)]
            axes.errorbar(cores, efficiency, spread, fmt=marker, capsize=3, label=kind)
    possible = sorted({(r["ranks"] * r["threads"], r["possible"]) for r in rows})
    axes.plot(*zip(*possible), color="0.5", linewidth=0.8, label="runs at once that exchange nothing")
    axes.set(xlabel="ranks x threads", ylabel="efficiency", ylim=(0, None), title=title)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend(frameon=False, fontsize=8)
    figure.savefig(path, dpi=120)


def parse_points(text: str) -> list[tuple[int, int]]:
    """'1x1,2x1,1x2' -> [(1, 1), (2, 1), (1, 2)]"""
    pairs = [part.split("x") for part in text.split(",")]
    return [(int(ranks), int(threads)) for ranks, threads in pairs]


def settings(a: argparse.Namespace, app: Any, config: Any, cores: int) -> tuple[str, ...]:
    """The --set list of a point. Exits when the case cannot grow."""
    try:
        grown = app.grow(config, cores) if a.law == "weak" else ()
    except ValueError as error:
        sys.exit(f"{a.case}: {error}")
    sets = (*a.sets, *grown)
    return (*sets, *ending(*scene(a.program, a.case, list(sets)), a.steps))


def main() -> None:
    a = arguments()
    app, config = scene(a.program, a.case, a.sets)
    shapes = parse_points(a.points)
    points = [Point(ranks, threads, settings(a, app, config, ranks * threads)) for ranks, threads in shapes]
    alone = {n: Point(1, 1, points[0].sets, copies=n) for n in sorted({p.cores for p in points} - {1})}
    measure_all(a.program, a.case, [*points, *alone.values()], a.repeats)
    name = Path(a.case).stem
    rows = table(points, alone, a.law == "weak")
    report(f"{a.law} scaling of {name}", rows, a.out or Path(f"benchmarks/{a.law}-{name}"))


if __name__ == "__main__":
    main()
