"""Compilation of kernels: `njit` with the flags of this package, kept in a private folder.

numba's own cache does not notice edits in another file, ends the program where it cannot write or finds a damaged file,
and unpickles whatever lies in its folder. Here the folder is named by a hash of the kernel sources, the versions and
the processor, and a file is unpickled when it is the one that was written, by this user (see caches.py).
"""

import functools
import gc
import hashlib
import importlib
import io
import linecache
import os
import pickle
import re
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from inspect import isfunction
from pathlib import Path
from typing import Any

import numba
from numba import types
from numba.core import event
from numba.core.caching import FunctionCache
from numba.core.compiler import CompileResult
from numba.core.environment import Environment
from numba.core.registry import cpu_target
from numba.core.runtime import rtsys
from numba.core.serialize import dumps
from numba.extending import register_jitable

from hpcpic.core.simd import frozen
from hpcpic.core.simd.caches import Store
from hpcpic.core.simd.resolution import remember

_ROOT = Path(__file__).resolve().parents[3]  # of the packages
_KERNEL_FOLDERS = {"simd", "space", "comm", "tasks", "physics", "kernels"}
_COMPILES = re.compile(rb"simd\.compile import (\([^)]*|.*)\bnjit\b")  # in a file that has kernels of its own
_FLAGS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
_BARE = "no_cpython_wrapper"  # the option of numba
PATIENCE_SECONDS = 60.0  # with another process that compiles what is needed here
NAP_SECONDS = 0.01
EVERY = "*"  # in place of a program: all there are
_own: dict[str, bytes] = {}  # module -> hash of a file of the user that it may call, and of what that reads
generated: dict[str, str] = {}  # names of generated modules -> the program they belong to


class Compilations(event.Listener):
    """Counts the functions that this process has compiled, as no cache had them: `n`."""

    n = 0

    def on_start(self, _event: event.Event) -> None:
        if not self.n:
            _import_without_blas()
            gc.freeze()  # collections while numba compiles need not look at what was imported: 4 % of the time
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
    """Files whose edit may change compiled code of a program: the kernel folders and files with kernels of their own,
    in the core and in the program.
    """
    folders = [_ROOT / "hpcpic" / "core"]
    if program == EVERY:
        folders += [found.parent for found in sorted([*_ROOT.glob("*/kernels"), *_ROOT.glob("hpcpic/*/kernels")])]
    elif program:
        folders.append(_ROOT.joinpath(*program.split(".")))
    files = [file for folder in folders for file in sorted(folder.rglob("*.py"))]
    return [
        file
        for file in files
        if _KERNEL_FOLDERS & {*file.relative_to(_ROOT).parts} or _COMPILES.search(file.read_bytes())
    ]


def _fingerprint(program: str) -> str:
    from llvmlite import binding

    digest = hashlib.sha256()
    for file in _kernel_sources(program):
        digest.update(str(file.relative_to(_ROOT)).encode() + b"\0" + file.read_bytes() + b"\0")
    digest.update(repr([version(name) for name in ("numba", "llvmlite", "numpy")]).encode())
    digest.update(str(sys.implementation.cache_tag).encode())  # what is kept holds Python's own bytecode
    digest.update(binding.get_host_cpu_name().encode() + binding.get_host_cpu_features().flatten().encode())
    settings = {key: value for key, value in os.environ.items() if key.startswith("NUMBA_")}
    settings.pop("NUMBA_CACHE_DIR", None)
    digest.update(repr(sorted(settings.items())).encode())
    return digest.hexdigest()


@functools.cache
def kernel_store(program: str = "") -> Store:
    """Compiled code, in `<cache root>/<user id>/<hash of sources, versions and processor>`.

    The sources are those of the core and of the program, so an edit in one program leaves the code of others alone.
    """
    return Store("compiled code", _fingerprint(program))


class Elsewhere(Exception):
    """A function is not kept, and it is not for this process to compile it now."""


