"""Arrays that stay where they are while their number of rows changes, so that compiled code need not be told."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import DTypeLike, NDArray

from hpcpic.core.space.fields import aligned_zeros


class Room:
    """whole[name] are the arrays with room to spare, on cache lines; `rows` gives the part in use."""

    def __init__(self) -> None:
        self.whole: dict[str, NDArray] = {}

    def rows(self, name: str, n: int, dtype: DTypeLike = np.float64, shape: Sequence[int] = ()) -> NDArray:
        """The first n rows of an array, with whatever was there; a new array when it has fewer."""
        found = self.whole.get(name)
        if found is None or len(found) < n:
            found = self.whole[name] = aligned_zeros((n + n // 4 + 8, *shape), dtype)
        return found[:n]
