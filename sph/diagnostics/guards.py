"""What tells a run that is no solution: speeds, steps, places, densities, the energy. All but the energy are looked at
in every step, from extremes that the time step needs anyhow.
"""

import logging
import math

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.run.guard import ConservedSums
from sph.diagnostics.checksums import Checksums
from sph.diagnostics.leaks import LeakFinder
from sph.diagnostics.scalars import Totals, fluid_scalars
from sph.kernels.marks import LIQUID
from sph.particles.extremes import Extremes
from sph.particles.openings import Exchange
from sph.particles.storage import Storage
from sph.particles.wall_forces import WallForces
from sph.physics import stability
from sph.physics.timestep import Clock
from sph.setup.channel import channel_of

MIN_SOUND_RATIO = 7.0  # c0 over the largest velocity, below which the fluid is told to be compressible
SHORTEST_STEP = 1e-2  # of that at the start: the fluid crosses h in it only if accelerated by 1e4 times c0^2/h
MAX_RMS_MACH = 1 / 3  # root mean square of the speeds over c0: the largest speed that c0 may be chosen for
MAX_DRIVEN_SPEED = 1.5  # of the largest velocity that its force gives the fluid of a channel
MAX_ENERGY_GROWTH = 1.0  # of the total energy, in kinetic energies of all fluid at eos.max_velocity
ROUNDING = 8.0  # of all forces in a step, which add at most about c0 to a velocity; 1e-3 of it is seen
MUCH_GAS = 0.05  # of all, that may pull at its neighbours: less does where water starts or strikes
LOOK_PERIOD = 20  # steps between looks at which of several fluids the fast particles are, and at suction in gases
ENERGY_PERIOD = 100  # steps after which the energy is summed, written or not; it costs a tenth of a step

log = logging.getLogger("hpcpic.sph")


