"""The plasma's arrays for the writers: fields, particles, and the state that checkpoints hold."""

import math
from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.sharding import by_id
from hpcpic.core.comm.world import World
from hpcpic.core.errors import Diverged
from hpcpic.core.files.arrays import Column, FieldArray, ParticleArray, Rows, Shard
from hpcpic.core.space.domain import block_ranges
from hpcpic.plasma.field.mesh import Mesh
from hpcpic.plasma.particles.cloud import CHUNK, Cloud
from hpcpic.plasma.particles.push_spec import PushSpec
from hpcpic.plasma.physics.species_fields import MESH_FIELDS, unit_in
from hpcpic.plasma.setup.scene import Scene
from hpcpic.plasma.sizes import EDGE, MAX_SPEED


def fields(mesh: Mesh, names: Collection[str]) -> dict[str, FieldArray]:
    """Those of rho, phi and E of this rank's rows at t = n dt that are among the names."""
    d = mesh.domain.ndim
    e = np.stack([component[mesh.inside] for component in mesh.e], axis=-1)
    found = {
        "rho": mesh.rho,
        "phi": mesh.phi.inner,
        "E": e,
    }
    return {
        name: FieldArray(values, unit_in(MESH_FIELDS[name].unit, d)) for name, values in found.items() if name in names
    }


def particles(scene: Scene, cloud: Cloud) -> dict[str, ParticleArray]:
    """Ids, x^n in m and v^(n-1/2) in m/s of this rank's particles."""
    d = scene.dimensions
    result = {}
    for k, species in enumerate(scene.species):
        n, done = cloud.count(k), 0
        ids, position, velocity = np.empty(n, np.int64), np.zeros((n, 3)), np.zeros((n, 3))
        for numbers, tiles, components in cloud.export(k):
            rows = slice(done, done + len(numbers))
            ids[rows] = numbers + species.first
            position[rows, :d] = (anchors(scene, tiles) + components[:, :d]) * scene.spacing
            v = components[:, d:].astype(np.float64) * (scene.velocity_spacing / scene.time_step)
            velocity[rows, : v.shape[1]] = v
            done = rows.stop
        columns, units, offsets = {"velocity": velocity}, {"velocity": "m/s"}, {"velocity": -0.5 * scene.time_step}
        real = species.section
        of_one = {"charge": real.charge, "mass": real.mass, "weighting": species.m / real.mass}
        result[species.name] = ParticleArray(ids, position, columns, units, offsets, of_one)
    return result


def anchors(scene: Scene, tiles: NDArray[np.int32]) -> NDArray[np.integer]:
    """Column (row, plane) of the first cell of tiles."""
    edge, found, rest = EDGE[scene.dimensions], [], tiles
    for points in scene.points[:-1]:
        rest, tile = np.divmod(rest, -(-points // edge))
        found.append(tile)
    return np.stack([*found, rest], axis=1) * edge


def particles_by_row(scene: Scene, cloud: Cloud) -> NDArray[np.int64]:
    """Particles of this rank in each row of cells across the slab axis."""
    d, counts = scene.dimensions, np.zeros(scene.points[-1], np.int64)
    layer = math.prod(-(-points // EDGE[d]) for points in scene.points[:-1])  # tiles
    for k in range(len(scene.species)):
        for _, tiles, components in cloud.export(k):
            rows = tiles // layer * EDGE[d] + components[:, d - 1].astype(np.int64)
            counts += np.bincount(rows, minlength=len(counts))
    return counts


def state(scene: Scene, world: World, cloud: Cloud) -> dict[str, Shard]:
    """Tile, position in it [cells] and velocity [cells per step] by species, in order of the numbers."""
    d = scene.dimensions
    real = cloud.spec.dtype
    layout = {"tile": (np.int32, ()), "position": (real, (d,)), "velocity": (real, (cloud.spec.velocities,))}
    result = {}
    for k, species in enumerate(scene.species):
        chunks = (
            (numbers, {"tile": tiles, "position": components[:, :d], "velocity": components[:, d:]})
            for numbers, tiles, components in cloud.export(k)
        )
        low, _ = block_ranges(species.n, world.size)[world.rank]
        for name, values in by_id(world, chunks, layout, species.n).items():
            result[f"{species.name}/{name}"] = Shard(values, low, species.n)
    return result


def columns(scene: Scene, spec: PushSpec) -> dict[str, Column]:
    """What `state` gives."""
    real, d = np.dtype(spec.dtype).type, scene.dimensions
    edge = EDGE[d]
    tiles = math.prod(-(-points // edge) for points in scene.points[:d])
    found: dict[str, Column] = {}
    for species in scene.species:
        found |= {
            f"{species.name}/tile": Column(np.int32, (species.n,), 0, tiles - 1),
            f"{species.name}/position": Column(real, (species.n, d), 0, np.nextafter(real(edge), real(0))),
            f"{species.name}/velocity": Column(real, (species.n, spec.velocities), -MAX_SPEED, MAX_SPEED),
        }
    return found


def restore(scene: Scene, world: World, cloud: Cloud, reader: Rows) -> None:
    """Replace all particles by those of a state. Raises Diverged when one is not in its tile."""
    cloud.clear()
    for k, species in enumerate(scene.species):
        low, high = block_ranges(species.n, world.size)[world.rank]
        for first in range(0, -(-species.n // world.size), CHUNK):
            a, b = min(low + first, high), min(low + first + CHUNK, high)
            columns = [reader.read(f"{species.name}/{name}", a, b) for name in ("tile", "position", "velocity")]
            if not all_in_tiles(scene, *columns[:2]):
                raise Diverged(f"a position of {species.name} is not a number, or not within its tile")
            cloud.admit(cloud.records(k, np.arange(a, b), *columns))
            cloud.migrate(reader.step)
            cloud.deliver()
    cloud.deposit_all()


def all_in_tiles(scene: Scene, tiles: NDArray[np.int32], x: NDArray) -> bool:
    """True if the positions x[n, d], in cells, are within their tiles, and these on the grid: kernels rely on it."""
    d = scene.dimensions
    corner = anchors(scene, tiles)
    return bool(((x >= 0) & (x < EDGE[d]) & (corner >= 0) & (corner + x < scene.points[:d])).all())