class _Unpickler(pickle.Unpickler):
    """Reads what is kept, without the imports of modules of numba that only its object mode would look into."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) == ("numba.core.environment", "_rebuild_env"):
            return _environment
        return super().find_class(module, name)


def _environment(module: str, constants: list, name: str) -> Environment:
    """numba's `_rebuild_env`, with no globals: compiled code has those that it uses in it."""
    made = Environment._memo.get(name)
    if made is None:
        made = Environment._memo[name] = Environment({"__name__": module})
        made.consts[:] = constants
        made.env_name = name
    return made


class KernelCache(FunctionCache):
    """The cache of one function: numba's interface and key, and a file of our own for each signature.

    Of several processes one compiles a function, the others wait and load it. Who waits for a function is in the middle
    of its callers, never of what it calls, so that no two wait for each other.
    """

    patience = PATIENCE_SECONDS  # of the next look, see `compiled`

    def __init__(self, function: Callable, store: Store, text: bytes, options: Mapping[str, Any]) -> None:
        self._py_func = function
        self._options = options
        self._store = store
        code = function.__code__
        self._place = repr((function.__module__, function.__qualname__, code.co_filename, code.co_firstlineno)).encode()
        self._text = text
        self._claims: list[str] = []  # names of what is being compiled here

    @property
    def cache_path(self) -> str | None:
        return str(self._store.folder.path) if self._store.folder else None

    @property
    def keeps(self) -> bool:
        """Whether what is compiled can be kept, as far as is known."""
        return self._store.keeps

    def flush(self) -> None:
        """Nothing to do: files are named by all that the code depends on."""

    def _name(self, key: tuple) -> str:
        callable_from_python = repr(not self._options[_BARE]).encode()
        digest = hashlib.sha256(repr(key).encode() + self._place + self._text + callable_from_python)
        return f"{self._py_func.__name__}-{digest.hexdigest()[:32]}.kernel"

    def load_overload(self, sig: Any, target_context: Any) -> CompileResult | None:
        rtsys.initialize(target_context)  # numba's refresh would import all that it compiles with: a fifth of a start
        patience, self.patience = self.patience, PATIENCE_SECONDS
        key = self._index_key(sig, target_context.codegen())
        name, until = self._name(key), time.monotonic() + patience
        found = self._load(name, key, target_context)
        while found is None and patience >= 0:
            if self._store.claim(name):
                self._claims.append(name)
                return self._load(name, key, target_context)  # another process may just have ended
            if time.monotonic() >= until:
                break
            time.sleep(NAP_SECONDS)
            found = self._load(name, key, target_context)
        if found is None and patience <= 0:
            raise Elsewhere
        return found

    def kept(self, sig: Any) -> bool:
        """Whether there is a file of this signature, sound or not."""
        key = self._index_key(sig, cpu_target.target_context.codegen())
        return self._store.has(self._name(key))

    def _load(self, name: str, key: tuple, target_context: Any) -> CompileResult | None:
        content = self._store.read(name)
        if content is None:
            return None
        try:
            found, parts = _Unpickler(io.BytesIO(content)).load()
            return CompileResult._rebuild(target_context, *parts) if found == key else None
        except Exception as error:  # whatever unpickling raises
            self._store.damaged(repr(error))
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        if data.lifted or data.library.has_dynamic_globals:
            return  # holds addresses of this process
        key = self._index_key(sig, data.codegen)
        self._store.write(self._name(key), dumps((key, data._reduce())))

    @contextmanager
    def releasing(self) -> Iterator[None]:
        """Gives back what is claimed in the body."""
        before = len(self._claims)
        try:
            yield
        finally:
            while len(self._claims) > before:
                self._store.release(self._claims.pop())


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


remember()


def njit(function: Any = None, **flags: Any) -> Callable:
    """`numba.njit` without the GIL, cached, IEEE division by zero, no fastmath; flags may be added."""
    return _cached(function, flags) if function else lambda function: _cached(function, flags)


def compiled(kernel: Any, types: tuple, patience: float = PATIENCE_SECONDS, called: bool = False) -> bool:
    """Whether a kernel is ready for arguments of these types: it was, is kept, or is compiled here now.

    Where another process compiles it, the patience (s) is to wait for that; with a negative one nothing is compiled.
    called: from Python, which needs a wrapper.
    """
    if types in kernel.overloads:
        return True
    kept = isinstance(kernel._cache, KernelCache)
    if kept:
        kernel._cache.patience = patience
    elif patience < 0:
        return False
    bare, kernel.targetoptions[_BARE] = kernel.targetoptions[_BARE], not called
    try:
        kernel.compile(types)
    except Elsewhere:
        return False
    finally:
        kernel.targetoptions[_BARE] = bare
    return True


