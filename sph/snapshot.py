"""The particles of an SPH run for the writers: snapshots, and the state that checkpoints hold."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.sharding import by_id
from hpcpic.core.files.arrays import ParticleArray, Shard
from hpcpic.core.space.domain import block_ranges

if TYPE_CHECKING:
    from hpcpic.core.files.sealed import Reader
    from sph.step import Sph

UNITS = {"velocity": "m/s", "pressure": "Pa", "density": "kg/m3", "mass": "kg"}


def particles(sph: "Sph") -> dict[str, ParticleArray]:
    """Position, velocity, pressure, density, mass of each fluid and, if asked, of the walls' particles."""
    scene, own = sph.scene, sph.own()
    chosen = {
        fluid.section.name: (own["id"] >= fluid.first) & (own["id"] < fluid.first + fluid.n) for fluid in scene.fluids
    }
    if scene.config.output.walls:
        chosen |= {wall.name: own["kind"] == wall.index + 1 for wall in scene.walls if wall.lattice is not None}
    background = scene.config.eos.background_pressure
    found = {}
    for name, mask in chosen.items():
        drho = own["drho"][mask]
        columns = {
            "velocity": three(own["v"][mask]).astype(np.float32),
            "pressure": (scene.pressure(drho) + background).astype(np.float32),
            "density": (scene.rho0 + drho).astype(np.float32),
            "mass": own["m"][mask].astype(np.float32),
        }
        found[name] = ParticleArray(own["id"][mask], three(own["x"][mask]), columns, UNITS)
    return found


def three(x: NDArray) -> NDArray[np.float64]:
    """[n, d] -> [n, 3]."""
    return np.pad(x, ((0, 0), (0, 3 - x.shape[1])))


def state(sph: "Sph") -> dict[str, Shard]:
    """Fluid by id: x in the engine's frame, v, drho. Walls by id: drho. Impulses. Collective."""
    world, d, n = sph.world, sph.scene.dimensions, sph.scene.n_fluid
    ids, columns = sph.fluid_state()
    layout = {"x": (np.float64, (d,)), "v": (np.float64, (d,)), "drho": (np.float64, ())}
    low, _ = block_ranges(n, world.size)[world.rank]
    found = {f"fluid/{k}": Shard(v, low, n) for k, v in by_id(world, [(ids, columns)], layout, n).items()}
    wall_ids, drho = sph.wall_state()
    rows = world.gather_rows(np.column_stack([wall_ids, np.ascontiguousarray(drho).view(np.int64)]))
    total = int(world.sum_int(np.array([len(wall_ids)]))[0])
    rows = np.zeros((0, 2), np.int64) if rows is None else rows[np.argsort(rows[:, 0])]
    offset = 0 if world.rank == 0 else total
    found["wall/id"] = Shard(np.ascontiguousarray(rows[:, 0]), offset, total)
    found["wall/drho"] = Shard(np.ascontiguousarray(rows[:, 1]).view(np.float64), offset, total)
    walls = len(sph.scene.walls)
    impulses = sph.impulses if world.rank == 0 else sph.impulses[:0]
    found["wall/impulse"] = Shard(impulses, 0 if world.rank == 0 else walls, walls)
    return found


def restore(sph: "Sph", reader: "Reader") -> None:
    """Replace all particles by those of a checkpoint. Collective."""
    world, n = sph.world, sph.scene.n_fluid
    low, high = block_ranges(n, world.size)[world.rank]
    columns = {name: reader.read(f"fluid/{name}", low, high) for name in ("x", "v", "drho")}
    total = reader.total("wall/id")
    sph.impulses[:] = reader.read("wall/impulse", 0, len(sph.scene.walls))
    sph.iteration, sph.time = reader.step, reader.time
    walls = (reader.read("wall/id", 0, total), reader.read("wall/drho", 0, total))
    sph.take_up(np.arange(low, high), columns, *walls)
