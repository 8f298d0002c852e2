"""Grains that move under contacts, weight, the shaken frame and the fluid, by substeps of a step of the fluid."""

import math

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.case import accelerations
from hpcpic.core.comm.world import World
from hpcpic.core.space.domain import Domain
from hpcpic.core.tasks.graph import Pool
from lbmdem.case.config import contact_law
from lbmdem.coupling.contact_pressure import ContactPressure
from lbmdem.coupling.immersed import Immersed
from lbmdem.grains.dem import Dem
from lbmdem.physics.lubrication import MOST_SUBSTEPS, STABLE, Film
from lbmdem.physics.velocity_sets import LATTICES
from lbmdem.physics.wall_rules import impedance
from lbmdem.setup.box_walls import box_walls
from lbmdem.setup.scene import GrainTable, Scene, volumes


class DrivenGrains:
    """The moving grains `dem` of a scene. immersed: the solids of its fluid; pressure: of fluid that it sees at rest,
    at contacts.

    least_film, worst_film: least share of its formula that a film got, in the last step and in all so far.
    """

    def __init__(
        self,
        scene: Scene,
        world: World,
        pool: Pool,
        domain: Domain,
        table: GrainTable,
        immersed: Immersed | None = None,
        pressure: ContactPressure | None = None,
    ) -> None:
        config = scene.config
        self._scene, self._table, self._immersed, self._pressure = scene, table, immersed, pressure
        solids_move = immersed is not None and not config.coupling.frozen
        film = None
        if solids_move and config.fluid and config.coupling.lubrication:
            viscosity = config.fluid.kinematic_viscosity * config.fluid.density
            film = Film.of_lattice(viscosity, config.spacing, scene.dimensions)
        columns = {name: getattr(table, name) for name in ("x", "v", "omega", "radius", "mass", "inertia", "fixed")}
        law, reach = contact_law(config), 2.0 * config.spacing
        own = [
            (accelerations.compiled(grains.acceleration), table.set == k)
            for k, grains in enumerate(config.grains)
            if grains.acceleration
        ]
        self.dem = Dem(world, pool, domain, columns, law, box_walls(scene), reach=reach, film=film, own=own)
        self.substeps = config.substeps  # but for what films want, see `move`
        self.has_films = film is not None
        self._shaken_alone = config.shaking is not None and immersed is None and not own
        self.least_film = self.worst_film = 1.0
        self._constant = scene.constant_force(table.mass, volumes(table.radius, scene.dimensions))
        if solids_move and config.coupling.inertia == "implicit":
            self._add_impedance()

    def _add_impedance(self) -> None:
        """Give grains that are lighter than the impedance of their links as much inertia as that.

        Half of it is where the force of the links would begin to swing. All others keep their own, and momentum closes.
        """
        scene, table, units = self._scene, self._table, self._scene.units
        rule = scene.config.coupling.bounce_back
        mass, inertia = impedance(LATTICES[scene.lattice], rule, table.radius / units.dx)
        added = mass * units.mass - table.mass, inertia * units.mass * units.dx**2 - table.inertia
        self.dem.grains.set_added(*(np.maximum(0.0, part) for part in added))

    def move(self, first: int, steps: int = 1) -> None:
        """Collective: steps from number `first` on, n_d substeps each, under forces that stay the same but for those
        of contacts, of a shaken frame and of the user's own.
        """
        dem, dt = self.dem, self._scene.time_step
        if self._shaken_alone:
            times = np.arange(first, first + steps) * dt
            frame = self._scene.shaken_over(times)
            dem.advance_shaken(dt / self.substeps, self.substeps, self._constant, frame, times)
            return
        time = first * dt
        n = self._substeps_of_films() if self.has_films else self.substeps
        force, torque = self._forces(time)
        dem.advance(dt / n, steps * n, force, torque, time=time, usual=dt / self.substeps)

    def _forces(self, time: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Force [n, d] (N) and torque [n, 1 or 3] (N m) on own grains that stay through substeps. Collective."""
        grains, units = self.dem.grains, self._scene.units
        own = grains.ids[: grains.n]
        force = self._constant[own] - self._table.mass[own, None] * self._scene.shaken_over(np.array([time]))
        torque = np.zeros((len(own), self._table.omega.shape[1]))
        if self._immersed:
            fluid_force, fluid_torque = self._immersed.forces(own)
            if self._pressure:
                fluid_force = fluid_force + self._pressure.forces()[own]
            force += fluid_force * units.force
            torque += fluid_torque * units.torque
        return force, torque

    def _substeps_of_films(self) -> int:
        """n_d of this step, in which no film is limited unless that takes more than MOST_SUBSTEPS. Collective."""
        dt = self._scene.time_step
        wanted = dt * self.dem.fastest_film(dt) / STABLE
        n = self.substeps
        if not self._scene.config.coupling.substeps:
            n = max(n, math.ceil(min(wanted, MOST_SUBSTEPS)))
        self.least_film = min(1.0, n / wanted) if wanted else 1.0
        self.worst_film = min(self.worst_film, self.least_film)
        return n
