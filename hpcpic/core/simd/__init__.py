"""What makes numba reach the machine: compilation cache, vector type, atomics, generated modules."""

import os

os.environ.setdefault("NUMBA_DISABLE_INTEL_SVML", "1")  # its functions have other bits than those of the C library
# colours of what numba says of each overload that it tries and drops: 6 % of compiling
os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")
