"""Values of Python as libconfig text, as the keys of a case want them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np

from hpcpic.core.case.config import leaves, loads
from hpcpic.core.case.dump import dump
from hpcpic.core.case.texts import value_text
from hpcpic.core.errors import ConfigError

Keep = Callable[[str, Mapping[str, Any]], str]  # writes the arrays of a key to a file, and tells its path


@contextmanager
def told_in_python(arrays: Iterable[str] = ()) -> Iterator[None]:
    """Errors in the body call a change of a case as Python does, where the command line has --set, and arrays by the
    keys that they were given under, where a case has a file.
    """

    def worded(told: str) -> str:
        told = re.sub("^--set ", "changed: ", told)
        for key in arrays:
            told = re.sub(rf'^changed: {re.escape(key)}={{ file = "[^"]*"; }}: ', "changed: ", told)
            told = told.replace(f"{key}.file: ", f"{key}: ")
        return told

    try:
        yield
    except ConfigError as error:
        raise ConfigError([worded(told) for told in error.messages]) from None


def called(told: str, path: str, name: str) -> str:
    """A message that begins with a place in a file that the user does not know, by the name of what the file holds."""
    return re.sub(f"^{re.escape(path)}(:\\d+)*", lambda _: name, told)


def assignments(changes: Mapping[str, Any], keep: Keep) -> Iterator[str]:
    """`key=value` of every key that changes; a mapping changes the keys in it, one by one. Raises ConfigError."""
    for key, value in changes.items():
        if isinstance(value, Mapping) and value and not _holds_arrays(key):
            yield from assignments({f"{key}.{name}": inner for name, inner in value.items()}, keep)
        else:
            yield f"{key}={setting_text(value, key, keep)}"


def case_text(sections: Mapping[str, Any], keep: Keep) -> str:
    """A case file that says these keys. Raises ConfigError for a value that no case file can hold."""
    return "".join(f"{name} = {setting_text(value, name, keep)};\n" for name, value in sections.items())


def setting_text(value: Any, key: str, keep: Keep) -> str:
    """A value in libconfig syntax: mappings are groups, sequences of mappings lists, other sequences arrays; an empty
    one is a list, which stands for no groups and for no numbers. What stands under a key `start` are arrays, which are
    kept in a file."""
    if isinstance(value, Mapping):
        if _holds_arrays(key) and "file" not in value:
            value = {"file": keep(key, value)}
        inner = (f"{name} = {setting_text(each, f'{key}.{name}', keep)};" for name, each in value.items())
        return "{ " + " ".join(inner) + " }"
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list | tuple):
        if not value:
            return "()"
        if isinstance(value[0], Mapping | list | tuple | np.ndarray):
            return "( " + ", ".join(setting_text(inner, f"{key}[{i}]", keep) for i, inner in enumerate(value)) + " )"
        return value_text([_plain(inner, f"{key}[{i}]") for i, inner in enumerate(value)])
    return value_text(_plain(value, key))


def settings_of(config: Any) -> dict[str, str]:
    """key -> value of all settings of a case. A file that is known by its content is that content, under the key of its
    group: the arrays of each rank lie in a file of its own.
    """
    values = {key: value_text(value) for key, value in leaves(loads(dump(config)).data)}
    for key in [key for key in values if key.endswith(".sha256")]:
        group = key.removesuffix(".sha256")
        del values[f"{group}.file"]
        values[group] = f"content {values.pop(key)[1:13]}"
    return values


def _holds_arrays(key: str) -> bool:
    return key.rpartition(".")[2] == "start"


def _plain(value: Any, key: str) -> bool | int | float | str:
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        raise ConfigError(f"{key}: must be a finite number (got {value})")
    if isinstance(value, bool | int | float | str):
        return value
    cure = "; to leave a key out make the case anew, or give the whole list that it is in" if value is None else ""
    raise ConfigError(f"{key}: a case holds numbers, texts, true and false (got {type(value).__name__}){cure}")
