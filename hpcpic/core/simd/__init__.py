"""What makes numba reach the machine: compilation cache, vector type, atomics, generated modules."""
