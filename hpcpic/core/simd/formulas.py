"""Formulas that stand once: plain functions that Python and numpy evaluate, and that kernels call when compiled.

    # physics/drag.py                                  # kernels/__init__.py
    from hpcpic.core.simd.formulas import fma          from hpcpic.core.simd.compile import formulas
                                                       from app.physics import drag
    def stokes(u, beta, a):
        return fma(-beta, u, a)                        formulas(drag)

A module of formulas imports nothing heavy, so what forecasts a run can read it too. Kernels call its functions with
numbers or with vectors (`hpcpic.core.simd.vector`), which these operations then mean.
"""

import math
from typing import Any

__all__ = ["fma", "maximum", "minimum", "select", "sqrt"]

VECTORS = "vectors have + - * /, and from hpcpic.core.simd.formulas fma, maximum, minimum, sqrt, select (for if)"


def fma(a: Any, b: Any, c: Any) -> Any:
    """a b + c; compiled, with one rounding."""
    return a * b + c


def select(mask: Any, a: Any, b: Any) -> Any:
    """a where the mask is true, else b, number by number. Both have been evaluated."""
    if isinstance(mask, bool):
        return a if mask else b
    import numpy as np

    return np.where(mask, a, b)


def minimum(a: Any, b: Any) -> Any:
    """The smaller one, number by number; b where they are not ordered."""
    return select(a < b, a, b)


def maximum(a: Any, b: Any) -> Any:
    """The larger one, number by number; b where they are not ordered."""
    return select(a > b, a, b)


def sqrt(a: Any) -> Any:
    """Square root, number by number."""
    if isinstance(a, float):
        return math.sqrt(a)
    import numpy as np

    return np.sqrt(a)
