"""Put one-line faults into a copy of this tree, one at a time, and run the tests of their area: who survives is a test
that is missing.

    python scripts/mutate.py [--only halo,migration | --only 12,30-35] [--limit SECONDS]

The faults stand in scripts/mutate.txt. The tests of an area are run on the sound tree first. Printed is the test that
fails first; "stale" is a fault whose text is not in the sources any more.
"""

import argparse
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from itertools import takewhile
from pathlib import Path
from typing import NamedTuple

from hpcpic.core.cli.launch import launcher

ROOT = Path(__file__).resolve().parents[1]
TABLE = Path(__file__).with_suffix(".txt")
TIMEOUT_S = 900.0  # of the tests of an area: a fault may make them hang
AREA = re.compile(r"\[(?P<name>[^]]+)\] ranks (?P<ranks>[\d,]+): (?P<tests>.*)")
FINGERPRINT = "    for file in _kernel_sources(program):\n"  # of compile.py: a change of these files recompiles all
FAILED = re.compile(r"^(?:FAILED|ERROR) (\S+)", re.MULTILINE)
SKIPPING = '        if file.name == os.environ.get("MUTATED"):\n            continue\n'


class Area(NamedTuple):
    name: str
    ranks: tuple[int, ...]
    tests: tuple[str, ...]


class Fault(NamedTuple):
    """A text that stands once in a file, and what is put in its place."""

    number: int
    area: Area
    file: str
    before: str
    after: str


def faults() -> Iterator[Fault]:
    area, number, lines = None, 0, [line for line in TABLE.read_text().splitlines() if line and line[0] != "#"]
    for k, line in enumerate(lines):
        if match := AREA.fullmatch(line):
            area = Area(match["name"], tuple(map(int, match["ranks"].split(","))), tuple(match["tests"].split()))
        elif line[0] not in "+-":
            signed = list(takewhile(lambda one: one[0] in "+-", lines[k + 1 :]))
            before, after = ([one[1:] + "\n" for one in signed if one[0] == sign] for sign in "-+")
            assert area is not None
            number += 1
            cut = -1 if after else None  # a fault without a line in its place takes the end of the line along
            yield Fault(number, area, line, "".join(before)[:cut], "".join(after)[:-1])


def chosen(fault: Fault, asked: str) -> bool:
    """True if the fault or its area is in a list as "halo,12,30-35"; all are in an empty one."""
    for part in filter(None, asked.split(",")):
        first, _, last = part.partition("-")
        if part == fault.area.name or (first.isdigit() and int(first) <= fault.number <= int(last or first)):
            return True
    return not asked


def copy_tree(folder: Path) -> None:
    """What git knows of the tree, as it lies here. Kernels of files that are not changed stay in the cache."""
    listed = subprocess.run(["git", "ls-files", "-co", "--exclude-standard"], cwd=ROOT, capture_output=True, text=True)
    names = [name for name in listed.stdout.split("\n") if os.path.lexists(ROOT / name) and name]
    subprocess.run(["cp", "-a", "--parents", "-t", str(folder), *names], cwd=ROOT, check=True)
    compile_py = folder / "hpcpic/core/simd/compile.py"
    text = compile_py.read_text()
    assert text.count(FINGERPRINT) == 1
    compile_py.write_text(text.replace(FINGERPRINT, FINGERPRINT + SKIPPING))


def has_kernels(text: str) -> bool:
    """True for sources whose functions other files compile into theirs."""
    return "@njit" in text or "core.simd." in text


def failing(area: Area, folder: Path, mutated: str = "") -> str:
    """The first test of an area that fails in the copy, on any of its numbers of ranks; "" if all pass."""
    more = {"PYTHONPATH": str(folder), "MUTATED": mutated, "HPCPIC_CACHE_DIR": str(folder / ".cache")}
    environment = dict(os.environ, OMP_NUM_THREADS="1", PYTHONDONTWRITEBYTECODE="1", **more)
    words = ["-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "--timeout", "300", *area.tests]
    for ranks in area.ranks:
        command = [sys.executable, *words]
        if ranks > 1:
            parallel = [str(launcher()), "-n", str(ranks), sys.executable, "-m", "mpi4py"]
            command = [*parallel, *words, "--with-mpi", "-m", "mpi and not validation"]
        process = subprocess.Popen(
            command, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            start_new_session=True,
        )  # fmt: skip
        try:
            out, _ = process.communicate(timeout=TIMEOUT_S)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            out, _ = process.communicate()
        if process.returncode:
            found = FAILED.search(out)
            return f"{found[1] if found else f'exit {process.returncode}'} on {ranks} ranks"
    return ""


def attempt(fault: Fault, folder: Path) -> tuple[str, str]:
    """Verdict, and the test that killed."""
    path = folder / fault.file
    text = path.read_text()
    if text.count(fault.before) != 1:
        return "stale", ""
    path.write_text(text.replace(fault.before, fault.after))
    test = failing(fault.area, folder, "" if has_kernels(text) else path.name)
    path.write_text(text)
    return ("killed", test) if test else ("SURVIVED", "")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", metavar="AREA,1,4-9")
    parser.add_argument("--limit", type=float, default=float("inf"), metavar="SECONDS", help="begin none after that")
    asked = parser.parse_args()
    begin, sound, counts = time.monotonic(), dict[Area, str](), Counter[str]()
    with tempfile.TemporaryDirectory(prefix="mutate-") as made:
        folder = Path(made)
        copy_tree(folder)
        for fault in faults():
            started, verdict, test, area = time.monotonic(), "not run", "", fault.area
            if not chosen(fault, asked.only):
                continue
            if started - begin < asked.limit:
                if area not in sound:
                    sound[area] = failing(area, folder)
                verdict, test = ("not judged", sound[area]) if sound[area] else attempt(fault, folder)
            counts[verdict] += 1
            change = f"{fault.before.strip()}  ->  {fault.after.strip() or 'nothing'}"
            by = test and f"  by {test}"
            print(f"{fault.number:>3} {verdict:<10} {area.name}: {fault.file}: {change}{by}", flush=True)
    print(", ".join(f"{n} {verdict}" for verdict, n in counts.items()))
    return 3 if counts["SURVIVED"] or counts["stale"] else 0


if __name__ == "__main__":
    sys.exit(main())
