#!/usr/bin/env python3
"""Run the shipped cases, draw one small picture of each, and write the page that shows them.

python scripts/gallery.py                   every case of up to ten minutes: docs/gallery/*.png and docs/cases.md
python scripts/gallery.py PROGRAM/CASE ...  only these pictures (sph/water-column); the page is written all the same
python scripts/gallery.py PROGRAM/CASE --run FOLDER    this picture of a run that is there
python scripts/gallery.py --page            only the page
"""

from __future__ import annotations

import argparse
import importlib
import io
import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image, ImageChops

from hpcpic.core.app.figures import NoData
from hpcpic.core.case.cases import cases_in, read_header
from hpcpic.core.files.reader import open_run

ROOT = Path(__file__).resolve().parent.parent
PICTURES, PAGE = ROOT / "docs/gallery", ROOT / "docs/cases.md"
DOTS_PER_INCH = 84
COLOURS = 256  # of a picture, where they do: the median cut spends them on the text
VISIBLE = 8  # levels of 255: a shift of a colour beyond this makes bands of a scale
LONG = 600.0  # seconds: longer cases are run only when they are named


@dataclass(frozen=True)
class Program:
    """One simulator: its cases, what shows each best, and settings for the picture that a case does not have."""

    name: str
    title: str
    folder: str
    plots: str
    otherwise: str
    figures: dict[str, str] = field(default_factory=dict)
    extra: dict[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def cases(self) -> dict[str, Path]:
        return cases_in(ROOT / "configs" / self.folder)

    def figure(self, case: str) -> str:
        return self.figures.get(case, self.otherwise)

    def picture(self, case: str) -> Path:
        return PICTURES / (f"{case}.png" if self.name == "hpcpic" else f"{self.name}-{case}.png")


PROGRAMS = (
    Program(
        "hpcpic", "Plasma", "plasma", "hpcpic.plasma.analysis.plots", "energies",
        {
            "bump-on-tail": "phase-space",
            "cyclotron": "orbits",
            "exb-drift": "orbits",
            "ion-acoustic": "modes",
            "landau-damping": "modes",
            "landau-damping-si": "modes",
            "magnetised-thermal-2d": "fields",
            "plasma-oscillation": "modes",
            "landau-damping-3d": "modes",
            "oscillation-3d": "fields",
            "thesis-1024-on-512": "timers",
            "thesis-10240-on-64": "timers",
            "two-particles": "orbits",
            "two-stream-cold": "modes",
            "two-stream-warm": "phase-space",
            "upper-hybrid": "modes",
        },
        {
            "bump-on-tail": ("output.sampling_period.particle=1000",),
            "two-particles": ("output.sampling_period.particle=4", "simulation.cycles=628"),
            "magnetised-thermal-2d": ("output.sampling_period.field=500",),
        },
    ),
    Program(
        "sph", "SPH", "sph", "sph.analysis.plots", "sequence",
        {
            "poiseuille": "profiles",
            "poiseuille-strain-rate": "profiles",
            "dam-break-sensor": "gauges",
            "hydrostatic": "depth",
            "hydrostatic-corrected": "depth",
            "still-tank": "depth",
            "dam-break-pressure": "gauges",
            "standing-wave": "gauges",
            "taylor-green": "energies",
            "two-layer-poiseuille": "profiles",
            "interfacial-wave": "gauges",
            "air-cushion": "gauges",
            "column-impact-a": "forces",
            "column-impact-b": "forces",
            "column-impact-c": "forces",
            "column-impact-printed": "forces",
        },
    ),
    Program(
        "lbmdem", "LBM-DEM", "lbmdem", "lbmdem.analysis.plots", "grains",
        {
            "poiseuille": "profile",
            "couette": "profile",
            "taylor-green": "energies",
            "sphere-array": "permeability",
            "segre-silberberg": "tracks",
            "permeability": "flow",
            "quick-condition": "stress",
            "settling-sphere": "tracks",
            "settling-disc": "tracks",
            "restitution": "tracks",
            "slide-to-roll": "rolling",
            "incline": "rolling",
        },
    ),
)  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", metavar="PROGRAM/CASE")
    parser.add_argument("--page", action="store_true", help="write the page of the pictures that are there")
    parser.add_argument("--run", type=Path, metavar="FOLDER", help="draw the one case named from this run")
    asked = parser.parse_args()
    if asked.run and len(asked.cases) != 1:
        parser.error("--run draws one case")
    PICTURES.mkdir(parents=True, exist_ok=True)
    for program in PROGRAMS if not asked.page else ():
        for case, path in program.cases.items():
            if f"{program.name}/{case}" in asked.cases or (not asked.cases and seconds(read_header(path).time) <= LONG):
                with tempfile.TemporaryDirectory() as scratch:
                    folder = asked.run or Path(scratch) / case
                    if not asked.run:
                        run_case(program, case, folder)
                    print(draw(program, case, folder), flush=True)
    PAGE.write_text(page(), encoding="utf-8")
    print(PAGE)
    return 0


def seconds(time: str) -> float:
    """The seconds that "20 s", "2 min" or "1 h" are."""
    number, unit = re.findall(r"([\d.]+) *(\w+)", time)[0]
    return float(number) * {"s": 1.0, "min": 60.0, "h": 3600.0}[unit]


def run_case(program: Program, case: str, folder: Path) -> None:
    """Raises CalledProcessError with the output of the run on the screen."""
    words = [sys.executable, "-P", "-m", program.name, "run", str(program.cases[case]), "-o", str(folder), "--quiet"]
    sets = (word for s in program.extra.get(case, ()) for word in ("--set", s))
    done = subprocess.run([*words, *sets], capture_output=True, text=True, cwd=ROOT)
    if done.returncode:
        print(done.stdout, done.stderr, sep="\n", file=sys.stderr)
        done.check_returncode()


def draw(program: Program, case: str, folder: Path) -> str:
    """One picture in few colours; the timers when the run has not what the one asked for shows."""
    plots, run, path = importlib.import_module(program.plots).PLOTS, open_run(folder), program.picture(case)
    try:
        figure = plots[program.figure(case)].make(run)
    except NoData as error:
        print(f"{case}: {program.figure(case)} {error}; drawing the timers", file=sys.stderr)
        figure = plots["timers"].make(run)
    save_small(figure, path)
    return f"{path.name:<40}{path.stat().st_size / 1024:6.1f} KiB"


def save_small(figure: Figure, path: Path) -> None:
    """A PNG in few colours, unless that would show."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DOTS_PER_INCH, facecolor="white")
    picture = Image.open(buffer).convert("RGB")
    few = picture.quantize(COLOURS, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    shift = np.asarray(ImageChops.difference(picture, few.convert("RGB"))).max()
    (picture if shift > VISIBLE else few).save(path, optimize=True)


def page() -> str:
    """The gallery: for each case its picture, header and command."""
    lines = [
        "# Cases",
        "",
        "Each file runs as it is, by its name or by its path, and says at its top what must come out.",
        "The pictures and this page are made by `python scripts/gallery.py`.",
        "",
    ]
    for program in PROGRAMS:
        lines += [f"## {program.title}: `{program.name}`", ""]
        for table in sorted(PICTURES.glob(f"{program.name}-*.md")):  # of scripts that compare cases
            lines += [table.read_text(encoding="utf-8").replace("](", "](gallery/")]
        for case, path in program.cases.items():
            lines += entry(program, case, path)
    return "\n".join(lines)


def entry(program: Program, case: str, path: Path) -> list[str]:
    header, picture, name = read_header(path), program.picture(case), program.name
    lines = [f"### {case}", "", f"{header.what[:1].upper()}{header.what[1:]}.", ""]
    if picture.exists():
        lines += [f"![{case}](gallery/{picture.name})", ""]
    then = f"then `{name} plot runs/{case} {program.figure(case)}`"
    return [
        *lines,
        f"* Run: `{name} run {case}` ({header.time} on two cores), {then}",
        f"* Source: {header.source}",
        f"* Expected: {header.expected}",
        f"* File: `configs/{program.folder}/{case}.conf`",
        "",
    ]


if __name__ == "__main__":
    sys.exit(main())
