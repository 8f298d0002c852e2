"""Where programs keep what they can make again: compiled kernels, measured rates."""

import errno
import os
from pathlib import Path


def cache_root() -> Path:
    """$HPCPIC_CACHE_DIR, else $XDG_CACHE_HOME/hpcpic, else ~/.cache/hpcpic. OSError for a user without a home."""
    asked = os.environ.get("HPCPIC_CACHE_DIR")
    caches = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    if not asked and caches.startswith("~"):  # it stays where there is no home
        raise FileNotFoundError(errno.ENOENT, "there is no home folder; set HPCPIC_CACHE_DIR", "~/.cache")
    return Path(asked or Path(caches) / "hpcpic")


def private_folder() -> Path:
    """The part of this user, which nobody else may write to; made by who uses it."""
    return cache_root() / str(os.getuid())
