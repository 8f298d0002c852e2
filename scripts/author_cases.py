#!/usr/bin/env python3
"""What `hpcpic check` says of every complete case file of the thesis author's program, or of any other folder.

python scripts/author_cases.py CHECKOUT [--refused]    CHECKOUT: a clone (heads of all branches are read) or a folder
Complete is a file with particles and a length of step; what several branches hold alike is read once. The clone is
that of github.com/rodarima/cpic; none of its files is kept here.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import chdir
from pathlib import Path

from hpcpic.core.case.config import load
from hpcpic.core.case.derived import enforce
from hpcpic.core.errors import ConfigError
from hpcpic.plasma.configure import configure
from hpcpic.plasma.forecast.derived import derived

CASE = re.compile(r"\.conf(\.\d+)?$")
TEMPLATE = re.compile(r"@[A-Z]+@")  # what his scripts fill in
HERE = r"(?m)^\s*{}\s*="


def main() -> int:
    checkout, brief = Path(sys.argv[1]).resolve(), "--refused" in sys.argv
    counts: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        seen: set[tuple[str, str]] = set()
        for root in branches(checkout, Path(folder)):
            for path in complete(root):
                name, text = str(path.relative_to(root)), path.read_text()
                if (name, text) in seen:
                    continue
                seen.add((name, text))
                verdict, reason = checked(root, path)
                counts[verdict] += 1
                if verdict != "accepted" or not brief:
                    print(f"{root.name:14} {name:52} {verdict:9} {reason}")
    print(", ".join(f"{n} {verdict}" for verdict, n in counts.items()))
    return 0


def branches(checkout: Path, folder: Path) -> Iterator[Path]:
    """A folder of each branch's case files, or the folder itself."""
    git = ["git", "-C", str(checkout)]
    asked = [*git, "for-each-ref", "--format=%(refname:short)", "refs/heads", "refs/remotes"]
    found = subprocess.run(asked, capture_output=True, text=True)
    if found.returncode or not found.stdout.strip():
        yield checkout
        return
    for branch in found.stdout.split():
        listed = subprocess.run([*git, "ls-tree", "-r", "--name-only", branch], capture_output=True, text=True)
        root = folder / branch.replace("/", "-")
        for name in filter(CASE.search, listed.stdout.splitlines()):
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            content = subprocess.run([*git, "show", f"{branch}:{name}"], capture_output=True, check=True)
            (root / name).write_bytes(content.stdout)
        if root.exists():
            yield root


def complete(root: Path) -> Iterator[Path]:
    """The case files that are neither templates nor parts of others."""
    for path in sorted(path for path in root.rglob("*") if CASE.search(path.name) and path.is_file()):
        text = path.read_text()
        case = re.search(HERE.format("(species|simulation|grid)"), text)
        if case and not TEMPLATE.search(text) and (path.name != "default.conf" or "species" in text):
            yield path


def checked(root: Path, path: Path) -> tuple[str, str]:
    """accepted or refused, and the first warning or all reasons; the working directory is that of the checkout."""
    name = os.path.relpath(path, root)
    try:
        with chdir(root):
            tree = load(name)
            config = configure(tree)
            enforce(derived(config), tree)
    except ConfigError as error:
        return "refused", " | ".join(error.messages)
    told = [warning for warning in tree.warnings if not warning.startswith("keys without meaning")]
    return "accepted", "; ".join(told)


if __name__ == "__main__":
    sys.exit(main())
