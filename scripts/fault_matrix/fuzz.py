"""`python -m fault_matrix.fuzz PROGRAM CASE SEED LINES FILES`: random changes of a case, read as `check` reads it.

LINES lines of the case go through the grammar, FILES whole cases through everything that `check` derives from them.
The last line printed is what came of it, as JSON; a traceback is a fault that was found.
"""

from __future__ import annotations

import json
import random
import resource
import sys
import time
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

from hpcpic.core.case.config import loads
from hpcpic.core.errors import ConfigError

ALPHABET = [*'{}()[]=;,:"\\#@+-.0123456789eExnL\n\t \x00\u202e', "@include", "true", "1e999", "0x", "nan", "'"]
MOST_CHANGES = 7


def changed(text: str, chance: random.Random) -> str:
    """With a few characters replaced, removed or put in."""
    for _ in range(chance.randint(1, MOST_CHANGES)):
        place = chance.randrange(len(text) + 1)
        text = text[:place] + chance.choice(ALPHABET) + text[place + chance.randrange(3) :]
    return text


def inputs(text: str, n_lines: int, n_files: int, seed: int) -> Iterator[tuple[str, bool]]:
    """(text, whether it is a whole case)"""
    chance = random.Random(seed)
    lines = [line for line in text.splitlines() if line.strip()]
    for _ in range(n_lines):
        yield changed(chance.choice(lines), chance), False
    for _ in range(n_files):
        yield changed(text, chance), True


def read(text: str, whole: bool, app: Any) -> bool:
    """Whether it is a case; False when it is refused. Everything else that is raised is a fault."""
    try:
        tree = loads(text)
        if whole:
            app.derived(app.configure(tree), 1)
    except ConfigError as error:
        str(error)
        return False
    return True


def fuzz(app: Any, source: Iterator[tuple[str, bool]], clock: Callable[[], float] = time.process_time) -> dict:
    """Counts, the most seconds that one input took, MiB that the peak of memory grew by."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    found = {"inputs": 0, "read": 0, "slowest": 0.0}
    for text, whole in source:
        begin = clock()
        try:
            found["read"] += read(text, whole, app)
        except Exception:
            print(repr(text), file=sys.stderr)
            raise
        found["slowest"] = max(found["slowest"], clock() - begin)
        found["inputs"] += 1
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    return found | {"mebibytes": grown / 1024}


def main() -> None:
    program, case = sys.argv[1], Path(sys.argv[2])
    seed, n_lines, n_files = map(int, sys.argv[3:])
    text, app = case.read_text(), import_module(f"{program}.__main__").load_app()
    read(text, True, app)  # what is imported late
    print(json.dumps(fuzz(app, inputs(text, n_lines, n_files, seed))))


if __name__ == "__main__":
    main()
