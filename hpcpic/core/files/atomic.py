"""A file is replaced as a whole: at any time, kills included, all of the new one is there, or the old one is."""

import json
import math
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

from hpcpic.core.errors import FileError
from hpcpic.core.files.together import explain


def temporary(path: Path, pid: int | str | None = None) -> Path:
    """The name a file has while this process writes it."""
    return path.with_name(f".{path.name}.{pid or os.getpid()}.tmp")


def discard(path: Path) -> None:
    """Remove what was begun, if it is still there to be removed: an error of the removal is not reported."""
    with suppress(OSError):
        path.unlink()


def create_anew(path: Path) -> IO[bytes]:
    """A new file, whatever has stood there: a link put in the way is removed, not followed."""
    path.unlink(missing_ok=True)
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
    return os.fdopen(os.open(path, flags, 0o644), "wb")


def write_atomic(path: Path, content: str | bytes) -> None:
    """Replace a file: all of it is there, or the old one is. Raises FileError."""
    made = temporary(path)
    try:
        with create_anew(made) as file:
            file.write(content.encode() if isinstance(content, str) else content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(made, path)
        descriptor = os.open(path.parent, os.O_RDONLY | os.O_CLOEXEC)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
    except OSError as error:
        discard(made)
        raise FileError(f"cannot write {path}: {explain(error)}") from error


def write_json(path: Path, content: Any) -> None:
    """Replace a file as `write_atomic`; numbers that are not finite, which JSON does not know, become null."""
    write_atomic(path, json.dumps(_plain(content), indent=1, allow_nan=False) + "\n")


def _plain(value: Any) -> Any:
    """The value as JSON can hold it."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, str | bool | int) or value is None:
        return value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):  # numpy scalars and arrays
        return _plain(value.tolist())
    return str(value)
