"""Gauges: what an instrument at a place would read, from the particles around it.

Each rank adds its own particles as integers (2^-40 of a unit), so that readings have the same bits for any ranks.
"""

import math

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.products import product
from sph.case.config import AXES, Gauge
from sph.diagnostics.snapshot import particles_at
from sph.kernels import readings
from sph.particles.storage import Storage
from sph.physics.smoothing import SMOOTHING

FIXED_POINT = 2.0**40
LEVELS = 4  # heights looked at per spacing
MIN_WEIGHT = 0.05  # of the kernel's sum, below which a point is dry
HALF_SLICE = 2  # spacings on each side of a section in which flow is counted

Own = dict[str, NDArray]


class Gauges:
    """The gauges of a run; `since`: the time up to which they have been read."""

    def __init__(self, storage: Storage, since: float = -math.inf) -> None:
        self.storage, self.scene, self.world = storage, storage.scene, storage.world
        self.since = since

    def values(self, time: float) -> dict[str, float]:
        """Readings of the gauges whose period is over: one number each, or one per axis. Collective."""
        found: dict[str, float] = {}
        own: Own | None = None
        for gauge in self.scene.config.gauge:
            if not due(gauge, time, self.since):
                continue
            if gauge.what == "front":
                found[gauge.name] = self.front(gauge)
                continue
            if own is None:
                own = particles_at(self.storage, self.storage.fluid_slots)
            found |= self.read(gauge, own)
        self.since = time
        return found

    def read(self, gauge: Gauge, own: Own) -> dict[str, float]:
        """What one gauge reads from the fluid of all ranks. Collective."""
        if gauge.what == "elevation":
            return {gauge.name: self.elevation(gauge, own)}
        if gauge.what == "flow":
            return {gauge.name: self.flow(gauge, own)}
        names = [gauge.name] if gauge.what == "pressure" else [f"{gauge.name}_{axis}" for axis in AXES]
        return dict(zip(names, self.at_point(gauge, own)))

    def separation(self, x: NDArray, at: tuple[float, ...]) -> NDArray[np.float64]:
        """x[n, d] - at in m, to the nearest image along periodic axes."""
        r = x - np.array(at)
        length = self.scene.high - self.scene.low
        return np.where(self.scene.periodic, r - length * np.rint(r / length), r)

    def summed(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Sums over n and over all ranks of values[n, k], rounded to 2^-40 each. Collective."""
        return self.world.sum_int(np.rint(values * FIXED_POINT).astype(np.int64).sum(axis=0)) / FIXED_POINT

    def at_point(self, gauge: Gauge, own: Own) -> list[float]:
        """Pressure in Pa, or velocity in m/s: Shepard's mean of the fluid within the support, 0 where there is none.

        Pressures are carried to the height of the gauge as in fluid at rest: half a spacing matters at a floor.
        """
        scene, d = self.scene, self.scene.dimensions
        r = self.separation(own["x"], gauge.at)
        near = np.sum(r * r, axis=1) < scene.support**2
        r = r[near]
        weight = SMOOTHING[scene.kernel].value(np.sqrt(np.sum(r * r, axis=1)) / scene.h, d)
        weight *= own["m"][near] / (scene.rho0 * scene.h**d)
        if gauge.what == "velocity":
            scale, values = scene.c0, own["v"][near]
        else:
            scale = scene.rho0 * scene.c0**2
            values = (scene.eos.pressure(own["drho"][near]) - scene.rho0 * product(r, scene.gravity))[:, None]
        sums = self.summed(np.column_stack([weight, weight[:, None] * values / scale]))
        return (
            [float(value) for value in sums[1:] * scale / sums[0]] if sums[0] > MIN_WEIGHT else [0.0] * (len(sums) - 1)
        )

    def front(self, gauge: Gauge) -> float:
        """The farthest edge of the fluid along an axis, m. Collective."""
        assert gauge.axis is not None
        sign, k = (1.0 if gauge.axis[1] == "+" else -1.0), AXES.index(gauge.axis[0])
        storage, along = self.storage, self.scene.axes.index(k)
        farthest = self.world.max(readings.farthest(storage.end, sign, storage.flags, storage.x[along]))
        return sign * (farthest + sign * self.scene.low[k] + self.scene.spacing / 2)

    def elevation(self, gauge: Gauge, own: Own) -> float:
        """Highest place over the point where half of the space is fluid, m; the lowest looked at when none is.
        Collective.
        """
        scene, d = self.scene, self.scene.dimensions
        axis, sign = self.vertical(gauge)
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
        weight = SMOOTHING[scene.kernel].value(q, d) * (own["m"][near] / (scene.rho0 * scene.h**d))[:, None]
        np.add.at(sums, at[inside], np.rint(weight[inside] * FIXED_POINT).astype(np.int64))
        share = self.world.sum_int(sums) / FIXED_POINT
        full = np.median(share[share > 0.5 * share.max()]) if share.max() > MIN_WEIGHT else 0.0
        wet = np.flatnonzero(share > 0.5 * full) if full else np.zeros(0, int)
        if not len(wet):
            return sign * ends[0]
        top = int(wet[-1])
        if top + 1 == len(levels):
            return sign * float(levels[top])
        part = (share[top] - 0.5 * full) / (share[top] - share[top + 1])
        return sign * float(levels[top] + step * part)

    def vertical(self, gauge: Gauge) -> tuple[int, float]:
        """Axis and sign of up: as given, else against gravity, else the last axis."""
        if gauge.axis:
            return AXES.index(gauge.axis[0]), 1.0 if gauge.axis[1] == "+" else -1.0
        g = self.scene.gravity
        k = int(np.argmax(np.abs(g))) if g.any() else self.scene.dimensions - 1
        return k, 1.0 if g[k] <= 0 else -1.0

    def flow(self, gauge: Gauge, own: Own) -> float:
        """Volume per time through the section, m3/s (2D: m2/s), counted in a slice of two spacings on each side."""
        assert gauge.axis is not None
        scene, d = self.scene, self.scene.dimensions
        k = AXES.index(gauge.axis[0])
        r = self.separation(own["x"], gauge.at)
        width = HALF_SLICE * scene.spacing
        inside = np.abs(r[:, k]) < width
        for axis, size in enumerate(gauge.size or (0.0,) * d):
            if axis != k and size:
                inside &= np.abs(r[:, axis]) <= size / 2
        weight = (1 - np.abs(r[inside, k]) / width) / width
        volume = own["m"][inside] / (scene.rho0 + own["drho"][inside])
        scale = scene.c0 * scene.spacing ** (d - 1)
        total = self.summed((weight * volume * own["v"][inside, k] / scale)[:, None])
        return float(total[0]) * scale * (1.0 if gauge.axis[1] == "+" else -1.0)


def due(gauge: Gauge, time: float, since: float) -> bool:
    """True if a multiple of the period lies in (since, time]; without a period, always."""
    if gauge.period is None or not math.isfinite(since):
        return True
    return math.floor(time / gauge.period * (1 + 1e-12)) > math.floor(since / gauge.period * (1 + 1e-12))