class Runaway:
    """Watches the fluid of a run, and ends it when its state is no solution any more."""

    def __init__(
        self, clock: Clock, storage: Storage, forces: WallForces, totals: Totals, checksums: Checksums,
        exchange: Exchange,
    ) -> None:  # fmt: skip
        scene = storage.scene
        self.clock, self.storage, self.scene, self.world = clock, storage, scene, storage.world
        self.walls, self.forces, self.leaks = forces.walls, forces, LeakFinder(storage, forces.walls)
        self.totals, self.checksums, self.exchange = totals, checksums, exchange
        self.shortest = SHORTEST_STEP * stability.time_step(scene.config)
        self.size = float(np.sqrt(np.sum((scene.high - scene.low) ** 2)))
        self.domain = [*zip(scene.low.tolist(), scene.high.tolist())]
        channel = channel_of(scene.config)
        fluids, still = scene.config.fluid, not any(wall.moving for wall in scene.walls)
        from_rest = still and not any(fluid.flow or any(fluid.velocity) for fluid in fluids)
        self.driven = channel.fastest if channel and from_rest else math.inf
        self.conserving = "energy_total" in scene.config.conserved
        momentum = tuple(name for name in scene.config.conserved if name.startswith("momentum"))
        real = np.float64 if scene.config.numerics.precision == "double" else np.float32
        self.kept = [
            ConservedSums(tuple({"mass"} & {*scene.config.conserved}), 0.0),
            ConservedSums(momentum, ROUNDING * float(np.finfo(real).eps)),
        ]
        self.exchanged = ConservedSums(("mass_total",), 4 * float(np.finfo(np.float64).eps))
        self.usual_speed = scene.config.eos.max_velocity or 0.0
        self._warned = self._told_suction = False
        self._energy_step = clock.step
        self._first_energy: float | None = None
        self._energy_trouble: str | None = None

    def look(self, now: Extremes) -> None:
        """Look at the extremes of a step that is about to be done. Collective; raises Diverged."""
        walls, storage, scene = self.walls, self.storage, self.scene
        self.checksums.compare(self.clock.step)
        fast = now.speed * MIN_SOUND_RATIO > scene.c0
        wall = walls.fastest() if fast or walls.moving else 0.0
        limit = max(scene.c0 * scene.liquids.swiftest, wall)
        if fast:
            self._look_at_speed(now.speed, wall)
        if scene.liquids.gases and self.clock.step % LOOK_PERIOD == 0 and not self._told_suction:
            self._look_at_suction()
        if now.speed > MAX_DRIVEN_SPEED * self.driven:
            who = storage.culprit(_lengths(storage.v[:, storage.fluid_slots]))
            most = f"{now.speed / self.driven:.3g} times F L^2 / (8 nu), the most that its force can give the channel"
            raise self.clock.diverged(f"{who} moves at {now.speed:.4g} m/s, {most}: a numerical instability")
        box = [*zip(now.box[0].tolist(), now.box[1].tolist())]
        away = max(max(a - low, high - b) for (low, high), (a, b) in zip(box, self.domain))
        if away > self.size + limit * self.clock.time:
            x = storage.x[:, storage.fluid_slots] + scene.low[list(scene.axes), None]
            text = f"{storage.culprit(_lengths(x))} is {away:.4g} m outside the domain, farther than sound has run"
            raise self.clock.diverged(f"{text}: a damaged position")
        if self.clock.time_step < self.shortest:
            self._end_short_step(now)
        self.leaks.look(box)

    def end_without_number(self) -> None:
        """End the run and name the particle with the first velocity, acceleration or density that is no number.
        Collective; raises Diverged.
        """
        storage, slots = self.storage, self.storage.fluid_slots
        values = _lengths(storage.v[:, slots])
        largest = float(np.where(np.isnan(values), np.inf, values).max(initial=0.0))
        if self.world.max(largest) <= self.scene.c0:
            values = _lengths(self._accelerations()) + np.abs(storage.drho[slots])
        text = "a velocity, acceleration or density is not a finite number, the largest are those of"
        raise self.clock.diverged(f"{text} {storage.culprit(values)}")

    def _look_at_suction(self) -> None:
        """Warn once if much of a gas is so far below its pressure of rest that its particles leave gaps. Collective."""
        eos, slots = self.scene.eos, self.storage.fluid_slots
        excess = self.storage.drho[slots][self.storage.is_gas(slots)]
        sucked = eos.pressure(excess) < -eos.background
        torn, all_gas = self.world.sum_int(np.array([np.count_nonzero(sucked), len(sucked)])).tolist()
        if torn > MUCH_GAS * all_gas:
            self._told_suction = True
            if self.world.rank == 0:
                part, words = 100 * torn / all_gas, "%.2g %% of the gas is farther below ambient at t = %.3g s than"
                more = " eos.background_pressure = %.3g holds together: gaps open in it"
                log.warning(words + more, part, self.clock.time, eos.background)

    def _mach_numbers(self, wall: float) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Speeds [n] of the fluid over the sound speed of rest of its liquid, 0 of what is no faster than walls, m/s;
        what is gas [n].
        """
        storage, slots = self.storage, self.storage.fluid_slots
        speeds, swift = _lengths(storage.v[:, slots]), self.scene.liquids.table[1, storage.flags[slots] >> LIQUID]
        return np.where(speeds > wall, speeds, 0.0) / (self.scene.c0 * swift), storage.is_gas(slots)

    def _look_at_speed(self, fastest: float, wall: float) -> None:
        """Warn once if it is fluid that comes near the sound speed, and end the run if it is faster than that and than
        walls, m/s; fastest: of all particles. Each of several fluids has a sound speed of its own; to warn they are
        told apart every LOOK_PERIOD steps, to end the run in each. Collective.
        """
        c0, liquids = self.scene.c0, self.scene.liquids
        if fastest <= wall:
            return
        mach = of_liquids = fastest / c0
        if liquids.densities:
            if self.clock.step % LOOK_PERIOD and fastest <= c0:
                return
            found, gas = self._mach_numbers(wall)
            most = np.array([found.max(initial=0.0), found[~gas].max(initial=0.0)])
            mach, of_liquids = self.world.max_array(most).tolist()
        if mach > 1.0:
            text = f"{self.storage.culprit(self._mach_numbers(wall)[0])} is faster than sound, {mach:.4g} times as fast"
            cause = "a numerical instability, or a fall that eos.max_velocity does not know of"
            raise self.clock.diverged(f"{text}: {cause}")
        if of_liquids * MIN_SOUND_RATIO > 1.0:
            self._warn(of_liquids * c0)

    def _accelerations(self) -> NDArray[np.float64]:
        """Accelerations of the fluid [d, n], m/s2."""
        storage, slots = self.storage, self.storage.fluid_slots
        return self.forces.sums.forces_on(slots) / storage.m[slots] + storage.arena["external"][:, None]

    def _end_short_step(self, now: Extremes) -> None:
        who = self.storage.culprit(_lengths(self._accelerations()))
        text = f"the time step has fallen to {self.clock.time_step:.3g} s, below {SHORTEST_STEP:g} of that at the start"
        more = f"by {now.acceleration:.3g} m/s2, densities by {now.density_error / self.scene.rho0:.2g} rho0"
        raise self.clock.diverged(f"{text}: {who} is accelerated {more}: a numerical instability")

    def _warn(self, speed: float) -> None:
        """Warn once that the sound speed is too low for what has come about in the fluid."""
        if not self._warned and self.world.rank == 0:
            words = "fluid at %.3g m/s at t = %.3g s: c0 is %.2g times that (below %g densities are off by 2 %%)"
            ratio = self.scene.c0 / speed
            log.warning(words + "; set a larger eos.max_velocity", speed, self.clock.time, ratio, MIN_SOUND_RATIO)
        self._warned = True

    def _look_at_energy(self, kinetic: float, total: float, mass: float) -> None:
        """Look at the energies in J and the mass in kg of all fluid."""
        self._energy_step = self.clock.step
        if not self._first_energy and math.isfinite(total):
            self._first_energy = total
        speed = math.sqrt(2.0 * kinetic / mass) if mass else 0.0
        usual, first = 0.5 * mass * self.usual_speed**2, self._first_energy
        if speed > MAX_RMS_MACH * self.scene.c0:
            self._energy_trouble = f"the mean speed of all fluid is {speed:.3g} m/s, {speed / self.scene.c0:.2g} c0"
        elif self.conserving and first is not None and total - first > MAX_ENERGY_GROWTH * usual:
            grew = f"the total energy grew from {first:.4g} J to {total:.4g} J"
            self._energy_trouble = f"{grew}: a numerical instability"

    def fluid_scalars(self) -> dict[str, float]:
        """Energies, mass, momentum and extremes of the fluid, after a look at the energy. Collective."""
        found = fluid_scalars(self.scene, self.totals)
        if self.scene.liquids.gases:
            found["front_x"] = self.storage.farthest(0, 1.0)
        found |= self.exchange.scalars(found["mass"])
        self._look_at_energy(found["energy_kinetic"], found["energy_total"], found["mass"])
        for sums in self.kept:
            sums.see(found, found["mass"] * self.scene.c0, self.clock.step)
        if self.scene.config.exchanges:
            self.exchanged.see(found, found["mass"] + found["inflow"] + found["outflow"], self.clock.step)
        return found

    def trouble(self) -> str | None:
        """Why this rank's state is no solution, or None. Collective where no series has looked at the energy lately."""
        storage = self.storage
        if self.clock.step - self._energy_step >= ENERGY_PERIOD:
            self.fluid_scalars()
        x, v = storage.x[:, : storage.end], storage.v[:, : storage.end]
        if not (np.isfinite(x).all() and np.isfinite(v).all()):
            return "a position or velocity is not a finite number"
        if not np.abs(self.forces.impulses).max(initial=0.0) <= self.forces.largest_impulse(self.clock.time):
            return "the impulse of the fluid on a wall is beyond what pressures of rho0 c0^2 could have given"
        jumps = (sums.trouble for sums in (*self.kept, self.exchanged) if sums.trouble)
        damaged = next(jumps, None) or self.checksums.trouble
        return self.leaks.found or self._energy_trouble or damaged or self.leaks.through_wall()


def _lengths(vectors: NDArray) -> NDArray[np.float64]:
    """Lengths [n] of vectors [d, n]."""
    return np.hypot.reduce(vectors, axis=0)
