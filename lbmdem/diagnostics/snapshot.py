"""The arrays of LBM-DEM for the writers: fluid, grains, and the state that checkpoints hold."""

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.world import World
from hpcpic.core.files.arrays import Column, FieldArray, ParticleArray, Rows, Shard
from hpcpic.core.files.sealed import Reader
from hpcpic.core.run.worst import worst_nodes, worst_particles
from hpcpic.core.space.shapes import in_three
from lbmdem.coupling.immersed import Immersed
from lbmdem.fluid.fluid import Fluid
from lbmdem.grains.dem import Dem
from lbmdem.kernels.layout import FLUID
from lbmdem.physics.velocity_sets import CS2
from lbmdem.setup.scene import GrainTable, Scene


def fields(scene: Scene, fluid: Fluid) -> dict[str, FieldArray]:
    """Velocity and pressure (beyond that of rest) at the nodes, and which of them are solid."""
    units = scene.units
    rho, u = fluid.moments()
    solid = fluid.solid.inner != FLUID
    return {
        "velocity": FieldArray(u * units.velocity, "m/s"),
        "pressure": FieldArray(np.where(solid, 0.0, (rho - 1.0) * CS2 * units.pressure), "Pa"),
        "solid": FieldArray(solid.astype(np.float32), ""),
    }


def grains(
    scene: Scene, world: World, table: GrainTable, dem: Dem | None, immersed: Immersed | None
) -> dict[str, ParticleArray]:
    """Grains of this rank by set: position, velocity, rotation, radius, forces. Collective."""
    columns = grain_columns(scene, world, table, dem, immersed)
    newton, newton_m = ("N/m", "N m/m") if scene.dimensions == 2 else ("N", "N m")
    units = {"velocity": "m/s", "angular_velocity": "rad/s", "radius": "m", "angle": "rad"}
    units["mass"] = "kg/m" if scene.dimensions == 2 else "kg"
    units |= {"fluid_force": newton, "fluid_torque": newton_m, "contact_force": newton}
    result = {}
    for k, name in enumerate(scene.set_names):
        mine = np.flatnonzero(table.set[columns["id"]] == k)
        chosen = {key: values[mine] for key, values in columns.items()}
        ids, x = chosen.pop("id"), chosen.pop("x")
        result[name] = ParticleArray(ids, x, chosen, {key: units.get(key, "") for key in chosen})
    return result


def worst(world: World, dem: Dem | None, fluid: Fluid | None) -> list[str]:
    """Lines on the worst grains and nodes of this rank."""
    lines = []
    if dem:
        own = dem.grains
        rows = slice(own.n)
        found = ParticleArray(own.ids[rows], own.x[rows], {"velocity": own.v[rows]})
        lines += worst_particles({"grain": found})
    if fluid:
        lines += worst_nodes(*fluid.moments(), fluid.domain.row_range(world.rank)[0])
    return lines


def grain_columns(
    scene: Scene, world: World, table: GrainTable, dem: Dem | None, immersed: Immersed | None
) -> dict[str, NDArray]:
    """Columns of the grains that this rank owns; vectors have three components. Collective.

    fluid_force, fluid_torque (about the centre): by the links, mean of the last two steps; contact_force: of the last
    substep; without their weight and what a body force adds (Scene.constant_force).
    """
    planar = scene.dimensions == 2
    if dem:
        own = dem.grains
        rows = slice(own.n)
        ids, x, v, omega, turned = own.ids[rows], own.x[rows], own.v[rows], own.omega[rows], own.orientation[rows]
    else:
        ids = np.arange(len(table)) if world.rank == 0 else np.zeros(0, np.int64)
        x, v, omega = table.x[ids], table.v[ids], table.omega[ids]
        turned = np.zeros(len(ids)) if planar else np.tile([1.0, 0.0, 0.0, 0.0], (len(ids), 1))
    turning = np.column_stack([np.zeros((len(ids), 2)), omega]) if planar else omega
    columns = {"id": ids, "x": in_three(x), "velocity": in_three(v), "angular_velocity": turning}
    if immersed:
        force, torque = immersed.all_forces(len(table))
        torque = (np.pad(torque, ((0, 0), (2, 0))) if planar else torque) * scene.units.torque
        columns |= {"fluid_force": in_three(force * scene.units.force)[ids], "fluid_torque": torque[ids]}
    if dem:
        columns["contact_force"] = dem.grains.columns["force"][: dem.grains.n, :3].copy()
    size = {"radius": table.radius[ids], "mass": table.mass[ids]}
    return columns | {"angle" if planar else "orientation": turned} | size


def state(
    world: World, n_grains: int, fluid: Fluid | None, dem: Dem | None, immersed: Immersed | None
) -> dict[str, Shard]:
    """Populations f - w [rows, ..., q] and the grains, in order of rows and of numbers."""
    result = {}
    if fluid:
        low, _ = fluid.domain.row_range(world.rank)
        populations = np.ascontiguousarray(np.moveaxis(fluid.populations(), 0, -1))
        result["populations"] = Shard(populations, low, fluid.domain.points[0])
    if dem:
        result |= dem.state()
    if immersed:
        pending = immersed.pending(n_grains)
        low = 0 if world.rank == 0 else len(pending)
        result["pending"] = Shard(pending[low:], low, len(pending))
    return result


def columns(
    reader: Reader, n_grains: int, fluid: Fluid | None, dem: Dem | None, immersed: Immersed | None, max_density: float
) -> dict[str, Column]:
    """Types and limits of the arrays of `state`; max_density: of the fluid, lattice units."""
    found = {}
    if fluid:
        shape = (*fluid.domain.points, fluid.lattice.q)
        found["populations"] = Column(fluid.layout_dtype, shape, -max_density, max_density)
    if dem:
        found |= dem.state_columns(reader)
    if immersed:
        found["pending"] = Column(np.int64, immersed.pending_shape(n_grains))
    return found


def restore_fluid(reader: Rows, world: World, fluid: Fluid) -> None:
    """Replace the populations by those of a state."""
    fluid.iteration = reader.step
    low, high = fluid.domain.row_range(world.rank)
    fluid.set_populations(np.moveaxis(reader.read("populations", low, high), -1, 0))
