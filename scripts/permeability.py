#!/usr/bin/env python3
"""Permeability of packed spheres against porosity beside Carman and Kozeny's, and its error with the spacing.

python scripts/permeability.py [FOLDER]    FOLDER keeps the runs, which are not made again
The picture is docs/gallery/lbmdem-carman-kozeny.png.
"""

from __future__ import annotations

import math
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from hpcpic.core.files.reader import open_run
from lbmdem.analysis.plots import carman_kozeny

ROOT = Path(__file__).resolve().parent.parent
PICTURE = ROOT / "docs/gallery/lbmdem-carman-kozeny.png"
POROSITIES = (0.39, 0.42, 0.46, 0.50, 0.55)  # rigid plates above and below leave no room for less
SPACINGS = (2.0e-5, 1.6e-5, 1.25e-5, 1.0e-5)  # m, of the study of resolution
SIDE, END, FREE = 8.0e-4, 0.002, 2.0e-4  # m: of the box across; s; m: of fluid below and above the sample
FINE, AT = 1.0e-5, 0.40  # spacing of the porosities, porosity of the spacings


def main() -> int:
    with tempfile.TemporaryDirectory() as folder:
        place = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(folder)
        porosity = np.array([measured(place, n, FINE) for n in POROSITIES])
        spacing = np.array([measured(place, AT, dx) for dx in SPACINGS])
    report(porosity, spacing)
    draw(porosity, spacing)
    return 0


def measured(place: Path, porosity: float, spacing: float) -> tuple[float, float, float, float]:
    """Porosity of the sample (of the spheres, in the space that the packing fills), k [m2], <d> [m] and
    <d3>/<d2> [m].
    """
    from lbmdem.grains.packing import beta_diameters

    d = beta_diameters(200, 1.0e-4, 2.0e-4, 1.0, 1.0, 1)
    solid = float((math.pi / 6.0 * d**3).sum()) / SIDE**2 / (1.0 - porosity)
    height = math.ceil((2.0 * FREE + solid) / spacing) * spacing
    end = END * (spacing / FINE) ** 2  # as many steps for all
    run = place / f"{porosity:.2f}-{spacing:.3g}"
    sets = {
        "grains[0].packing.porosity": porosity,
        "domain.spacing": spacing,
        "domain.size": f"[{SIDE!r}, {SIDE!r}, {height!r}]",
        "simulation.end_time": end,
        "output.period.fields": 0.0,
        "output.period.series": end / 40,
    }
    words = [word for key, value in sets.items() for word in ("--set", f"{key}={value}")]
    if not (run / "timers.csv").exists():
        command = [sys.executable, "-P", "-m", "lbmdem", "run", "permeability", "-o", str(run), "--quiet", "--replace"]
        command += words
        subprocess.run(command, check=True)
    series = open_run(run).series
    k = series["permeability"][len(series["permeability"]) // 2 :]  # about a mean, with the sound of the open ends
    assert k.std() < 0.1 * k.mean(), f"{run}: not steady"
    return porosity, float(k.mean()), float(d.mean()), float((d**3).sum() / (d**2).sum())


def extrapolated(dx: np.ndarray, k: np.ndarray) -> float:
    """k of no spacing: a line through k against dx2, by least squares over the three finest."""
    return float(np.polyfit(dx[-3:] ** 2, k[-3:], 1)[1])


def report(porosity: np.ndarray, spacing: np.ndarray) -> None:
    for n, k, mean, sauter in porosity:
        by_mean, by_sauter = k / mean**2 / carman_kozeny(n), k / sauter**2 / carman_kozeny(n)
        print(f"n {n:.2f}  k/<d>2 {k / mean**2:.4e}  over Carman-Kozeny {by_mean:.3f}, by <d3>/<d2> {by_sauter:.3f}")
    exact = extrapolated(np.array(SPACINGS), spacing[:, 1])
    for dx, (_, k, mean, _) in zip(SPACINGS, spacing, strict=True):
        print(f"<d>/dx {mean / dx:5.1f}  k {k:.4e} m2  error {k / exact - 1.0:+.2%}")


def draw(porosity: np.ndarray, spacing: np.ndarray) -> None:
    from hpcpic.core.app.figures import COLOURS, INK, new_figure, style

    n, k, mean, sauter = porosity.T
    line = np.linspace(0.33, 0.58, 60)
    with style():
        figure, (left, right) = new_figure(1, 2, (8.4, 3.6))
        left.plot(line, carman_kozeny(line), color=INK, linestyle="--", label="Carman-Kozeny")
        left.fill_between(line, 0.85 * carman_kozeny(line), 1.15 * carman_kozeny(line), color="#d5d8dc", label="15 %")
        left.plot(n, k / mean**2, "o", color=COLOURS[0], label="by <d>")
        left.plot(n, k / sauter**2, "s", color=COLOURS[1], label="by <d$^3$>/<d$^2$>")
        left.set(yscale="log", xlabel="porosity", ylabel="k / d$^2$", title="200 spheres, d$_{max}$ = 2 d$_{min}$")
        left.legend()
        dx, found = np.array(SPACINGS), spacing[:, 1]
        error = np.abs(found / extrapolated(dx, found) - 1.0)
        right.loglog(spacing[:, 2] / dx, 100.0 * error, "o-", color=COLOURS[0], label=f"porosity {AT:g}")
        right.loglog(spacing[:, 2] / dx, 100.0 * error[0] * (dx / dx[0]) ** 2, "--", color=INK, label="second order")
        for axis, ticks in ((right.xaxis, (7, 8, 10, 12, 14)), (right.yaxis, (3, 5, 10, 15))):
            axis.set_ticks(ticks, [f"{tick:g}" for tick in ticks])
            axis.set_ticks([], minor=True)
        right.set(xlabel="nodes across <d>", ylabel="error of k, %", title="Its own error")
        right.legend()
        figure.savefig(PICTURE, dpi=110, facecolor="white", transparent=False)


if __name__ == "__main__":
    raise SystemExit(main())
