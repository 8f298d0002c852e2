"""`--use FILE.py`: a Python file of the user, imported before a case is read, that registers a kernel, a loader, a
scalar, a field, a wall rule or an acceleration of its own.

Only the command line names such a file, never a case, which may come from somebody else. A run keeps the file in given/
and restarts, figures and reports import that copy; compiled kernels know it by a hash of its text (core.simd.generate).
"""

from __future__ import annotations

import hashlib
import os
import sys
import traceback
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import click

from hpcpic.core.case.config import file_bytes
from hpcpic.core.errors import ConfigError
from hpcpic.core.simd import own


@dataclass(frozen=True, slots=True)
class UserFile:
    path: str
    text: str

    @property
    def digest(self) -> str:
        return hashlib.sha256(self.text.encode()).hexdigest()


used: dict[str, UserFile] = {}  # name -> what this process has imported, in that order


def use(path: str) -> None:
    """Import a file of the user. Raises ConfigError with its line where that fails."""
    try:
        text = file_bytes(os.path.realpath(path)).decode("utf-8-sig")
    except (OSError, ValueError) as error:
        raise ConfigError(f"--use {path}: cannot read: {getattr(error, 'strerror', None) or error}") from None
    import_text(Path(path).name, text, path)


def import_text(name: str, text: str, path: str) -> None:
    """Import the text of a file of the user, once in a process. Raises ConfigError."""
    from hpcpic.core.simd.generate import module_from_source

    if name in used:
        if used[name].text != text:
            raise ConfigError(f"{path}: {used[name].path} has the same name; give one of them another")
        return
    stem = f"use_{Path(name).stem}"
    try:
        module_from_source(text, stem)
    except (Exception, SystemExit) as error:
        raise ConfigError(f"{path}:{_line_of(error, stem)}: {type(error).__name__}: {error}") from error
    used[name] = UserFile(path, text)


def keep_own() -> list[str]:
    """Keep what a script has registered, as a run of it is to be restarted; what no restart can import is told."""
    told, script = [], os.path.realpath(getattr(sys.modules["__main__"], "__file__", None) or "")
    for path in sorted(own.files):
        text = file_bytes(path).decode("utf-8-sig")
        if path != script or "__main__" in text:
            used.setdefault(Path(path).name, UserFile(path, text))
        else:
            told.append(f'{path}: no restart can import it: put what runs under if __name__ == "__main__":')
    if own.typed:
        told.append(
            f"{', '.join(sorted(own.typed))}: stands in a notebook or at the prompt, where a run cannot keep it and no "
            "restart finds it: write it, and the call of register, into a file, and import that"
        )
    return told


def _line_of(error: BaseException, stem: str) -> int:
    """The line of the user's file at which an import of it has failed."""
    frames = [(frame.filename, frame.lineno) for frame in traceback.extract_tb(error.__traceback__)]
    if isinstance(error, SyntaxError):
        frames.append((str(error.filename), error.lineno))
    return next((line or 1 for file, line in reversed(frames) if file.startswith(f"<{stem}_")), 1)


def import_kept(facts: Mapping[str, object], given: Path) -> None:
    """Import what the run of these facts (run.json) has used, from its given/. Raises ConfigError: also where a file
    belongs to another user, whose code must not run as ours.
    """
    kept = facts.get("used", {})
    for name, digest in kept.items() if isinstance(kept, dict) else ():
        with suppress(OSError):  # `use` says what is missing
            if (given / name).stat().st_uid != os.geteuid():
                said = "belongs to another user, and would run as you; copy the folder of the run if you trust it"
                raise ConfigError(f"{given / name}: {said}")
        if name in used and used[name].digest != digest:
            raise ConfigError(
                f"{given / name}: the run was started with this file, and this process has imported {used[name].path}, "
                "which has its name and another text: open it in a process of its own"
            )
        use(str(given / name))
        if used[name].digest != digest:
            raise ConfigError(f"{given / name}: not the file that the run was started with")


def import_to_go_on(facts: Mapping[str, object], given: Path) -> None:
    """Import what a run has used, which must read the same numbers and arrays as it did. Raises ConfigError."""
    from hpcpic.core.simd import frozen

    import_kept(facts, given)
    values = facts.get("own_values", {})
    frozen.require_same(values if isinstance(values, dict) else {})


def kept_digests() -> dict[str, str]:
    """name -> SHA-256 of the files in use, as run.json has them."""
    return {name: file.digest for name, file in used.items()}


def texts() -> dict[str, str]:
    """name -> text of the files in use."""
    return {name: file.text for name, file in used.items()}


def words(folder: str | None = None) -> list[str]:
    """Words of a command that uses the same files: where they are, or the copies in a folder."""
    paths = [file.path if folder is None else f"{folder}/given/{name}" for name, file in used.items()]
    return [word for path in paths for word in ("--use", path)]


def _use_all(context: click.Context, option: click.Parameter, paths: tuple[str, ...]) -> None:
    for path in paths:
        use(path)


use_option = click.option(
    "--use",
    "paths",
    multiple=True,
    metavar="FILE.py",
    expose_value=False,
    callback=_use_all,
    help="Import a Python file first: a kernel, loader, scalar, field, wall rule or acceleration of your own. May be "
    "given several times.",
)
