"""The cells about nodes, for shapes that are placed by the nearest node (NGP, TSC): one more a row than grid cells."""

from hpcpic.core.simd.vector import floor
from hpcpic.plasma.kernels.lanes import inlined
from hpcpic.plasma.kernels.storage import TILE
from hpcpic.plasma.kernels.weights import HALF

DIM = 2  # axes of the grid

PITCH = TILE + 8  # of a row of nodes, in eights
EDGE = TILE + 1 if DIM > 1 else PITCH  # behind the last node
LAYER = EDGE * PITCH  # of a plane of nodes
CELLS = (PITCH, LAYER, EDGE * LAYER)[DIM - 1]


@inlined
def cell_of(x):
    """Number of the nearest node along an axis."""
    return floor(x + HALF)
