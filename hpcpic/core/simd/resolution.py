"""The types that numba infers for calls of a function, remembered.

numba tries the implementations of a function one after the other: of `+` those of texts, lists and sets too, each time
a kernel adds two numbers. That took a seventh of the time to compile. What it finds is what it found before: a function
that gains implementations becomes another object.
"""

from collections.abc import Mapping
from typing import Any

from numba import types
from numba.core.targetconfig import ConfigStack

_find = types.Function.get_call_type  # numba's
_found: dict[tuple, tuple[Any, Any]] = {}  # its signature, and the key of its implementation


def _remembered(function: Any, context: Any, arguments: Any, keywords: Mapping[str, Any]) -> Any:
    """The signature of a call, or None; what an implementation is compiled with depends on the flags of its caller."""
    if keywords:
        return _find(function, context, arguments, keywords)
    flags = ConfigStack.top_or_none()
    key = function, context, tuple(arguments), flags and flags.summary()
    if key not in _found:
        signature = _find(function, context, arguments, keywords)
        if signature is None:
            return None
        _found[key] = signature, function.get_impl_key(signature)
    signature, implementation = _found[key]
    function._impl_keys[signature.args] = implementation  # another call may have put its own there
    return signature


def remember() -> None:
    """Let numba ask here."""
    types.Function.get_call_type = _remembered  # type: ignore[method-assign, assignment]
