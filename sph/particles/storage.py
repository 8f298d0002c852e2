"""The particles of one rank in the slots of its arrays: own ones of fluid and walls, ghosts and images."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.migrate import Migrate
from hpcpic.core.comm.tags import Channel
from hpcpic.core.comm.world import World
from hpcpic.core.errors import ConfigError
from hpcpic.core.space.domain import block_ranges
from hpcpic.core.tasks.arena import Arena
from sph.kernels import readings
from sph.kernels.groups import OldState, Shown, State
from sph.kernels.marks import BODY, CODES, FLOWS, FLUID, LIQUID, OWN, REAL, WALL_BITS
from sph.physics.equation_of_state import compression
from sph.setup.scene import Scene

ROUNDING = 1e-6  # of a spacing
OVERRUN = 16  # slots behind the last one that vectors may touch
MAX_SLOTS = 2**31 * 7 // 8  # of a rank: their numbers are int32, and the arena takes an eighth more

Slots = NDArray[np.int64]


class Storage:
    """n own particles, and ghosts, in slots below `end`; where flags[slot] is 0 nobody is. New ones are put behind all
    others, until the cells sort them in.

    x [d, slots] m, relative to the lower corner of the domain, and v [d, slots] m/s, in storage axes; drho [slots]
    kg/m3 (rho - rho0); m [slots] kg; key [slots] int64 (number of the particle CODES + number of the image) are lines
    of one array, `state`. flags [slots] int32: see kernels.marks.
    """

    def __init__(self, scene: Scene, world: World, arena: Arena) -> None:
        self.scene, self.world, self.arena, self.d = scene, world, arena, scene.dimensions
        arena.group(y=State, y_old=OldState, shown=Shown)
        self.n = self.end = 0
        self._name_lines()
        self._since_sort: dict[str, Any] = {}
        self._room = 256  # for what is found near a place
        self._record = np.dtype([("numbers", np.float64, 2 * self.d + 2), ("id", np.int64), ("flags", np.int64)])
        self._migrate = Migrate(world, self._record.itemsize, Channel.PARTICLES)

    def _name_lines(self) -> None:
        """Give the lines of the state their names, here and in the arena."""
        state, d = self.arena["state"], self.d
        self.state, self.flags = state, self.arena["flags"]
        self.x, self.v, self.drho, self.m = state[:d], state[d : 2 * d], state[2 * d], state[2 * d + 1]
        self.key: NDArray[np.int64] = state[2 * d + 2].view(np.int64)
        self.arena.set(x=self.x, v=self.v, drho=self.drho, m=self.m, key=self.key)

    # ---- who is where

    def until_sorted(self, name: str, find: Callable[[], Any]) -> Any:
        """What `find` returns, found once until particles change their slots."""
        if name not in self._since_sort:
            self._since_sort[name] = find()
        return self._since_sort[name]

    @property
    def own_slots(self) -> Slots:
        """Slots of the own particles."""
        return self.until_sorted("own", lambda: np.flatnonzero(self.flags[: self.end] & OWN))

    @property
    def fluid_slots(self) -> Slots:
        """Slots of the own particles of the fluid."""
        return self.until_sorted("fluid", lambda: np.flatnonzero(self.flags[: self.end] & (OWN | FLUID) == OWN | FLUID))

    def beside(self, at: NDArray[np.float64], reach: NDArray[np.float64]) -> Slots:
        """Slots of the own fluid not farther from a place, m from the lower corner of the domain, than `reach` m along
        any axis, and a few beside it; both in physical axes.
        """
        axes = list(self.scene.axes)
        place, reach = at[axes], reach[axes] + ROUNDING * self.scene.spacing
        while True:
            slots = np.empty(self._room, np.int64)
            n = readings.beside(self.end, self.flags, self.x, place, reach, self.arena["period"], slots)
            if n <= self._room:
                return slots[:n]
            self._room = 2 * n

    def with_few(self, slots: Slots, most: int) -> NDArray[np.bool_]:
        """Which of the fluid in these slots has at most so many neighbours of fluid, ghosts counted."""
        found = np.zeros(len(slots), np.bool_)
        readings.with_few(self.end, self.flags, self.key, self.x, slots, self.scene.support, most, found)
        return found

    def number(self, slot: int) -> int:
        """The number of the particle in a slot."""
        return int(self.key[slot] // CODES)

    def numbers(self, slots: Slots) -> NDArray[np.int64]:
        """The numbers of the particles in some slots."""
        return self.key[slots] // CODES

    def own_values(self, name: str) -> NDArray:
        """A copy of an array, own particles only: [n] or [d, n]. "id": their numbers, "wall": 1 + number of their wall,
        0 for fluid.
        """
        if name in ("id", "wall"):
            return self.numbers(self.own_slots) >> (WALL_BITS if name == "wall" else 0)
        return self.arena[name][..., self.own_slots]

    def liquid(self, ids: NDArray[np.int64]) -> NDArray[np.int64]:
        """Number of the liquid of particles of the fluid, by their numbers."""
        scene = self.scene
        numbers = [scene.liquids.number(fluid.section) for fluid in scene.fluids] + [0] * len(scene.inlets)
        return np.array(numbers, np.int64)[scene.kinds(ids)]

    def relative_density(self, slots: Slots) -> NDArray[np.float64]:
        """rho0 of the liquids of particles over that of the reference liquid [n], 1 for walls."""
        if not self.scene.liquids.densities:
            return np.ones(len(slots))
        return 1.0 / self.scene.liquids.table[0, self.flags[slots] >> LIQUID]

    def is_gas(self, slots: Slots) -> NDArray[np.bool_]:
        """Which particles [n] are gas."""
        liquids = self.scene.liquids
        return liquids.table[3, self.flags[slots] >> LIQUID] > 0.0 if liquids.gases else np.zeros(len(slots), bool)

    def farthest(self, axis: int, sign: float) -> float:
        """Where liquids end along a physical axis, up it or down it, m. Collective."""
        x = self.x[self.scene.axes.index(axis)]
        if self.scene.liquids.gases:
            slots = self.fluid_slots
            own = float((sign * x[slots[~self.is_gas(slots)]]).max(initial=-np.inf))
        else:
            own = readings.farthest(self.end, sign, self.flags, x)
        return sign * (self.world.max(own) + sign * self.scene.low[axis] + self.scene.spacing / 2)

    def compressed_density(self, slots: Slots) -> NDArray[np.float64]:
        """rho of particles [n] over that `relative_density`, kg/m3."""
        scene, drho = self.scene, self.drho[slots]
        found = scene.rho0 + drho
        if scene.liquids.gases:
            gas = self.is_gas(slots)
            u = 1.0 + scene.eos.pressure(drho[gas]) / (scene.liquids.ambient * scene.rho0 * scene.c0**2)
            found[gas] = scene.rho0 * compression(u)
        return found

    def set_own_values(self, name: str, values: NDArray | float) -> None:
        """Replace what an array has of the own particles."""
        self.arena[name][..., self.own_slots] = values

    def physical(self, name: str, slots: Slots | None = None) -> NDArray[np.float64]:
        """Positions "x" (absolute, m) or velocities "v" (m/s) [n, d] in physical order of axes, of these slots or of
        the own particles.
        """
        slots = self.own_slots if slots is None else slots
        values = np.empty((len(slots), self.d))
        values[:, list(self.scene.axes)] = self.arena[name][:, slots].T
        if name == "x":
            values += self.scene.low
        return values

    def culprit(self, values: NDArray[np.float64]) -> str:
        """Number and place of the particle of the fluid whose value is largest, of all ranks: one value for each of
        `fluid_slots`. Collective.
        """
        values = np.where(np.isnan(values), np.inf, values)
        top = self.world.max(float(values.max(initial=-np.inf)))
        worst = self.fluid_slots[values == top]
        numbers = self.numbers(worst)
        number = int(self.world.max(float(numbers.max(initial=-1))))
        x = np.full((1, self.d), -np.inf)
        if number in numbers:
            x = self.physical("x", worst[numbers == number])
        place = ", ".join(f"{value:.4g}" for value in self.world.max_array(x[0]))
        return f"particle {number} at ({place}) m"

    # ---- coming and going

    def reserve(self, slots: int) -> bool:
        """Make room for so many slots. True if there was none, so that arrays lie elsewhere now."""
        slots += OVERRUN
        if slots > MAX_SLOTS:
            raise ConfigError([f"{slots:.3g} particles on a rank, more than {MAX_SLOTS}: more ranks"])
        moved = self.arena.reserve(slots=slots)
        if moved:
            self._name_lines()
        return moved

    def extend(self, n: int) -> Slots:
        """n new slots behind all others."""
        self._since_sort.clear()
        self.reserve(self.end + n)
        self.end += n
        return np.arange(self.end - n, self.end)

    def append(self, x: NDArray, v: NDArray, drho: NDArray, m: NDArray, ids: NDArray, flags: NDArray | int) -> None:
        """Add n own particles, x and v [d, n]."""
        slots = self.extend(len(ids))
        for name, values in (("x", x), ("v", v), ("drho", drho), ("m", m), ("flags", flags | BODY | OWN)):
            self.arena[name][..., slots] = values
        self.key[slots] = np.asarray(ids, np.int64) * CODES
        self.n += len(ids)

    def append_fluid(self) -> None:
        """Add this rank's share by number of the fluid at t = 0."""
        scene = self.scene
        low, high = block_ranges(scene.n_fluid, self.world.size)[self.world.rank]
        ids, axes = np.arange(low, high), list(scene.axes)
        fluid = scene.fluid(ids)
        x, v = (fluid["x"] - scene.low)[:, axes].T, fluid["v"][:, axes].T
        self.append(x, v, fluid["drho"], fluid["m"], ids, FLUID | REAL | FLOWS | self.liquid(ids) << LIQUID)

    def remove(self, slots: Slots) -> None:
        """Take out own particles."""
        self.flags[slots] = 0
        self.n -= len(slots)
        self._since_sort.clear()

    def remove_ghosts(self, slots: NDArray[np.int32]) -> None:
        """Take out ghosts."""
        self.flags[slots] = 0
        self._since_sort.clear()

    def clear(self) -> None:
        """Take out all."""
        self.flags[:] = 0
        self.n = self.end = 0
        self._since_sort.clear()

    def sorted(self, end: int) -> None:
        """The cells have put all into slots below `end`."""
        self._since_sort.clear()
        self.flags[end : max(end, self.end)] = 0
        self.end = end

    def migrate(self, iteration: int, leaving: Slots, owners: NDArray[np.int64]) -> None:
        """Send the own particles in the slots `leaving` to other ranks, their owners. Collective."""
        outgoing = {peer: self._pack(leaving[owners == peer]) for peer in set(owners.tolist())}
        self.remove(leaving)
        for message in self._migrate.send(iteration, outgoing):
            records = np.ascontiguousarray(message).reshape(-1).view(self._record)
            numbers, d = records["numbers"].T, self.d
            x, v, drho, m = numbers[:d], numbers[d : 2 * d], numbers[2 * d], numbers[2 * d + 1]
            self.append(x, v, drho, m, records["id"], records["flags"])

    def _pack(self, slots: Slots) -> NDArray[np.uint8]:
        records = np.empty(len(slots), self._record)
        records["numbers"] = self.state[: 2 * self.d + 2, slots].T
        records["id"], records["flags"] = self.numbers(slots), self.flags[slots]
        return records.view(np.uint8).reshape(len(slots), -1)

    def free(self) -> None:
        """Release what MPI holds (all ranks together)."""
        self._migrate.free()
