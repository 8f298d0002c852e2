"""What integrators are made of: the rates of the state y = (x, v, rho), and its way forward in time by kernels."""

from collections.abc import Callable
from types import ModuleType

import numpy as np

from hpcpic.core.timers import Timers
from sph.particles.openings import Openings
from sph.particles.pair_sums import PairSums
from sph.particles.rigid.bodies import Bodies
from sph.particles.tasks import Tasks
from sph.particles.walls import Walls
from sph.physics.timestep import Clock
from sph.physics.waves import shift_decay


class Evolution:
    """`motion`: the kernels of that name; `evaluations`: of pair sums so far (see physics.integrators.Evolving);
    `speed`: the largest, m/s, by which particles are shifted away from where they are crowded, as far as in a step none
    overshoots.
    """

    def __init__(
        self, clock: Clock, tasks: Tasks, motion: ModuleType, sums: PairSums, walls: Walls, timers: Timers
    ) -> None:
        self.clock, self.tasks, self.motion, self.sums = clock, tasks, motion, sums
        self.walls, self.timers, self.numbers = walls, timers, tasks.arena["numbers"]
        self.evaluations, self._evaluated_at, self.speed = 0, -1, 0.0
        self.bodies: Bodies | None = None
        self.openings: Openings | None = None
        self.driven: list[Callable] = []  # kernels of accelerations of the user's own
        numerics, d = walls.scene.config.numerics, walls.scene.dimensions
        overshoot = shift_decay(numerics.kernel, d, numerics.smoothing) if sums.spec.shifting else 1.0
        self._shift_reach = walls.scene.config.h / overshoot  # m in a step

    def evaluate(self, start: bool = False) -> None:
        """Find a and D = d rho / dt of the present y; `start`: it is y^n, whose rates may be known. Collective."""
        self._sum(self.sums.everything, start)

    def evaluate_forces(self) -> None:
        """Find a of y^n, if it is not known. Collective."""
        self._sum(self.sums.forces, start=True)

    def _sum(self, sums: Callable[[int], None], start: bool) -> None:
        if not start or self._evaluated_at != self.clock.step:
            with self.timers.section("pairs"):
                self.evaluations += 1
                if not start:  # those of y^n are as they were found
                    self.sums.ghosts.refresh(self.clock.step)
                if self.sums.spec.accelerated:  # which densities of walls follow
                    axes = list(self.walls.scene.axes)
                    self.tasks.arena["wall_acceleration"][:] = self.walls.acceleration[:, axes]
                for kernel in self.driven:
                    self.tasks.each(kernel)
                sums(self.clock.step)
                if self.driven:
                    self.tasks.each(self.motion.add_own)
                if self.openings:
                    self.openings.hold(True, self.sums.rate)
                if self.bodies:
                    self.bodies.find_rates()
        self._evaluated_at = self.clock.step if start else -1

    def evaluate_rates(self) -> None:
        """Find D of rho as in `evaluate_forces`, the new v, and x half a step of it later. Collective.

        Where particles are shifted, v is the velocity they move with until they have: v + speed offset. Densities know
        of it where walls or gravity press: what flows back adds up. Elsewhere they would only be noisier.
        """
        pressed = bool(self.walls.scene.walls) or bool(np.any(self.walls.scene.gravity))
        if pressed:
            self._set_off()
        with self.timers.section("pairs"):
            self.sums.rates(self.clock.step, self.clock.time_step)
            if self.openings:
                self.openings.hold(False, self.sums.rate)
        if not pressed:
            self._set_off()

    def _set_off(self) -> None:
        if self.sums.spec.shifting:
            if self.openings:
                self.openings.still()
            self._update(self.motion.set_off, min(self.speed, self._shift_reach / self.clock.time_step))

    def forget_rates(self) -> None:
        """The rates of y^n are not known any more."""
        self._evaluated_at = -1

    def keep(self) -> None:
        """Remember y^n."""
        self._update(self.motion.keep)
        if self.bodies:
            self.bodies.keep()

    def combine(
        self, old: float, now: float, new: float, *, until: float = 1.0, with_new_velocity: bool = False
    ) -> None:
        """y = old y^n + now y + new dt f(y); the stage stands for t^n + until dt."""
        self._update(self.motion.advance, old, now, new, float(with_new_velocity), at=self.sums.rate)
        self._carry_walls(until)
        if self.bodies:
            self.bodies.combine(old, now, new, with_new_velocity)

    def kick(self) -> None:
        """v = v + dt a."""
        self._update(self.motion.kick)
        if self.bodies:
            self.bodies.kick()

    def drift(self) -> None:
        """x = x + dt v, rho = rho + dt D."""
        self._update(self.motion.drift, at=self.sums.rate)
        if self.sums.spec.shifting:
            self._update(self.motion.arrive)
        self._carry_walls(1.0)
        if self.bodies:
            self.bodies.drift()

    def wrap(self) -> None:
        """Particles behind a mirror change places with their images; x goes back into periodic sides."""
        if len(self.tasks.arena["mirrors"].normals):
            self.tasks.each(self.motion.swap)
        self.tasks.each(self.motion.rewrap)

    def _update(self, kernel: Callable, *numbers: float, **more: int) -> None:
        with self.timers.section("update"):
            self.numbers[: 1 + len(numbers)] = self.clock.time_step, *numbers
            self.tasks.each(kernel, **more)

    def _carry_walls(self, until: float) -> None:
        now = self.clock.time + until * self.clock.time_step
        if self.driven:
            self.tasks.arena["moment"][0] = now
        self.walls.carry(now, self.tasks, self.motion.carry)
