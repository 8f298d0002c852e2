"""Groups of arrays that the kernels of links and of uncovered nodes take."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.simd.compile import njit
from lbmdem.kernels import layout

FLUID = np.int32(layout.FLUID)


class Populations(NamedTuple):
    """The populations f of a slab, and where they are (see `kernels.layout`)."""

    f: NDArray
    strides: NDArray
    slots: NDArray
    shifts: NDArray


class Nodes(NamedTuple):
    """What is at the nodes of a slab and around it: `solid`, flat, of shape[3] (x, row, plane) with ghosts.

    inner[3, 2]: the places that are no ghosts; box[3, 2]: those within the faces of the box.
    """

    solid: NDArray
    shape: NDArray
    inner: NDArray
    box: NDArray


class LinkDirections(NamedTuple):
    """e[q, 3] (x, row, plane), the opposite of each direction, and 6 w."""

    e: NDArray
    opposite: NDArray
    w6: NDArray


class BounceBack(NamedTuple):
    """Number of a wall rule. open_mass: 1 to count the fluid that a wall sweeps over as momentum (Wen et al., JCP 266
    (2014) 161: Galilean invariant on the mean), 0 where covered and uncovered nodes are counted themselves.
    """

    rule: int
    open_mass: float


class Parts(NamedTuple):
    """Parts of images: planes first .. after of `image`, and what their links give, int64[n, 7]."""

    image: NDArray
    first: NDArray
    after: NDArray
    gains: NDArray


class View(NamedTuple):
    """The nodes of a part of an image: planes from p on, rows from r on, columns from x on."""

    p: int
    planes: int
    r: int
    rows: int
    x: int
    columns: int


class Grain(NamedTuple):
    """A grain as a slab sees it. motion[6]: velocity and angular velocity; offset[3]: to local nodes."""

    centre: NDArray
    radius: float
    number: np.int32
    motion: NDArray
    offset: NDArray


class Scratch(NamedTuple):
    """Memory for a part: `work` holds tables of `table` words and lists of `listed` links; further[2, listed]; sums."""

    work: NDArray
    table: int
    listed: int
    further: NDArray
    sums: NDArray


@njit(forceinline=True)
def arrival(populations, parity, z, y, x, i):
    """Index in f of the population i that arrives at the own node (z, y, x)."""
    return layout.arrival(populations.strides, populations.slots, populations.shifts, parity, z, y, x, i)


@njit(forceinline=True)
def is_fluid(nodes, p, r, x):
    """True for a node, ghosts among them, that is of the fluid and in the box."""
    box, shape = nodes.box, nodes.shape
    inside = box[0, 0] <= x < box[0, 1] and box[1, 0] <= r < box[1, 1] and box[2, 0] <= p < box[2, 1]
    return inside and nodes.solid[(p * shape[1] + r) * shape[0] + x] == FLUID
