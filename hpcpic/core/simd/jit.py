"""Compilation of kernels: `njit` with the flags of this package, cached in a private folder.

numba's own cache does not notice edits in another file and holds pickles, so the folder is named by a hash of
all kernel sources and versions, and is used only when nobody else can write to it.
"""

import atexit
import functools
import hashlib
import importlib
import os
import shutil
import stat
import sys
import tempfile
import warnings
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

_PACKAGE = Path(__file__).resolve().parents[2]
_KERNEL_FOLDERS = {"simd", "space", "comm", "kernels"}
_FLAGS: dict[str, Any] = {"nogil": True, "cache": True, "error_model": "numpy"}


def _kernel_sources() -> list[Path]:
    """Files whose edit may change compiled code: the kernel folders, whatever compiles by itself, and the kernels of
    packages beside this one.
    """
    files = sorted(_PACKAGE.rglob("*.py"))
    own = [file for file in files if file.parent.name in _KERNEL_FOLDERS or b"simd.jit" in file.read_bytes()]
    return own + sorted(_PACKAGE.parent.glob("*/kernels/*.py"))


def _fingerprint() -> str:
    from llvmlite import binding

    digest = hashlib.sha256()
    for file in _kernel_sources():
        digest.update(str(file.relative_to(_PACKAGE.parent)).encode() + b"\0" + file.read_bytes() + b"\0")
    digest.update(repr([version(name) for name in ("numba", "llvmlite", "numpy")]).encode())
    digest.update(binding.get_host_cpu_name().encode() + binding.get_host_cpu_features().flatten().encode())
    settings = {key: value for key, value in os.environ.items() if key.startswith("NUMBA_")}
    settings.pop("NUMBA_CACHE_DIR", None)
    digest.update(repr(sorted(settings.items())).encode())
    return digest.hexdigest()


def _make_private(folder: Path) -> None:
    """Create the folder with mode 0700; PermissionError when it is not ours alone to write."""
    folder.mkdir(mode=0o700, exist_ok=True)
    status = folder.lstat()
    if not stat.S_ISDIR(status.st_mode):
        raise PermissionError(f"{folder} is not a plain folder")
    if status.st_uid != os.getuid():
        raise PermissionError(f"{folder} belongs to another user")
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise PermissionError(f"{folder} can be written by others (mode {stat.S_IMODE(status.st_mode):o})")


@functools.cache
def cache_directory() -> Path:
    """Folder of compiled and generated code, `<root>/<user id>/<hash of sources, versions and processor>`.

    The root is $HPCPIC_CACHE_DIR, else $XDG_CACHE_HOME/hpcpic, else ~/.cache/hpcpic. A folder that is a
    symbolic link, belongs to another user or can be written by others is not used: one warning, and a fresh
    private temporary folder for this process.
    """
    caches = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    root = Path(os.environ.get("HPCPIC_CACHE_DIR") or caches / "hpcpic")
    try:
        root.mkdir(mode=0o700, parents=True, exist_ok=True)
        mine = root / str(os.getuid())
        _make_private(mine)
        folder = mine / _fingerprint()
        _make_private(folder)
    except OSError as error:
        folder = Path(tempfile.mkdtemp(prefix="hpcpic-"))
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        warnings.warn(f"compiled code is not kept: {error}; using {folder}", RuntimeWarning, stacklevel=2)
    return folder


os.environ["NUMBA_CACHE_DIR"] = str(cache_directory())

import numba  # noqa: E402  (reads NUMBA_CACHE_DIR when imported)

# when somebody imported numba before
numba.config.CACHE_DIR = os.environ["NUMBA_CACHE_DIR"]  # type: ignore[attr-defined]


def _import_without_blas() -> None:
    """Import what looks for a BLAS in scipy.linalg, which takes an eighth of a second, as if there were no scipy.

    No kernel here does linear algebra. For others in this process numba's still works; only its np.convolve and
    np.correlate take a loop where they could call BLAS.
    """
    if "scipy.linalg" in sys.modules:
        return
    sys.modules["scipy.linalg"] = None  # type: ignore[assignment]  # makes its import an ImportError
    try:
        importlib.import_module("numba.np.arraymath")
    finally:
        del sys.modules["scipy.linalg"]


_import_without_blas()


def njit(*signature_or_function: Any, **flags: Any) -> Callable:
    """`numba.njit` without the GIL, cached, IEEE division by zero, no fastmath; flags may be added."""
    return numba.njit(*signature_or_function, **(_FLAGS | flags))
