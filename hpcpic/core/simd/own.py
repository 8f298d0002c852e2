"""Registries of what cases may name, such as kernels or loaders, also from files of the user: a run keeps a copy."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

_PACKAGES = tuple(f"{Path(__file__).parents[3] / name}/" for name in ("hpcpic", "sph", "lbmdem"))
files: set[str] = set()
typed: set[str] = set()  # names of what stands in no file: in a notebook, or at the prompt


def enter(
    registry: dict[str, Any], kind: str, name: str, thing: Any, function: Callable[[Any], Any] | None = None
) -> None:
    """Let cases name a thing of this kind. ValueError where another one has the name: it may only be defined again, as
    in a cell of a notebook that is run twice. function: the one of a thing that tells; by default its class does.
    """
    known = registry.get(name, thing)
    if function:
        one, other = (_called(function(each)) for each in (known, thing))
        again = known == thing or (one is not other and _same(one, other))
    else:
        again = _same(type(known), type(thing))
    if not again:
        raise taken(kind, name)
    note(function(thing) if function else thing)
    registry[name] = thing


def taken(kind: str, name: str) -> ValueError:
    """The error where another thing of this kind has the name already."""
    return ValueError(f"there is another {kind} {name!r}: give yours another name")


def _called(function: Any) -> Any:
    """The function that a functools.partial calls; another object as it is."""
    return getattr(function, "func", function)


def _same(one: object, other: object) -> bool:
    """Whether two functions or classes are one, or one that has been defined again."""
    names = [(getattr(part, "__module__", None), getattr(part, "__qualname__", None)) for part in (one, other)]
    return one is other or (names[0] == names[1] and None not in names[0])


def shipped(function: object) -> bool:
    """Whether a function comes with this program."""
    code = getattr(_called(function), "__code__", None)
    return code is not None and code.co_filename.startswith(_PACKAGES)


def note(thing: object) -> None:
    """Note where a function, or the class of an object, comes from, unless that is this program or no file."""
    thing = _called(thing)
    code = getattr(thing, "__code__", None)
    kind = sys.modules.get(type(thing).__module__)
    file = code.co_filename if code else getattr(kind, "__file__", None) or ""
    if not Path(file).is_file() and not file.startswith("<use_"):  # which --use has imported, and keeps
        typed.add(getattr(thing, "__name__", type(thing).__name__))
    elif not file.startswith((*_PACKAGES, "<use_")):
        files.add(str(Path(file).resolve()))
