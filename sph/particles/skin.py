"""How far particles may move until their neighbours are found again: a Verlet skin that follows their speed."""

import numpy as np

from hpcpic.core.errors import Diverged
from sph.setup.scene import Scene

MAX_WAY = 0.15  # of c0 times a step of Courant number cfl: particles of integrators with stages move no farther
SPARE = 1.15  # neighbours are known for this much more than the way of the last step
MIN_REACH = 2e-3  # and for so many h
ROUNDING = 1e-9  # of the support
BODY_WAY = 0.25  # spacings: jets from under a body that lands meet its particles in some steps, and walls on the way


class Skin:
    """`reach`: how far particles may move in the present step, m; `next_reach` in the next one; `farthest`: in any,
    0 where an integrator evaluates only where neighbours were found.
    """

    def __init__(self, scene: Scene, staged: bool) -> None:
        self.h, self.support = scene.h, scene.support * (1 + ROUNDING)
        self.farthest = MAX_WAY * (scene.config.simulation.cfl or 0.0) * scene.h if staged else 0.0
        self.most = BODY_WAY * scene.spacing if any(wall.rigid for wall in scene.walls) else np.inf
        self.reach = self.next_reach = min(MIN_REACH * scene.h, self.farthest)

    @property
    def largest_radius(self) -> float:
        """Within which neighbours are ever looked for, m: the edge of a cell."""
        return self.support + 2 * self.farthest

    @property
    def radius(self) -> float:
        """Within which neighbours of the present step are, m."""
        return self.support + 2 * self.reach

    @property
    def step_limit(self) -> float:
        """The farthest a particle may move in a step, m."""
        return min(self.farthest or np.inf, self.most)

    def check(self) -> None:
        """Raise Diverged for a reach that cannot be, as a damaged checkpoint may have it."""
        if not 0.0 <= self.reach <= self.farthest * (1 + ROUNDING):
            known = f"0 .. {self.farthest:.4g} m"
            raise Diverged(f"neighbours are known for {self.reach:.4g} m of their way, which is not within {known}")

    def suffices(self, dt: float, speed: float, acceleration: float) -> bool:
        """True if neighbours are known as far as a step of dt s takes particles at the largest speed and acceleration.
        If not, the reach grows and they must be found again. Sets the reach of the next step: as far as that may go.
        """
        way = dt * max(speed, 0.5 * speed + 0.25 * dt * acceleration)  # of the stages where rates are evaluated
        if way > self.farthest * (1 + ROUNDING):
            raise Diverged("a particle moves farther in a step than where its neighbours are known")
        enough = way <= self.reach
        self.next_reach = min(SPARE * way + MIN_REACH * self.h, self.farthest)
        if not enough:
            self.reach = self.next_reach
        return enough
