"""How wide the registers are that kernels are compiled for.

It loads no compiler, so that `check` and `estimate` may ask: what a program holds in whole vectors depends on it.
"""

import functools
import os
from typing import Any

import numpy as np


@functools.cache
def has_avx512() -> bool:
    """Whether the processor, or the one that numba is told to compile for in its place, has AVX-512."""
    generic = os.environ.get("NUMBA_CPU_NAME", "").lower() == "generic"
    chosen = os.environ.get("NUMBA_CPU_FEATURES", "" if generic else None)
    if chosen is not None:
        return "+avx512f" in chosen.split(",")
    from numpy._core._multiarray_umath import __cpu_features__

    return bool(__cpu_features__.get("AVX512F"))


def lanes(dtype: Any) -> int:
    """Lanes of the widest registers: 64 bytes with AVX-512, else 32."""
    return (64 if has_avx512() else 32) // np.dtype(dtype).itemsize