def formulas(*modules: Any) -> None:
    """Let kernels call the functions of modules of formulas (see formulas.py); LLVM puts them into their callers."""
    for module in modules:
        for function in vars(module).values():
            if isfunction(function) and function.__module__ == module.__name__:
                formula(function)


def depends_on(module: str, function: Callable) -> None:
    """Let kernels call a function of the user's own by way of a module's: who may do so is kept apart from others."""
    formula(function)
    text = _text_of(function.__code__.co_filename) or os.urandom(32)  # typed in: another one each time
    _own[module] = text + frozen.digest_of(function)


def _own_text(function: Callable) -> bytes:
    """Hash of a file of the user, of which a kernel may call a function: by way of what its module has imported."""
    module = function.__module__
    if _own and module not in _own:
        values = function.__globals__.values()
        imported = {getattr(value, "__module__", None) or getattr(value, "__name__", None) for value in values}
        if found := _own.keys() & imported:
            _own[module] = b"".join(_own[name] for name in sorted(found))
    return _own.get(module, b"")


@functools.cache
def formula(function: Callable) -> None:
    """Let kernels call a function of its own. Nothing but kernels calls what is compiled of it."""
    register_jitable(**_FLAGS, _nrt=False, forceinline=True, no_cpython_wrapper=True)(function)


def _cached(function: Callable, flags: dict[str, Any]) -> Callable:
    flags = _FLAGS | flags
    keep = flags.pop("cache", True)
    kernel = numba.njit(**flags)(function)
    if kernel is function:  # NUMBA_DISABLE_JIT
        return kernel
    kernel.targetoptions[_BARE] = True
    kernel.get_call_template = functools.partial(_call_template, kernel)
    kernel._compile_for_args = functools.partial(_compile_for_args, kernel)
    kernel.add_overload = functools.partial(_add_overload, kernel)
    text = _text_of(function.__code__.co_filename)
    if keep and text:
        text += _own_text(function)
        kernel._cache = KernelCache(function, _store_of(function), text, kernel.targetoptions)
        kernel.compile = functools.partial(_compile, kernel)
    return kernel


def _compile(kernel: Any, signature: Any) -> Any:
    """numba's, of what no other process compiles at the same time."""
    with kernel._cache.releasing():
        return type(kernel).compile(kernel, signature)


def _compile_for_args(kernel: Any, *arguments: Any) -> Any:
    """numba's, of a call from Python: it needs a wrapper, which kernels that tasks and other kernels call do without
    (a fifth of the time to compile them).
    """
    kernel.overloads.pop(tuple(map(kernel.typeof_pyval, arguments)), None)
    kernel.targetoptions[_BARE] = False
    try:
        return type(kernel)._compile_for_args(kernel, *arguments)
    finally:
        kernel.targetoptions[_BARE] = True


def _add_overload(kernel: Any, compiled: Any) -> None:
    """numba's, but calls from Python do not find what has no wrapper."""
    if kernel.targetoptions[_BARE]:
        kernel.overloads[tuple(compiled.signature.args)] = compiled
    else:
        type(kernel).add_overload(kernel, compiled)


def _call_template(kernel: Any, arguments: Sequence[Any], keywords: dict[str, Any]) -> Any:
    """numba's, but an integer that stands in the text of a caller counts as any other: the kernel is compiled once."""
    plain = [types.unliteral(one) if isinstance(one, types.IntegerLiteral) else one for one in arguments]
    return type(kernel).get_call_template(kernel, plain, keywords)


@functools.cache
def _text_of(file: str) -> bytes:
    """Hash of a source; nothing of a function that was typed in: its constants are not in its code."""
    lines = linecache.getlines(file)
    return hashlib.sha256("".join(lines).encode()).digest() if lines else b""


def _store_of(function: Callable) -> Store:
    program = generated.get(function.__module__, program_of(function.__module__))
    return kernel_store(EVERY if program is None else program)
