"""Seconds from the command to the first step, for every shipped case: with an empty cache, and again with a warm one.

    python scripts/first_step.py [PROGRAM[/CASE] ...] [--ranks N] [--threads N]      all of them take half an hour

Each case runs as `PROGRAM run CASE` until its log tells of the first step, and is ended then. Processor seconds are
those of all its processes up to there, compiling helpers included: they count less when the machine is busy.
"""

import argparse
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

from hpcpic.core.files.provenance import cpu

COLD, WARM = 15.0, 1.5  # s, what is aimed at
BIN = Path(sys.executable).parent
TICK = os.sysconf("SC_CLK_TCK")


class First(NamedTuple):
    seconds: float
    processor: float


def processor_seconds(pid: int) -> float:
    """Of a process and of those that it started and that still run."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        children = [int(child) for task in Path(f"/proc/{pid}/task").iterdir()
                    for child in (task / "children").read_text().split()]  # fmt: skip
    except OSError:  # it has just ended
        return 0.0
    return sum(map(int, fields[11:15])) / TICK + sum(map(processor_seconds, children))


def first_step(program: str, case: str, folder: Path, ranks: int, threads: int | None) -> First:
    words = [str(BIN / "mpirun"), "-n", str(ranks)] if ranks > 1 else []
    words += [str(BIN / program), "run", case, "--output", str(folder / "run"), "--replace"]
    words += ["--threads", str(threads)] if threads else []
    environment = os.environ | {"HPCPIC_CACHE_DIR": str(folder / "cache")}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # users keep the bytecode of our modules
    running = subprocess.Popen(words, cwd=folder, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                               text=True)  # fmt: skip
    assert running.stderr is not None
    told = []
    for line in running.stderr:
        told.append(line)
        if found := re.search(r"the first step was done after ([\d.]+) s", line):
            first = First(float(found[1]), processor_seconds(running.pid))
            running.terminate()
            running.communicate()
            return first
    sys.exit(f"{program} {case} took no step:\n{''.join(told)}")


def wanted(names: list[str]) -> list[tuple[str, str]]:
    modules = {"hpcpic": "hpcpic", "sph": "sph", "lbmdem": "lbmdem"}
    cases = [(program, case) for program, name in modules.items() for case in import_module(name).cases()]
    return [one for one in cases if not names or one[0] in names or "/".join(one) in names]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("case", nargs="*", metavar="PROGRAM[/CASE]")
    parser.add_argument("--ranks", type=int, default=1)
    parser.add_argument("--threads", type=int, help="per rank [default: the cores shared]")
    given = parser.parse_args()
    print(f"{platform.node()}, {cpu()}, {len(os.sched_getaffinity(0))} cores, load {os.getloadavg()[0]:.1f}\n")
    print(f"| case | files kept | cold (aim {COLD:g} s) | warm (aim {WARM:g} s) | processor s, cold and warm |")
    print("| --- | --- | --- | --- | --- |")
    late = 0
    for program, case in wanted(given.case):
        folder = Path(tempfile.mkdtemp(prefix="first-step-"))
        try:
            cold, warm = (first_step(program, case, folder, given.ranks, given.threads) for _ in range(2))
            kept = sum(path.suffix in (".kernel", ".bin") for path in (folder / "cache").rglob("*"))
        finally:
            shutil.rmtree(folder, ignore_errors=True)
        late += cold.seconds > COLD or warm.seconds > WARM
        print(
            f"| {program} {case} | {kept} | {cold.seconds:.1f} | {warm.seconds:.1f} "
            f"| {cold.processor:.1f}, {warm.processor:.1f} |",
            flush=True,
        )
    print(f"\n{late} later than aimed at")


if __name__ == "__main__":
    main()
