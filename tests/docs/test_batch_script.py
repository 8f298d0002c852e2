"""The batch script of docs/start/cluster.md, with stand-ins for SLURM and for the program."""

import os
import subprocess
from pathlib import Path

SCRIPT = Path(__file__).resolve().parents[2] / "examples/slurm.sh"
STANDINS = {
    "srun": 'shift; exec "$@"',
    "sbatch": 'echo submitted "$@"',
    "sph": 'echo sph "$@"; [ -d runs/column/checkpoints ] && exit 0; mkdir -p runs/column/checkpoints; exit 5',
}


def test_a_job_that_stopped_early_submits_itself_and_the_next_one_goes_on(tmp_path):
    for name, text in STANDINS.items():
        (tmp_path / name).write_text(f"#!/bin/bash\n{text}\n")
        (tmp_path / name).chmod(0o755)
    (tmp_path / ".venv/bin").mkdir(parents=True)
    (tmp_path / ".venv/bin/activate").write_text("")
    env = {"PATH": f"{tmp_path}:{os.environ['PATH']}", "SLURM_CPUS_PER_TASK": "3"}
    words = ["bash", SCRIPT, "sph", "cases/column.conf"]
    first, second = (subprocess.run(words, cwd=tmp_path, env=env, capture_output=True, text=True) for _ in range(2))
    assert (first.returncode, second.returncode) == (5, 0), first.stderr + second.stderr
    assert first.stdout.splitlines() == [
        "sph run cases/column.conf --output runs/column --threads 3",
        "submitted examples/slurm.sh sph cases/column.conf",
    ]
    assert second.stdout == "sph restart runs/column --threads 3\n"
