"""The scalars of an SPH run in time: energies, mass, momentum, extremes, forces on walls; all at one time level.

Sums are exact (core.space.exact), so that their bits depend on neither ranks nor threads. In 2D masses, energies and
forces are those of a slice one metre thick.
"""

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.world import World
from hpcpic.core.space import exact
from sph.config import AXES
from sph.scene import Scene
from sph.snapshot import own_particles

if TYPE_CHECKING:
    from sph.step import Sph


def scalar_units(scene: Scene) -> dict[str, str]:
    """Name and unit of every column of the series, gauges apart."""
    d = scene.dimensions
    per = "/m" if d == 2 else ""
    force, turn = f"N{per}", "N" if d == 2 else "N m"
    units = dict.fromkeys(("energy_kinetic", "energy_potential", "energy_internal", "energy_total"), f"J{per}")
    units |= {"mass": f"kg{per}"} | {f"momentum_{axis}": f"kg m/s{per}" for axis in AXES[:d]}
    units |= {"max_velocity": "m/s", "max_density_error": "1", "front_x": "m", "dt": "s"}
    for wall in scene.walls:
        if wall.measure_force:
            units |= {f"force_{wall.name}_{axis}": force for axis in AXES[:d]}
            units |= {f"torque_{wall.name}_{axis}": turn for axis in (AXES if d == 3 else "z")}
            units |= {f"impulse_{wall.name}": f"N s{per}"}
            units |= {f"impulse_{wall.name}_{axis}": f"N s{per}" for axis in AXES[:d]}
    return units


def exact_sums(world: World, columns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sums[k] of columns[k, n] over all ranks, the same bits however the n are spread. Collective."""
    most = np.abs(columns).max(axis=1, initial=0.0)
    most = world.max_array(np.where(np.isfinite(most), most, np.inf))
    if not np.all(np.isfinite(most)):
        return np.full(len(columns), np.nan)
    scales = [exact.power_of_two_above(float(value)) for value in most]
    limbs = np.zeros((len(columns), exact.LIMBS), np.int64)
    for row, column, scale in zip(limbs, columns, scales):
        exact.add_limbs(row, np.ascontiguousarray(column), 1.0 / scale)
    limbs = world.sum_int(limbs)
    return np.array([exact.value(row, scale) for row, scale in zip(limbs, scales)])


def internal_energy(scene: Scene, drho: NDArray) -> NDArray[np.float64]:
    """Work of compression from rho0, J/kg: the integral of p / rho^2 of (MP 14)."""
    gamma, change = scene.gamma, drho / scene.rho0
    volume = change / (1 + change)  # rho0 (1/rho0 - 1/rho)
    stretch = np.log1p(change)
    bent = stretch if gamma == 1.0 else np.expm1((gamma - 1) * stretch) / (gamma - 1)
    background = scene.config.eos.background_pressure
    return (scene.stiffness * (bent - volume) + background * volume) / scene.rho0


def scalars(sph: "Sph") -> dict[str, float]:
    """All of `scalar_units`. Collective; the same on all ranks."""
    scene, world, d = sph.scene, sph.world, sph.scene.dimensions
    own = own_particles(sph)
    fluid = own["kind"] == 0
    x, v, m, drho = (own[name][fluid] for name in ("x", "v", "m", "drho"))
    square = np.sum(v * v, axis=1)
    terms = [0.5 * m * square, -m * (x @ scene.gravity), m * internal_energy(scene, drho), m]
    kinetic, potential, internal, mass, *momentum = exact_sums(world, np.stack([*terms, *(m * v.T)]))
    extremes = [square.max(initial=0.0), np.abs(drho).max(initial=0.0), x[:, 0].max(initial=-np.inf)]
    fastest, denser, front = world.max_array(np.array(extremes))
    found = {
        "energy_kinetic": kinetic,
        "energy_potential": potential,
        "energy_internal": internal,
        "energy_total": kinetic + potential + internal,
        "mass": mass,
        "max_velocity": math.sqrt(fastest),
        "max_density_error": denser / scene.rho0,
        "front_x": front + scene.spacing / 2,
        "dt": sph.time_step,
    }
    found |= {f"momentum_{axis}": value for axis, value in zip(AXES, momentum)}
    return {name: float(value) for name, value in (found | wall_scalars(sph, d)).items()}


def wall_scalars(sph: "Sph", d: int) -> dict[str, float]:
    """Force, torque and impulse of the fluid on each measured wall."""
    found: dict[str, float] = {}
    if not any(wall.measure_force for wall in sph.scene.walls):
        return found
    forces = sph.wall_forces()
    for wall in sph.scene.walls:
        if not wall.measure_force:
            continue
        force, torque = forces[wall.name]
        impulse = sph.impulses[wall.index]
        found |= {f"force_{wall.name}_{axis}": force[k] for k, axis in enumerate(AXES[:d])}
        turns = enumerate(AXES) if d == 3 else [(2, "z")]
        found |= {f"torque_{wall.name}_{axis}": torque[k] for k, axis in turns}
        found |= {f"impulse_{wall.name}": impulse[0]}
        found |= {f"impulse_{wall.name}_{axis}": impulse[1 + k] for k, axis in enumerate(AXES[:d])}
    return found
