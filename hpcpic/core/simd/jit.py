"""Compilation of kernels: `njit` with the flags of this package, cached in a private folder.

numba's own cache does not notice edits in another file and holds pickles, so the folder is named by a hash of
the kernel sources and versions, and is used only when nobody else can write to it.
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
from inspect import isfunction
from pathlib import Path
from typing import Any

import numba
from numba.core import event

from hpcpic.core.simd.caches import private_folder
from hpcpic.core.simd.registers import has_avx512

_ROOT = Path(__file__).resolve().parents[3]  # of the packages
_KERNEL_FOLDERS = {"simd", "space", "comm", "kernels"}
_FLAGS: dict[str, Any] = {"nogil": True, "cache": True, "error_model": "numpy"}
EVERY = "*"  # in place of a program: all there are
generated_in: set[Path] = set()  # folders of generated modules: their compiled code is kept beside them


class Compilations(event.Listener):
    """How many functions this process has compiled, that no cache had."""

    n = 0

    def on_start(self, _event: event.Event) -> None:
        self.n += 1

    def on_end(self, _event: event.Event) -> None:
        """Nothing to do."""


compilations = Compilations()
event.register("numba:compile", compilations)


def program_of(module: str) -> str | None:
    """The program a module belongs to: "hpcpic.plasma", "sph"; "" for the core, None for what is none of ours."""
    first, second, *_ = [*module.split("."), "core"]
    if first == "hpcpic":
        return "" if second == "core" else f"hpcpic.{second}"
    return first if (_ROOT / first / "kernels").is_dir() else None


def _kernel_sources(program: str) -> list[Path]:
    """Files whose edit may change compiled code of a program: the kernel folders and whatever compiles by itself, in
    the core and in the program.
    """
    folders = [_ROOT / "hpcpic" / "core"]
    if program == EVERY:
        folders += [found.parent for found in sorted([*_ROOT.glob("*/kernels"), *_ROOT.glob("hpcpic/*/kernels")])]
    elif program:
        folders.append(_ROOT.joinpath(*program.split(".")))
    files = [file for folder in folders for file in sorted(folder.rglob("*.py"))]
    return [file for file in files if file.parent.name in _KERNEL_FOLDERS or b"simd.jit" in file.read_bytes()]


def _fingerprint(program: str) -> str:
    from llvmlite import binding

    digest = hashlib.sha256()
    for file in _kernel_sources(program):
        digest.update(str(file.relative_to(_ROOT)).encode() + b"\0" + file.read_bytes() + b"\0")
    digest.update(repr([version(name) for name in ("numba", "llvmlite", "numpy")]).encode())
    digest.update(binding.get_host_cpu_name().encode() + binding.get_host_cpu_features().flatten().encode())
    settings = {key: value for key, value in os.environ.items() if key.startswith("NUMBA_")}
    settings.pop("NUMBA_CACHE_DIR", None)
    digest.update(repr([sorted(settings.items()), has_avx512()]).encode())
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
def cache_directory(program: str = "") -> Path:
    """Folder of compiled and generated code, `<cache root>/<user id>/<hash of sources, versions and processor>`.

    The sources are those of the core and of the program, so an edit in one program leaves the code of others alone.
    A folder that is a symbolic link, belongs to another user or can be written by others is not used: a warning, and a
    fresh private temporary folder for this process.
    """
    try:
        mine = private_folder()
        mine.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        _make_private(mine)
        folder = mine / _fingerprint(program)
        _make_private(folder)
    except OSError as error:
        folder = _temporary(str(error))
    return folder


@functools.cache
def _temporary(why: str) -> Path:
    """A folder that is removed at the end of this process; told once for each reason."""
    folder = Path(tempfile.mkdtemp(prefix="hpcpic-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    warnings.warn(f"compiled code is not kept: {why}; using {folder}", RuntimeWarning, stacklevel=3)
    return folder


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
    if signature_or_function and isfunction(signature_or_function[0]):
        return _cached(signature_or_function[0], (), flags)
    return lambda function: _cached(function, signature_or_function, flags)


def _cached(function: Callable, signature: tuple, flags: dict[str, Any]) -> Callable:
    before = numba.config.CACHE_DIR  # type: ignore[attr-defined]
    numba.config.CACHE_DIR = str(_folder_of(function))  # type: ignore[attr-defined]
    try:
        return numba.njit(*signature, **(_FLAGS | flags))(function)
    finally:
        numba.config.CACHE_DIR = before  # type: ignore[attr-defined]


def _folder_of(function: Callable) -> Path:
    folder = Path(function.__code__.co_filename).parent
    if folder in generated_in:
        return folder
    program = program_of(function.__module__)
    return cache_directory(EVERY if program is None else program)
