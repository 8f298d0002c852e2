"""Numbers that the program and its forecasts both read. Without numpy."""

STORAGE = {"double": "float64", "single": "float32"}  # numpy's name of the type of populations, by `fluid.storage`
STEPS_PER_PASS = 6  # steps of the lattice in a pass over memory, at most: more gain little
CACHE = 12e6  # bytes of the last-level cache that planes of all threads may fill where a pass goes by tiles of rows
CACHE_OF_WHOLE_PLANES = 28e6  # the same where a pass goes by whole planes, because links or faces come after sweeps
SPARSE_BELOW = 0.85  # share of fluid nodes below which it is less work to hold these alone, with masks (has_masks)
SPARSE_BLOCK = 16  # vectors that list together where else they read, where fluid nodes alone are held
GAINS = 7  # of a body from its links: force, torque, and the mass that the fluid gains
ROW = 16  # values of a grain (x y z radius, v and inverse mass, omega and inverse inertia, orientation) or a plane
LANES = 8  # contacts whose forces are found at a time
GRAINS_OF_ONE_THREAD = 500  # grains per thread up to which one thread does all substeps in one call
MAX_REPLICATED = 512  # grains, at most, that all ranks hold
STEPS_OWED = 20  # after which the fluid gets back the mass that moving grains have taken: a pass over all nodes
STEPS_PER_CALL = 256  # steps of grains alone in one call: short enough to hear signals
PAIRS_PER_GRAIN = {2: 3, 3: 6}  # near enough to be listed, in a dense packing
PARTS_PER_THREAD = 4  # of a kernel over links, nodes or grains


def parts_of(threads: int) -> int:
    """Parts in which such a kernel goes over its links, nodes or grains: one where one thread does them all."""
    return PARTS_PER_THREAD * threads if threads > 1 else 1
