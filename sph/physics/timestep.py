"""Where a run is in time, and the length of a step (MP, SC: Courant condition modified for viscosity; Monaghan 1992 for
forces).
"""

import math
from dataclasses import dataclass

from hpcpic.core.errors import Diverged
from sph.case.config import SphConfig
from sph.physics.equation_of_state import EquationOfState
from sph.physics.liquids import liquids_of
from sph.physics.stability import MAX_FORCE_STEP, physical_viscosity, viscous_limit


@dataclass(slots=True)
class Clock:
    """Steps done, the time they have led to and the length of the last one (or of the one that is being done), s."""

    step: int = 0
    time: float = 0.0
    time_step: float = 0.0

    def diverged(self, reason: str) -> Diverged:
        """The error that ends a run here."""
        return Diverged(f"step {self.step}, t = {self.time:.6g} s: {reason}")


class TimeStep:
    """dt = least of the acoustic, viscous and force criteria, or the fixed one; and of what particles may move.

    reach: the farthest a particle may move in a step, m; inf where neighbours are only needed at its start.
    """

    def __init__(self, config: SphConfig, eos: EquationOfState, reach: float) -> None:
        self.fixed = config.simulation.time_step
        self.h, self.cfl, self.reach = config.h, config.simulation.cfl or 0.0, reach
        self.eos, self.swiftest = eos, liquids_of(config).swiftest
        nu = physical_viscosity(config)
        self.viscous = viscous_limit(config) * config.h**2 / nu if nu else math.inf

    def __call__(self, speed: float, acceleration: float, drho: float) -> float:
        """dt in s for the largest |v|, |a| and |rho - rho0| of all particles."""
        if self.fixed:
            return self.fixed
        force = MAX_FORCE_STEP * math.sqrt(self.h / acceleration) if acceleration > 0 else math.inf
        travel = self.reach / speed if speed > 0 else math.inf
        return min(self.cfl * self.h / (self.eos.sound_speed(drho) * self.swiftest), self.viscous, force, travel)
