"""numba's search for the meaning of an operator, once for all places where it stands between the same types.

At each place numba asks some ten implementations of, say, `+` (of texts, lists, arrays, ...) and makes a sentence of
every refusal: a tenth of the time to compile. What is found depends on nothing but types where it is a rule of types
alone, without compiled code behind it; only such a finding is kept.
"""

from typing import Any

from numba import types
from numba.core.targetconfig import TargetConfig
from numba.core.types.functions import BaseFunction

from hpcpic.core.simd.kinds import Vec

_PLAIN = (types.Number, types.Boolean, Vec, types.Array, types.BaseTuple, types.NoneType)
_search, _equal = BaseFunction.get_call_type, TargetConfig.__eq__


def _resolved(self: Any, context: Any, args: Any, kws: dict[str, Any]) -> Any:
    """The signature of a function for arguments of these types."""
    args = tuple(args)
    if kws or not all(isinstance(arg, _PLAIN) for arg in args):
        return _search(self, context, args, kws)
    known = self.__dict__.setdefault("_resolved", {})
    if args not in known:
        found: Any = _search(self, context, args, kws)
        if self._impl_keys[found.args] != self.typing_key:  # compiled for these types
            return found
        known[args] = found
    return known[args]


def _same(self: TargetConfig, other: object) -> bool:
    """Flags of the compiler are equal; in numba's way all fifty of them are read by name."""
    return self is other or (isinstance(other, TargetConfig) and self._values == other._values) or _equal(self, other)


def install() -> None:
    """For all that this process compiles."""
    BaseFunction.get_call_type = _resolved  # type: ignore[method-assign,assignment]
    TargetConfig.__eq__ = _same  # type: ignore[method-assign,assignment]
    TargetConfig.__hash__ = lambda self: hash(type(self))  # type: ignore[method-assign]
