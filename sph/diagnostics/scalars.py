"""The scalars of an SPH run in time: energies, mass, momentum, extremes, forces on walls; all at one time level.

Sums are exact (core.space.exact), so that their bits depend on neither ranks nor threads. In 2D masses, energies and
forces are those of a slice one metre thick.
"""

import math

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.world import World
from hpcpic.core.simd.generate import specialise
from hpcpic.core.space import exact
from sph.case.config import AXES
from sph.particles.tasks import Tasks
from sph.particles.wall_forces import WallForces
from sph.physics.equation_of_state import LEAST, coefficients, compression
from sph.setup.scene import Scene

ROUNDING_FACTOR = 2.0


class Totals:
    """The sums and extremes of a run's fluid, by kernels."""

    def __init__(self, scene: Scene, world: World, tasks: Tasks) -> None:
        d, axes = scene.dimensions, list(scene.axes)
        self.scene, self.world, self.tasks, self.axes = scene, world, tasks, axes
        several, gas = scene.liquids.densities, scene.liquids.gases
        self.kernels = specialise("sph.kernels", ["totals"], DIM=d, DENSITIES=several, GASES=gas)
        self.n = self.kernels.TERMS
        eos = scene.eos
        numbers = [scene.rho0, eos.stiffness, eos.background, eos.gamma - 1, *scene.gravity[axes], *scene.low[axes]]
        tasks.arena.set(
            constants=np.array(numbers),
            powers=coefficients(eos.gamma - 1),
            part_maxima=np.zeros((tasks.parts, 3 + 2 * d)),
            inverse=np.zeros(self.n),
            limbs=np.zeros((tasks.parts, self.n, exact.LIMBS), np.int64),
        )

    def find(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Sums of kinetic, potential and internal energy (J), mass (kg) and momentum (kg m/s); largest mass, |v|^2,
        |drho|, x and -x, in storage axes. Exact: with the same bits for any ranks and threads. Collective.
        """
        a = self.tasks.arena
        self.tasks.each(self.kernels.extremes)
        maxima = a["part_maxima"]
        most = np.where(np.isnan(maxima).any(axis=1)[:, None], np.inf, maxima).max(axis=0)
        most = self.world.max_array(most)
        if not np.isfinite(most[:3]).all():
            return np.full(self.n, np.nan), most
        if most[0] == 0.0:  # all has left
            return np.zeros(self.n), most
        scales = [exact.power_of_two_above(float(bound)) for bound in self._bounds(most[0], most[1], most[2], most[3:])]
        a["inverse"][:] = [1.0 / scale for scale in scales]
        self.tasks.each(self.kernels.add)
        limbs = self.world.sum_int(a["limbs"].sum(axis=0))
        return np.array([exact.value(row, scale) for row, scale in zip(limbs, scales)]), most

    def _bounds(self, mass: float, square: float, excess: float, sides: NDArray) -> NDArray[np.float64]:
        """Bounds of the terms of each sum, from largest mass, |v|^2, |drho|, x and -x."""
        scene, d = self.scene, self.scene.dimensions
        low = self.tasks.arena["constants"][4 + d :]
        farthest = np.maximum(np.abs(low + sides[:d]), np.abs(low - sides[d:]))
        height = np.abs(scene.gravity[self.axes]) @ farthest
        ends = np.array([excess, -min(excess, 0.9 * scene.rho0)])
        background = scene.eos.background * np.abs(ends / (scene.rho0 + ends)) / scene.rho0
        inner = (np.abs(scene.eos.energy(ends)) + 2 * background).max() * scene.liquids.lightest
        inner = max(inner, self._most_work(ends) * scene.liquids.lightest)
        speed = math.sqrt(square)
        return ROUNDING_FACTOR * mass * np.array([square, height, inner, 1.0, *[speed] * d])

    def _most_work(self, ends: NDArray) -> float:
        """A bound of the work of compression of a gas, J per kg of the reference liquid, between two rho - rho0 of it:
        at most the largest pressure all along.
        """
        scene = self.scene
        if not scene.liquids.gases:
            return 0.0
        most = float(np.abs(scene.eos.pressure(ends)).max()) + scene.eos.background
        return most / scene.rho0 / compression(LEAST)


def fluid_scalars(scene: Scene, totals: Totals) -> dict[str, float]:
    """Energies, mass, momentum and extremes of the fluid. Collective; the same on all ranks."""
    (kinetic, potential, internal, mass, *momentum), (_, fastest, denser, *farthest) = totals.find()
    along = scene.axes.index(0)
    found = {
        "energy_kinetic": kinetic,
        "energy_potential": potential,
        "energy_internal": internal,
        "energy_total": kinetic + potential + internal,
        "mass": mass,
        "max_velocity": math.sqrt(fastest),
        "max_density_error": denser / scene.rho0,
        "front_x": farthest[along] + scene.low[0] + scene.spacing / 2,
    }
    found |= {f"momentum_{AXES[axis]}": value for axis, value in zip(scene.axes, momentum)}
    return {name: float(value) for name, value in found.items()}


def wall_scalars(scene: Scene, forces: WallForces) -> dict[str, float]:
    """Force, torque and impulse of the fluid on each measured wall, by the last pair sums. Collective."""
    found: dict[str, float] = {}
    d, now = scene.dimensions, forces.now() if forces.measured else {}
    for wall in forces.measured:
        force, torque = now[wall.name]
        impulse = forces.impulses[wall.index]
        found |= {f"force_{wall.name}_{axis}": force[k] for k, axis in enumerate(AXES[:d])}
        turns = enumerate(AXES) if d == 3 else [(2, "z")]
        found |= {f"torque_{wall.name}_{axis}": torque[k] for k, axis in turns}
        found |= {f"impulse_{wall.name}": impulse[0]}
        found |= {f"impulse_{wall.name}_{axis}": impulse[1 + k] for k, axis in enumerate(AXES[:d])}
    return {name: float(value) for name, value in found.items()}
