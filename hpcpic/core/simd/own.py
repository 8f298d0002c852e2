"""Files of the user that have registered something, as a kernel or a wall rule. A run keeps a copy of them."""

import sys
from pathlib import Path

_PACKAGES = tuple(f"{Path(__file__).parents[3] / name}/" for name in ("hpcpic", "sph", "lbmdem"))
files: set[str] = set()
typed: set[str] = set()  # names of what stands in no file: in a notebook, or at the prompt


def same(one: object, other: object) -> bool:
    """Whether two functions, or objects of two classes, are one, or one that has been defined again."""
    names = [(getattr(part, "__module__", None), getattr(part, "__qualname__", None)) for part in (one, other)]
    return one is other or (names[0] == names[1] and None not in names[0])


def shipped(function: object) -> bool:
    """Whether a function comes with this program."""
    code = getattr(getattr(function, "func", function), "__code__", None)  # of a functools.partial: what it calls
    return code is not None and code.co_filename.startswith(_PACKAGES)


def note(thing: object) -> None:
    """Note where a function, or the class of an object, comes from, unless that is this program or no file."""
    thing = getattr(thing, "func", thing)  # of a functools.partial
    code = getattr(thing, "__code__", None)
    kind = sys.modules.get(type(thing).__module__)
    file = code.co_filename if code else getattr(kind, "__file__", None) or ""
    if not Path(file).is_file() and not file.startswith("<use_"):  # which --use has imported, and keeps
        typed.add(getattr(thing, "__name__", type(thing).__name__))
    elif not file.startswith((*_PACKAGES, "<use_")):
        files.add(str(Path(file).resolve()))
