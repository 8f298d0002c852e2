"""Two checkouts in turns: what a step of a case takes in this one, over what it takes in another.

    git worktree add ../before COMMIT
    python scripts/turns.py ../before [--rounds 5] [--ranks 1] [--threads 1] hpcpic magnetised-thermal-2d

Each round runs the case in the other checkout and in this one, the order turning round, after one run of each that
compiles. A step's time is the median of a run (`step_ms` of run.json), so that compiling and output do not count.
Prints the ratio of the least times, the median of the rounds' ratios with the least and the most, and whether the
digests are equal.
"""

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def run(tree: Path, ranks: int, threads: int, program: str, rest: list[str]) -> tuple[float, str]:
    """Milliseconds of a step, and the digest."""
    with tempfile.TemporaryDirectory() as folder:
        launcher = ["mpirun", "-n", str(ranks)] if ranks > 1 else []
        to = ["--threads", str(threads), "--output", str(Path(folder, "run"))]
        subprocess.run(
            [*launcher, sys.executable, "-m", program, "run", *rest, *to], cwd=tree, check=True, capture_output=True
        )
        told = json.loads(Path(folder, "run", "run.json").read_text())
    return told["step_ms"], told["state_digest"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("other", type=Path, help="folder of the other checkout")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--ranks", type=int, default=1)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("program", choices=("hpcpic", "sph", "lbmdem"))
    parser.add_argument("rest", nargs=argparse.REMAINDER, help="what follows `PROGRAM run`")
    options = parser.parse_args()
    trees = [options.other.resolve(), ROOT]
    how = options.ranks, options.threads, options.program, options.rest
    digests = [run(tree, *how)[1] for tree in trees]
    times: list[list[float]] = [[], []]
    for k in range(options.rounds):
        for one in (0, 1) if k % 2 else (1, 0):
            times[one].append(run(trees[one], *how)[0])
    ratios = sorted(new / old for old, new in zip(*times))
    least = [min(one) for one in times]
    print(
        f"{options.program} {' '.join(options.rest)}, {options.ranks} x {options.threads}: "
        f"{least[0]:.3f} -> {least[1]:.3f} ms a step (least), {least[1] / least[0]:.2f}; of rounds "
        f"{statistics.median(ratios):.2f} ({ratios[0]:.2f} - {ratios[-1]:.2f}); "
        f"digests {'equal' if digests[0] == digests[1] else 'differ'}"
    )


if __name__ == "__main__":
    main()
