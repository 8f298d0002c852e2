"""The length of a step (MP, SC: Courant condition modified for viscosity; Monaghan 1992 for forces)."""

import math
from typing import TYPE_CHECKING

from sph.physics.stability import FORCE, PHYSICAL, viscous_limit

if TYPE_CHECKING:
    from sph.setup.scene import Scene


class TimeStep:
    """dt = least of the acoustic, viscous and force criteria, or the fixed one; and of what particles may move.

    reach: the farthest a particle may move in a step, m; inf where neighbours are only needed at its start.
    """

    def __init__(self, scene: "Scene", reach: float) -> None:
        config = scene.config
        self.fixed = config.simulation.time_step
        self.h, self.cfl, self.reach = scene.h, config.simulation.cfl, reach
        self.c0, self.rho0, self.gamma = scene.c0, scene.rho0, scene.gamma
        nu = scene.viscosity / scene.rho0 if config.numerics.viscosity_form in PHYSICAL else 0.0
        self.viscous = viscous_limit(config) * scene.h**2 / nu if nu else math.inf

    def __call__(self, speed: float, acceleration: float, drho: float) -> float:
        """dt in s for the largest |v|, |a| and |rho - rho0| of all particles."""
        if self.fixed:
            return self.fixed
        sound = self.c0 * (1.0 + drho / self.rho0) ** ((self.gamma - 1.0) / 2.0)
        force = FORCE * math.sqrt(self.h / acceleration) if acceleration > 0 else math.inf
        travel = self.reach / speed if speed > 0 else math.inf
        return min(self.cfl * self.h / sound, self.viscous, force, travel)
