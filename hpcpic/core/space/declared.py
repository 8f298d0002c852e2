"""Arrays as a simulator declares them: once, for what allocates them and for what foretells them. Without numpy."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace


@dataclass(frozen=True, slots=True)
class Array:
    """One array of a rank. `shape` holds numbers and names of sizes that are known later ("slots", "d").

    `dtype` as numpy writes it ("float64", "int32"); `unit` of its values, "" for none; `text` says what they are.
    `phase`: arrays of different phases of a step use the same memory in turn; "" for an array with its own memory.
    """

    name: str
    shape: tuple[int | str, ...]
    dtype: str
    unit: str = ""
    text: str = ""
    phase: str = ""

    def sized(self, sizes: Mapping[str, int]) -> "Array":
        """This array with numbers in place of names. KeyError for a size that is not given."""
        return replace(self, shape=tuple(sizes[n] if isinstance(n, str) else n for n in self.shape))

    @property
    def itemsize(self) -> int:
        """Bytes of one value."""
        return int("".join(filter(str.isdigit, self.dtype))) // 8

    @property
    def bytes(self) -> int:
        """Memory of an array whose sizes are numbers."""
        return math.prod(int(n) for n in self.shape) * self.itemsize
