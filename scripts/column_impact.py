#!/usr/bin/env python3
"""Force of the wave on the column in the cases of Silvester & Cleary 2006 beside the experiment: table and picture.

python scripts/column_impact.py SPACINGS FOLDER ...     run folders, as of `sph run column-impact-a -o FOLDER`

The names of the folders are the names in the table; those that differ by what follows a comma ("5 mm, seed 1") have
one colour. "5 mm" as SPACINGS writes docs/gallery/sph-column-impact-5-mm.png
and .md, which scripts/gallery.py puts on the page of the cases.
"""

from __future__ import annotations

import sys
from pathlib import Path

from gallery import PICTURES, save_small

from hpcpic.core.app.figures import COLOURS, columns_of, new_figure, style
from hpcpic.core.files.reader import open_run
from sph.analysis import experiments, theory
from sph.analysis.plots import DATA

TABLE = """The force on the column in the cases of Silvester & Cleary 2006 with particles of {spacings}, by
`python scripts/column_impact.py`; all by the clock of the experiment, {shift} s late. Peak and plateau are of the
force filtered over 13 ms, the impulse until 1.3 s.

![force on the column with particles of {spacings}]({picture})

| case | peak, N | arrival, s | plateau, N | impulse, N s |
| --- | --- | --- | --- | --- |
"""


def main() -> int:
    if len(sys.argv) < 3:
        print(__doc__, file=sys.stderr)
        return 2
    spacings, *folders = sys.argv[1:]
    runs = {Path(folder).name: columns_of(open_run(folder), "impulse_column_x") for folder in folders}
    picture = PICTURES / f"sph-column-impact-{spacings.replace(' ', '-')}.png"
    lines = [line("experiment", experiments.COLUMN_FIGURES)]
    lines += [line(name, experiments.column_figures(*samples)) for name, samples in runs.items()]
    text = TABLE.format(spacings=spacings, shift=experiments.COLUMN_SHIFT, picture=picture.name)
    text += "\n".join(lines) + "\n"
    print(text)
    picture.with_suffix(".md").write_text(text, encoding="utf-8")
    draw(runs, picture)
    return 0


def line(name: str, found: dict[str, float]) -> str:
    cells = (f"{found[key]:.{n}f}" for key, n in (("peak", 1), ("arrival", 3), ("plateau", 1), ("impulse", 2)))
    return f"| {name} | {' | '.join('-' if cell == 'nan' else cell for cell in cells)} |"


def draw(runs: dict, picture: Path) -> None:
    """Force and impulse over the experiment's clock."""
    with style():
        figure, (top, low) = new_figure(2, 1, (6.4, 6.0), sharex=True)
        kinds = [name.partition(",")[0] for name in runs]
        colours = dict(zip(dict.fromkeys(kinds), COLOURS))
        for n, (kind, (t, impulse)) in enumerate(zip(kinds, runs.values())):
            t = t + experiments.COLUMN_SHIFT
            middle, force = theory.mean_rate(t, impulse)
            look = {"label": kind if kind not in kinds[:n] else None, "color": colours[kind], "linewidth": 1.0}
            top.plot(middle, theory.triangular(middle, force), **look)
            low.plot(t, impulse, **look)
        last = max(t[-1] for t, _ in runs.values()) + experiments.COLUMN_SHIFT
        experiment = experiments.COLUMN_FORCE[experiments.COLUMN_FORCE[:, 0] < last]
        look = DATA | {"markersize": 2.8, "label": "experiment: Yeh & Petroff"}
        top.plot(*experiment.T, **look)
        low.plot(experiment[:, 0], theory.cumulative(*experiment.T), **look)
        top.set(ylabel="force along x, N", title="Force on the column, 13 ms filter", xlim=(0.25, None))
        top.set_ylim(bottom=-25)
        low.set(ylabel="impulse along x, N s", xlabel="time of the experiment, s", title="Impulse")
        top.legend(fontsize="small")
        save_small(figure, picture)


if __name__ == "__main__":
    sys.exit(main())
