"""Ghosts: particles of this rank and of others seen through maps x -> turn x + shift: the identity for those next to a
slab, shifts for periodic sides, reflections for walls that mirror. The owner of a particle knows who needs which of its
images.
"""

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.ghosts import Refresh
from hpcpic.core.comm.tags import Channel
from hpcpic.core.simd.generate import specialise
from sph.kernels.ghosts import NAMES
from sph.particles.images import Maps
from sph.particles.slabs import PADS, Slabs
from sph.particles.storage import Storage

NEAREST = 0.1  # spacings to a wall, for the slope of a velocity there
Numbers = NDArray[np.int32]


class Ghosts:
    """The ghosts of this rank are in `slots`. It shows images of number `codes` (0: the identity) of own particles in
    the slots `sources`, which are shifted by `shift` [n, d] m.
    """

    def __init__(self, storage: Storage, maps: Maps) -> None:
        self.storage, self.maps, scene = storage, maps, storage.scene
        self.kernels = specialise("sph.kernels", ["ghosts"], DIM=storage.d)
        self.slots = self.sources = self.codes = np.zeros(0, np.int32)
        self.shift = np.zeros((0, storage.d))
        shown = storage.arena.value("shown")
        kept = sum(len(lines) for lines in (shown.gradient, shown.own, shown.shear, shown.matrix) if lines.size)
        self._columns = 2 * storage.d + 1 + kept
        self._near = np.array([NEAREST * scene.spacing, scene.c0 / scene.h])
        self._refresh = Refresh(storage.world, Channel.GHOSTS)

    @property
    def none_anywhere(self) -> bool:
        """True if neither ranks nor maps make ghosts."""
        return self.storage.world.size == 1 and len(self.maps.planes) == 1

    def forget(self) -> None:
        """Take out all ghosts."""
        self.storage.remove_ghosts(self.slots)
        self.slots = self.sources = self.codes = self.slots[:0]

    def sorted(self, place: Numbers) -> None:
        """The cells have put what was in each slot into place[slot]."""
        self.sources, self.slots = place[self.sources], place[self.slots]

    def choose(self, iteration: int, layer: Numbers, slabs: Slabs) -> None:
        """Find who is seen where from now on, and show them: layer[slot] of own particles, of others -1. Collective."""
        seers = self._find(layer, slabs)
        self.storage.remove_ghosts(self.slots)
        ranks = slabs.world.rank, *slabs.peers
        members = {rank: np.flatnonzero(seers & (1 << k)) for k, rank in enumerate(ranks)}
        found = self._refresh.choose_and_send(iteration, members, slabs.peers, self._values(NAMES))
        self.slots = self.storage.extend(len(found)).astype(np.int32)
        self.kernels.take(found, self.slots, self.storage.arena.value("shown"))

    def _find(self, layer: Numbers, slabs: Slabs) -> NDArray[np.int64]:
        """Set sources, codes and shift; bits of the ranks that see them, mostly not many more than the last time."""
        room, grid = len(self.sources) + len(self.sources) // 8, slabs.grid
        lines, centre = np.array([grid.scale[0], PADS, grid.layers]), np.empty(self.storage.d)
        while True:
            sources, codes = np.empty((2, room + 1), np.int32)
            shift, seers = np.empty((room + 1, self.storage.d)), np.empty(room + 1, np.int64)
            seen = sources, codes, shift, seers
            n = self.kernels.choose(layer, self.storage.x, self.maps.images, lines, slabs.spans, centre, *seen)
            if n <= room:
                self.sources, self.codes, self.shift = sources[:n], codes[:n], shift[:n]
                return seers[:n]
            room = n

    def _values(self, more: int = 0) -> NDArray[np.float64]:
        """What the images show now, with room for their names."""
        values, shown = np.empty((len(self.sources), self._columns + more)), self.storage.arena.value("shown")
        self.kernels.show(self.sources, self.codes, self.shift, self.maps.images, shown, self._near, values)
        return values

    def refresh(self, iteration: int) -> None:
        """Send x, v, drho and, where they are kept, gradient, own, shear and matrix of the ghosts, as they are
        now. Collective.
        """
        if self.storage.world.size > 1 or len(self.slots):
            self._refresh.start(iteration, self._values())
            self.kernels.take(self._refresh.finish(), self.slots, self.storage.arena.value("shown"))
