"""What numba found for a call is what it would find again, and it is asked once."""

from types import SimpleNamespace
from typing import ClassVar

from numba import float64, int64, types
from numba.extending import overload

from hpcpic.core.simd import resolution
from hpcpic.core.simd.compile import njit


def kind_of(number):
    """For kernels."""


@overload(kind_of, prefer_literal=True)
def _kind_of(number):
    kind = 1 if isinstance(number, types.Literal) else 2
    return lambda number: kind


def test_numba_is_asked_once_for_the_same_types(monkeypatch):
    asked, find = [], resolution._find
    monkeypatch.setattr(resolution, "_found", {})

    def counted(function, context, arguments, keywords):
        asked.append((function, tuple(arguments)))
        return find(function, context, arguments, keywords)

    monkeypatch.setattr(resolution, "_find", counted)
    kernels = [njit(lambda a, b, k=k: (a + b) * a + (b - a) * k, cache=False) for k in (1.0, 2.0)]
    for kernel in kernels:
        kernel.compile((float64, float64, float64))
    assert len(asked) == len(set(asked)) and {str(one.typing_key) for one, _ in asked} >= {
        f"<built-in function {name}>" for name in ("add", "sub", "mul")
    }
    assert [kernel(3.0, 5.0, k) for kernel, k in zip(kernels, (1.0, 2.0))] == [26.0, 28.0]


def test_a_number_in_the_text_has_its_own_implementation():
    """In any order, though both are of 64 bits."""
    for _ in range(2):
        kernel = njit(lambda n: 100 * kind_of(3) + 10 * kind_of(n) + kind_of(3), cache=False)
        kernel.compile((int64,))
        assert kernel(3) == 121


def test_a_call_that_is_known_has_the_implementation_that_was_found_for_it(monkeypatch):
    """Though another call of the same signature has put its own in the place since; no signature is asked for again."""

    class Function:
        _impl_keys: ClassVar = {}

        def get_impl_key(self, signature):
            return self._impl_keys[signature.args]

    function, asked = Function(), []

    def find(_function, _context, arguments, _keywords):
        asked.append(arguments)
        if arguments == ("unknown",):
            return None
        function._impl_keys["same",] = arguments
        return SimpleNamespace(args=("same",))

    monkeypatch.setattr(resolution, "_find", find)
    monkeypatch.setattr(resolution, "_found", {})
    for arguments in ((1,), (2,), (1,), ("unknown",), ("unknown",)):
        signature = resolution._remembered(function, None, arguments, {})
        assert signature is None or function._impl_keys[signature.args] == arguments
    assert asked == [(1,), (2,), ("unknown",), ("unknown",)]
