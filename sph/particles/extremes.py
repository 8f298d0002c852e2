"""The largest values of all particles, and the box that holds the fluid: what the time step and guards look at."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.world import World
from sph.particles.storage import Storage
from sph.particles.tasks import Tasks
from sph.setup.scene import Scene

Corners = tuple[NDArray[np.float64], NDArray[np.float64]]


class Extremes(NamedTuple):
    """Largest |v| m/s and |rho - rho0| kg/m3 of fluid and walls and |a| m/s2 of the fluid, inf where one is not a
    number; the corners of the box around all fluid, m, in physical axes.
    """

    speed: float
    acceleration: float
    density_error: float
    box: Corners

    @property
    def finite(self) -> bool:
        """True if all three are numbers."""
        return bool(np.isfinite(self[:3]).all())


def extremes(scene: Scene, world: World, tasks: Tasks, largest: Callable) -> Extremes:
    """Extremes of the state of which the last pair sums are, by the kernel `largest`. Collective."""
    tasks.each(largest)
    found = tasks.arena["part_extremes"]
    own = np.full(found.shape[1], np.inf) if np.isnan(found).any() else found.max(axis=0)
    worst = world.max_array(own)
    speed, acceleration = (float(np.sqrt(square)) for square in worst[:2])
    return Extremes(speed, acceleration, float(worst[2]), _corners(scene, worst[3:]))


def fluid_box(scene: Scene, world: World, storage: Storage) -> Corners:
    """Corners of the box around all fluid, m, in physical axes. Collective."""
    x = storage.x[:, storage.fluid_slots]
    return _corners(scene, world.max_array(np.concatenate([-x, x]).max(axis=1, initial=-np.inf)))


def _corners(scene: Scene, reach: NDArray[np.float64]) -> Corners:
    """Corners in physical axes from the largest -x and x of the fluid, [2 d] in storage axes."""
    axes, d = list(scene.axes), scene.dimensions
    low, high = np.empty(d), np.empty(d)
    low[axes], high[axes] = scene.low[axes] - reach[:d], scene.low[axes] + reach[d:]
    return low, high
