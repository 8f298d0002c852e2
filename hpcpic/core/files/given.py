"""The files that a run was given, as its folder keeps them: what a restart reads are these copies."""

import hashlib
import os
from pathlib import Path
from typing import Any

from hpcpic.core.case.config import Tree, file_bytes
from hpcpic.core.case.dump import dump
from hpcpic.core.case.texts import value_text

MOST = 256 << 20  # bytes of a file that a setting names


def content_of(path: str) -> bytes:
    """Bytes of a file that a setting names. OSError, or ValueError where it is no regular file or too large."""
    return file_bytes(os.path.realpath(path), MOST)


def digest_of(path: str) -> str:
    """SHA-256 of the content of a file. Raises as `content_of`."""
    return hashlib.sha256(content_of(path)).hexdigest()


def names_of(tree: Tree) -> dict[str, str]:
    """path -> name in given/ of the files that settings name: their own, unless another has taken it."""
    names: dict[str, str] = {}
    for path in dict.fromkeys(tree.attached):
        name = os.path.basename(path)
        names[path] = f"{len(names)}-{name}" if name in names.values() else name
    return names


def contents(tree: Tree) -> dict[str, str | bytes]:
    """name in given/ -> content: files of the case by their names relative to the main one's folder, where `_up` stands
    for a folder above, and those that settings name. Raises as `content_of`.
    """
    main = Path(tree.files[0][0]).resolve().parent
    names = (os.path.relpath(Path(name).resolve(), main) for name, _ in tree.files)
    parts = (("_up" if part == os.pardir else part for part in Path(name).parts) for name in names)
    texts = {str(Path(*those)): text for those, (_, text) in zip(parts, tree.files)}
    return texts | {name: content_of(path) for path, name in names_of(tree).items()}


def config_text(config: Any, tree: Tree) -> str:
    """config.conf of a new run: files that settings name are the copies in given/."""
    return located(dump(config), {path: f"given/{name}" for path, name in names_of(tree).items()})


def kept_text(config: Any, tree: Tree, folder: Path) -> str:
    """config.conf of a run that goes on in the folder, which may have been moved."""
    here = {path: os.path.relpath(path, folder.resolve()) for path in tree.attached}
    return located(dump(config), {path: name for path, name in here.items() if not name.startswith(os.pardir)})


def located(text: str, names: dict[str, str]) -> str:
    """The text of a case in which files are called by other names: path -> name."""
    for path, name in names.items():
        text = text.replace(f" = {value_text(path)};", f" = {value_text(name)};")
    return text
