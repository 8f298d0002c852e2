"""The programs that measure run to their end: at their smallest, for what they print, not for how fast it was."""

import re
import subprocess
import sys

import pytest
from app_runner import ROOT

pytestmark = pytest.mark.validation
PROGRAMS = {  # words -> rows of its table at the least
    "benchmarks/lbm.py --points 32 --rounds 1 --lattice D3Q19 D2Q9": 4,
    "benchmarks/links.py 48": 4,
    "benchmarks/pores.py 32": 5,
    "benchmarks/plasma.py 64 8 double 1": 1,
    "benchmarks/dem.py": 9,
    "benchmarks/sph_speed.py --particles 2e4 --rounds 1": 6,
    "benchmarks/transform.py 64": 1,
    "benchmarks/solvers.py 16 --figure {folder}/solvers.png": 1,
    "benchmarks/stencil.py": 4,
    "scripts/scene_costs.py": 30,
    "scripts/estimates.py hpcpic --cases two-stream-warm --rounds 1": 3,
    "scripts/scaling.py strong hpcpic plasma-oscillation --steps 10 --repeats 2 --out {folder}/strong": 3,
    "scripts/scaling.py weak sph hydrostatic --steps 10 --repeats 2 --out {folder}/weak": 3,
}


@pytest.mark.parametrize("words", PROGRAMS)
def test_a_program_that_measures_prints_its_table(words, tmp_path):
    command = [sys.executable, *words.format(folder=tmp_path).split()]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Traceback" not in done.stderr and not re.search(r"\b(nan|inf)\b", done.stdout), done.stdout + done.stderr
    rows = [line for line in done.stdout.splitlines() if re.search(r"\d", line)]
    assert len(rows) >= PROGRAMS[words], done.stdout
