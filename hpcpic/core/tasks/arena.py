"""The arrays of a rank: declared once, found by name, bound to kernels by the names of their arguments.

A kernel says what it reads and writes in its signature. An argument is an array of the arena, a value that was set
under that name, a group of arrays (a NamedTuple whose fields are names of arrays), or is given where the kernel is
bound. Arrays grow between launches; every task that was bound to one then gets its new address. Arrays of different
phases share memory: what one phase leaves in it is lost when the next begins.
"""

import weakref
from collections.abc import Iterable
from typing import Any

from numpy.typing import NDArray

from hpcpic.core.simd.team import Job, team
from hpcpic.core.space.declared import Array
from hpcpic.core.space.fields import ALIGNMENT, aligned_zeros
from hpcpic.core.tasks.graph import Bound, parameters, type_of

SPARE = 8  # an array that must grow gets one row more for so many


class Arena:
    """Arrays as declared, on cache lines and zero at first; `sizes` gives a number for each name in their shapes.

    `arena["x"]` is an array; `arena.sizes["slots"]` a size. Whoever keeps an array beyond a call of `reserve` holds
    memory that the tasks no longer read.
    """

    def __init__(self, declared: Iterable[Array], **sizes: int) -> None:
        self.declared = {array.name: array for array in declared}
        self.sizes = sizes
        self._values: dict[str, Any] = {
            name: self._made(array) for name, array in self.declared.items() if not array.phase
        } | self._shared()
        self._groups: dict[str, type] = {}
        self._uses: dict[str, list[tuple[weakref.ref[Bound], int]]] = {}  # tasks by argument, with its place
        self._asked: dict[Any, Job] = {}  # of what will be called

    def __getitem__(self, name: str) -> Any:
        return self._values[name]

    def _made(self, array: Array) -> NDArray:
        sized = array.sized(self.sizes)
        return aligned_zeros([int(n) for n in sized.shape], sized.dtype)

    def _shared(self) -> dict[str, NDArray]:
        """Arrays of the phases: those of one phase lie one behind another, each on cache lines, from where those of
        every other phase begin.
        """
        arrays = [array.sized(self.sizes) for array in self.declared.values() if array.phase]
        ends: dict[str, int] = {}
        starts = []
        for array in arrays:
            starts.append(ends.get(array.phase, 0))
            ends[array.phase] = starts[-1] + -(-array.bytes // ALIGNMENT) * ALIGNMENT
        memory = aligned_zeros((max(ends.values(), default=0),), "uint8")
        return {
            array.name: memory[start : start + array.bytes].view(array.dtype).reshape([int(n) for n in array.shape])
            for array, start in zip(arrays, starts)
        }

    def reserve(self, **sizes: int) -> bool:
        """Let sizes grow to these and an eighth more. Values stay, but those of phases are lost. True if one moved."""
        grown = {name: n + n // SPARE for name, n in sizes.items() if n > self.sizes[name]}
        if not grown:
            return False
        self.sizes |= grown
        moved = {}
        for name, array in self.declared.items():
            if not array.phase and grown.keys() & set(array.shape):
                old, new = self._values[name], self._made(array)
                new[tuple(slice(n) for n in old.shape)] = old
                moved[name] = new
        if any(array.phase and grown.keys() & set(array.shape) for array in self.declared.values()):
            moved |= self._shared()
        self.set(**moved)
        return True

    def set(self, **values: Any) -> None:
        """Give names to values, or arrays new memory; bound tasks take them from the next launch on."""
        self._values |= values
        for name in values:
            self._update_tasks(name)
        for name, kind in self._groups.items():
            if values.keys() & set(kind._fields):  # type: ignore[attr-defined]
                self._update_tasks(name)

    def group(self, **kinds: type) -> None:
        """Arguments that stand for several arrays: name = NamedTuple class whose fields are names of this arena."""
        self._groups |= kinds

    def value(self, name: str) -> Any:
        """The value of a kernel's argument of this name. KeyError for a name that was not given."""
        kind = self._groups.get(name)
        if kind is None:
            return self._values[name]
        return kind(*(self._values[field] for field in kind._fields))  # type: ignore[attr-defined]

    def bind(self, kernel: Any, parts: int | None = None, /, **more: Any) -> Bound:
        """The kernel as a task: arguments by name, those in `more` before those of the arena; a text in `more` is
        the name of the arena's value to take. With `parts`: as so many tasks, whose first argument is their number.
        """
        names = parameters(kernel.py_func)
        if unknown := more.keys() - set(names):
            raise TypeError(f"{kernel.py_func.__name__} takes no {', '.join(sorted(unknown))}")
        wanted = [more.get(name, name) for name in names]
        if parts is not None:
            wanted[0] = 0
        bound = Bound(kernel, [self.value(one) if isinstance(one, str) else one for one in wanted], parts)
        for index, one in enumerate(wanted):
            if isinstance(one, str):
                self._uses.setdefault(one, []).append((weakref.ref(bound), index))
        return bound

    def ask(self, kernel: Any, /, **more: Any) -> None:
        """Have the kernel compiled for a `call` to come, with arguments of the same types."""
        types = tuple(map(type_of, self._arguments(kernel, more)))
        self._asked[kernel] = Job(kernel, types, called=True)
        team.ask(self._asked[kernel])

    def call(self, kernel: Any, /, **more: Any) -> Any:
        """Call the kernel now, with arguments as `bind` finds them; returns its result."""
        if kernel in self._asked:
            team.want([self._asked.pop(kernel)])
        return kernel(*self._arguments(kernel, more))

    def _arguments(self, kernel: Any, more: dict[str, Any]) -> list[Any]:
        wanted = (more.get(name, name) for name in parameters(kernel.py_func))
        return [self.value(one) if isinstance(one, str) else one for one in wanted]

    def _update_tasks(self, name: str) -> None:
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
