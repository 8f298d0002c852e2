"""Cases: what their files look like, those that are shipped, and the header at the top of each file.

A header is a block of comments `# what: ...`, `# source: ...`, `# expected: ...`, `# time: ...`; a comment
line that starts with more than one space goes on with the line before it.
"""

import difflib
import os
import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hpcpic.core.errors import ConfigError

SHARED = ("description", "simulation", "gauge", "output")
PROGRAMS = {  # the groups and settings outside of groups in a case of each program
    "hpcpic": {*SHARED, "units", "grid", "field", "constants", "species", "numerics", "histogram"},
    "sph": {*SHARED, "domain", "fluid", "eos", "numerics", "gravity", "body_force", "wall", "inlet", "outlet"},
    "lbmdem": {
        *SHARED, "domain", "fluid", "boundary", "obstacle", "grains", "contact", "coupling", "gravity", "shaking",
    },
}  # fmt: skip
ROOT = Path(__file__).resolve().parents[3]  # of the packages
SHIPPED = {"hpcpic": "hpcpic/plasma/shipped", "sph": "sph/shipped", "lbmdem": "lbmdem/shipped"}
GROUP = re.compile(rf"(?m)^\s*(@include\b|({'|'.join(sorted(set().union(*PROGRAMS.values())))})\s*[=:]\s*[{{(\[])")


def looks_like_case(text: str) -> bool:
    """True if a line begins as in a case; messages quote no other line, which may hold a secret."""
    return GROUP.search(text) is not None


def fit(data: Mapping[str, Any], keys: Iterable[str]) -> int:
    """Score of a case for a program: its outermost keys that are among these, less those that are not."""
    known = len(set(keys).intersection(data))
    return 2 * known - len(data)


def fits(data: Mapping[str, Any]) -> dict[str, int]:
    """`fit` of each program, and one more for the form in which it says what a fluid is."""
    fluid = data.get("fluid")
    form = "lbmdem" if isinstance(fluid, dict) else "sph" if isinstance(fluid, tuple) else ""
    return {program: fit(data, keys) + (program == form) for program, keys in PROGRAMS.items()}


@dataclass(frozen=True, slots=True)
class Header:
    what: str = ""
    source: str = ""
    expected: str = ""
    time: str = ""


def read_header(path: str | os.PathLike) -> Header:
    """The header of a case file; what the file does not say is empty."""
    parts: dict[str, str] = {}
    key = ""
    for line in Path(path).read_text(encoding="utf-8-sig", errors="replace").splitlines():
        started = re.fullmatch(r"# (what|source|expected|time): *(.*)", line)
        if started:
            key = started[1]
            parts[key] = started[2].strip()
        elif key and re.match(r"#  +\S", line):
            parts[key] += " " + line[1:].strip()
        else:
            break
    return Header(**parts)


def cases_in(folder: Path) -> dict[str, Path]:
    """Name and file of every case in a folder, by name."""
    return {path.stem: path for path in sorted(folder.glob("*.conf"))}


def shipped_with(program: str) -> dict[str, Path]:
    """Name and file of each case that comes with a program: package data, in a checkout a link into configs/."""
    return cases_in((ROOT / SHIPPED[program]).resolve())


def find_case(case: str, shipped: Mapping[str, Path]) -> Path:
    """The file of a case given by path or by the name of a shipped case. Raises ConfigError."""
    path = Path(case)
    if os.path.isfile(case):  # a name that is too long is none; Path would raise
        return path
    if case in shipped:
        return shipped[case]
    if os.path.isdir(case):
        hint = f"; its case is {path / 'config.conf'}" if (path / "config.conf").is_file() else ""
        raise ConfigError(f"{case}: a folder, not a case file{hint}")
    for program, folder in SHIPPED.items():
        if os.path.isfile(ROOT / folder / f"{case}.conf"):
            raise ConfigError(f"{case}: a shipped case of {program}; say `{program}` instead")
    near = difflib.get_close_matches(case, shipped, 1)
    hint = f"; did you mean {near[0]!r}?" if near else f"; shipped cases: {', '.join(shipped)}"
    raise ConfigError(f"{case}: no such file, and there is no shipped case of that name{hint}")


def stranger(keys: Collection[str], data: Mapping[str, Any], file: str) -> str:
    """A sentence on data of a file that are no case of the program with these keys; empty where they may be one."""
    if not data:
        return ""
    own = next((program for program, theirs in PROGRAMS.items() if theirs == set(keys)), "")
    found = fits(data)
    here, other = found.get(own, fit(data, keys)), max(found, key=lambda program: found[program])
    if found[other] > max(here, 0):
        return f"this is a case of {other}; run: {other} check {file}"
    if here == -len(data):
        return f"no case: it has none of the keys {', '.join(keys)}"
    return ""
