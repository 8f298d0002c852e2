"""Particles torn off the fluid, and those that leave it for good.

The density of a particle is the history of its neighbours. One that is left with few of them has no such history: where
its density is beyond what a weakly compressible fluid can have it gets that of rest, and goes on as a drop does, under
gravity and before walls, until it falls back. Its mass stays. Among enough neighbours such a density is a divergence.
"""

import logging
import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sph.kernels.marks import BODY, CODES

if TYPE_CHECKING:
    from sph.case.config import SphConfig
    from sph.step import Sph

BEYOND = 0.3  # |rho / rho0 - 1| of no weakly compressible fluid: fluids at 0.3 c0 that meet come to 0.19
FEW = 0.5  # of the neighbours inside a fluid; beside a flat surface there are 0.6
LEAST, SHARE = 10, 0.01  # strays of one step beyond which the fluid bursts: that many, or of all particles
ROUNDING = 1e-9

log = logging.getLogger("hpcpic.sph")


def most_strays(n: int) -> int:
    """Of n particles in one step."""
    return max(LEAST, int(SHARE * n))


def full_neighbourhood(config: "SphConfig") -> float:
    """Neighbours of a particle inside the fluid."""
    reach = config.support / config.numerics.spacing
    return (math.pi * reach**2 if config.dimensions == 2 else 4 / 3 * math.pi * reach**3) - 1


class Strays:
    """How many there have been, and the numbers of those of the present step on this rank."""

    def __init__(self, sph: "Sph") -> None:
        self.sph, self.count = sph, 0
        self.most = most_strays(sph.scene.n_fluid)
        self.few = FEW * full_neighbourhood(sph.scene.config)
        self._found = np.zeros(0, np.int64)

    def find(self, density: float) -> None:
        """Look for them if the largest |rho - rho0| of fluid and walls is beyond. Collective; raises Diverged."""
        sph, rho0 = self.sph, self.sph.scene.rho0
        self._found = self._found[:0]
        if density < BEYOND * (1 - ROUNDING) * rho0:
            return
        rows = sph.bodies.fluid
        excess = np.abs(sph.bodies.drho[rows]) / rho0
        beyond = excess >= BEYOND * (1 - ROUNDING)
        n = int(sph.world.sum_int(np.array([np.count_nonzero(beyond)]))[0])
        limits = f"beyond {1 - BEYOND:g} .. {1 + BEYOND:g} rho0"
        if n > self.most:
            who = sph.runaway.culprit(excess)
            sph.runaway.end(f"the density of {n} particles is {limits} (one step's strays: {self.most}), most of {who}")
        around = np.zeros(len(rows))
        around[beyond] = self._neighbours(rows[beyond])
        fewest = sph.world.max(float(around.max(initial=0.0)))
        if fewest >= self.few:
            self._burst(around, limits)
        self._found = sph.bodies.key[rows[beyond]] // CODES
        self._tell(n)

    def _burst(self, around: NDArray, limits: str) -> None:
        sph = self.sph
        who = sph.runaway.culprit(around)
        excess = sph.bodies.drho[sph.bodies.fluid][around >= self.few] / sph.scene.rho0
        worst = sph.world.max_array(np.array([excess.max(initial=-np.inf), -excess.min(initial=np.inf)]))
        value = 1 + (worst[0] if worst[0] > worst[1] else -worst[1])
        cause = "a numerical instability, or a fluid faster than eos.max_velocity"
        sph.runaway.end(f"the density of {who} is {value:.3g} rho0, {limits}, inside the fluid: {cause}")

    def _neighbours(self, rows: NDArray[np.int64]) -> list[int]:
        """Bodies within the support of each of these."""
        bodies, support = self.sph.bodies, self.sph.scene.support
        x = bodies.x[:, np.flatnonzero(bodies.flags[: bodies.end] & BODY)]
        found = []
        for row in rows:
            near = x[:, np.abs(x[0] - bodies.x[0, row]) < support] - bodies.x[:, row, None]
            found.append(np.count_nonzero(np.sum(near * near, axis=0) < support**2) - 1)
        return found

    def settle(self) -> None:
        """The density of rest for those found in this step; before particles change ranks."""
        if len(self._found):
            bodies = self.sph.bodies
            rows = bodies.fluid
            bodies.drho[rows[np.isin(bodies.key[rows] // CODES, self._found)]] = 0.0

    def _tell(self, n: int) -> None:
        before, self.count = self.count, self.count + n
        if (
            n and self.sph.world.rank == 0 and self.count >= 2 * before
        ):  # the first, and each time there are twice as many
            words = "%d stray particles until t = %.3g s, torn off with a density beyond %g .. %g rho0: they got rho0"
            log.warning(words, self.count, self.sph.time, 1 - BEYOND, 1 + BEYOND)


class Outflow:
    """Sides of the domain through which fluid leaves for good."""

    def __init__(self, sph: "Sph") -> None:
        self.sph, self.told = sph, False
        scene = sph.scene
        self.faces = [("xyz".index(face[0]), face[1] == "+") for face in scene.config.domain.outflow]
        self.margin = 0.5 * scene.support  # more than the fluid moves in a step

    def leave(self) -> None:
        """Take out what has left; before particles change ranks."""
        sph, scene = self.sph, self.sph.scene
        for axis, up in self.faces:
            side = scene.high[axis] if up else scene.low[axis]
            if (sph.box[1][axis] + self.margin > side) if up else (sph.box[0][axis] - self.margin < side):
                rows, storage = sph.bodies.fluid, sph.axes.index(axis)
                x, at = sph.bodies.x[storage, rows], side - scene.low[axis]
                gone = rows[x > at if up else x < at]
                sph.bodies.remove(gone)
                if len(gone) and not self.told:
                    self.told = True
                    log.info("fluid leaves through %s from t = %.3g s on", "xyz"[axis] + "-+"[up], sph.time)

    def mass(self) -> float:
        """That has left so far, kg (2D: kg/m). Collective."""
        sph = self.sph
        ids, fluids = sph.bodies.key[sph.bodies.fluid] // CODES, sph.scene.fluids
        own = [np.count_nonzero((ids >= fluid.first) & (ids < fluid.first + fluid.n)) for fluid in fluids]
        left = sph.world.sum_int(np.array(own, np.int64))
        return float(sum(fluid.mass * (fluid.n - n) for fluid, n in zip(fluids, left.tolist())))
