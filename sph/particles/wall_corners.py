"""Particles in the corner behind two walls that meet: which wall bears what the fluid does to them.

            |  fluid
     gate A |      q         x, a particle of the floor, is behind both faces: the fluid at q reaches it through either.
    --------+------------    Fluid pushes A with its pressure times the face of A. A part of that push falls on such
         x  |  floor B       particles; its component along the normal of A belongs to A, whose ever they are.

Booked to the owner, that part made a gate of 0.2 x 0.3 m lose 5 % of its load at 12 mm. The components along normals
that are not at right angles are those of a Gram-Schmidt basis (`duals`).
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sph.particles.walls import Walls
from sph.setup.scene import Wall
from sph.setup.tanks import depth_in_wall

WAY = 0.5  # spacings that walls move on before corners are sought anew: with the same bits after a restart
STEP = 1e-3  # spacings over which normals are found
TINY = 0.05  # spacings
TOUCHING = 1.5  # spacings between a wall and the particles of one that it may stand on
CHUNK = 1 << 12
ROUNDING = 1e-9  # of a share
SINE = 0.3  # between normals: walls of less are one face

Reals = NDArray[np.float64]
Numbers = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Shares:
    """ids[n]: numbers of particles, ascending, one line for each wall that takes a share. of[n]: that wall.
    The share of a force F is normal[n, d] (dual[n, d] . F), with the dual of `duals` times the part of the particle
    that is behind the wall; who owns it has what is left.
    """

    ids: Numbers
    of: Numbers
    normal: Reals
    dual: Reals

    def force(self, lines: Numbers, force: Reals) -> Reals:
        """[d, k] N: of the forces [d, k] on the particles of some lines, what the walls of these take."""
        normal, dual = self.normal[lines].T, self.dual[lines].T
        along = dual[0] * force[0]
        for part, component in zip(dual[1:], force[1:]):
            along = along + part * component
        return normal * along


class WallCorners:
    """The shares at the present places of the walls, without bodies; owns[wall]: it may own shared particles."""

    def __init__(self, walls: Walls) -> None:
        self.scene, self._walls = walls.scene, [wall for wall in walls.walls if not wall.rigid]
        self._displacement = walls.displacement  # of now
        self._pairs = [(a, b) for a, b in itertools.permutations(self._walls, 2)
                       if (a.measure_force or b.measure_force)
                       and not (b.moving and b.shape.plane)]  # fmt: skip  # whose particles are put back as it slides
        self.owns = np.isin(np.arange(len(walls.scene.walls)), [b.index for _, b in self._pairs])
        self._tiny = TINY * walls.scene.spacing
        self._at: Reals | None = None

    def shares(self) -> Shares:
        """Found anew where walls have moved."""
        step = WAY * self.scene.spacing
        at = np.rint(self._displacement / step) * step
        if self._at is None or not np.array_equal(at, self._at):
            self._at, self._shares = at, self._found(at)
        return self._shares

    def _found(self, at: Reals) -> Shares:
        d = self.scene.dimensions
        none = np.zeros(0, np.int64)
        found = [(none, none, np.zeros((0, d)), np.zeros((0, d)), np.zeros(0))]
        found += [part for a, b in self._pairs for part in self._corner(at, a, b)]
        numbers, of, owner_normals, normals, parts = map(np.concatenate, zip(*found))
        order = np.argsort(numbers, kind="stable")
        numbers, normals = numbers[order], normals[order]
        along = duals(numbers, owner_normals[order], normals)
        return Shares(numbers, of[order], normals, parts[order, None] * along)

    def _corner(self, at: Reals, a: Wall, b: Wall) -> Iterator[tuple[Numbers, Numbers, Reals, Reals, Reals]]:
        """Some at a time, the particles of b that are behind a too: numbers[n], a[n], the normals [n, d] of b, who owns
        them, and of a, and which part of each is behind a.
        """
        scene, reach = self.scene, self.scene.support
        low, high = (corner + at[a.index] for corner in a.bounds)
        low, high = np.maximum(low, scene.low) - reach, np.minimum(high, scene.high) + reach
        numbers, x, _ = b.near(low - at[b.index], high - at[b.index])
        x = x + at[b.index]
        before = self._before(at, a, x)
        if before.min(initial=np.inf) > TOUCHING * scene.spacing:
            return
        numbers, x = numbers[before < reach], x[before < reach]
        for k in range(0, len(x), CHUNK):
            which, n_b, n_a, part = self._seen(at, a, b, x[k : k + CHUNK])
            yield numbers[k + which], np.full(len(which), a.index), n_b, n_a, part

    def _seen(self, at: Reals, a: Wall, b: Wall, x: Reals) -> tuple[Numbers, Reals, Reals, Reals]:
        """Look around points x[n, d], first at half the support, as fluid may be between walls that are near: if a
        place is before a, b and all other walls, and the faces of both there end at each other, x is in their corner.
        Which are; of these the normals of b and a, and the part behind a.
        """
        scene, ways = self.scene, np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=x.shape[1])))
        ways = np.concatenate([0.5 * ways, ways]) * scene.support
        which, way = np.repeat(np.arange(len(x)), len(ways)), np.tile(ways, (len(x), 1))
        for wall in (a, b, *(wall for wall in self._walls if wall not in (a, b))):
            before = self._before(at, wall, x[which] + way)
            free = (before > 0.0) & (before < (scene.support if wall in (a, b) else np.inf))
            which, way = which[free], way[free]
        before_a, before_b = self._before(at, a, x[which] + way), self._before(at, b, x[which] + way)
        n_a, n_b = self._normals(at, a, x[which] + way), self._normals(at, b, x[which] + way)
        deep_a, deep_b = _dot(way, n_a) - before_a, _dot(way, n_b) - before_b
        half = 0.5 * scene.spacing
        beside = self._before(at, a, x[which] + (deep_b + half)[:, None] * n_b)  # a, where it stands on b
        behind = np.clip(0.5 - 0.5 * beside / half, 0.0, 1.0)  # that part of a particle's own square
        good = (behind > ROUNDING) & (deep_a > -half) & (deep_b > 0.0) & (_dot(n_a, n_b) ** 2 < 1.0 - SINE * SINE)
        good &= self._before(at, b, x[which] + deep_a[:, None] * n_a) < self._tiny  # the faces end at each other
        found, first = np.unique(which[good], return_index=True)
        return found, n_b[good][first], n_a[good][first], behind[good][first]

    def _normals(self, at: Reals, wall: Wall, x: Reals) -> Reals:
        """[n, d] of a wall, into the fluid, at points x[n, d]."""
        moves = STEP * self.scene.spacing * np.eye(x.shape[1])
        slopes = [self._before(at, wall, x + move) - self._before(at, wall, x - move) for move in moves]
        normal = np.stack(slopes, axis=1)
        return normal / np.maximum(np.sqrt(_dot(normal, normal)), 1e-300)[:, None]

    def _before(self, at: Reals, wall: Wall, x: Reals) -> Reals:
        """How far points x[n, d] are before a wall, m; through periodic sides too."""
        scene = self.scene
        if np.any(scene.periodic):
            length = scene.high - scene.low
            x = np.where(scene.periodic, x - np.floor((x - scene.low) / length) * length, x)
        return -depth_in_wall(wall, x - at[wall.index])


def duals(numbers: Numbers, owner_normals: Reals, normals: Reals) -> Reals:
    """[n, d]: of the normals of walls, one line for each wall but the owner of a particle, the vectors whose product
    with a force is its part along each, where the parts along the others are taken off.
    """
    row, first, end = np.arange(len(numbers)), *(np.searchsorted(numbers, numbers, side) for side in ("left", "right"))
    others = [owner_normals]
    for k in range(int(np.max(end - first, initial=1))):
        other = (k < end - first) & (first + k != row)
        others.append(np.where(other[:, None], normals[np.where(other, first + k, row)], 0.0))
    basis: list[Reals] = []
    for vector in others:
        rest = _beside(basis, vector)
        size = np.sqrt(_dot(rest, rest))
        basis.append(np.where(size > SINE, 1.0, 0.0)[:, None] * rest / np.maximum(size, SINE)[:, None])
    rest = _beside(basis, normals)
    return rest / np.maximum(_dot(rest, normals), SINE * SINE)[:, None]


def _beside(basis: list[Reals], vector: Reals) -> Reals:
    """The part [n, d] of vectors that is at right angles to all of a basis."""
    rest = vector
    for one in basis:
        rest = rest - _dot(one, vector)[:, None] * one
    return rest


def _dot(x: Reals, y: Reals) -> Reals:
    total = x[:, 0] * y[:, 0]
    for k in range(1, x.shape[1]):
        total = total + x[:, k] * y[:, k]
    return total
