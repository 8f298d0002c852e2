"""How many numbers the vectors of kernels hold: as many on every processor, so that sums over lanes have the same bits.

Vectors have 64 bytes, a register of AVX-512; for narrower registers the compiler makes two or four instructions of one.
This file loads no compiler: `check` and `estimate` ask it too.
"""

from typing import Any

import numpy as np

VECTOR_BYTES = 64


def lanes(dtype: Any) -> int:
    """Numbers of this type in a vector."""
    return VECTOR_BYTES // np.dtype(dtype).itemsize
