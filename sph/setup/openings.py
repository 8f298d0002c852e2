"""Inlets and outlets: boxes in which the flow is prescribed. Points x[n, d] m and vectors are in physical axes.

A head is the integral of dp / rho of fluid at rest, in m2/s2, of which an opening knows the slope across its axis: by
gravity.
"""

import itertools
import math
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.space.products import product
from sph.case.config import AXES
from sph.case.openings import Inlet, Opening, Outlet
from sph.physics.equation_of_state import EquationOfState
from sph.setup.particle_lattices import Grid, even

SIGMA = 0.25  # of the speed of sound over the length of the domain: how fast an outlet returns to its pressure
FOLLOWS = 0.25  # times sqrt(depth / g) in which fluid in an outlet follows the surface of a wave: not that of sound
RELAXED = 0.5  # times sqrt(height / g) in which the surface in an inlet follows that before it


class Liquid(Protocol):
    """What is read of a scene."""

    dimensions: int
    spacing: float
    support: float
    eos: EquationOfState
    rho0: float
    c0: float
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    gravity: NDArray[np.float64]
    periodic: NDArray[np.bool_]


class Place:
    """A box from low[d] to high[d] through which fluid flows along `axis`, towards `sign`; `free`: where along it the
    box meets the free fluid, which lies `inward` (1 or -1) of that; `end`: the other end, m. From the end to `pressed`
    density is prescribed: in an inlet as far as the kernel reaches, for what the fluid beyond it pushes together would
    be forgotten. has_surface: of which the pressure is never below 0.
    """

    has_surface: bool

    def __init__(self, scene: Liquid, section: Opening, into: bool) -> None:
        self.scene, self.name = scene, section.name
        self.low, self.high = np.array(section.low), np.array(section.high)
        self.axis, self.sign = AXES.index(section.axis[0]), 1.0 if section.axis[1] == "+" else -1.0
        ends = (self.low, self.high)[:: int(self.sign)]
        self.end, self.free = (float(end[self.axis]) for end in ends[:: 1 if into else -1])
        self.inward = self.sign if into else -self.sign
        reach = min(scene.support, abs(self.free - self.end))
        self.pressed = self.end + self.inward * reach if into else self.free
        self.across = [k for k in range(scene.dimensions) if k != self.axis]
        self.fall = np.where(np.arange(scene.dimensions) == self.axis, 0.0, scene.gravity)
        self.middle = (self.low + self.high) / 2
        self.lines = [even(a, b, scene.spacing) for a, b in zip(self.low, self.high)]  # of a lattice in the box
        self.g = math.hypot(*self.fall)
        self.up = -self.fall / self.g if self.g else self.fall

    def from_middle(self, x: NDArray) -> NDArray[np.float64]:
        """Head[n] in points less that in the middle of the box."""
        return product(x - self.middle, self.fall)

    @property
    def nodes(self) -> int:
        """Points of the lattice across the axis."""
        return math.prod(len(self.lines[k]) for k in self.across)

    def shares(self, x: NDArray) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Nodes [n, 2^(d - 1)] around points and the shares of each, which are linear in between and constant beyond
        the outer ones.
        """
        nodes, shares = np.zeros((len(x), 1), np.int64), np.ones((len(x), 1))
        for k in self.across:
            n = len(self.lines[k])
            at = np.clip((x[:, k] - self.low[k]) / (self.high[k] - self.low[k]) * n - 0.5, 0.0, n - 1.0)
            first = np.minimum(at.astype(np.int64), max(n - 2, 0))
            both = np.stack([first, np.minimum(first + 1, n - 1)], axis=1)
            part = np.stack([1.0 - (at - first), at - first], axis=1)
            corners = len(x), 2 * nodes.shape[1]
            nodes = (nodes[:, :, None] * n + both[:, None]).reshape(corners)
            shares = (shares[:, :, None] * part[:, None]).reshape(corners)
        return nodes, shares

    def at_level(self, level: float) -> float:
        """Head in the middle of the box below a surface of this height in m, against gravity."""
        return self.g * level + float(product(self.middle, self.fall))

    def height(self, x: NDArray) -> NDArray[np.float64]:
        """Height[n] of points above the lowest corner of the box against gravity, m."""
        return product(x, self.up) - self.bottom

    @property
    def bottom(self) -> float:
        """Height of the lowest corner of the box against gravity, m."""
        return -float(np.maximum(self.low * self.fall, self.high * self.fall).sum()) / self.g

    @property
    def top(self) -> float:
        """Height of the highest corner of the box against gravity, m."""
        return -float(np.minimum(self.low * self.fall, self.high * self.fall).sum()) / self.g


class Source(Place):
    """An inlet. Its fluid moves in rows, which end on the points of a lattice across the axis: `rows`, one particle of
    `mass` kg (2D: kg/m) in `step` m of each; profile[n]: velocity of a row over the mean one.
    """

    def __init__(self, scene: Liquid, section: Inlet) -> None:
        super().__init__(scene, section, into=True)
        self.section = section
        self.columns = len(self.lines[self.axis])
        self.step = (self.high - self.low)[self.axis] / self.columns
        ends = Grid((*self.lines[: self.axis], np.array([self.end]), *self.lines[self.axis + 1 :]))
        self.rows = ends.points(ends.unflat(np.arange(ends.n)))
        self.area = float(np.prod((self.high - self.low)[self.across])) / len(self.rows)
        self.mass = scene.rho0 * self.area * self.step
        self._mean_shape = float(self._shape(self.rows).mean())
        self.profile = self.profile_at(self.rows)
        self.follows = bool(section.over_time("discharge")) and self.g > 0.0
        self.has_surface = self.follows or bool(section.over_time("level"))
        self.relaxed = RELAXED * math.sqrt((self.top - self.bottom) / self.g) if self.g else math.inf

    def _shape(self, x: NDArray) -> NDArray[np.float64]:
        if self.section.profile == "uniform":
            return np.ones(len(x))
        (k,) = [k for k in self.across if not self.scene.periodic[k]]
        return np.maximum((x[:, k] - self.low[k]) * (self.high[k] - x[:, k]), 0.0)

    def profile_at(self, x: NDArray) -> NDArray[np.float64]:
        """Velocity[n] in points over the mean one of the rows."""
        return self._shape(x) / self._mean_shape

    def now(self, name: str, t: float) -> float | None:
        """Velocity m/s, discharge m3/s (2D: m2/s) or level m at the time t in s; None where it is not given."""
        given = self.section.over_time(name)
        return float(np.interp(t, [at for at, _ in given], [value for _, value in given])) if given else None

    @cached_property
    def heads(self) -> NDArray[np.float64]:
        """Heads of the rows less that in the middle of the box."""
        return self.from_middle(self.rows)

    def wet(self, head: float) -> NDArray[np.bool_]:
        """Which rows lie below the surface, for the head in the middle of the box."""
        return self.heads + head > 0.0 if self.has_surface else np.ones(len(self.rows), bool)

    def head_at(self, t: float, last: float, before: float | None, share: float) -> float:
        """Head in the middle of the box at the time t in s: of its level; else of the fluid before it (None where there
        is none), which a surface follows from the last one by a share of what is between them.
        """
        level = self.now("level", t)
        if level is not None:
            return self.at_level(level)
        if before is None:
            before = last or (self.at_level(self.top) if self.follows else 0.0)
        if not self.follows:
            return before
        least = self.at_level(self.bottom) + self.g * self.scene.spacing
        return max(last + min(share, 1.0) * (before - last), least)

    def speed(self, t: float, head: float) -> float:
        """Mean velocity along the axis at the time t in s, m/s."""
        discharge = self.now("discharge", t)
        if discharge is None:
            return self.now("velocity", t) or 0.0
        return discharge / (self.area * max(1, int(np.count_nonzero(self.wet(head)))))

    def volume(self, end: float) -> float:
        """What flows in until `end` in s, m3 (2D: m2), where the whole box is below the surface."""
        total, times = 0.0, sorted({0.0, end, *(moment.time for moment in self.section.table if moment.time < end)})
        for name, factor in (("velocity", float(self.area) * len(self.rows)), ("discharge", 1.0)):
            values = [self.now(name, t) or 0.0 for t in times]
            total += factor * sum((b - a) * (u + v) / 2 for (a, u), (b, v) in itertools.pairwise(zip(times, values)))
        return total


class Sink(Place):
    """An outlet; `head`: in the middle of the box in still fluid; `wave`: speed of long waves below its level, m/s;
    `spare`: length of the box that may be empty, m.
    """

    def __init__(self, scene: Liquid, section: Outlet) -> None:
        super().__init__(scene, section, into=False)
        self.section, self.has_surface = section, section.level is not None
        level, pressure = section.level, section.pressure
        self.head = float(scene.eos.head(scene.eos.excess(pressure))) if level is None else self.at_level(level)
        self.c0, self.wave = scene.c0, 0.0
        length = (self.high - self.low)[self.axis]
        self.spare = max(float(length) - scene.support, scene.spacing)
        self.returns = SIGMA * scene.c0 / float((scene.high - scene.low)[self.axis])  # 1/s
        if section.level is not None and section.waves:
            self.wave = math.sqrt(self.g * (section.level - self.bottom))

    def growth(self, head: float, columns: float) -> float:
        """Rate, 1/s, at which columns of `columns` m in the box grow, which follow the surface of this head."""
        depth = (head - self.at_level(self.bottom)) / self.g
        return (depth / columns - 1.0) * self.g / (FOLLOWS * self.wave)

    def head_at(self, last: float, speed: float, rise: float, dt: float) -> float:
        """Head in the middle of the box a step of dt s after the last one, for the mean velocity of the fluid before it
        in m/s, which rose by `rise`: that of a wave that goes out. Below a level it is a long one, in which the
        velocity is twice what the wave's speed sqrt(g depth) has grown by; else sound, from which the head returns to
        what is prescribed (Poinsot & Lele 1992).
        """
        if self.wave:
            faster = 0.5 * (speed - self.section.velocity)
            return self.head + faster * (2.0 * self.wave + faster)
        if self.has_surface:
            return self.head
        return last + self.c0 * rise - dt * self.returns * (last - self.head)
