"""How many numbers the vectors of kernels hold: as many on every processor, so that sums over lanes have the same bits.

Vectors have 64 bytes, a register of AVX-512; for narrower registers the compiler makes two or four instructions of one.
This file loads no compiler: `check` and `estimate` ask it too.
"""

import functools
import os
from typing import Any

import numpy as np

VECTOR_BYTES = 64


def lanes(dtype: Any) -> int:
    """Numbers of this type in a vector."""
    return VECTOR_BYTES // np.dtype(dtype).itemsize


@functools.cache
def compiled_for(feature: str) -> bool:
    """Whether kernels are compiled for a processor with this feature, by LLVM's name."""
    features = os.environ.get("NUMBA_CPU_FEATURES")
    if features is None and os.environ.get("NUMBA_CPU_NAME", "").lower() == "generic":
        features = ""
    if features is None:
        from llvmlite import binding  # without the rest of the compiler

        features = binding.get_host_cpu_features().flatten()
    return f"+{feature}" in features.split(",")


def has_masks() -> bool:
    """Whether instructions take masks: AVX-512. Layouts may differ by it, results may not."""
    return compiled_for("avx512f")
