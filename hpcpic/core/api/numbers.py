"""Numbers that a Python program gives as arguments: taken as they are meant, or refused with what would be right."""

from __future__ import annotations

import math
import operator
from typing import Any

from hpcpic.core.errors import ConfigError


def whole(value: Any, name: str, least: int = 1) -> int:
    """A whole number, of Python or numpy, that is not below `least`. Raises ConfigError."""
    try:
        number = operator.index(value)
    except TypeError:
        number = least - 1
    if isinstance(value, bool) or number < least:
        raise ConfigError(f"{name}: a whole number, {least} or more (got {value!r})")
    return number


def finite(value: Any, name: str) -> float:
    """A number that is neither infinite nor nan. Raises ConfigError."""
    try:
        number = math.nan if isinstance(value, str | bool) else float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise ConfigError(f"{name}: a finite number (got {value!r})")
    return number


def words(value: Any) -> str | None:
    """An argument that the command line takes as text: a number is written as it reads one."""
    if value is None or isinstance(value, str):
        return value
    return f"{value:f}" if isinstance(value, float) else str(value)
