"""Ghosts: particles of this rank and of others seen through maps x -> turn x + shift: the identity for those next to a
slab, shifts for periodic sides, reflections for walls that mirror. The owner of a particle knows who needs which of its
images.
"""

from itertools import pairwise
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.ghosts import Refresh
from hpcpic.core.comm.tags import Channel
from sph.kernels.groups import Turns
from sph.kernels.marks import FLOWS, OWN, REAL
from sph.particles.images import Maps
from sph.particles.slabs import Slabs
from sph.particles.storage import Slots, Storage

NEAREST = 0.1  # spacings to a wall, for the slope of a velocity there


class Ghosts:
    """The ghosts of this rank are in `slots`. It sends those of `sources`, which are own particles, through the maps of
    number `codes` (0: the identity), which shift them by `shift` [n, d] m.

    `motion`: the kernels of that name.
    """

    def __init__(self, storage: Storage, motion: ModuleType, maps: Maps) -> None:
        self.storage, self.motion, self.maps = storage, motion, maps
        self.slots = self.sources = self.codes = np.zeros(0, np.int64)
        self.shift = np.zeros((0, storage.d))
        self._refresh = Refresh(storage.world, Channel.GHOSTS)

    @property
    def none_anywhere(self) -> bool:
        """True if neither ranks nor maps make ghosts."""
        return self.storage.world.size == 1 and len(self.maps.planes) == 1

    def forget(self) -> None:
        """Take out all ghosts."""
        self.storage.remove_ghosts(self.slots)
        self.slots = self.sources = self.codes = self.slots[:0]

    def sorted(self, place: NDArray[np.int32]) -> None:
        """The cells have put what was in each slot into place[slot]."""
        self.sources, self.slots = (place[slots].astype(np.int64) for slots in (self.sources, self.slots))

    def choose(self, layer: NDArray[np.int32], slabs: Slabs) -> None:
        """Find who is seen where from now on: layer[slot] of own particles, of others -1. Collective."""
        storage, rank = self.storage, slabs.world.rank
        sources, codes = self._imaged(layer)
        self.forget()
        if slabs.peers:
            beside = np.flatnonzero(slabs.beside[layer] & (layer >= 0))
            sources, codes = np.concatenate([beside, sources]), np.concatenate([np.zeros_like(beside), codes])
        if slabs.world.size == 1 and not len(sources):
            return
        shift = self.maps.shifts(codes, storage.x[:, sources])
        members = {rank: np.arange(len(sources))}
        if slabs.peers:
            at = np.sum(self.maps.turns[codes, 0] * storage.x[:, sources].T, axis=1) + shift[:, 0]
            seen_in = np.where(codes > 0, slabs.grid.layer(at), layer[sources])
            members = _seen_by(seen_in, codes > 0, slabs)
        order = np.concatenate(list(members.values()))
        self.sources, self.codes, self.shift = sources[order], codes[order], shift[order]
        ends = np.cumsum([0, *map(len, members.values())])
        places = {peer: np.arange(*span) for peer, span in zip(members, pairwise(ends))}
        self.slots = storage.extend(self._refresh.choose(places, slabs.peers))
        self._identify()

    def _imaged(self, layer: NDArray[np.int32]) -> tuple[Slots, NDArray[np.int64]]:
        """Slots of own particles that have images, and the maps of these; mostly not many more than the last time."""
        room, bounds = len(self.sources) + len(self.sources) // 8, self.maps.bounds
        while True:
            slots, codes = np.empty((2, room), np.int64)
            n = self.motion.imaged(layer, self.storage.x, *bounds, slots, codes)
            if n <= room:
                return slots[:n], codes[:n]
            room = n

    def _identify(self) -> None:
        """Send what of the ghosts does not change with time: key, flags, mass. Collective."""
        storage, mirrored = self.storage, np.array(self.maps.mirrored)[self.codes]
        flags = storage.flags[self.sources] & ~OWN
        flags = np.where(self.codes > 0, flags & ~REAL, flags) & ~np.where(mirrored, FLOWS, 0)
        mass = storage.m[self.sources].view(np.int64)
        self._refresh.start(0, np.stack([storage.key[self.sources] + self.codes, flags, mass], axis=1))
        found = self._refresh.finish()
        storage.key[self.slots], storage.flags[self.slots] = found[:, 0], found[:, 1]
        storage.m[self.slots] = np.ascontiguousarray(found[:, 2]).view(np.float64)

    def refresh(self, iteration: int) -> None:
        """Send x, v, drho and, where they are kept, gradient, shear and matrix of the ghosts, as they are now.
        Collective.
        """
        storage, maps = self.storage, self.maps
        if storage.world.size == 1 and not len(self.slots):
            return
        shown = storage.arena.value("shown")
        kept = sum(len(lines) for lines in (shown.gradient, shown.shear, shown.matrix) if lines.size)
        values = np.empty((len(self.sources), 2 * storage.d + 1 + kept))
        turns = Turns(maps.turns, maps.spin, maps.push)
        near = np.array([NEAREST * storage.scene.spacing, storage.scene.c0 / storage.scene.h])
        self.motion.ghost_values(self.sources, self.codes, self.shift, turns, shown, near, values)
        self._refresh.start(iteration, values)
        self.motion.take_ghosts(self._refresh.finish(), self.slots, shown)


def _seen_by(layer: NDArray, image: NDArray[np.bool_], slabs: Slabs) -> dict[int, NDArray[np.int64]]:
    """By rank, which of those in or beside its layers it has as ghosts (layer[n]); images only of its own."""
    members, last, me = {}, len(slabs.owner) - 1, slabs.world.rank
    for peer in sorted({*slabs.peers, me}):
        seen = np.zeros(len(layer), bool)
        for near in (layer - 1, layer, layer + 1):
            seen |= slabs.owner[np.clip(near, 0, last)] == peer
        members[peer] = np.flatnonzero(seen if peer != me else seen & image)
    return members
