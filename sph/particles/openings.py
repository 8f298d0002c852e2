"""Places where fluid comes in and where it leaves.

In the boxes of inlets and outlets fluid has no acceleration and no change of density by its neighbours: both are
prescribed at the end of every step. An inlet makes a particle in each row as soon as the last one has gone a spacing;
farther on than the kernel reaches from there its density is its own, and once past the end of the box it is fluid like
all other. An outlet takes out what has come to the end of its box.

The fluid before a box, as far as the kernel reaches, says what is not prescribed: the head before an inlet without a
level, the velocity before an outlet. Each rank adds these as integers, so that they have the same bits for any ranks.
"""

import logging
import math

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.world import World
from sph.kernels.marks import FLOWS, FLUID, REAL
from sph.particles.slabs import Slabs
from sph.particles.storage import Slots, Storage
from sph.physics.timestep import Clock
from sph.setup.openings import Place, Sink, Source
from sph.setup.scene import Scene

log = logging.getLogger("hpcpic.sph")

FIXED_POINT = 2.0**40
HEAD, SPEED = 0, 1


class Exchange:
    """What has come and left: made[k] particles made by inlet k, filled[k] of them at t = 0, on all ranks; gone[kind]
    (see Scene.kinds) taken out by this rank; and the sides of the domain through which fluid leaves for good.
    """

    def __init__(self, scene: Scene, world: World, clock: Clock, storage: Storage) -> None:
        self.scene, self.world, self.clock, self.storage = scene, world, clock, storage
        self.faces = [("xyz".index(face[0]), face[1] == "+") for face in scene.config.domain.outflow]
        self.margin = 0.5 * scene.support  # more than the fluid moves in a step
        self.gone = np.zeros(len(scene.masses), np.int64)
        self.made, self.filled = np.zeros((2, len(scene.inlets)), np.int64)
        self._has_begun, self._left = False, 0

    @property
    def come(self) -> int:
        """Particles more on all ranks than fluids have at the start, as far as their leaving is known."""
        return int(self.made.sum()) - self._left

    def leave(self, box: tuple[NDArray, NDArray]) -> None:
        """Take out what has left; before particles change ranks. `box`: around all fluid before it moved, m."""
        scene, storage = self.scene, self.storage
        for axis, up in self.faces:
            side = scene.high[axis] if up else scene.low[axis]
            if (box[1][axis] + self.margin > side) if up else (box[0][axis] - self.margin < side):
                slots = storage.fluid_slots
                x, at = storage.x[scene.axes.index(axis), slots], side - scene.low[axis]
                self.take(slots[x > at if up else x < at], "xyz"[axis] + "-+"[up])

    def take(self, slots: Slots, where: str) -> None:
        """Take out own fluid."""
        if len(slots):
            kinds = self.scene.kinds(self.storage.numbers(slots))
            self.gone += np.bincount(kinds, minlength=len(self.gone))
            self.storage.remove(slots)
            if not self._has_begun:
                self._has_begun = True
                log.info("fluid leaves through %s from t = %.3g s on", where, self.clock.time)

    def scalars(self, mass: float) -> dict[str, float]:
        """Mass that has come in since t = 0 and that has left, and the sum of what is here (`mass`) and gone less what
        came, kg (2D: kg/m). Collective.
        """
        if not self.scene.config.exchanges:
            return {}
        masses, gone = self.scene.masses, self.world.sum_int(self.gone)
        self._left = int(gone.sum())
        came = math.fsum(masses[len(self.scene.fluids) :] * (self.made - self.filled))
        left = math.fsum(masses * gone)
        return {"inflow": came, "outflow": left, "mass_total": math.fsum([mass, left, -came])}


