"""What rigid bodies touch in a step: their spheres near the surfaces of others, with the law of each contact.

Solids that were apart touch a spacing apart: no narrower gap holds a layer of particles, and one that is caught in it
is pressed into the solids. A sphere that began nearer touches where it began until it has been a spacing away: before
that no fluid comes between.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.physics.contact_law import damping_of
from hpcpic.core.space.shapes import in_three
from sph.kernels.contacts import Solids, Touches
from sph.particles.walls import Walls
from sph.physics.timestep import Clock
from sph.setup.rigid.surfaces import pairs, sides, spheres, surfaces

DEEPEST = 0.5  # spacings: a body that is deeper in another is on its way through it
FARTHEST = 1.0  # spacings that a point of a body may go in a step
SAFE = 2.0  # times the way of a step, within which spheres are looked at
REST = 1e-3  # spacings, and so much more
FILM = 1.0  # spacings between solids that touch: one layer of fluid
SIDES, FACES, SPHERES = 2, 8, 1 << 40  # in the number of a contact: of a pair, of a tank, of a body
Reals = NDArray[np.float64]


@dataclass
class Pair:
    """Two solids that may touch. law: stiffness of a sphere N/m (2D: N/m2), damping, friction; least: not farther than
    this they are apart, m, at the places that the solids had last.
    """

    first: Any
    second: Any
    law: tuple[float, float, float]
    least: float = 0.0


@dataclass
class Places:
    """Spheres of solids near others: see kernels.contacts.Touches; key: their numbers, which grow."""

    key: list[NDArray] = field(default_factory=list)
    first: list[NDArray] = field(default_factory=list)
    second: list[NDArray] = field(default_factory=list)
    arm: list[Reals] = field(default_factory=list)
    foot: list[Reals] = field(default_factory=list)
    normal: list[Reals] = field(default_factory=list)
    shift: list[Reals] = field(default_factory=list)
    radius: list[Reals] = field(default_factory=list)
    film: list[Reals] = field(default_factory=list)


class Contacts:
    """origin[wall, 3]: the point O of each solid at t = 0, about which it turns; of the spheres near others, keys[n],
    friction springs[n, 3] m and the distance film[n] at which each touches, m.
    """

    def __init__(self, clock: Clock, walls: Walls, origin: Reals) -> None:
        self.clock, self.walls, self.origin, self.scene = clock, walls, origin, walls.scene
        self.pairs = [Pair(a, b, self._law(a, b)) for a, b in pairs(self.scene.walls)]
        self.spheres = {wall.index: spheres(wall.shape, self.scene.spacing) for wall in self.scene.walls if wall.rigid}
        self.radius = np.zeros(len(self.scene.walls))
        for k, (x, radius) in self.spheres.items():
            self.radius[k] = np.max(np.sqrt(np.sum((in_three(x) - origin[k]) ** 2, axis=1)) + radius)
        self._last: tuple[Reals, Reals] | None = None
        self.take(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0))

    def take(self, keys: NDArray[np.int64], springs: Reals, film: Reals) -> None:
        """Let these be the spheres near others."""
        self.keys, self.springs, self.film = keys, springs, film

    def _law(self, a: Any, b: Any) -> tuple[float, float, float]:
        """The lower numbers of two bodies; stiff enough for eos.max_velocity."""
        every = [wall.section.body.contact for wall in (a, b) if wall.rigid]
        masses = [wall.rigid.mass for wall in (a, b) if wall.rigid]
        mass = 1.0 / sum(1.0 / one for one in masses)
        speed = self.scene.config.eos.max_velocity or 0.1 * self.scene.c0
        depth = min(one.overlap for one in every) * self.scene.spacing
        restitution, friction = min(one.restitution for one in every), min(one.friction for one in every)
        return mass * (speed / depth) ** 2, damping_of(restitution), friction

    def find(self, solids: Solids, speeds: Reals) -> Touches | None:
        """What may touch in the step that is about to be done, for solids whose points go so fast, m/s. Raises Diverged
        for bodies that are in each other, or too fast.
        """
        dt, dp = self.clock.time_step, self.scene.spacing
        ways = self._ways(solids)
        if (fast := int(np.argmax(speeds))) >= 0 and speeds[fast] * dt > FARTHEST * dp:
            name, text = self.scene.walls[fast].name, "which its contacts do not follow"
            raise self.clock.diverged(f"{name} moves at {speeds[fast]:.4g} m/s, a spacing or more in a step, {text}")
        found, cuts, laws = Places(), [0], []
        for number, pair in enumerate(self.pairs):
            a, b = pair.first.index, pair.second.index
            pair.least -= ways[a] + ways[b]
            reach = SAFE * dt * (speeds[a] + speeds[b]) + (FILM + REST) * dp
            if pair.least <= reach:
                self._look(number, pair, reach, found)
                total = sum(map(len, found.key))
                if total > cuts[-1]:
                    cuts.append(total)
                    laws.append(pair.law)
        if not laws:
            self.take(self.keys[:0], self.springs[:0], self.film[:0])
            return None
        arrays = {name: np.ascontiguousarray(np.concatenate(rows)) for name, rows in vars(found).items()}
        keys, film = arrays.pop("key"), arrays.pop("film")
        springs, at = np.zeros((len(keys), 3)), np.searchsorted(self.keys, keys)
        known = at < len(self.keys)
        known[known] = self.keys[at[known]] == keys[known]
        springs[known] = self.springs[at[known]]
        film[known] = np.where(film[known] < FILM * dp, self.film[at[known]], FILM * dp)
        self.take(keys, springs, film)
        arrays["radius"] += film
        return Touches(**arrays, springs=springs, cuts=np.array(cuts), laws=np.array(laws))

    def _ways(self, solids: Solids) -> Reals:
        """How far a point of each solid may have gone since the last call, m."""
        last, now = self._last, (solids.place.copy(), solids.turn.copy())
        self._last = now
        if last is None:
            return np.zeros(len(self.radius))
        moved = np.sqrt(np.sum((now[0] - last[0]) ** 2, axis=1))
        return moved + 2.2 * np.sqrt(np.sum((now[1] - last[1]) ** 2, axis=1)) * self.radius

    def forget(self) -> None:
        """The bodies have been put elsewhere."""
        self._last = None
        for pair in self.pairs:
            pair.least = 0.0

    def _look(self, number: int, pair: Pair, reach: float, found: Places) -> None:
        """Find the spheres of either solid of a pair within reach of the other, and how far they are apart."""
        least = np.inf
        for side, (a, b) in enumerate(sides(pair.first, pair.second)):
            (own, radius), shift = self.spheres[a.index], self._shift(a, b)
            at = self.walls.at_rest(b, self.walls.now(a, own) - shift)
            for face, (apart, normals) in enumerate(surfaces(b, at)):
                gap = apart - radius
                least = min(least, float(gap.min(initial=np.inf)))
                near = np.flatnonzero(gap <= reach)
                if not len(near):
                    continue
                if least < -DEEPEST * self.scene.spacing:
                    text = f"{pair.first.name} is {-least:.3g} m deep in {pair.second.name}, more than half a spacing"
                    cure = "set a larger eos.max_velocity, by which contacts are stiff enough"
                    raise self.clock.diverged(f"{text}: {cure}")
                n = normals(at[near])
                found.key.append(((number * SIDES + side) * FACES + face) * SPHERES + near)
                found.first.append(np.full(len(near), a.index))
                found.second.append(np.full(len(near), b.index))
                found.arm.append(in_three(own[near]) - self.origin[a.index])
                found.foot.append(in_three(at[near] - apart[near, None] * n) - self.origin[b.index])
                found.normal.append(in_three(n))
                found.shift.append(in_three(np.broadcast_to(shift, (len(near), len(shift)))))
                found.radius.append(radius[near])
                found.film.append(np.clip(gap[near], 0.0, FILM * self.scene.spacing))
        pair.least = least

    def _shift(self, a: Any, b: Any) -> Reals:
        """[d]: how far the image of solid b next to a is from b, through periodic sides, m."""
        scene, (there, here) = self.scene, (self.walls.middle(wall) for wall in (a, b))
        length = scene.high - scene.low
        return np.where(scene.periodic & ~b.through & ~a.through, length * np.rint((there - here) / length), 0.0)
