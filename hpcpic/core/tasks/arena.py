"""The arrays of a rank: declared once, found by name, bound to kernels by the names of their arguments.

A kernel says what it reads and writes in its signature. An argument is an array of the arena, a value that was set
under that name, a group of arrays (a NamedTuple whose fields are names of arrays), or is given where the kernel is
bound. Arrays grow between launches; every task that was bound to one is told where it lies now.
"""

import inspect
import weakref
from collections.abc import Iterable
from typing import Any

from numpy.typing import NDArray

from hpcpic.core.space.declared import Array
from hpcpic.core.space.fields import aligned_zeros
from hpcpic.core.tasks.graph import Bound, bind

SPARE = 8  # an array that must grow gets one row more for so many


class Arena:
    """Arrays as declared, on cache lines and zero at first; `sizes` gives a number for each name in their shapes.

    `arena["x"]` is an array; `arena.sizes["slots"]` a size. Whoever keeps an array beyond a call of `reserve` holds
    memory that the tasks no longer read.
    """

    def __init__(self, declared: Iterable[Array], **sizes: int) -> None:
        self.declared = {array.name: array for array in declared}
        self.sizes = sizes
        self._values: dict[str, Any] = {name: self._made(array) for name, array in self.declared.items()}
        self._groups: dict[str, type] = {}
        self._uses: dict[str, list[tuple[weakref.ref[Bound], int]]] = {}  # tasks by argument, with its place

    def __getitem__(self, name: str) -> Any:
        return self._values[name]

    def _made(self, array: Array) -> NDArray:
        sized = array.sized(self.sizes)
        return aligned_zeros([int(n) for n in sized.shape], sized.dtype)

    def reserve(self, **sizes: int) -> bool:
        """Make room: sizes grow to what is asked and an eighth more, values stay. Whether any array moved."""
        grown = {name: n + n // SPARE for name, n in sizes.items() if n > self.sizes[name]}
        if not grown:
            return False
        self.sizes |= grown
        moved = {}
        for name, array in self.declared.items():
            if grown.keys() & set(array.shape):
                old, new = self._values[name], self._made(array)
                new[tuple(slice(n) for n in old.shape)] = old
                moved[name] = new
        self.set(**moved)
        return True

    def set(self, **values: Any) -> None:
        """Give names to values, or arrays new memory; bound tasks take them from the next launch on."""
        self._values |= values
        for name in values:
            self._tell(name)
        for name, kind in self._groups.items():
            if values.keys() & set(kind._fields):  # type: ignore[attr-defined]
                self._tell(name)

    def group(self, **kinds: type) -> None:
        """Arguments that stand for several arrays: name = NamedTuple class whose fields are names of this arena."""
        self._groups |= kinds

    def value(self, name: str) -> Any:
        """What a kernel's argument of this name gets. KeyError for a name that nobody has given."""
        kind = self._groups.get(name)
        if kind is None:
            return self._values[name]
        return kind(*(self._values[field] for field in kind._fields))  # type: ignore[attr-defined]

    def bind(self, kernel: Any, **more: Any) -> Bound:
        """The kernel as a task: arguments by name, those in `more` before those of the arena."""
        names = list(inspect.signature(kernel.py_func).parameters)
        if unknown := more.keys() - set(names):
            raise TypeError(f"{kernel.py_func.__name__} takes no {', '.join(sorted(unknown))}")
        bound = bind(kernel, *(more[name] if name in more else self.value(name) for name in names))
        for index, name in enumerate(names):
            if name not in more:
                self._uses.setdefault(name, []).append((weakref.ref(bound), index))
        return bound

    def _tell(self, name: str) -> None:
        uses = [use for use in self._uses.get(name, ()) if use[0]() is not None]
        if not uses:
            return
        self._uses[name], value = uses, self.value(name)
        for task, index in uses:
            if bound := task():
                bound.update(index, value)

    @property
    def bytes(self) -> dict[str, int]:
        """Memory by declared array."""
        return {name: self._values[name].nbytes for name in self.declared}
