#!/usr/bin/env python3
"""The picture of speed against accuracy of one case per simulator: docs/gallery/front-PROGRAM.png.

python scripts/fronts.py [PROGRAM ...]
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from gallery import COLOURS, PICTURES
from PIL import Image

CASES = {  # program -> case, tolerance
    "hpcpic": ("two-stream-cold", "1%"),
    "sph": ("poiseuille", "1%"),
    "lbmdem": ("taylor-green", "1%"),
}
WIDTH = 840  # of a picture: keeps it small


def main() -> int:
    code = 0
    for program in sys.argv[1:] or CASES:
        case, tolerance = CASES[program]
        with tempfile.TemporaryDirectory() as folder:
            words = [sys.executable, "-P", "-m", program, "tradeoff", case, "--tolerance", tolerance, "-o", folder]
            code = max(code, subprocess.run(words).returncode)
            made = Path(folder) / "front.png"
            if made.exists():
                shrunk(made, PICTURES / f"front-{program}.png")
    return code


def shrunk(source: Path, target: Path) -> None:
    picture = Image.open(source).convert("RGB")
    height = round(picture.height * WIDTH / picture.width)
    picture = picture.resize((WIDTH, height), Image.Resampling.LANCZOS).quantize(COLOURS)
    part = target.with_suffix(".part.png")
    picture.save(part, optimize=True)
    shutil.move(part, target)


if __name__ == "__main__":
    raise SystemExit(main())
