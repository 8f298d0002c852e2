"""Numbers that the program and its forecasts both read. Without numpy."""

STORAGE = {"double": "float64", "single": "float32"}  # numpy's name of the type of populations, by `fluid.storage`
STEPS_PER_PASS = 6  # steps of the lattice in a pass over memory, at most: more gain little
CACHE = 12e6  # bytes of the last-level cache that planes of all threads may fill where a pass goes by tiles of rows
CACHE_OF_WHOLE_PLANES = 28e6  # the same where a pass goes by whole planes, because links or faces come after sweeps
SPARSE_BELOW = 0.85  # share of fluid nodes below which it is less work to hold these alone
