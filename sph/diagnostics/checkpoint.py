"""The state of an SPH run in order of ids, for checkpoints and digests, and back."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.sharding import by_id
from hpcpic.core.files.arrays import Column, Shard
from hpcpic.core.space.domain import block_ranges
from sph.kernels.marks import CODES, FLOWS, FLUID, NORMAL, REAL
from sph.particles.walls import add_walls

if TYPE_CHECKING:
    from hpcpic.core.files.sealed import Reader
    from sph.step import Sph


def state(sph: "Sph") -> dict[str, Shard]:
    """x (relative to the lower corner, storage axes), v, drho of the fluid; of walls also which particles there are."""
    d, world = sph.scene.dimensions, sph.world
    own, total, shapes = _own(sph, fluid=True), sph.scene.n_fluid, {"x": (d,), "v": (d,), "drho": ()}
    if sph.scene.config.domain.outflow:
        total, shapes = _numbered(sph, own), shapes | {"number": ()}
    result = _sharded(sph, own, total, shapes, "")
    whole = {"reach": np.array([sph.reach])} if sph.farthest_reach else {}  # which neighbours are looked at
    if _have_periods(sph):
        whole["gauges/since"] = np.array([sph.gauges.since])
    if sph.strays.count:
        whole["strays"] = np.array([sph.strays.count])
    if sph.scene.walls:
        whole |= {"walls/made": sph.walls.boxes(), "walls/impulse": sph.impulses}
    for name, rows in whole.items():
        low, high = block_ranges(len(rows), world.size)[world.rank]
        result[name] = Shard(rows[low:high], low, len(rows))
    if not sph.scene.walls:
        return result
    own = _own(sph, fluid=False)
    shapes = {"x": (d,), "drho": (), "number": ()} | ({"normal": (d,)} if sph.law.repulsive else {})
    return result | _sharded(sph, own, _numbered(sph, own), shapes, "walls/")


def _numbered(sph: "Sph", own: dict[str, NDArray]) -> int:
    """How many particles of a kind there are; their ids, which have gaps, become `number`, ranks among them `id`."""
    ids = _everybodys(sph, own["id"])
    own["number"], own["id"] = own["id"], np.searchsorted(ids, own["id"])
    return len(ids)


def _have_periods(sph: "Sph") -> bool:
    """Whether it matters up to when gauges have been read: a run may stop between two samples."""
    return any(gauge.period for gauge in sph.scene.config.gauge)


def _own(sph: "Sph", fluid: bool) -> dict[str, NDArray]:
    """Columns [n, ...] of the own particles of the fluid, or of walls."""
    bodies = sph.bodies
    rows = bodies.fluid if fluid else np.setdiff1d(bodies.rows, bodies.fluid, assume_unique=True)
    own = {name: bodies.arena[name][..., rows].T for name in ("x", "v", "drho")} | {"id": bodies.key[rows] // CODES}
    if sph.law.repulsive:
        own["normal"] = sph.scene.normals[bodies.flags[rows] >> NORMAL][:, sph.axes]
    return own


def _everybodys(sph: "Sph", ids: NDArray[np.int64]) -> NDArray[np.int64]:
    """Sorted ids of all ranks, on all ranks."""
    found = sph.world.gather_rows(np.ascontiguousarray(ids))
    content = np.sort(found).tobytes() if found is not None else None
    return np.frombuffer(sph.world.bcast(content), np.int64)


def _sharded(
    sph: "Sph", rows: dict[str, NDArray], total: int, shapes: dict[str, tuple], where: str
) -> dict[str, Shard]:
    layout = {name: (np.int64 if name == "number" else np.float64, shape) for name, shape in shapes.items()}
    chunk = rows["id"], {name: np.ascontiguousarray(rows[name]) for name in layout}
    low, _ = block_ranges(total, sph.world.size)[sph.world.rank]
    shared = by_id(sph.world, [chunk], layout, total)
    return {where + name: Shard(values, low, total) for name, values in shared.items()}


def columns(sph: "Sph", reader: "Reader") -> dict[str, Column]:
    """What `state` gives: fluid of some density, less of it where it may leave, and as many wall particles as were
    made.
    """
    scene, real = sph.scene, np.float64
    d, far = scene.dimensions, scene.spacing / np.finfo(real).eps  # farther out, places are coarser than the spacing
    n = reader.total("number") if scene.config.domain.outflow and "number" in reader.names else scene.n_fluid
    found = {
        "x": Column(real, (n, d), -far, far),
        "v": Column(real, (n, d)),
        "drho": Column(real, (n,), -scene.rho0),
    }
    if scene.config.domain.outflow:
        found["number"] = Column(np.int64, (n,), 0, scene.n_fluid - 1, increasing=True)
    if "strays" in reader.names:  # there have been some
        found["strays"] = Column(np.int64, (1,), 1)
    if sph.farthest_reach:
        found["reach"] = Column(real, (1,), 0.0, sph.farthest_reach)
    if _have_periods(sph):
        found["gauges/since"] = Column(real, (1,), high=reader.time, open=True)
    if scene.walls:
        walls, number = len(scene.walls), reader.total("walls/number")
        found |= {
            "walls/made": Column(real, (walls, 2, d), open=True),
            "walls/impulse": Column(real, sph.impulses.shape),
            "walls/x": Column(real, (number, d), -far, far),
            "walls/drho": Column(real, (number,)),
            "walls/number": Column(np.int64, (number,), increasing=True, legal=scene.has_wall_particles),
        }
        if sph.law.repulsive:
            found["walls/normal"] = Column(real, (number, d), -1.0, 1.0)
    return found


def restore(sph: "Sph", reader: "Reader") -> None:
    """Replace all particles by those of a checkpoint. Collective."""
    world, bodies = sph.world, sph.bodies
    sph.iteration, sph.time = reader.step, reader.time
    if sph.farthest_reach:
        sph.reach = float(reader.read("reach")[0])
    if _have_periods(sph):
        sph.gauges.since = float(reader.read("gauges/since")[0])
    sph.strays.count = int(reader.read("strays")[0]) if "strays" in reader.names else 0
    bodies.clear()
    outflow = bool(sph.scene.config.domain.outflow)
    total = reader.total("number") if outflow else sph.scene.n_fluid
    low, high = block_ranges(total, world.size)[world.rank]
    ids = reader.read("number", low, high) if outflow else np.arange(low, high)
    x, v, drho = (reader.read(name, low, high) for name in ("x", "v", "drho"))
    bodies.append(x.T, v.T, drho, sph.scene.fluid(ids)["m"], ids, FLUID | REAL | FLOWS)
    if sph.scene.walls:
        sph.walls.restore(reader.read("walls/made"), reader.time)
        sph.impulses[:] = reader.read("walls/impulse")
        low, high = block_ranges(reader.total("walls/number"), world.size)[world.rank]
        ids, x, drho = (reader.read(f"walls/{name}", low, high) for name in ("number", "x", "drho"))
        add_walls(sph, ids, x.T, drho)
    sph.resume()
