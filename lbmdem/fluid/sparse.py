"""Fluid nodes one behind the other, without the solid ones: for porous media whose solids stay.

The face of `kernels.layout.Layout` and of `exchange.Exchange`; the scheme is that of `kernels.sparse`.
"""

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.pieces import Parcel, Pieces
from hpcpic.core.comm.tags import Channel
from hpcpic.core.comm.world import World
from hpcpic.core.space.declared import Array
from hpcpic.core.space.domain import Domain
from hpcpic.core.space.fields import aligned_zeros
from hpcpic.core.tasks.arena import Arena
from hpcpic.core.tasks.graph import Bound
from lbmdem.fluid.exchange import neighbours, tell_iteration
from lbmdem.fluid.solid_nodes import several_slabs
from lbmdem.kernels import sparse_addresses as kernels
from lbmdem.kernels.layout import FLUID, Layout, storage_order
from lbmdem.kernels.sparse import FETCHED
from lbmdem.layout import place_type, sparse_arrays
from lbmdem.sizes import SPARSE_BLOCK as BLOCK

_STREAMS_BYTES, _PAGE = 1088, 4096  # distance of the slots modulo a page, so that they use different sets of a cache


class SparseLayout:
    """Positions of the fluid nodes of a slab: by planes, rows and x, every plane from a multiple of the lanes on.

    ids[planes + 2, rows, nx + 2]: what is solid, with ghosts (rows have none in 2D). positions, of the same shape: -1
    in solid nodes and beyond faces; those of nodes of the ranks below and above are behind the own ones (`beyond`).
    """

    whole_planes = True

    def __init__(self, dense: Layout, ids: NDArray[np.int32], world: World, domain: Domain) -> None:
        self.lattice, self.planes, self.rows, self.nx = dense.lattice, dense.planes, dense.rows, dense.nx
        self.itemsize, self.lanes = dense.itemsize, dense.lanes
        flat = self.lattice.dimensions == 2
        self.row_ghosts = int(not flat)
        self.positions: NDArray[np.int32] = np.full(ids.shape, -1, np.int32)
        inner = (slice(None) if flat else slice(1, -1), slice(1, -1))
        counts = np.count_nonzero(ids[(slice(None), *inner)] == FLUID, axis=(1, 2))
        self.first = np.concatenate(([0], np.cumsum(-(-counts[1:-1] // self.lanes)))).astype(np.int64)
        starts = [-1, *(self.first[:-1] * self.lanes), -1]
        end, self.beyond = self.vectors * self.lanes, {}
        for plane, peer in zip((0, self.planes + 1), neighbours(domain, world.rank)):
            if peer is not None:
                starts[plane], self.beyond[plane], end = end, (end, int(counts[plane])), end + int(counts[plane])
        for plane, start in enumerate(starts):
            if start >= 0:
                wet = ids[(plane, *inner)] == FLUID
                self.positions[(plane, *inner)][wet] = start + np.arange(counts[plane])
        alone = domain.periodic[0] and not several_slabs(domain)
        self.stored = self.planes + (not alone)  # as `Layout.stored`
        self._wrap([alone, not flat and domain.periodic[1], domain.periodic[-1]])
        used = (end + self.lanes) * self.itemsize
        self.slot_stride = (used + (_STREAMS_BYTES - used) % _PAGE) // self.itemsize
        largest = np.diff(self.first).max(initial=0) * self.lanes * self.lattice.q * self.itemsize
        self.plane_bytes = int(world.max(float(largest)))

    def _wrap(self, wraps: list[bool]) -> None:
        for axis, wrap in enumerate(wraps):
            if wrap and self.planes:
                layers = np.moveaxis(self.positions, axis, 0)
                layers[0], layers[-1] = layers[-2], layers[1]

    def arrays(self, real: str) -> tuple[Array, ...]:
        """What a rank holds of its nodes, with populations of the type `real`."""
        return sparse_arrays(self.lattice, self.positions.shape, real, place_type(self.size))

    def places(self, local: NDArray[np.int64]) -> NDArray[np.int64]:
        """Positions of nodes (x, row, plane) of this slab or one beyond; -1 where there is none."""
        x, row, plane = local.T
        return self.positions[plane + 1, row + self.row_ghosts, x + 1].astype(np.int64)

    @property
    def vectors(self) -> int:
        return int(self.first[-1])

    @property
    def size(self) -> int:
        """Elements of the array."""
        return self.lattice.q * self.slot_stride

    @property
    def strides(self) -> NDArray[np.int64]:
        """What `element` wants: [slot stride, ghosts of rows]."""
        return np.array([self.slot_stride, self.row_ghosts], np.int64)

    @property
    def slots(self) -> NDArray[np.int64]:
        """slot[parity, i] of the arrivals."""
        return np.array([np.arange(self.lattice.q), self.lattice.opposite], np.int64)

    @property
    def shifts(self) -> NDArray[np.int64]:
        """-e[i] in storage order: where f_i comes from."""
        return -np.array([storage_order(self.lattice, i) for i in range(self.lattice.q)], np.int64)


def sparse_arena(layout: SparseLayout, real: str) -> Arena:
    """The arrays of a slab of fluid nodes, with all that the sweep wants to know of the nodes; no populations yet."""
    n, blocks = layout.vectors, np.concatenate(([0], np.cumsum(-(-np.diff(layout.first) // BLOCK)))).astype(np.int64)
    held = {"solid": None, "positions": layout.positions, "first": layout.first, "blocks": blocks}
    arena = Arena(
        [array for array in layout.arrays(real) if array.name not in held],
        slot=layout.slot_stride, vectors=n, blocks=int(blocks[-1]) + 1, pieces=FETCHED, ruled=0, ends=n + 1, links=1,
    )  # fmt: skip
    arena.set(**held, f=arena["populations"].reshape(-1), stride=layout.slot_stride)
    arena.set(n=layout.lanes, row_ghosts=layout.row_ghosts, ways=-layout.shifts[1:])
    arena.group(found=kernels.Neighbours)
    arena.reserve(pieces=arena.call(kernels.tables) + FETCHED)
    arena["masks"][...], arena["shifts"][...] = 0, 0
    arena.call(kernels.tables)
    return arena


class SparseExchange:
    """After an even step nodes beyond are fetched; what odd steps have written there goes back to their ranks."""

    def __init__(self, world: World, domain: Domain, layout: SparseLayout, arena: Arena) -> None:
        self._layout, self._slots = layout, arena["populations"]
        peers = neighbours(domain, world.rank)
        self.open = (peers[0] is not None, peers[1] is not None)
        here: list[list[Parcel]] = [[], []]  # at a parity: what this rank owns
        there: list[list[Parcel]] = [[], []]
        backs: list[Bound] = []
        for side, peer in enumerate(peers):
            if peer is None:
                continue
            # slots that nodes beyond this side read from here, and that nodes of this side read from beyond
            outwards = [i for i in range(layout.lattice.q) if storage_order(layout.lattice, i)[0] == (-1, 1)[1 - side]]
            inwards = [i for i in range(layout.lattice.q) if storage_order(layout.lattice, i)[0] == (-1, 1)[side]]
            send, receive = (Channel.POPULATIONS_UP, Channel.POPULATIONS_DOWN)[:: 1 if side else -1]
            plane = layout.planes - 1 if side else 0
            own = self._plane(plane)
            beyond = slice(*np.cumsum(layout.beyond[layout.planes + 1 if side else 0]))
            here[0].append(Parcel(peer, send, [self._slots[i, own] for i in outwards]))
            there[0].append(Parcel(peer, receive, [self._slots[i, beyond] for i in inwards]))
            buffer = aligned_zeros((len(outwards), own.stop - own.start), self._slots.dtype)
            here[1].append(Parcel(peer, send, [self._slots[i, beyond] for i in inwards]))
            there[1].append(Parcel(peer, receive, [buffer]))
            place = {"strides": layout.strides, "shifts": layout.shifts, "plane": plane}
            backs.append(arena.bind(kernels.returned, buffer=buffer, ways=np.array(outwards, np.int64), **place))
        self.messages = [Pieces(world, here[parity], there[parity], stride=2) for parity in range(2)]
        self.unpacks: list[list[Bound]] = [[], backs]

    def _plane(self, plane: int) -> slice:
        """Positions of the nodes of an own plane."""
        start = int(self._layout.first[plane]) * self._layout.lanes
        return slice(start, start + int(np.count_nonzero(self._inner(plane) >= 0)))

    def _inner(self, plane: int) -> NDArray[np.int32]:
        ghosts = self._layout.row_ghosts
        return self._layout.positions[plane + 1, ghosts : self._layout.positions.shape[1] - ghosts, 1:-1]

    def at(self, iteration: int) -> None:
        """The next launch begins at this iteration."""
        tell_iteration(self.messages, iteration)

    def free(self) -> None:
        for pieces in self.messages:
            pieces.free()
