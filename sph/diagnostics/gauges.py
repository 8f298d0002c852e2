"""Gauges: what an instrument at a place would read, from the particles around it.

Each rank adds its own particles as integers (2^-40 of a unit), so that readings have the same bits for any ranks.
"""

import math

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.products import product
from sph.case.config import AXES, ELEVATION, FLOW, FRONT, PRESSURE, VELOCITY, WALL_PRESSURE, Gauge
from sph.diagnostics.sensors import Sensors
from sph.diagnostics.snapshot import particles_at
from sph.particles.storage import Slots, Storage
from sph.physics.smoothing import SMOOTHING
from sph.setup.tanks import free_way
from sph.sizes import LEVELS

FIXED_POINT = 2.0**40
MIN_WEIGHT = 0.05  # of the kernel's sum, below which a point is dry
HALF_SLICE = 2  # spacings on each side of a section in which flow is counted

Own = dict[str, NDArray]


class Gauges:
    """The gauges of a run; `since`: the time of the last sample of the series."""

    def __init__(self, storage: Storage, sensors: Sensors, since: float = -math.inf) -> None:
        self.storage, self.scene, self.world, self.sensors = storage, storage.scene, storage.world, sensors
        self.since = since
        self._last: tuple[float, dict[str, float]] = (math.nan, {})  # time and readings
        self._beds: dict[str, float] = {}  # by gauge

    @property
    def remember(self) -> bool:
        """Whether a reading depends on the last sample: then its time is a part of the state."""
        return any(gauge.kind is WALL_PRESSURE or gauge.period for gauge in self.scene.config.gauge)

    def due(self, time: float) -> list[Gauge]:
        """The gauges whose period is over."""
        return [gauge for gauge in self.scene.config.gauge if due(gauge, time, self.since)]

    def values(self, time: float) -> dict[str, float]:
        """Readings of the gauges whose period is over: one number each, or one per axis. Collective."""
        if time != self._last[0]:
            gauges = self.due(time)
            points = [gauge for gauge in gauges if gauge.kind.at_point]
            readings = self.at_points(points) if points else {}
            readings |= {gauge.name: self.read(gauge) for gauge in gauges if not gauge.kind.at_point}
            self._last = time, readings
        return self._last[1]

    def sampled(self, time: float) -> None:
        """Let means over time begin anew, as the series has the readings of this time. Collective."""
        if self.remember:
            self.values(time)  # which stay the readings of this time
            self.sensors.begin_anew([gauge for gauge in self.due(time) if gauge.kind is WALL_PRESSURE])
            self.since = time

    def read(self, gauge: Gauge) -> float:
        """What one gauge that is no point reads from the fluid of all ranks. Collective."""
        if gauge.kind is WALL_PRESSURE:
            return self.sensors.read(gauge)
        if gauge.kind is FRONT:
            return self.front(gauge)
        own = particles_at(self.storage, self.near(gauge.at, self.reach(gauge)))
        if gauge.kind is ELEVATION:
            return self.elevation(gauge, own)
        if gauge.kind is FLOW:
            return self.flow(gauge, own)
        raise unread(gauge)

    def reach(self, gauge: Gauge) -> NDArray[np.float64]:
        """How far from its place a gauge looks at fluid along each axis, m."""
        reach = np.full(self.scene.dimensions, self.scene.support)
        if gauge.kind.column:
            reach[self.scene.vertical(gauge)[0]] = np.inf
        if gauge.kind is FLOW:
            reach[:] = [size / 2 or np.inf for size in gauge.size or (0.0,) * len(reach)]
            reach[gauge.direction[0]] = HALF_SLICE * self.scene.spacing
        return reach

    def near(self, at: tuple[float, ...], reach: NDArray) -> Slots:
        """Slots of the own fluid not farther from a place than `reach` along any axis, and a few beside it."""
        return self.storage.beside(np.array(at) - self.scene.low, reach)

    def separation(self, x: NDArray, at: tuple[float, ...] | NDArray) -> NDArray[np.float64]:
        """x[n, d] - at in m (one place, or [n, d]), to the nearest image along periodic axes."""
        r = x - np.array(at)
        length = self.scene.high - self.scene.low
        return np.where(self.scene.periodic, r - length * np.rint(r / length), r)

    def summed(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Sums over n and over all ranks of values[n, k], rounded to 2^-40 each. Collective."""
        return self.world.sum_int(np.rint(values * FIXED_POINT).astype(np.int64).sum(axis=0)) / FIXED_POINT

    def at_points(self, gauges: list[Gauge]) -> dict[str, float]:
        """Pressures in Pa and velocities in m/s: Shepard's mean of the fluid within the support, 0 where there is none.
        Collective.

        Pressures are carried to the height of the gauge as in fluid at rest: half a spacing matters at a floor.
        """
        scene, d = self.scene, self.scene.dimensions
        slots = [self.near(gauge.at, self.reach(gauge)) for gauge in gauges]
        of = np.repeat(np.arange(len(gauges)), [len(found) for found in slots])
        own = particles_at(self.storage, np.concatenate(slots))
        r = self.separation(own["x"], np.array([gauge.at for gauge in gauges])[of])
        weight = SMOOTHING[scene.kernel].value(np.sqrt(np.sum(r * r, axis=1)) / scene.h, d)
        weight *= own["rest"] / (scene.rho0 * scene.h**d)
        weight[np.sum(r * r, axis=1) >= scene.support**2] = 0.0
        head = scene.eos.pressure(own["drho"]) - scene.rho0 * own["relative"] * product(r, scene.gravity)
        unit = np.array([1.0, scene.rho0 * scene.c0**2, *[scene.c0] * d])
        terms = weight[:, None] * np.column_stack([np.ones(len(r)), head, own["v"]]) / unit
        sums = np.zeros((len(gauges), 2 + d), np.int64)
        np.add.at(sums, of, np.rint(terms * FIXED_POINT).astype(np.int64))
        totals = self.world.sum_int(sums) / FIXED_POINT
        found: dict[str, float] = {}
        for gauge, (full, *sides) in zip(gauges, totals):
            pressure, *v = (unit[1:] * sides / full if full > MIN_WEIGHT else np.zeros(1 + d)).tolist()
            if gauge.kind is PRESSURE:
                found[gauge.name] = pressure
            elif gauge.kind is VELOCITY:
                found |= {f"{gauge.name}_{axis}": value for axis, value in zip(AXES, v)}
            else:
                raise unread(gauge)
        return found

    def front(self, gauge: Gauge) -> float:
        """The farthest edge of the liquids along an axis, m. Collective."""
        return self.storage.farthest(*gauge.direction)

    def elevation(self, gauge: Gauge, own: Own) -> float:
        """Highest place over the point where half of the space is liquid, or that fluid which the gauge names, m; the
        bed when none is. Collective.
        """
        scene, d = self.scene, self.scene.dimensions
        if gauge.fluid or scene.liquids.gases:
            names = [fluid.section.name for fluid in scene.fluids]
            chosen = scene.kinds(own["id"]) == names.index(gauge.fluid) if gauge.fluid else ~own["gas"]
            own = {key: values[chosen] for key, values in own.items()}
        axis, sign = scene.vertical(gauge)
        others = [k for k in range(d) if k != axis]
        r = self.separation(own["x"], gauge.at)[:, others]
        near = np.sum(r * r, axis=1) < scene.support**2
        height = sign * own["x"][near, axis]
        ends = sorted((sign * scene.low[axis], sign * scene.high[axis]))
        step = scene.spacing / LEVELS
        levels = ends[0] + step * np.arange(math.ceil((ends[1] - ends[0]) / step) + 1)
        sums = np.zeros(len(levels), np.int64)
        reach = math.ceil(scene.support / step) + 1
        at = np.rint((height - ends[0]) / step).astype(np.int64)[:, None] + np.arange(-reach, reach + 1)
        inside = (at >= 0) & (at < len(levels))
        gap = height[:, None] - (ends[0] + step * at)
        q = np.sqrt(gap * gap + np.sum(r[near] ** 2, axis=1)[:, None]) / scene.h
        weight = SMOOTHING[scene.kernel].value(q, d) * (own["rest"][near] / (scene.rho0 * scene.h**d))[:, None]
        np.add.at(sums, at[inside], np.rint(weight[inside] * FIXED_POINT).astype(np.int64))
        share = self.world.sum_int(sums) / FIXED_POINT
        full = np.median(share[share > 0.5 * share.max()]) if share.max() > MIN_WEIGHT else 0.0
        wet = np.flatnonzero(share > 0.5 * full) if full else np.zeros(0, int)
        if not len(wet):
            return self.bed(gauge)
        top = int(wet[-1])
        if top + 1 == len(levels):
            return sign * float(levels[top])
        part = (share[top] - 0.5 * full) / (share[top] - share[top + 1])
        return sign * float(levels[top] + step * part)

    def bed(self, gauge: Gauge) -> float:
        """Where the walls that stay are first met from above, over the point of a gauge of level, m; where there are
        none, the side of the domain. It is looked for once.
        """
        if gauge.name in self._beds:
            return self._beds[gauge.name]
        scene, (axis, sign) = self.scene, self.scene.vertical(gauge)
        top, low = (scene.high, scene.low)[:: int(sign)]
        start, up = np.array(gauge.at, float), sign * np.eye(scene.dimensions)[axis]
        start[axis], depth = top[axis], abs(top[axis] - low[axis])
        walls = [wall for wall in scene.walls if not wall.moving and not wall.rigid]
        bed = float(top[axis] - sign * min(depth, free_way(walls, start, -up, depth, scene.spacing)))
        self._beds[gauge.name] = bed
        return bed

    def flow(self, gauge: Gauge, own: Own) -> float:
        """Volume per time through the section, m3/s (2D: m2/s), counted in a slice of two spacings on each side."""
        scene, d = self.scene, self.scene.dimensions
        k, sign = gauge.direction
        r = self.separation(own["x"], gauge.at)
        width = HALF_SLICE * scene.spacing
        inside = np.abs(r[:, k]) < width
        for axis, size in enumerate(gauge.size or (0.0,) * d):
            if axis != k and size:
                inside &= np.abs(r[:, axis]) <= size / 2
        weight = (1 - np.abs(r[inside, k]) / width) / width
        volume = own["rest"][inside] / own["dense"][inside]
        scale = scene.c0 * scene.spacing ** (d - 1)
        total = self.summed((weight * volume * own["v"][inside, k] / scale)[:, None])
        return float(total[0]) * scale * sign


def unread(gauge: Gauge) -> ValueError:
    """The error of a kind that is among the keys and that `Gauges` does not know."""
    return ValueError(f"{gauge.name}: nothing reads a gauge of {gauge.what}")


def due(gauge: Gauge, time: float, since: float) -> bool:
    """True if a multiple of the period lies in (since, time]; without a period, always."""
    if gauge.period is None or not math.isfinite(since):
        return True
    return math.floor(time / gauge.period * (1 + 1e-12)) > math.floor(since / gauge.period * (1 + 1e-12))
