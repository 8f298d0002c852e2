"""Scalars of the fluid: mass, momentum, energy, flow rate and permeability, pressure in control slices."""

import math
from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.world import World
from lbmdem.case.config import AXES, seeps
from lbmdem.coupling.immersed import Immersed
from lbmdem.fluid.drive import Drive
from lbmdem.fluid.fluid import Fluid
from lbmdem.kernels.layout import FLUID
from lbmdem.physics.velocity_sets import CS2
from lbmdem.setup.scene import Scene

GRAVITY = 9.81  # m/s2, of hydraulic gradients where a case has none of its own


class FluidScalars:
    """`scalars` and `units` of a fluid.

    fastest: greatest speed (nodes per step), drift: change of the mean density of a closed fluid, jump: its change
    since the look before, where nothing can change it; all at the last look. sample: its ends, heights: of the rows of
    this rank, m.
    """

    def __init__(
        self,
        scene: Scene,
        world: World,
        fluid: Fluid,
        drive: Drive,
        immersed: Immersed | None,
        sample: tuple[float, float],
        heights: NDArray,
    ) -> None:
        self._scene, self._world, self._fluid, self._immersed = scene, world, fluid, immersed
        self._sample, self._heights = sample, heights
        assert scene.config.fluid is not None
        self._section = scene.config.fluid
        self._axes = AXES[: scene.dimensions]
        self.fastest = self.drift = self.jump = 0.0
        self._kept: float | None = None  # sum of the populations at the last look
        self._closed = not any(face.is_open for face in scene.config.boundary)
        self._driving_force = self._seepage_force(drive) if seeps(scene.config) else None
        along = scene.dimensions == 3
        per = "" if along else "/m"
        self.units = {"mass": f"kg{per}"}
        self.units |= {"mean_density": "kg/m3"} if scene.config.grains_move else {}
        self.units |= {f"momentum_{axis}": f"kg m/s{per}" for axis in self._axes}
        self.units |= {"max_mach": "", "energy_kinetic": f"J{per}"}
        self.units |= {f"flow_rate_{axis}": "m3/s" if along else "m2/s" for axis in self._axes}
        self.units |= {"permeability": "m2", "hydraulic_gradient": "", "porosity": ""} if self._driving_force else {}

    def go_on(self, before: "FluidScalars") -> None:
        """Know the last look of these."""
        self.fastest, self.drift, self.jump, self._kept = before.fastest, before.drift, before.jump, before._kept

    def _seepage_force(self, drive: Drive) -> Callable[[int], float]:
        """Driving force per mass along the last axis at a step, m/s2, of fixed grains: of the case's body force, or of
        the pressures at both ends over the height of the sample.
        """
        scene = self._scene
        force = self._section.body_force[-1]
        if force:
            return lambda step: force
        low, high = (scene.faces[self._axes[-1] + side] for side in "-+")
        bottom, top = self._sample
        unit = CS2 * scene.units.pressure / scene.density / (top - bottom)
        return lambda step: (low.density - high.density + (low.rate - high.rate) * drive.ramp_steps(step)) * unit

    def scalars(self, step: int, slices: NDArray) -> dict[str, float]:
        """Collective. slices: ends of the control slices, m; none to leave out their pressures."""
        scene, units = self._scene, self._scene.units
        rows, squares = self._fluid.row_sums()
        nodes, excess, *rest = self._world.sum_exact(rows)
        momentum, energy, flow = rest[: len(self._axes)], rest[len(self._axes)], rest[len(self._axes) + 1 :]
        values = {"mass": (nodes + excess) * units.mass}
        values["mean_density"] = (1.0 + excess / nodes) * scene.density if nodes else math.nan
        values["energy_kinetic"] = 0.5 * energy * units.mass * units.velocity**2
        self._watch_mass(excess, nodes)
        for axis, p in zip(self._axes, momentum):
            values[f"momentum_{axis}"] = p * units.mass * units.velocity
        self.fastest = math.sqrt(self._world.max(float(squares.max(initial=0.0))))
        values["max_mach"] = self.fastest / math.sqrt(CS2)
        rate = 0.0
        for axis, sum_of_u, n in zip(self._axes, flow, scene.points):  # mean over the sections across the axis
            rate = sum_of_u / n * units.velocity * units.dx ** (scene.dimensions - 1)
            values[f"flow_rate_{axis}"] = rate
        if self._driving_force:
            values |= self._permeability(rate, self._driving_force(step))
        return values | self._pressures(rows, slices)

    def _pressures(self, rows: NDArray, slices: NDArray) -> dict[str, float]:
        """Mean of the fluid's pressure in the control slices. Collective."""
        values = {}
        z = np.repeat(self._heights, len(rows) // max(1, len(self._heights)))
        for k in range(len(slices) - 1):
            inside = (z >= slices[k]) & (z < slices[k + 1])
            nodes, excess = self._world.sum_exact(np.where(inside[:, None], rows[:, :2], 0.0))
            values[f"pressure_{k + 1}"] = excess / max(nodes, 1.0) * CS2 * self._scene.units.pressure
        return values

    @cached_property
    def _keeps_mass(self) -> bool:
        """True where the sum of the populations stays to rounding: links of grains are balanced, no wall moves."""
        config = self._scene.config
        still = not any(any(face.velocity) for face in config.boundary)
        balanced = self._immersed is None or config.coupling.keeps_mass
        return self._closed and still and balanced and self._section.storage == "double"

    def _watch_mass(self, excess: float, nodes: float) -> None:
        """Mean density less that of rest: nodes that grains cover and uncover change it in a box that is closed."""
        if self._keeps_mass:
            kept = excess - (self._immersed.owed() if self._immersed else 0.0)
            self.jump = 0.0 if self._kept is None else (kept - self._kept) / nodes
            self._kept = kept
        if self._closed:
            self.drift = excess / nodes

    def _permeability(self, rate: float, drive: float) -> dict[str, float]:
        """Darcy: k = nu U / G with the superficial velocity U and the driving force per mass G."""
        config = self._scene.config
        u = rate / math.prod(config.domain.size[:-1])
        gravity = math.hypot(*config.gravity) or GRAVITY
        return {
            "permeability": self._section.kinematic_viscosity * u / drive if drive else math.nan,
            "hydraulic_gradient": drive / gravity,
            "porosity": self.porosity,
        }

    @cached_property
    def porosity(self) -> float:
        """Share of fluid nodes between the ends of the sample (section 5.2 of the paper); of all nodes where the
        medium repeats along the flow. Collective.
        """
        scene, ones = self._scene, (1,) * (self._scene.dimensions - 1)
        bottom, top = (0.0, scene.config.domain.size[-1]) if scene.periodic[-1] else self._sample
        z = self._heights.reshape(-1, *ones)
        inside = (z > bottom) & (z < top)
        fluid = (self._fluid.solid.inner == FLUID) & inside
        nodes = inside.sum() * math.prod(fluid.shape[1:])
        counts = self._world.sum_int(np.array([fluid.sum(), nodes], np.int64))
        return float(counts[0] / counts[1])
