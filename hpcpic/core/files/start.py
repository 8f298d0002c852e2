"""Files that a setting names, known by what is in them; and the arrays of such a file with which a run starts."""

from __future__ import annotations

import io
import os
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import lru_cache
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from hpcpic.core.case.config import Path, Tree, dotted
from hpcpic.core.case.schema import REQUIRED, Fault, Section, matching, setting
from hpcpic.core.errors import ConfigError
from hpcpic.core.files.given import content_of, digest_of


class Start(Section):
    file: str = setting(REQUIRED, "arrays by name, as numpy.savez writes them, beside the case file")
    sha256: str = setting("", "digest of the file, by which another one is refused; by default that of the file")


def attach(tree: Tree, groups: tuple[str, ...]) -> list[Path]:
    """Make the `file` of these groups relative to the file that names it, known by what is in it, and kept with a run.

    Returns the paths of the groups.
    """
    paths = matching(tree.data, groups)
    for path in paths:
        group = _inside(tree, path)
        if not isinstance(group.get("file"), str):
            continue
        folder = os.path.dirname(os.path.abspath(tree.where((*path, "file")).file))
        group["file"] = os.path.normpath(os.path.join(folder, group["file"]))
        with suppress(OSError, ValueError):  # told when it is read
            digest = digest_of(group["file"])
            tree.attached.append(group["file"])
            if group.setdefault("sha256", digest) != digest:
                told = f"not the file of this case: its SHA-256 is {digest}"
                tree.faults.append(f"{tree.where((*path, 'file'))}: {dotted((*path, 'file'))}: {told}")
    return paths


def attach_arrays(tree: Tree, groups: tuple[str, ...]) -> list[Path]:
    """`attach` where the files hold arrays. Raises ConfigError with the place of each that does not: all that follows
    reads them.
    """
    paths, wrong = attach(tree, groups), []
    for path in paths:
        try:
            attached_arrays(tree, path)
        except ConfigError as error:
            wrong.append(f"{tree.where((*path, 'file'))}: {dotted((*path, 'file'))}: {error.message}")
    if wrong:
        raise ConfigError(wrong)
    return paths


def _inside(tree: Tree, path: Path) -> dict:
    found: dict = tree.data
    for key in path:
        found = found[key]  # type: ignore[index]
    return found


def attached_arrays(tree: Tree, path: Path) -> Mapping[str, NDArray]:
    """The arrays of the group at this path, nothing where its keys are wrong, as is told later. Raises ConfigError."""
    with suppress(ValidationError):
        return arrays(Start(**_inside(tree, path)))
    return {}


@lru_cache(maxsize=8)
def arrays(start: Start) -> Mapping[str, NDArray]:
    """The arrays of the file by name. Raises ConfigError."""
    try:
        with np.load(io.BytesIO(content_of(start.file)), allow_pickle=False) as found:
            return dict(found)
    except (OSError, ValueError, EOFError, AttributeError, zipfile.BadZipFile) as error:
        words = getattr(error, "strerror", None) or str(error) or "no .npz file"
        raise ConfigError(f"{start.file}: cannot be read as arrays ({words})") from None


def start_faults(
    start: Start,
    expected: Mapping[str, tuple[int | None, ...]],
    rows: int | None = None,
    held: Mapping[str, slice] = MappingProxyType({}),
) -> Iterator[Fault]:
    """The faults of the arrays. expected: name -> shape, None for a length that all arrays share: `rows` if given.

    held: components that vectors have in this box. These may be [n, 3] too, as vectors are read, and 0 in the others.
    """
    found = arrays(start)
    lengths = {len(values) for name, values in found.items() if values.ndim and None in expected.get(name, ())}
    for name, values in found.items():
        whole = name in held and values.ndim == 2 and values.shape[1] == 3
        shape = (None, 3) if whole else expected.get(name, ())
        if name not in expected:
            yield ("file",), f"holds an array {name!r}; there are {', '.join(expected)}"
        elif len(values.shape) != len(shape) or any(n not in (None, m) for n, m in zip(shape, values.shape)):
            wanted = ", ".join("n" if n is None else str(n) for n in expected[name])
            cure = "; array[:, None] has it" if expected[name] == (None, 1) and values.ndim == 1 else ""
            yield ("file",), f"{name} must have the shape [{wanted}] (got {list(values.shape)}){cure}"
        elif values.dtype.kind not in "fiu":
            yield ("file",), f"{name} must hold real numbers (got {values.dtype})"
        elif not np.isfinite(values).all():
            first = list(map(int, np.argwhere(~np.isfinite(values))[0]))
            yield ("file",), f"{name} must hold finite numbers (got {values[tuple(first)]} at {first})"
        elif whole and np.delete(values, held[name], axis=1).any():
            others = " and ".join(np.delete(list("xyz"), held[name]))
            yield ("file",), f"{name} must be 0 in {others} in this box"
    if len(lengths) > 1:
        yield ("file",), f"arrays of different lengths: {', '.join(map(str, sorted(lengths)))}"
    elif rows is not None and lengths - {rows}:
        yield ("file",), f"arrays of {lengths.pop()} rows for {rows} particles"
