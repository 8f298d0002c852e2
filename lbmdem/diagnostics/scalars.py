"""Scalars of a run: sums over nodes and grains that are the same for any ranks, in SI units."""

import logging
import math
from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.world import World
from hpcpic.core.space import exact
from lbmdem.analysis.quick_condition import slice_edges
from lbmdem.case.config import AXES, seeps
from lbmdem.grains import contact_network
from lbmdem.kernels.layout import FLUID
from lbmdem.physics.velocity_sets import CS2

if TYPE_CHECKING:
    from lbmdem.step import LbmDem

log = logging.getLogger("hpcpic.lbmdem")

FAST, DRIFTED, UNRULED = 0.3, 1e-3, 0.01  # nodes per step, change of density, share of links: warned of beyond
GRAVITY = 9.81  # m/s2, of hydraulic gradients where a case has none of its own


def total(world: World, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sums [k] of values[n, k] over the rows of all ranks, with the same bits however they are divided."""
    columns = np.ascontiguousarray(values.T)
    most = world.max_array(np.abs(columns).max(axis=1, initial=0.0))
    if not np.all(np.isfinite(most)):
        return np.full(values.shape[1], np.nan)
    scales = [exact.power_of_two_above(m) for m in most]
    limbs = np.zeros((len(columns), exact.LIMBS), np.int64)
    for of_column, column, scale in zip(limbs, columns, scales):
        exact.add_limbs(of_column, column, 1.0 / scale)
    limbs = world.sum_int(limbs.ravel()).reshape(-1, exact.LIMBS)
    return np.array([exact.value(limb, scale) for limb, scale in zip(limbs, scales)])


class Diagnostics:
    """What `scalars` of the simulator returns, and its units."""

    def __init__(self, app: "LbmDem") -> None:
        self.app = app
        scene = app.scene
        self.axes = AXES[: scene.dimensions]
        self.fastest = self.deepest = self.drift = 0.0  # nodes per step, overlap / diameter, density; last look
        self.jump = 0.0  # of the mean density since the look before, where nothing can change it
        self._kept: float | None = None  # sum of the populations then
        self._told: set[str] = set()  # what has been warned of
        self.obstacles = [obstacle.name for obstacle in scene.config.obstacle]
        faces = scene.faces.values() if scene.config.fluid else ()
        self.n_slices = scene.config.output.stress_slices if app.dem else 0
        self.closed = all(face.kind in ("wall", "periodic") for face in faces)
        self.drive = self._drive()
        self.units = self._units()

    def _drive(self) -> Callable[[int], float] | None:
        """Driving force per mass along the last axis at a step, m/s2, of fixed grains: of the case's body force, or of
        the pressures at both ends over the height of the sample.
        """
        scene = self.app.scene
        if not seeps(scene.config):
            return None
        force = scene.config.fluid.body_force[-1]
        if force:
            return lambda step: force
        low, high = (scene.faces[self.axes[-1] + side] for side in "-+")
        bottom, top = self.app.sample()
        unit = CS2 * scene.units.pressure / scene.density / (top - bottom)
        return lambda step: (low.density - high.density + (low.rate - high.rate) * self.app.ramped(step)) * unit

    def _units(self) -> dict[str, str]:
        scene = self.app.scene
        along = scene.dimensions == 3
        per = "" if along else "/m"  # two-dimensional quantities are per metre of depth
        units = {}
        if scene.config.fluid:
            units = {"mass": f"kg{per}"}
            units |= {f"momentum_{axis}": f"kg m/s{per}" for axis in self.axes}
            units |= {"max_mach": "", "energy_kinetic": f"J{per}"}
            units |= {f"flow_rate_{self.axes[-1]}": "m3/s" if along else "m2/s"}
            units |= {"permeability": "m2", "hydraulic_gradient": "", "porosity": ""} if self.drive else {}
            units |= {"link_fallbacks": ""} if self.app.immersed else {}
            for name in (*scene.set_names, *self.obstacles):
                units |= {f"force_{name}_{axis}": f"N{per}" for axis in self.axes}
        if self.app.dem:
            units |= {"contact_count": "", "energy_kinetic_grains": f"J{per}", "overlap": ""}
            units |= {"least_film": ""} if self.app.films else {}
        slices = range(1, self.n_slices + 1)
        units |= {f"stress_{2 * self.axes[-1]}_{k}": "Pa" for k in slices}
        units |= {f"pressure_{k}": "Pa" for k in slices if scene.config.fluid}
        return units

    def scalars(self) -> dict[str, float]:
        """Collective. Momentum and velocity are those at full steps, with half of the body force."""
        values = self._fluid() if self.app.fluid else {}
        values |= self._solids() if self.app.immersed else {}
        values |= self._grains() if self.app.dem else {}
        return {name: values[name] for name in self.units}

    def _fluid(self) -> dict[str, float]:
        app, scene, units = self.app, self.app.scene, self.app.scene.units
        rows, squares = app.fluid.row_sums()
        nodes, excess, *momentum, energy, flow = total(app.world, rows)
        values = {"mass": (nodes + excess) * units.mass}
        values["energy_kinetic"] = 0.5 * energy * units.mass * units.velocity**2
        self._watch_mass(excess, nodes)
        for axis, p in zip(self.axes, momentum):
            values[f"momentum_{axis}"] = p * units.mass * units.velocity
        self.fastest = math.sqrt(app.world.max(float(squares.max(initial=0.0))))
        self._tell("speed", self.fastest > FAST, f"the fluid moves by {self.fastest:.2f} nodes in a step (limit 0.4)")
        values["max_mach"] = self.fastest / math.sqrt(CS2)
        along = flow / scene.points[-1]  # mean over the rows of the sums over a cross-section
        rate = along * units.velocity * units.dx ** (scene.dimensions - 1)
        values[f"flow_rate_{self.axes[-1]}"] = rate
        if self.drive:
            values |= self._permeability(rate)
        return values | self._pressures(rows)

    @cached_property
    def slices(self) -> NDArray[np.float64]:
        """Ends of the control slices along the last axis, m."""
        return slice_edges(*self.app.sample(), 2.0 * float(self.app.table.radius.max()), self.n_slices)

    def _pressures(self, rows: NDArray) -> dict[str, float]:
        """Mean of the fluid's pressure in the control slices. Collective."""
        app, values = self.app, {}
        z = app.coordinates()[-1].ravel()
        z = np.repeat(z, len(rows) // max(1, len(z)))
        for k in range(self.n_slices):
            inside = (z >= self.slices[k]) & (z < self.slices[k + 1])
            nodes, excess = total(app.world, np.where(inside[:, None], rows[:, :2], 0.0))
            values[f"pressure_{k + 1}"] = excess / max(nodes, 1.0) * CS2 * app.scene.units.pressure
        return values

    @cached_property
    def _keeps_mass(self) -> bool:
        """Whether the sum of the populations stays to rounding: links of grains are balanced, and no wall moves."""
        config, immersed = self.app.scene.config, self.app.immersed
        still = not any(any(face.velocity) for face in config.boundary)
        balanced = immersed is None or config.coupling.refill == "conserving"
        return self.closed and still and balanced and config.fluid.storage == "double"

    def _watch_mass(self, excess: float, nodes: float) -> None:
        """Mean density less that of rest: nodes that grains cover and uncover change it in a box that is closed."""
        if self._keeps_mass:
            kept = excess - (self.app.immersed.owed() if self.app.immersed else 0.0)
            self.jump = 0.0 if self._kept is None else (kept - self._kept) / nodes
            self._kept = kept
        if self.closed:
            self.drift = excess / nodes
            cure = 'coupling.refill = "conserving" keeps the mass'
            text = f"the mean density of the fluid has changed by {self.drift:.1e}: {cure}"
            self._tell("mass", abs(self.drift) > DRIFTED, text)

    def _tell(self, kind: str, wrong: bool, text: str) -> None:
        """Warn, once of each kind."""
        if wrong and kind not in self._told:
            self._told.add(kind)
            if self.app.world.rank == 0:
                log.warning("step %d: %s", self.app.iteration, text)

    def _permeability(self, rate: float) -> dict[str, float]:
        """Darcy: k = nu U / G with the superficial velocity U and the driving force per mass G."""
        config, drive = self.app.scene.config, self.drive(self.app.iteration)
        u = rate / math.prod(config.domain.size[:-1])
        gravity = math.hypot(*config.gravity) or GRAVITY
        return {
            "permeability": config.fluid.kinematic_viscosity * u / drive if drive else math.nan,
            "hydraulic_gradient": drive / gravity,
            "porosity": self.porosity,
        }

    @cached_property
    def porosity(self) -> float:
        """Share of fluid nodes between the ends of the sample (section 5.2 of the paper); of all nodes where the
        medium repeats along the flow. Collective.
        """
        app, ones = self.app, (1,) * (self.app.scene.dimensions - 1)
        repeats = app.scene.periodic[-1]
        bottom, top = (0.0, app.scene.config.domain.size[-1]) if repeats else app.sample()
        z = app.coordinates()[-1].reshape(-1, *ones)
        inside = (z > bottom) & (z < top)
        fluid = (app.fluid.solid.inner == FLUID) & inside
        nodes = inside.sum() * math.prod(fluid.shape[1:])
        counts = app.world.sum_int(np.array([fluid.sum(), nodes], np.int64))
        return float(counts[0] / counts[1])

    def _solids(self) -> dict[str, float]:
        """What links tell: those without their rule, and the force on every set of grains and every obstacle.

        It is the momentum that the nodes of the fluid lose; a body force a acts on the place of a solid of volume V
        by density V a besides (Scene.constant_force).
        """
        app = self.app
        counts = app.immersed.counts()
        share = counts["fallbacks"] / max(1, counts["links"])
        text = f"{share:.1%} of the links have no room for their rule, and follow a simpler one"
        self._tell("links", share > UNRULED, text)
        unit = app.scene.units.force
        force, walls = app.immersed.all_forces(len(app.table))[0] * unit, app.immersed.wall_forces()[0] * unit
        of_sets = [force[app.table.set == k].sum(axis=0) for k in range(len(app.scene.set_names))]
        values = {"link_fallbacks": share}
        for name, of_all in zip((*app.scene.set_names, *self.obstacles), (*of_sets, *walls)):
            values |= {f"force_{name}_{axis}": float(f) for axis, f in zip(self.axes, of_all)}
        return values

    def _grains(self) -> dict[str, float]:
        """What contacts tell."""
        app = self.app
        self.deepest = contact_network.greatest_overlap(app.dem)
        values = {"contact_count": float(contact_network.contact_count(app.dem)), "overlap": self.deepest}
        values["energy_kinetic_grains"] = contact_network.kinetic_energy(app.dem)
        if app.films:
            values["least_film"] = app.least_film
            text = f"a film had {app.worst_film:.1%} of its resistance, all that is stable with so few substeps"
            self._tell("films", app.worst_film < 1.0, text)
        if self.n_slices:
            stress = contact_network.stress(app.dem, self.slices)[:, -1, -1]
            values |= {f"stress_{2 * self.axes[-1]}_{k + 1}": float(s) for k, s in enumerate(stress)}
        return values