class Openings:
    """ways[k][row]: how far the last one of a row has gone from the end of
    its box, m; mean[n, 3]: head in the middle of the box in m2/s2 and velocity of the fluid before it in m/s, of
    inlets, for which it is the prescribed one, and then of outlets; and how far what is in an outlet has gone back, m,
    as it may by the spare length of its box. columns[k]: height of the columns of fluid in outlet k, m, 0 but for
    waves: they grow with the surface of a wave and narrow, so that as much is in the box as before it.
    """

    def __init__(self, scene: Scene, clock: Clock, storage: Storage, slabs: Slabs, exchange: Exchange) -> None:
        self.scene, self.clock, self.storage, self.slabs, self.exchange = scene, clock, storage, slabs, exchange
        self.places: list[Source | Sink] = [*scene.inlets, *scene.outlets]
        self.way = np.concatenate([np.zeros(0), *(np.full(len(inlet.rows), inlet.step) for inlet in scene.inlets)])
        self.ways = np.split(self.way, np.cumsum([len(inlet.rows) for inlet in scene.inlets])[:-1])
        self.mean = np.zeros((len(self.places), 3))
        self.columns = np.array([place.wave**2 / place.g if place.wave else 0.0 for place in scene.outlets])
        self._sums: list[NDArray[np.float64]] = []

    # ---- during a step

    def hold(self, forces: bool, rate: int) -> None:
        """No acceleration and no change of density in the boxes, in the last pair sums; rate: line of its sums, -1 for
        none. Who is in a box was decided where neighbours were found.
        """
        slots = self.held
        arena = self.storage.arena
        if forces:
            m, external = self.storage.m[slots], arena["external"][:, None]
            arena["sums"][: self.storage.d, slots] = -external * m / arena["factors"][0]
        if rate >= 0:
            arena["sums"][rate, self.pressed] = 0.0

    @property
    def held(self) -> Slots:
        """Slots of the own fluid in the boxes."""
        return self.storage.until_sorted("held", lambda: self._slots(*(place.free for place in self.places)))

    @property
    def pressed(self) -> Slots:
        """Those of them whose density is prescribed."""
        return self.storage.until_sorted("pressed", lambda: self._slots(*(place.pressed for place in self.places)))

    def _slots(self, *until: float) -> Slots:
        return np.unique(np.concatenate([self._between(p, p.end, last) for p, last in zip(self.places, until)]))

    def still(self) -> None:
        """Nothing is shifted in the boxes."""
        self.storage.arena["offset"][:, self.held] = 0.0

    # ---- at the end of a step

    def begin(self) -> None:
        """Fill the boxes of inlets and prescribe the flow at t = 0. Collective."""
        self._look(first=True)
        for k, inlet in enumerate(self.scene.inlets):
            for column in range(inlet.columns):
                self._make(k, np.flatnonzero(inlet.wet(self.mean[k, HEAD])), (column + 0.5) * inlet.step)
            self.ways[k][inlet.wet(self.mean[k, HEAD])] = 0.5 * inlet.step
        self.exchange.filled[:] = self.exchange.made
        self._prescribe()

    def follow(self) -> None:
        """Fluid leaves and comes in after a step of the clock's length, to its end. Collective."""
        for k, (outlet, (head, _, _)) in enumerate(zip(self.scene.outlets, self.mean[len(self.scene.inlets) :])):
            slots = self._between(outlet, outlet.free, outlet.end + outlet.sign * self.scene.support)
            x = self.storage.physical("x", slots)
            gone = outlet.sign * (x[:, outlet.axis] - outlet.end) > 0.0
            if outlet.has_surface:  # what a falling surface has left above it would stay there
                gone |= head + outlet.from_middle(x) < -0.5 * outlet.g * self.scene.spacing
            self.exchange.take(slots[gone], outlet.name)
            if outlet.wave:
                self.columns[k] *= 1.0 + self.clock.time_step * outlet.growth(head, self.columns[k])
        for k, inlet in enumerate(self.scene.inlets):
            self._let_in(k, inlet)
        self._look()
        self._prescribe()

    def _let_in(self, k: int, inlet: Source) -> None:
        """What has come in through an inlet since the step began."""
        head, speed = self.mean[k, HEAD], self.mean[k, SPEED]
        way, wet = self.ways[k], inlet.wet(head)
        way += self.clock.time_step * speed * inlet.profile
        rows = np.flatnonzero(wet & (way >= inlet.step))
        way[rows] -= inlet.step
        way[~wet] = np.minimum(way[~wet], inlet.step)
        self._make(k, rows, way[rows])

    def _make(self, k: int, rows: NDArray[np.int64], way: NDArray | float) -> None:
        """Make particles of inlet k in rows, `way` m from where these begin; all ranks count them alike."""
        scene, inlet, axes = self.scene, self.scene.inlets[k], list(self.scene.axes)
        x = inlet.rows[rows]
        x[:, inlet.axis] += inlet.sign * way
        ids = scene.n_fluid + k + len(scene.inlets) * (self.exchange.made[k] + np.arange(len(rows)))
        self.exchange.made[k] += len(rows)
        x = (x - scene.low)[:, axes]
        mine = self.slabs.owner[self.slabs.grid.layer(x[:, 0])] == self.slabs.world.rank
        zeros, mass = np.zeros((scene.dimensions, len(rows))), np.full(len(rows), inlet.mass)
        drho = self._excess(inlet, self.mean[k, HEAD], inlet.rows[rows[mine]])
        values = (x.T[:, mine], zeros[:, mine], drho, mass[mine], ids[mine])
        self.storage.append(*values, FLUID | REAL | FLOWS)

    def _look(self, first: bool = False) -> None:
        """Find heads and velocities from the fluid before the boxes; `first`: at t = 0. Collective."""
        t, dt = self.clock.time, self.clock.time_step
        self._sums = self._sums_before()
        for mean, place, sums in zip(self.mean, self.places, self._sums):
            weight, head, speed = sums.sum(axis=0).tolist()
            last, before, way = mean.tolist()
            if isinstance(place, Sink):
                speed = speed / weight if weight else before
                rise = 0.0 if first else speed - before
                head = place.head_at(place.head if first else last, speed, rise, dt)
                mean[:] = head, speed, min(max(way + dt * speed, -place.spare), 0.0)
            elif isinstance(place, Source):
                here = head / weight if weight else None
                mean[HEAD] = place.head_at(t, last, here, 1.0 if first else dt / place.relaxed)
                mean[SPEED] = place.speed(t, float(mean[HEAD]))

    def _sums_before(self) -> list[NDArray[np.float64]]:
        """By place [node, 3]: sums of 1, head in m2/s2 and velocity in m/s over the fluid before the box, which has its
        weight in the middle between the box and as far as the kernel reaches. Collective.
        """
        scene, storage, support = self.scene, self.storage, self.scene.support
        units, sums = np.array([1.0, scene.c0**2, scene.c0]), []
        for place in self.places:
            slots = self._between(place, place.free, place.free + place.inward * support)
            x, v = storage.physical("x", slots), storage.physical("v", slots)
            q = np.clip(place.inward * (x[:, place.axis] - place.free) / support, 0.0, 1.0)
            head = scene.eos.head(storage.drho[slots]) - place.from_middle(x)
            terms = np.stack([np.ones(len(x)), head, place.sign * v[:, place.axis]], axis=1) / units
            nodes, shares = place.shares(x)
            shares *= (q * (1.0 - q))[:, None]
            sums.append(np.zeros((place.nodes, 3), np.int64))
            np.add.at(sums[-1], nodes, np.rint(shares[..., None] * terms[:, None] * FIXED_POINT).astype(np.int64))
        whole = self.slabs.world.sum_int(np.concatenate(sums)) / FIXED_POINT * units
        return np.split(whole, np.cumsum([place.nodes for place in self.places])[:-1])

    def _between(self, place: Place, first: float, last: float) -> Slots:
        """Slots of own fluid between two places along the axis of a box, as wide as that."""
        low, high = place.low.copy(), place.high.copy()
        low[place.axis], high[place.axis] = min(first, last), max(first, last)
        return self.storage.beside((low + high) / 2 - self.scene.low, (high - low) / 2)

    @staticmethod
    def _outwards(place: Sink, sums: NDArray, x: NDArray, speed: float, way: float) -> NDArray[np.float64]:
        """Velocity[n] at x[n, d] in an outlet: by rows what flows out, and no row comes in while others leave; what has
        gone back, by the spare length of the box at most, moves as one: what left by some rows while it came back by
        others would be lost.
        """
        total = float(sums[:, 2].sum())
        if way < 0.0 or total <= 0.0:
            return np.full(len(x), max(speed, 0.0) if way <= -place.spare else speed)
        out = np.maximum(sums[:, 2], 0.0)
        out *= total / float(out.sum())
        nodes, shares = place.shares(x)
        weight, flow = np.sum(shares * sums[nodes, 0], axis=1), np.sum(shares * out[nodes], axis=1)
        return np.where(weight > 0.0, flow / np.where(weight > 0.0, weight, 1.0), speed)

    def _prescribe(self) -> None:
        """Give what is in the boxes the velocities and densities of now."""
        storage, scene = self.storage, self.scene
        for place, sums, (head, speed, way) in zip(self.places, self._sums, self.mean):
            slots = self._between(place, place.end, place.free)
            x, along = storage.physical("x", slots), scene.axes.index(place.axis)
            if isinstance(place, Source):
                forward = speed * place.profile_at(x)
            else:
                forward = self._outwards(place, sums, x, speed, way)
            storage.v[:, slots] = 0.0
            if isinstance(place, Sink) and place.wave:
                rate = place.growth(head, self.columns[scene.outlets.index(place)])
                storage.v[:, slots] = rate * place.up[list(scene.axes), None] * place.height(x)
                forward -= rate * (place.sign * (x[:, place.axis] - place.free) + 0.5 * scene.support)
            storage.v[along, slots] = place.sign * forward
            pressed = self._between(place, place.end, place.pressed)
            storage.drho[pressed] = self._excess(place, head, storage.physical("x", pressed))

    def _excess(self, place: Place, head: float, x: NDArray) -> NDArray[np.float64]:
        """rho - rho0 [n] at rest at x[n, d] in a box, for the head in its middle in m2/s2."""
        rest = head + place.from_middle(x)
        return self.scene.eos.excess_at_head(np.maximum(rest, 0.0) if place.has_surface else rest)
