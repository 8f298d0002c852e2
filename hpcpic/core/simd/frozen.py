"""Numbers and arrays that a function of the user's own reads beside its arguments: compiled code keeps them for good.

    K = 4.0                                    def spring(k):
    def spring(x, v, t):                           def f(x, v, t):
        return -K * x[0], 0.0, 0.0                     return -k * x[0], 0.0, 0.0
                                                   return f

Who sets K to 5.0 after `register` would go on with 4.0, and a scan over K would compute one case many times: this is
refused. spring(5.0) is a function of its own, which may be registered in place of spring(4.0).
"""

import hashlib
from collections.abc import Callable, Iterator, Mapping
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

from hpcpic.core.errors import ConfigError
from hpcpic.core.simd.own import shipped

FEW = 4  # numbers of an array that are shown; of more a hash is
_registered: dict[str, tuple[tuple[Callable, ...], dict[str, str]]] = {}  # what it is -> functions, and what they read


def keep(what: str, *functions: Callable) -> None:
    """Note what the functions of something that is registered read now. what: "acceleration 'spring'"."""
    _registered[what] = functions, values_of(*functions)


def require_unchanged() -> None:
    """Raise ConfigError where a script has changed what a registered function reads."""
    for what, (functions, before) in _registered.items():
        if before and (changes := _differences(before, values_of(*functions))):
            raise ConfigError(
                f"{what} was registered with {changes} now, which compiled code does not see: let a function make it "
                "(def make(k): def f(...): ...; return f) and register what that returns for the new value"
            )


def kept() -> dict[str, dict[str, str]]:
    """The values that the registered functions read, long arrays as hashes: run.json keeps them, for restarts."""
    return {what: values for what, (_, values) in _registered.items() if values}


def require_same(before: Mapping[str, Mapping[str, str]]) -> None:
    """Raise ConfigError where registered functions read other values than those of a run."""
    for what, (_, now) in _registered.items():
        if what in before and (changes := _differences(before[what], now)):
            raise ConfigError(f"{what} was registered with {changes} now: the run cannot go on with another function")


def digest_of(*functions: Callable) -> bytes:
    """A hash of what functions read; b"" where that is nothing."""
    values = values_of(*functions)
    return hashlib.sha256(repr(sorted(values.items())).encode()).digest() if values else b""


def values_of(*functions: Callable) -> dict[str, str]:
    """Name -> value in words of what functions and those that they call read."""
    found: dict[str, str] = {}
    for name, value in read_by(*functions):
        if not callable(value) and (words := _words(value)):
            known = found.get(name, words)
            found[name] = words if words == known else f"{known} and {words}"  # of two functions that call it alike
    return found


def read_by(*functions: Callable) -> Iterator[tuple[str, Any]]:
    """Names and values of what functions, and those of the user's own that they call, read beside their arguments."""
    left, seen = list(functions), set[int]()
    while left:
        function: Any = left.pop()
        function = getattr(function, "py_func", function)  # of one that numba has compiled
        if not isinstance(function, FunctionType) or id(function) in seen or shipped(function):
            continue
        seen.add(id(function))
        for name, value in _read(function):
            yield name, value
            if callable(value):
                left.append(value)


def _read(function: FunctionType) -> Iterator[tuple[str, Any]]:
    """Names and values that a function finds in its file, in the function that made it, or in a module."""
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or ()):
        yield name, cell.cell_contents
    names = set(_names(function.__code__))
    for name in sorted(names & function.__globals__.keys()):
        value = function.__globals__[name]
        if isinstance(value, ModuleType):
            yield from ((f"{name}.{inner}", vars(value)[inner]) for inner in sorted(names & vars(value).keys()))
        else:
            yield name, value


def _names(code: CodeType) -> Iterator[str]:
    yield from code.co_names
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield from _names(inner)


def _words(value: Any) -> str:
    """A value that compiled code takes over, in words; "" of anything else."""
    if isinstance(value, np.ndarray):
        numbers = value.tolist() if value.size <= FEW else hashlib.sha256(value.tobytes()).hexdigest()[:16]
        return f"{value.dtype}{list(value.shape)} {numbers}"
    if isinstance(value, tuple):
        return f"({', '.join(map(_words, value))})"
    return repr(value) if isinstance(value, bool | int | float | complex | str | np.generic) else ""


def _differences(before: Mapping[str, str], now: Mapping[str, str]) -> str:
    """The values that differ; "" of none."""
    names = sorted({name for name, _ in before.items() ^ now.items()})
    return ", ".join(f"{name} = {before.get(name, 'none')}, and it is {now.get(name, 'none')}" for name in names)
