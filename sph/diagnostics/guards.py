"""What tells a run that is no solution: speeds, steps, places, densities, the energy. All but the energy are looked at
in every step, from extremes that the time step needs anyhow.
"""

import logging
import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.errors import Diverged
from sph.kernels.marks import CODES
from sph.particles.walls import through_wall
from sph.physics import stability
from sph.setup.tanks import sides

if TYPE_CHECKING:
    from sph.step import Sph

SLOW = 7.0  # c0 over the largest velocity, below which the fluid is told to be compressible
SHORTEST = 1e-2  # of the step at the start: the fluid would cross h in it only from an acceleration of 1e4 times c0^2/h
MACH = 1 / 3  # of the root mean square of the speeds: the largest speed that c0 may be chosen for
GROWTH = 1.0  # of the kinetic energy of all fluid at eos.max_velocity, by which the total energy may grow
LATE = 100  # steps after which the energy is seen again, written or not; it costs a tenth of a step

log = logging.getLogger("hpcpic.sph")


class Runaway:
    """Watches the fluid of a run."""

    def __init__(self, sph: "Sph") -> None:
        scene, config = sph.scene, sph.scene.config
        self.sph, self.scene = sph, scene
        self.shortest = SHORTEST * stability.time_step(config)
        self.size = float(np.sqrt(np.sum((scene.high - scene.low) ** 2)))
        self.domain = [*zip(scene.low.tolist(), scene.high.tolist())]
        self.sides = [(wall.index, side) for wall in scene.walls for side in sides(wall)]
        self.conserving = "energy_total" in config.conserved
        self.fastest = config.eos.max_velocity or 0.0
        self.first: float | None = None
        self.seen, self.told = sph.iteration, False
        self.energy: str | None = None
        self.leak: str | None = None

    def see(self, speed: float, acceleration: float, density: float) -> None:
        """The largest |v|, |a| and |rho - rho0| of a step that is about to be done. Collective; raises Diverged."""
        sph, scene = self.sph, self.scene
        wall = float(np.sqrt(np.sum(sph.walls.velocity**2, axis=1)).max()) if sph.walls.moving else 0.0
        most = max(scene.c0, wall)
        if speed > most:
            who = self.culprit(_lengths(sph.bodies.v[:, sph.bodies.fluid]))
            cause = "a numerical instability, or a fall that eos.max_velocity does not know of"
            self.end(f"{who} moves at {speed:.4g} m/s, faster than sound ({scene.c0:.4g} m/s): {cause}")
        box = [*zip(sph.box[0].tolist(), sph.box[1].tolist())]
        away = max(max(a - low, high - b) for (low, high), (a, b) in zip(box, self.domain))
        if away > self.size + most * sph.time:
            x = sph.bodies.x[:, sph.bodies.fluid] + sph.origin[:, None]
            who = self.culprit(_lengths(x))
            self.end(f"{who} is {away:.4g} m outside the domain, farther than sound has run: a damaged position")
        if sph.time_step < self.shortest:
            self._too_short(acceleration, density)
        if speed * SLOW > scene.c0 and speed > wall:
            self._tell(speed)
        if self.sides and not self.leak and self._outside(box):
            self.leak = through_wall(sph, sph.bodies.fluid)

    def _outside(self, box: list[tuple[float, float]]) -> bool:
        """Whether fluid, all of which the box holds, is behind a side of an open tank: over its edge, or through it."""
        for index, (axis, sign, place) in self.sides:
            shift = sign * self.sph.walls.displacement[index, axis] if self.sph.walls.moving else 0.0
            if sign * box[axis][sign > 0] > place + shift:
                return True
        return False

    def no_number(self) -> None:
        """The particle with the first velocity, acceleration or density that is none. Collective; raises Diverged."""
        rows = self.sph.bodies.fluid
        values = _lengths(self.sph.bodies.v[:, rows])
        most = float(np.where(np.isnan(values), np.inf, values).max(initial=0.0))
        if self.sph.world.max(most) <= self.scene.c0:
            values = _lengths(self._accelerations()) + np.abs(self.sph.bodies.drho[rows])
        who = self.culprit(values)
        self.end(f"a velocity, acceleration or density is not a finite number, the largest are those of {who}")

    def _accelerations(self) -> NDArray[np.float64]:
        """[d, n] of the fluid, m/s2."""
        sph, rows = self.sph, self.sph.bodies.fluid
        return sph.sums.forces_on(rows) / sph.bodies.m[rows] + sph.tasks.arena["external"][:, None]

    def _too_short(self, acceleration: float, density: float) -> None:
        who = self.culprit(_lengths(self._accelerations()))
        text = f"the time step has fallen to {self.sph.time_step:.3g} s, below {SHORTEST:g} of that at the start"
        more = f"by {acceleration:.3g} m/s2, densities by {density / self.scene.rho0:.2g} rho0"
        self.end(f"{text}: {who} is accelerated {more}: a numerical instability")

    def culprit(self, values: NDArray[np.float64]) -> str:
        """The particle of the fluid whose value is largest (one value for each of bodies.fluid). Collective."""
        sph = self.sph
        rows, world = sph.bodies.fluid, sph.world
        values = np.where(np.isnan(values), np.inf, values)
        top = world.max(float(values.max(initial=-np.inf)))
        worst = rows[values == top]
        numbers = sph.bodies.key[worst] // CODES
        number = int(world.max(float(numbers.max(initial=-1))))
        x = np.full((1, self.scene.dimensions), -np.inf)
        if number in numbers:
            x = sph.physical("x", worst[numbers == number])
        place = ", ".join(f"{value:.4g}" for value in world.max_array(x[0]))
        return f"particle {number} at ({place}) m"

    def end(self, text: str) -> None:
        raise Diverged(f"step {self.sph.iteration}, t = {self.sph.time:.6g} s: {text}")

    def _tell(self, speed: float) -> None:
        """A warning, once, when the sound speed is too low for what has come about in the fluid."""
        if not self.told and self.sph.world.rank == 0:
            words = "fluid at %.3g m/s at t = %.3g s: c0 is %.2g times that (below %g densities are off by 2 %%)"
            log.warning(words + "; larger eos.max_velocity", speed, self.sph.time, self.scene.c0 / speed, SLOW)
        self.told = True

    def see_energy(self, kinetic: float, total: float, mass: float) -> None:
        """The energies in J and the mass in kg of all fluid, which a series or the guard has summed."""
        self.seen = self.sph.iteration
        if not self.first and math.isfinite(total):
            self.first = total
        speed = math.sqrt(2.0 * kinetic / mass) if mass else 0.0
        usual = 0.5 * mass * self.fastest**2
        if speed > MACH * self.scene.c0:
            self.energy = f"the mean speed of all fluid is {speed:.3g} m/s, {speed / self.scene.c0:.2g} c0"
        elif self.conserving and self.first is not None and total - self.first > GROWTH * usual:
            self.energy = f"the total energy grew from {self.first:.4g} J to {total:.4g} J: a numerical instability"

    def trouble(self) -> str | None:
        """Why this rank's state is no solution, or None. Collective where no series has looked at the energy lately."""
        sph, bodies = self.sph, self.sph.bodies
        x, v = bodies.x[:, : bodies.end], bodies.v[:, : bodies.end]
        if not (np.isfinite(x).all() and np.isfinite(v).all()):
            return "a position or velocity is not a finite number"
        if sph.iteration - self.seen >= LATE:
            (kinetic, potential, internal, mass, *_), _ = sph.totals.find()
            self.see_energy(kinetic, kinetic + potential + internal, mass)
        if not np.abs(sph.impulses).max(initial=0.0) <= self._most_impulse():
            return "the impulse of the fluid on a wall is beyond what pressures of rho0 c0^2 could have given"
        return self.leak or self.energy or through_wall(sph, bodies.fluid)

    def _most_impulse(self) -> float:
        """Of pressures rho0 c0^2 on the sides of all particles since the start, N s."""
        scene = self.scene
        area = 2 * scene.dimensions * scene.n_fluid * scene.spacing ** (scene.dimensions - 1)
        return area * scene.rho0 * scene.c0 * (scene.c0 * self.sph.time + scene.h)


def _lengths(vectors: NDArray) -> NDArray[np.float64]:
    return np.hypot.reduce(vectors, axis=0)
