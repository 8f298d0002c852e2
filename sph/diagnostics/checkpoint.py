"""The state of an SPH run in order of ids, for checkpoints and digests, and back."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.sharding import by_id
from hpcpic.core.files.arrays import Column, Shard
from hpcpic.core.files.sealed import Reader
from hpcpic.core.space.domain import block_ranges
from sph.diagnostics.gauges import Gauges
from sph.kernels.marks import FLOWS, FLUID, LIQUID, NORMAL, REAL, WALL_BITS
from sph.particles.openings import Exchange, Openings
from sph.particles.rigid.bodies import Bodies
from sph.particles.skin import Skin
from sph.particles.storage import Storage
from sph.particles.strays import Strays
from sph.particles.wall_forces import WallForces
from sph.physics.timestep import Clock

FASTEST = 10.0  # times c0: at c0, or the speed of its walls, a run ends
DENSEST = 10.0  # times rho0: of walls, whose densities are extrapolated
Arrays = dict[str, NDArray]
Shapes = dict[str, tuple[int, ...]]


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """What the state of a run is taken from, and given back to."""

    clock: Clock
    storage: Storage
    forces: WallForces
    gauges: Gauges
    strays: Strays
    skin: Skin
    bodies: Bodies | None
    exchange: Exchange
    openings: Openings | None

    def state(self) -> dict[str, Shard]:
        """x (relative to the lower corner, storage axes) m, v m/s, drho kg/m3 of the fluid; of walls also which
        particles there are. Collective.
        """
        scene = self.storage.scene
        own, total, shapes = self._own(fluid=True), scene.n_fluid, self._shapes("x", "v", "drho")
        if scene.config.exchanges:
            total, shapes = self._count(own), shapes | self._shapes("number")
        result = self._sharded(own, total, shapes, "")
        for name, rows in self._whole().items():
            low, high = self._share(len(rows))
            result[name] = Shard(rows[low:high], low, len(rows))
        if not scene.walls:
            return result
        own, shapes = self._own(fluid=False), self._shapes("x", "drho", "number", *self._normal)
        return result | self._sharded(own, self._count(own), shapes, "walls/")

    def _whole(self) -> Arrays:
        """The arrays of which every rank has all values."""
        whole = {"reach": np.array([self.skin.reach])} if self.skin.farthest else {}  # which neighbours are looked at
        if self._have_periods:
            whole["gauges/since"] = np.array([self.gauges.since])
        if (sensors := self.gauges.sensors).gauges:
            whole["gauges/pressed"] = np.stack([sensors.integrals, sensors.lasted], axis=1)
        if self.strays.count:
            whole["strays"] = np.array([self.strays.count])
        if self.storage.scene.config.exchanges:
            whole["gone"] = self.storage.world.sum_int(self.exchange.gone)
        if self.openings:
            whole["openings/means"] = self.openings.mean
            if self.openings.columns.any():
                whole["openings/columns"] = self.openings.columns
        if self.storage.scene.inlets:
            assert self.openings
            whole |= {"openings/made": self.exchange.made, "openings/ways": self.openings.way}
        if self.bodies:
            whole |= {"bodies": self.bodies.state} | self.bodies.kept()
        if self.storage.scene.walls:
            whole |= {"walls/made": self.forces.walls.boxes(), "walls/impulse": self.forces.impulses}
        return whole

    @property
    def _normal(self) -> list[str]:
        """The array of normals, where there are repulsive walls."""
        return ["normal"] if any(wall.rule.repulsive for wall in self.storage.scene.walls) else []

    @property
    def _have_periods(self) -> bool:
        """Whether gauges have periods: then the time of their last reading is kept, as a run may stop between two."""
        return any(gauge.period for gauge in self.storage.scene.config.gauge)

    def _shapes(self, *names: str) -> Shapes:
        """Shapes of what these arrays have of one particle."""
        return {name: (self.storage.d,) if name in ("x", "v", "normal") else () for name in names}

    def _share(self, n: int) -> tuple[int, int]:
        """First and end of this rank's rows of n."""
        world = self.storage.world
        return block_ranges(n, world.size)[world.rank]

    def _own(self, fluid: bool) -> Arrays:
        """Arrays [n, ...] of the own particles of the fluid, or of walls."""
        storage, scene = self.storage, self.storage.scene
        slots = storage.fluid_slots
        if not fluid:
            slots = np.setdiff1d(storage.own_slots, slots, assume_unique=True)
        own = {name: storage.arena[name][..., slots].T for name in ("x", "v", "drho")} | {"id": storage.numbers(slots)}
        if self._normal:
            own["normal"] = scene.normals[storage.flags[slots] >> NORMAL][:, list(scene.axes)]
        return own

    def _count(self, own: Arrays) -> int:
        """How many particles of a kind there are; their ids, which have gaps, become `number`, ranks among them `id`.
        Collective.
        """
        world = self.storage.world
        found = world.gather_rows(np.ascontiguousarray(own["id"]))
        content = np.sort(found).tobytes() if found is not None else None
        ids = np.frombuffer(world.bcast(content), np.int64)
        own["number"], own["id"] = own["id"], np.searchsorted(ids, own["id"])
        return len(ids)

    def _sharded(self, own: Arrays, total: int, shapes: Shapes, prefix: str) -> dict[str, Shard]:
        layout = {name: (np.int64 if name == "number" else np.float64, shape) for name, shape in shapes.items()}
        chunk = own["id"], {name: np.ascontiguousarray(own[name]) for name in layout}
        shared = by_id(self.storage.world, [chunk], layout, total)
        return {prefix + name: Shard(values, self._share(total)[0], total) for name, values in shared.items()}

    def columns(self, reader: Reader) -> dict[str, Column]:
        """What `state` gives: fluid of some density, less of it where it may leave, and as many wall particles as were
        made.
        """
        scene, real, varies = self.storage.scene, np.float64, self.storage.scene.config.exchanges
        d, far = scene.dimensions, scene.spacing / np.finfo(real).eps  # beyond, places are coarser than the spacing
        fastest = FASTEST * scene.c0
        n = reader.total("number") if varies and "number" in reader.names else scene.n_fluid
        found = {
            "x": Column(real, (n, d), -far, far),
            "v": Column(real, (n, d), -fastest, fastest),
            "drho": Column(real, (n,), -scene.rho0, scene.rho0),
        }
        if varies:
            most = (1 << WALL_BITS if scene.inlets else scene.n_fluid) - 1
            found["number"] = Column(np.int64, (n,), 0, most, increasing=True)
            found["gone"] = Column(np.int64, self.exchange.gone.shape, 0)
        if self.openings:
            found["openings/means"] = Column(real, self.openings.mean.shape, -(fastest**2), fastest**2)
            if self.openings.columns.any():
                found["openings/columns"] = Column(real, self.openings.columns.shape, 0.0, scene.diagonal)
        if scene.inlets:
            rows = sum(len(inlet.rows) for inlet in scene.inlets)
            found["openings/made"] = Column(np.int64, (len(scene.inlets),), 0)
            found["openings/ways"] = Column(real, (rows,), 0.0, max(inlet.step for inlet in scene.inlets))
        if "strays" in reader.names:  # there have been some
            found["strays"] = Column(np.int64, (1,), 1)
        if self.skin.farthest:
            found["reach"] = Column(real, (1,), 0.0, self.skin.farthest)
        if self._have_periods:
            found["gauges/since"] = Column(real, (1,), high=reader.time, open=True)
        if (sensors := self.gauges.sensors).gauges:
            found["gauges/pressed"] = Column(real, (len(sensors.gauges), 2))
        if self.bodies:
            limits = np.repeat([far, 1.0 + 1e-9, fastest, fastest / scene.spacing, np.inf], [3, 4, 3, 3, 6])
            found["bodies"] = Column(real, self.bodies.state.shape, -limits, limits)
            if "ties/ledger" in reader.names:
                found["ties/ledger"] = Column(real, self.bodies.ledger.shape)
            if "ties/springs" in reader.names:
                n = reader.total("ties/springs")
                found["ties/springs"] = Column(real, (n, 3), -scene.diagonal, scene.diagonal)
                found["ties/touching"] = Column(np.int64, (n,), 0, increasing=True)
            if "ties/film" in reader.names:
                found["ties/film"] = Column(real, (n,), 0.0, scene.spacing)
        if scene.walls:
            walls, number = len(scene.walls), reader.total("walls/number")
            impulse, densest = self.forces.largest_impulse(reader.time), DENSEST * scene.rho0
            found |= {
                "walls/made": Column(real, (walls, 2, d), open=True),
                "walls/impulse": Column(real, self.forces.impulses.shape, -impulse, impulse),
                "walls/x": Column(real, (number, d), -far, far),
                "walls/drho": Column(real, (number,), -densest, densest),
                "walls/number": Column(np.int64, (number,), increasing=True, legal=scene.has_wall_particles),
                **{f"walls/{name}": Column(real, (number, d), -1.0, 1.0) for name in self._normal},
            }
        return found

    def restore(self, reader: Reader) -> None:
        """Replace all particles by those of a checkpoint, which are in no slab yet. Collective."""
        storage, scene = self.storage, self.storage.scene
        self.clock.step, self.clock.time = reader.step, reader.time
        if self.skin.farthest:
            self.skin.reach = float(reader.read("reach")[0])
        if self._have_periods:
            self.gauges.since = float(reader.read("gauges/since")[0])
        if (sensors := self.gauges.sensors).gauges:
            sensors.integrals[:], sensors.lasted[:] = reader.read("gauges/pressed").T
        self.strays.count = int(reader.read("strays")[0]) if "strays" in reader.names else 0
        storage.clear()
        varies = scene.config.exchanges
        if varies:
            self.exchange.gone[:] = reader.read("gone") if storage.world.rank == 0 else 0
        if self.openings:
            self.openings.mean[:] = reader.read("openings/means")
            if self.openings.columns.any():
                self.openings.columns[:] = reader.read("openings/columns")
        if scene.inlets:
            assert self.openings
            self.exchange.made[:] = reader.read("openings/made")
            self.openings.way[:] = reader.read("openings/ways")
        low, high = self._share(reader.total("number") if varies else scene.n_fluid)
        ids = reader.read("number", low, high) if varies else np.arange(low, high)
        x, v, drho = (reader.read(name, low, high) for name in ("x", "v", "drho"))
        kinds = FLUID | REAL | FLOWS | storage.liquid(ids) << LIQUID
        storage.append(x.T, v.T, drho, scene.masses[scene.kinds(ids)], ids, kinds)
        if scene.walls:
            self.forces.walls.restore(reader.read("walls/made"), reader.time)
            if self.bodies:
                arrays = {name: reader.read(name) for name in reader.names if name.startswith(("bodies", "ties/"))}
                self.bodies.restore(arrays)
            self.forces.impulses[:] = reader.read("walls/impulse")
            low, high = self._share(reader.total("walls/number"))
            ids, x, drho = (reader.read(f"walls/{name}", low, high) for name in ("number", "x", "drho"))
            self.forces.walls.add(storage, ids, x.T, drho)
