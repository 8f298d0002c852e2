#!/usr/bin/env python3
"""Run the shipped cases, draw one small picture of each, and write the page that shows them.

python scripts/gallery.py              every case in full: docs/gallery/*.png and configs/README.md
python scripts/gallery.py CASE ...     only these pictures; the page is written all the same
python scripts/gallery.py --quick      every case shortened to 20 steps, into a temporary folder: does it work?
"""

from __future__ import annotations

import argparse
import io
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

from hpcpic.core.cli.figures import NoData
from hpcpic.core.files.cases import cases_in, read_header
from hpcpic.core.files.reader import open_run
from hpcpic.plasma.plots import PLOTS

ROOT = Path(__file__).resolve().parent.parent
CASES, PICTURES, PAGE = ROOT / "configs/plasma", ROOT / "docs/gallery", ROOT / "configs/README.md"
DOTS_PER_INCH = 84
COLOURS = 96  # of a picture: keeps it near 20 kB
FIGURES = {  # what shows a case best
    "bump-on-tail": "phase-space",
    "cyclotron": "orbits",
    "exb-drift": "orbits",
    "landau-damping": "modes",
    "magnetised-thermal-2d": "fields",
    "plasma-oscillation": "modes",
    "thesis-1024-on-512": "timers",
    "thesis-10240-on-64": "timers",
    "two-particles": "orbits",
    "two-stream-cold": "modes",
    "two-stream-warm": "phase-space",
    "upper-hybrid": "modes",
}
EXTRA = {  # settings for the picture: snapshots that the case does not ask for
    "bump-on-tail": ("output.sampling_period.particle=1000",),
    "two-particles": ("output.sampling_period.particle=4", "simulation.cycles=628"),
    "magnetised-thermal-2d": ("output.sampling_period.field=500",),
}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", metavar="CASE")
    parser.add_argument("--quick", action="store_true", help="shortened runs; nothing is kept")
    asked = parser.parse_args()
    shipped = cases_in(CASES)
    with tempfile.TemporaryDirectory() as scratch:
        pictures = Path(scratch) / "pictures" if asked.quick else PICTURES
        pictures.mkdir(parents=True, exist_ok=True)
        for name in asked.cases or shipped:
            sets = ("simulation.cycles=20",) if asked.quick else EXTRA.get(name, ())
            folder = Path(scratch) / name
            run_case(name, folder, sets)
            print(draw(folder, pictures / f"{name}.png", FIGURES.get(name, "energies")), flush=True)
    if not asked.quick:
        PAGE.write_text(page(), encoding="utf-8")
        print(PAGE)
    return 0


def run_case(name: str, folder: Path, sets: tuple[str, ...]) -> None:
    """Raises CalledProcessError with the output of the run on the screen."""
    words = [sys.executable, "-m", "hpcpic", "run", str(CASES / f"{name}.conf"), "-o", str(folder), "--quiet"]
    done = subprocess.run(
        [*words, *(word for s in sets for word in ("--set", s))], capture_output=True, text=True, cwd=ROOT
    )
    if done.returncode:
        print(done.stdout, done.stderr, sep="\n", file=sys.stderr)
        done.check_returncode()


def draw(folder: Path, path: Path, name: str) -> str:
    """One picture in few colours; the energies when the run is too short for the one asked for."""
    run = open_run(folder)
    try:
        figure = PLOTS[name].make(run, None)
    except NoData as error:
        print(f"{folder.name}: {name} {error}; drawing the energies", file=sys.stderr)
        figure = PLOTS["energies"].make(run, None)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DOTS_PER_INCH, facecolor="white")
    picture = Image.open(buffer).convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
    picture.save(path, optimize=True)
    return f"{path.name:<32}{path.stat().st_size / 1024:6.1f} KiB"


def page() -> str:
    """The gallery: for each case its picture, header and command."""
    lines = [
        "# Cases",
        "",
        "Each file runs as it is, by its name or by its path, and says at its top what must come out.",
        "The pictures and this page are made by `python scripts/gallery.py`.",
        "",
    ]
    for name, path in cases_in(CASES).items():
        header = read_header(path)
        lines += [f"## {name}", "", f"{header.what[:1].upper()}{header.what[1:]}.", ""]
        if (PICTURES / f"{name}.png").exists():
            lines += [f'<img src="../docs/gallery/{name}.png" alt="{name}" width="480">', ""]
        lines += [
            f"* Run: `hpcpic run {name}` ({header.time} on two cores), "
            f"then `hpcpic plot runs/{name} {FIGURES.get(name, 'energies')}`",
            f"* Source: {header.source}",
            f"* Expected: {header.expected}",
            f"* File: [plasma/{name}.conf](plasma/{name}.conf)",
            "",
        ]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
