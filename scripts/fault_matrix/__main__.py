"""`scripts/faults`: try every fault of the matrix on a program and print what came of it."""

from __future__ import annotations

import argparse
import json
import logging
import sys
import tempfile
import time
import traceback
from pathlib import Path

from fault_matrix import caches, checkpoints, inputs, processes, states, surroundings  # noqa: F401  (their rows enter)
from fault_matrix.bench import HERE, Bench, Skipped, Wrong
from fault_matrix.checkpoints import alone
from fault_matrix.rows import ROWS, Row

SETTINGS = {  # of the cases here: beyond the scheme's stability; fewer particles than ranks; fewer rows than ranks
    "hpcpic": (
        ("simulation.time_step=2.5", "species[0].drift_velocity=[0.0, 0.0]"),
        ("species[0].particles=1", "species[1].particles=1"),
        ("grid.points=[37, 4]",),
    ),
    "sph": (("simulation.cfl=3.0",), ("numerics.spacing=0.0365",), ("numerics.spacing=0.0365",)),
    "lbmdem": (
        ("fluid.relaxation_time=0.9", "gravity=[0.0, -981.0]"),
        (),
        (
            "domain.size=[0.06, 0.03]", "domain.spacing=6.0e-3", "fluid.relaxation_time=0.5012",
            "grains[0].diameter=1.5e-2", "grains[1].diameter=1.5e-2",
            "grains[0].position=[0.012, 0.015]", "grains[1].position=[0.045, 0.015]",
        ),
    ),
}  # fmt: skip


def numbers(text: str) -> list[int]:
    """1,4,20-26"""
    found: list[int] = []
    for part in text.split(","):
        first, _, last = part.partition("-")
        found += range(int(first), int(last or first) + 1)
    return found


def attempt(row: Row, bench: Bench) -> tuple[str, str]:
    """Verdict and what was got."""
    bench.folder = bench.work / f"row-{row.number}"
    bench.folder.mkdir()
    try:
        return "good", row.attempt(bench)
    except Wrong as wrong:
        return "FAILED", str(wrong)
    except Skipped as skipped:
        return "skipped", str(skipped)
    except Exception:
        return "FAILED", traceback.format_exc(limit=-3)


def main() -> int:
    parser = argparse.ArgumentParser(prog="scripts/faults", description=__doc__)
    parser.add_argument("program", nargs="?", default="hpcpic", choices=SETTINGS, help="[default: hpcpic]")
    parser.add_argument("--only", type=numbers, default=sorted(ROWS), metavar="1,4,20-26")
    parser.add_argument("--flips", type=int, metavar="N", help="instead: N flipped bits, each followed for 500 steps")
    parser.add_argument("--kills", type=int, metavar="N", help="instead: kill -9 at N moments of writing")
    asked = parser.parse_args()
    logging.getLogger("hpcpic").setLevel(logging.ERROR)
    begin, failed = time.monotonic(), []
    with tempfile.TemporaryDirectory(prefix="faults-") as work:
        bench = Bench(asked.program, HERE / f"{asked.program}.conf", *SETTINGS[asked.program], Path(work))
        bench.digest()
        for what, n in (("campaign", asked.flips), ("kills", asked.kills)):
            if n:
                bench.folder = bench.work / what
                bench.folder.mkdir()
                print(json.dumps(alone(bench, what, n, timeout=24 * 3600.0), indent=1))
        chosen = [] if asked.flips or asked.kills else asked.only
        for number in chosen:
            row, start = ROWS[number], time.monotonic()
            verdict, got = attempt(row, bench)
            failed += [number] if verdict == "FAILED" else []
            print(f"{number:>3}  {verdict:<8}{row.fault}\n     expected  {row.expected}\n     got       {got}")
            print(f"     took      {time.monotonic() - start:.1f} s", flush=True)
    n = len(chosen)
    took = time.monotonic() - begin
    print(f"{n - len(failed)} of {n} rows good or skipped in {took:.0f} s; failed: {failed or 'none'}")
    return 3 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
