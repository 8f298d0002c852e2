"""Scalars of a run: sums over nodes and grains that are the same for any ranks, in SI units."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.world import World
from hpcpic.core.space import exact
from lbmdem.config import AXES
from lbmdem.scene import CS2

if TYPE_CHECKING:
    from lbmdem.step import LbmDem


def total(world: World, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sums [k] of values[n, k] over the rows of all ranks, with the same bits however they are divided."""
    most = world.max_array(np.abs(values).max(axis=0, initial=0.0))
    if not np.all(np.isfinite(most)):
        return np.full(values.shape[1], np.nan)
    scales = [exact.power_of_two_above(m) for m in most]
    limbs = np.array([exact.exact_limbs(column, scale) for column, scale in zip(values.T, scales)])
    limbs = world.sum_int(limbs.ravel()).reshape(-1, exact.LIMBS)
    return np.array([exact.value(limb, scale) for limb, scale in zip(limbs, scales)])


class Diagnostics:
    """What `scalars` of the simulator returns, and its units."""

    def __init__(self, app: "LbmDem") -> None:
        self.app = app
        scene = app.scene
        self.axes = AXES[: scene.dimensions]
        self.units = self._units()

    def _units(self) -> dict[str, str]:
        scene = self.app.scene
        along = scene.dimensions == 3
        per = "" if along else "/m"  # two-dimensional quantities are per metre of depth
        units = {"mass": f"kg{per}"}
        units |= {f"momentum_{axis}": f"kg m/s{per}" for axis in self.axes}
        units |= {"max_mach": "", "energy_kinetic": f"J{per}"}
        units |= {f"flow_rate_{self.axes[-1]}": "m3/s" if along else "m2/s"}
        if self.app.has_permeability:
            units |= {"permeability": "m2", "hydraulic_gradient": ""}
        for name in scene.set_names:
            units |= {f"force_{name}_{axis}": f"N{per}" for axis in self.axes}
        if self.app.grains_move:
            units |= {"contact_count": "", "energy_kinetic_grains": f"J{per}", "overlap": ""}
        slices = scene.config.output.stress_slices
        units |= {f"stress_{2 * self.axes[-1]}_{k + 1}": "Pa" for k in range(slices)}
        return units

    def scalars(self) -> dict[str, float]:
        """Collective. Momentum and velocity are those at full steps, with half of the body force."""
        values = self._fluid()
        values |= self._grains()
        return {name: values[name] for name in self.units}

    def _fluid(self) -> dict[str, float]:
        app, scene, units = self.app, self.app.scene, self.app.scene.units
        rho, u = app.moments()  # lattice units, zero in solid nodes
        squares = np.sum(u * u, axis=-1)
        columns = [rho, *(rho * u[..., k] for k in range(scene.dimensions)), rho * squares, u[..., -1]]
        rows = np.stack([column.sum(axis=-1).ravel() for column in columns], axis=1)  # a row of nodes has its own order
        mass, *momentum, energy, flow = total(app.world, rows)
        values = {"mass": mass * units.mass, "energy_kinetic": 0.5 * energy * units.mass * units.velocity**2}
        for axis, p in zip(self.axes, momentum):
            values[f"momentum_{axis}"] = p * units.mass * units.velocity
        fastest = app.world.max(float(squares.max(initial=0.0)))
        values["max_mach"] = float(np.sqrt(fastest / CS2))
        along = flow / scene.points[-1]  # mean over the rows of the sums over a cross-section
        rate = along * units.velocity * units.dx ** (scene.dimensions - 1)
        values[f"flow_rate_{self.axes[-1]}"] = rate
        if app.has_permeability:
            values |= self._permeability(rate)
        return values

    def _permeability(self, rate: float) -> dict[str, float]:
        """Darcy: k = nu U / G with G the driving force per mass along the last axis, over the sample."""
        app = self.app
        config = app.scene.config
        drive = app.drive()
        area = np.prod(config.domain.size[:-1])
        k = config.fluid.viscosity * rate / area / drive if drive else float("nan")
        return {"permeability": k, "hydraulic_gradient": drive / 9.81}

    def _grains(self) -> dict[str, float]:
        app, units = self.app, self.app.scene.units
        if not app.scene.set_names:
            return {}
        values: dict[str, float] = {}
        force = app.forces()  # [n, d] of all grains, on all ranks, lattice units
        for k, name in enumerate(app.scene.set_names):
            of_set = force[app.table.set == k].sum(axis=0) * units.force
            values |= {f"force_{name}_{axis}": float(f) for axis, f in zip(self.axes, of_set)}
        if app.grains_move:
            values |= app.grain_scalars()
        slices = app.scene.config.output.stress_slices
        if slices:
            stress = app.slice_stress(slices)
            values |= {f"stress_{2 * self.axes[-1]}_{k + 1}": float(s) for k, s in enumerate(stress)}
        return values


def conserved(values: Mapping[str, float]) -> float:
    """Mass, which the run's summary watches."""
    return values["mass"]
