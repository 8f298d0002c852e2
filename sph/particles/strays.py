"""Particles torn off the fluid.

The density of a particle is the history of its neighbours. One that is left with few of them has no such history: where
its density is beyond what a weakly compressible fluid can have it gets that of rest, and goes on as a drop does, under
gravity and before walls, until it falls back. Its mass stays. Among enough neighbours such a density is a divergence.
Only fluid counts, against what there is room for before walls: a drop that strikes a wall is alone. Between a rigid
body and another solid there is as much room as anywhere: a film of a layer or two is no fluid around a particle.

Spray, a drop or a few, cannot pull at a wall: where its density is below that of rest it gets that of rest. By its
tension it stuck to walls, swung through their surface, ever faster, and flew off with half the sound speed.
"""

import logging

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.world import World
from sph.kernels.marks import BODY, WALL_SHIFT
from sph.particles.storage import Slots, Storage
from sph.physics.stray_limits import (
    FREE_NEIGHBOUR_SHARE,
    LIMIT,
    MAX_DENSITY_ERROR,
    SPRAY_NEIGHBOUR_SHARE,
    SPRAY_TENSION,
    full_neighbourhood,
    most_strays,
)
from sph.physics.timestep import Clock
from sph.setup.scene import Scene

LEAST_ROOM = 0.1  # of a neighbourhood: in the corner of a box it is an eighth

log = logging.getLogger("hpcpic.sph")


class Strays:
    """Particles torn off so far (`count`, of all ranks), and the numbers of those that get the density of rest in the
    present step on this rank: what is torn off, and spray.
    """

    def __init__(self, scene: Scene, world: World, clock: Clock, storage: Storage) -> None:
        self.scene, self.world, self.clock, self.storage = scene, world, clock, storage
        self.count, self.most = 0, most_strays(scene.n_fluid)
        self.rigid = [wall.index + 1 for wall in scene.walls if wall.rigid]
        self.full = full_neighbourhood(scene.config)
        self.few = int(SPRAY_NEIGHBOUR_SHARE * self.full)
        self._numbers = np.zeros(0, np.int64)

    def find(self, density_error: float) -> None:
        """Look for spray and strays if the largest |rho - rho0| of fluid and walls is beyond the limits. Collective;
        raises Diverged for a stray inside the fluid, or for too many.
        """
        storage, rho0 = self.storage, self.scene.rho0
        self._numbers = self._numbers[:0]
        if density_error < SPRAY_TENSION * rho0:
            return
        slots = storage.fluid_slots
        low = slots[storage.drho[slots] <= -SPRAY_TENSION * rho0]
        self._numbers = storage.numbers(low[storage.with_few(low, self.few)])
        if density_error >= LIMIT * rho0:
            self._numbers = np.append(self._numbers, self._torn_off(slots))

    def _torn_off(self, slots: Slots) -> NDArray[np.int64]:
        """Numbers of the strays in some slots, those of the fluid. Collective."""
        storage, rho0 = self.storage, self.scene.rho0
        excess = np.abs(storage.drho[slots]) / rho0
        beyond = excess >= LIMIT
        n = int(self.world.sum_int(np.array([np.count_nonzero(beyond)]))[0])
        limits = f"beyond {1 - MAX_DENSITY_ERROR:g} .. {1 + MAX_DENSITY_ERROR:g} rho0"
        if n > self.most:
            most = f"(one step's strays: {self.most}), most of {storage.culprit(excess)}"
            raise self.clock.diverged(f"the density of {n} particles is {limits} {most}")
        share = np.zeros(len(slots))
        share[beyond] = self._shares(slots[beyond])
        if self.world.max(float(share.max(initial=0.0))) >= FREE_NEIGHBOUR_SHARE:
            self._end(share, limits)
        self._tell(n)
        return storage.numbers(slots[beyond])

    def _end(self, share: NDArray, limits: str) -> None:
        storage, rho0 = self.storage, self.scene.rho0
        who = storage.culprit(share)
        excess = storage.drho[storage.fluid_slots][share >= FREE_NEIGHBOUR_SHARE] / rho0
        worst = self.world.max_array(np.array([excess.max(initial=-np.inf), -excess.min(initial=np.inf)]))
        value = 1 + (worst[0] if worst[0] > worst[1] else -worst[1])
        cause = "a numerical instability, or a fluid faster than eos.max_velocity"
        text = f"the density of {who} is {value:.3g} rho0, {limits}, inside the fluid: {cause}"
        raise self.clock.diverged(text)

    def _shares(self, slots: Slots) -> list[float]:
        """How much fluid there is within the support of each of these, of what there is room for."""
        storage, support = self.storage, self.scene.support
        every = np.flatnonzero(storage.flags[: storage.end] & BODY)
        x, of = storage.x[:, every], storage.key[every] >> WALL_SHIFT
        found = []
        for slot in slots:
            close = np.flatnonzero(np.abs(x[0] - storage.x[0, slot]) < support)
            apart = x[:, close] - storage.x[:, slot, None]
            near = of[close[np.sum(apart * apart, axis=0) < support**2]]
            fluid = np.count_nonzero(near == 0)
            between = len(np.unique(near)) > 2 and np.isin(near, self.rigid).any()
            room = self.full if between else max(self.full - (len(near) - fluid), LEAST_ROOM * self.full)
            found.append(float(fluid - 1) / room)
        return found

    def settle(self) -> None:
        """Give those found in this step the density of rest; before particles change ranks."""
        if len(self._numbers):
            slots = self.storage.fluid_slots
            self.storage.drho[slots[np.isin(self.storage.numbers(slots), self._numbers)]] = 0.0

    def _tell(self, n: int) -> None:
        """Warn of the first, and each time there are twice as many."""
        before, self.count = self.count, self.count + n
        if n and self.world.rank == 0 and self.count >= 2 * before:
            log.warning(
                "%d stray particles until t = %.3g s, torn off with a density beyond %g .. %g rho0: they got rho0",
                self.count, self.clock.time, 1 - MAX_DENSITY_ERROR, 1 + MAX_DENSITY_ERROR,
            )  # fmt: skip
