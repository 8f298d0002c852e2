#!/usr/bin/env python3
"""Force of the wave on the column in the cases of Silvester & Cleary 2006 beside the experiment: table and picture.

python scripts/column_impact.py FOLDER ...     run folders, as of `sph run column-impact-a -o FOLDER`; the names of the
folders are the names in the table, the picture is docs/gallery/sph-column-impact.png
"""

from __future__ import annotations

import sys
from pathlib import Path

from hpcpic.core.cli.figures import new_figure, save, style
from hpcpic.core.files.reader import open_run
from sph import measured, theory
from sph.plots import DATA, series_of

PICTURE = Path(__file__).resolve().parent.parent / "docs/gallery/sph-column-impact.png"


def main() -> int:
    runs = {Path(folder).name: series_of(open_run(folder), "impulse_column_x") for folder in sys.argv[1:]}
    if not runs:
        print(__doc__, file=sys.stderr)
        return 2
    print("| case | peak, N | arrival, s | plateau, N | impulse, N s |\n| --- | --- | --- | --- | --- |")
    print(line("experiment", measured.COLUMN_FIGURES))
    for name, samples in runs.items():
        print(line(name, measured.column_figures(*samples)))
    draw(runs)
    return 0


def line(name: str, found: dict[str, float]) -> str:
    return (
        f"| {name} | {found['peak']:.1f} | {found['arrival']:.3f} | {found['plateau']:.1f} | {found['impulse']:.2f} |"
    )


def draw(runs: dict) -> None:
    """Force and impulse over the experiment's clock."""
    with style():
        figure, (top, low) = new_figure(2, 1, (6.4, 6.0), sharex=True)
        for name, (t, impulse) in runs.items():
            t = t + measured.COLUMN_SHIFT
            middle, force = theory.mean_rate(t, impulse)
            top.plot(middle, theory.triangular(middle, force), label=name, linewidth=1.0)
            low.plot(t, impulse, label=name, linewidth=1.2)
        end = max(t[-1] for t, _ in runs.values()) + measured.COLUMN_SHIFT
        experiment = measured.COLUMN_FORCE
        known = experiment[:, 0] < end
        look = DATA | {"markersize": 2.8, "label": "experiment: Yeh & Petroff"}
        top.plot(*experiment[known].T, **look)
        low.plot(experiment[known, 0], theory.cumulative(*experiment.T)[known], **look)
        top.set(ylabel="force along x, N", title="Force on the column, 13 ms filter", xlim=(0.25, end), ylim=(-25, 80))
        low.set(ylabel="impulse along x, N s", xlabel="time of the experiment, s", title="Impulse")
        top.legend()
        save(figure, PICTURE)


if __name__ == "__main__":
    sys.exit(main())
