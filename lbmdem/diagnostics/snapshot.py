"""The arrays of LBM-DEM for the writers: fluid, grains, and the state that checkpoints hold."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.files.arrays import Column, FieldArray, ParticleArray, Shard
from hpcpic.core.run.worst import worst_nodes, worst_particles
from lbmdem.kernels.layout import FLUID
from lbmdem.physics.velocity_sets import CS2

if TYPE_CHECKING:
    from hpcpic.core.files.sealed import Reader
    from lbmdem.step import LbmDem


def fields(app: "LbmDem") -> dict[str, FieldArray]:
    """Velocity and pressure (beyond that of rest) at the nodes, and whether they are solid."""
    units = app.scene.units
    rho, u = app.fluid.moments()
    solid = app.fluid.solid.inner != FLUID
    return {
        "velocity": FieldArray(u * units.velocity, "m/s"),
        "pressure": FieldArray(np.where(solid, 0.0, (rho - 1.0) * CS2 * units.pressure), "Pa"),
        "solid": FieldArray(solid.astype(np.float32), ""),
    }


def grains(app: "LbmDem") -> dict[str, ParticleArray]:
    """Grains of this rank by set: position, velocity, rotation, radius, forces. Collective."""
    columns = grain_columns(app)
    newton, newton_m = ("N/m", "N m/m") if app.scene.dimensions == 2 else ("N", "N m")
    units = {"velocity": "m/s", "angular_velocity": "rad/s", "radius": "m", "angle": "rad"}
    units["mass"] = "kg/m" if app.scene.dimensions == 2 else "kg"
    units |= {"fluid_force": newton, "fluid_torque": newton_m, "contact_force": newton}
    result = {}
    for k, name in enumerate(app.scene.set_names):
        mine = np.flatnonzero(app.table.set[columns["id"]] == k)
        chosen = {key: values[mine] for key, values in columns.items()}
        ids, x = chosen.pop("id"), chosen.pop("x")
        result[name] = ParticleArray(ids, x, chosen, {key: units.get(key, "") for key in chosen})
    return result


def worst(app: "LbmDem") -> list[str]:
    """Lines on the worst grains and nodes of this rank."""
    lines = []
    if app.dem:
        own = app.dem.grains
        rows = slice(own.n)
        found = ParticleArray(own.ids[rows], own.x[rows], {"velocity": own.v[rows]})
        lines += worst_particles({"grain": found})
    if app.fluid:
        lines += worst_nodes(*app.fluid.moments(), app.domain.row_range(app.world.rank)[0])
    return lines


def grain_columns(app: "LbmDem") -> dict[str, NDArray]:
    """Of the grains that this rank owns; vectors have three components. Collective.

    fluid_force, fluid_torque (about the centre): by the links, mean of the last two steps; contact_force: of the last
    substep; without their weight and what a body force adds (Scene.constant_force).
    """
    if app.dem:
        own = app.dem.grains
        rows = slice(own.n)
        ids, x, v, omega, turned = own.ids[rows], own.x[rows], own.v[rows], own.omega[rows], own.orientation[rows]
    else:
        ids = np.arange(len(app.table)) if app.world.rank == 0 else np.zeros(0, np.int64)
        x, v, omega = app.table.x[ids], app.table.v[ids], app.table.omega[ids]
        turned = np.zeros(len(ids)) if app.scene.dimensions == 2 else np.tile([1.0, 0.0, 0.0, 0.0], (len(ids), 1))
    planar = app.scene.dimensions == 2
    turning = np.column_stack([np.zeros((len(ids), 2)), omega]) if planar else omega
    columns = {"id": ids, "x": spatial(x), "velocity": spatial(v), "angular_velocity": turning}
    if app.immersed:
        force, torque = app.immersed.all_forces(len(app.table))
        torque = (np.pad(torque, ((0, 0), (2, 0))) if planar else torque) * app.scene.units.torque
        columns |= {"fluid_force": spatial(force * app.scene.units.force)[ids], "fluid_torque": torque[ids]}
    if app.dem:
        columns["contact_force"] = own.columns["force"][rows, :3].copy()
    size = {"radius": app.table.radius[ids], "mass": app.table.mass[ids]}
    return columns | {"angle" if planar else "orientation": turned} | size


def spatial(vectors: NDArray) -> NDArray[np.float64]:
    """Vectors [n, d] with three components."""
    return np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1])))


def state(app: "LbmDem") -> dict[str, Shard]:
    """Populations f - w [rows, ..., q] and the grains, in order of rows and of numbers."""
    result = {}
    if app.fluid:
        low, _ = app.domain.row_range(app.world.rank)
        populations = np.ascontiguousarray(np.moveaxis(app.fluid.populations(), 0, -1))
        result["populations"] = Shard(populations, low, app.domain.points[0])
    if app.dem:
        result |= app.dem.state()
    if app.immersed:
        pending = app.immersed.pending(len(app.table))
        low = 0 if app.world.rank == 0 else len(pending)
        result["pending"] = Shard(pending[low:], low, len(pending))
    return result


def columns(app: "LbmDem", reader: "Reader", densest: float) -> dict[str, Column]:
    """What `state` gives, of fluid of at most this density in lattice units."""
    found = {}
    if app.fluid:
        shape = (*app.domain.points, app.fluid.lattice.q)
        found["populations"] = Column(app.fluid.layout_dtype, shape, -densest, densest)
    if app.dem:
        found |= app.dem.state_columns(reader)
    if app.immersed:
        found["pending"] = Column(np.int64, app.immersed.pending_shape(len(app.table)))
    return found


def restore(app: "LbmDem", reader: "Reader") -> None:
    """Replace everything by a checkpoint."""
    app.iteration = reader.step
    if app.dem:
        app.dem.restore(reader)
        app.start_solid()
    if app.fluid:
        app.fluid.iteration = reader.step
        low, high = app.domain.row_range(app.world.rank)
        app.fluid.set_populations(np.moveaxis(reader.read("populations", low, high), -1, 0))
    if app.immersed:
        app.immersed.restore(reader.read("pending"))
