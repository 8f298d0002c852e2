"""What makes numba reach the machine: compilation cache, vector type, atomics, generated modules."""

import os

os.environ.setdefault("NUMBA_DISABLE_INTEL_SVML", "1")  # its functions have other bits than those of the C library
