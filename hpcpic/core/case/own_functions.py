"""Faults of a function of the user's own that kernels are to call, in one sentence with its place.

numba tells it in pages of its own. Only who names such a function in a case waits for it to be compiled.
"""

import dis
import functools
import inspect
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import CodeType, FunctionType
from typing import Any

from hpcpic.core.simd.formulas import VECTORS
from hpcpic.core.simd.frozen import read_by

_IMPORTED = re.compile(r"<use_(.+)_[0-9a-f]{32}>")  # see core.app.use
_COLOURS = re.compile(r"\x1b\[[0-9;]*m")
_LINE = re.compile(r'File "[^"]*", line (\d+)')
_GENERAL = ("Failed in nopython mode", "During:", 'File "', "Invalid use of")


def file_of(code: CodeType) -> str:
    """The file of a function, as the user calls it."""
    imported = _IMPORTED.fullmatch(code.co_filename)
    return f"{imported[1]}.py" if imported else code.co_filename


def place_of(function: FunctionType, line: int | None = None) -> str:
    """FILE:LINE: NAME of a function; by default its first line."""
    code = function.__code__
    return f"{file_of(code)}:{code.co_firstlineno if line is None else line}: {function.__name__}"


def is_own(file: str, own: set[str]) -> bool:
    """Whether code in a file is of the user's own: imported by --use, or one of these files."""
    return bool(_IMPORTED.fullmatch(file)) or file in own


def failed_at(error: BaseException, own: set[str]) -> str:
    """FILE:LINE: NAME, where a function of the user's own has raised; "" where none has."""
    frames, trace = [], error.__traceback__
    while trace:
        frames.append((trace.tb_frame.f_code, trace.tb_lineno))
        trace = trace.tb_next
    places = [f"{file_of(code)}:{line}: {code.co_name}" for code, line in frames if is_own(code.co_filename, own)]
    return places[-1] if places else ""


def plain(function: Any) -> Any:
    """The Python function of one that numba has compiled; others as they are."""
    return getattr(function, "py_func", function)


def fault(function: Any, arguments: Mapping[str, Any], returned: Callable[[Any], bool], wanted: str) -> str:
    """FILE:LINE: NAME: what is wrong; "" of a function that numba compiles.

    arguments: their names and numba types. returned: whether the type that comes back is one of those `wanted`.
    """
    function = plain(function)
    if not isinstance(function, FunctionType):
        return f"a function is wanted (got {function!r})"
    line, said = _fault(function, tuple(arguments), tuple(arguments.values()), returned, wanted)
    return said and f"{place_of(function, line)}: {said}"


@functools.cache
def formula_fault(
    function: Callable, vectors: tuple[str, ...] = (), numbers: tuple[str, ...] = (), results: int = 1
) -> str:
    """FILE:LINE: NAME: what is wrong with a formula that kernels call; "" of a sound one.

    vectors, numbers: names of its arguments that are vectors of numbers, and of those after them that are numbers.
    results: how many values it returns.
    """
    from numba import types

    from hpcpic.core.simd.vector import Vec, lanes

    def is_value(kind: Any) -> bool:
        return isinstance(types.unliteral(kind), types.Integer | types.Float | Vec)

    def returned(kind: Any) -> bool:
        parts = getattr(kind, "types", ())
        return is_value(kind) if results == 1 else len(parts) == results and all(map(is_value, parts))

    vector = Vec(lanes(float), float)
    arguments = dict.fromkeys(vectors, vector) | dict.fromkeys(numbers, types.float64)
    said = fault(function, arguments, returned, "one value" if results == 1 else f"{results} values")
    return f"{said}; {VECTORS}" if "Vec(" in said else said


