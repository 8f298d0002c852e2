"""Names of a package that are imported when they are first asked for, so that a command pays for what it uses."""

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any


def lazy(package: str, names: Mapping[str, Sequence[str]]) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """The `__getattr__` and `__dir__` of a package. names: module -> what is taken from it."""

    def find(name: str) -> Any:
        for module, offered in names.items():
            if name in offered:
                return getattr(import_module(module), name)
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    def offered() -> list[str]:
        return sorted({name for names_of in names.values() for name in names_of} | {"__version__"})

    return find, offered
