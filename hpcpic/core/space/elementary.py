"""Elementary functions of arrays, number by number, by the C library: the same bits on every processor.

numpy has code of its own where a processor has AVX-512, whose last bits differ. What reaches the state of a run takes
its cosines here, and those of single numbers from `math`. The first call of a process compiles, or loads what is
compiled (core.space.elementary_kernels).
"""

import math
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

__all__ = ["cos", "cosh", "expm1", "log1p", "sin", "sinh", "tanh"]


def _of_arrays(number: int) -> Callable[[ArrayLike], Any]:
    single = getattr(math, __all__[number])

    def function(x: ArrayLike) -> Any:
        values = np.array(x, np.float64, order="C")
        if values.size == 1:  # of a forecast, which loads no compiler
            with suppress(ValueError, OverflowError):
                return np.full(values.shape, single(values.item()))[()]
        from hpcpic.core.space import elementary_kernels

        elementary_kernels.apply(number, values.reshape(-1))
        return values[()]

    return function


cos, cosh, expm1, log1p, sin, sinh, tanh = map(_of_arrays, range(len(__all__)))