def arithmetic_fault(function: Any) -> str:
    """The fault of a function whose text kernels take over; "" of one that is arithmetic of its arguments."""
    if not isinstance(function, FunctionType) or function.__name__ == "<lambda>":
        return f"a function made by `def` is wanted (got {function!r})"
    builtin = vars(__import__("builtins"))
    for step in dis.get_instructions(function):
        outside = step.opname == "LOAD_GLOBAL" and step.argval not in builtin
        if outside or step.opname == "LOAD_DEREF":
            return f"{place_of(function)}: is to be arithmetic of its arguments alone (it uses {step.argval!r})"
    return ""


def _fault(
    function: FunctionType, names: Sequence[str], types: tuple, returned: Callable[[Any], bool], wanted: str
) -> tuple[int, str]:
    """The line, and the sentence; "" of none."""
    import numba

    first = function.__code__.co_firstlineno
    try:
        inspect.signature(function).bind(*names)
    except TypeError:
        return first, f"is called with ({', '.join(names)}), but takes {inspect.signature(function)}"
    for unknown, line in _undefined(function):
        return line, f"{unknown!r} is not defined"
    if further := list(inspect.signature(function).parameters)[len(names) :]:
        return first, (
            f"takes {further[0]!r} besides ({', '.join(names)}): let a function make it, def make({further[0]}): def "
            f"{function.__name__}(...): ...; return {function.__name__}"
        )
    for name in _random(function):
        return first, f"draws random numbers ({name}): it must give the same whenever it is asked, on any rank"
    try:
        compiled = numba.njit(function)
        compiled.compile(types)
    except Exception as error:  # of whatever kind: numba's, or of an attribute that a module lacks
        said = _COLOURS.sub("", str(error))
        if "unify return type" in said:  # of several returns: numba names one of them by chance
            return first, _sentence(error, function)
        lines, place = _LINE.findall(said), getattr(error, "loc", None)
        return int(lines[-1]) if lines else getattr(place, "line", first), _sentence(error, function)
    result: Any = compiled.overloads[types]
    result = result.signature.return_type
    if not returned(result):
        return first, f"must return {wanted} (it returns {_shown(result)})"
    return first, ""


def _undefined(function: FunctionType) -> list[tuple[str, int]]:
    """Names that stand for nothing, with their lines."""
    found, line = [], function.__code__.co_firstlineno
    there = {**vars(__import__("builtins")), **function.__globals__}
    for step in dis.get_instructions(function):
        line = (step.positions and step.positions.lineno) or line
        if step.opname in ("LOAD_GLOBAL", "LOAD_NAME") and step.argval not in there:
            found.append((step.argval, line))
    return found


def _random(function: FunctionType) -> Iterator[str]:
    """Names by which a function, or one that it calls, draws random numbers."""
    import random

    import numpy as np

    sources = random.Random | np.random.RandomState | np.random.Generator
    for name, value in read_by(function):
        if value is random or value is np.random or isinstance(getattr(value, "__self__", value), sources):
            yield name


def _sentence(error: Exception, function: FunctionType) -> str:
    """The error of numba on a function in one sentence, without all that it has tried."""
    text = _COLOURS.sub("", str(error))
    if call := re.search(r"No implementation of function (.+) found for signature:\s+>>> (.+)", text):
        return f"cannot be compiled: no such operation: {call[2].strip()}"
    if name := re.search(r"Untyped global name '(\w+)'", text):
        thing = function.__globals__.get(name[1])
        if isinstance(thing, FunctionType):
            return f"cannot be compiled: it calls {name[1]!r}, a function of Python: write @numba.njit above that one"
        return f"cannot be compiled: {name[1]!r} is of the type {type(thing).__name__}, not a number or an array"
    lines = [line.strip() for line in text.splitlines()]
    said = next((line for line in lines if line and not line.startswith(_GENERAL)), type(error).__name__)
    return f"cannot be compiled: {said}"


def _shown(result: Any) -> str:
    """A type of numba in words."""
    text = str(result)
    return "nothing" if text == "none" else re.sub(r"Literal\[\w+\]\((.*?)\)", r"\1", text)
