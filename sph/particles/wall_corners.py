"""Particles in the corner behind two walls that meet: which wall bears what the fluid does to them.

            |  fluid
     gate A |      q         x, a particle of the floor, is behind both faces: the fluid at q reaches it through either.
    --------+------------    Fluid pushes A with its pressure times the face of A. A part of that push falls on such
         x  |  floor B       particles; its component along the normal of A belongs to A, whose ever they are.

Booked to the owner, that part made a gate of 0.2 x 0.3 m lose 5 % of its load at 12 mm. The components along normals
that are not at right angles are those of a Gram-Schmidt basis (`duals`).

A component f along n_A is booked as the force f (n_A + c n_B)/(1 + c), c = n_A . n_B, and B keeps what is left. Under a
uniform pressure p pairs act as p and a force p K along each face, K = (1/pi) integral of r W; those of two faces that
end at an edge of one wall sum up to none over that wall. Where A ends at B it has its own only by this share (theory
page): with n_A for it a ramp of 37 degrees bears p 2 K/tan(37) too little, which the floor bears (6.6 % at 20 mm).
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
SINE = 0.04  # between normals: walls of less are one face

Reals = NDArray[np.float64]
Numbers = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Shares:
    """ids[n]: numbers of particles, ascending, one line for each wall that takes a share. of[n]: that wall.
    The share of a force F is way[n, d] (dual[n, d] . F), with the dual of `duals` times the part of the particle that
    is behind the wall; who owns it has what is left.
    """

    ids: Numbers
    of: Numbers
    way: Reals
    dual: Reals

    def force(self, lines: Numbers, force: Reals) -> Reals:
        """[d, k] N: of the forces [d, k] on the particles of some lines, what the walls of these take."""
        way, dual = self.way[lines].T, self.dual[lines].T
        along = dual[0] * force[0]
        for part, component in zip(dual[1:], force[1:]):
            along = along + part * component
        return way * along


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
        owner_normals = owner_normals[order]
        cosine = _dot(owner_normals, normals)[:, None]
        ways = (normals + cosine * owner_normals) / np.maximum(1.0 + cosine, SINE)
        return Shares(numbers, of[order], ways, parts[order, None] * duals(numbers, owner_normals, normals))

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
        place is before a, b and all other walls, and x is behind the faces of a and b there, which end at each other,
        it is in their corner. Which are; of these the normals of b and a, and the part behind a.
        """
        scene, ways = self.scene, np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=x.shape[1])))
        ways = np.concatenate([0.5 * ways, ways]) * scene.support
        which, way = np.repeat(np.arange(len(x)), len(ways)), np.tile(ways, (len(x), 1))
        for wall in (a, b, *(wall for wall in self._walls if wall not in (a, b))):
            before = self._before(at, wall, x[which] + way)
            free = (before > 0.0) & (before < (scene.support if wall in (a, b) else np.inf))
            which, way = which[free], way[free]
        x, half = x[which], 0.5 * scene.spacing
        (n_a, deep_a), (n_b, deep_b) = self._faces(at, a, b, x, way)
        good = (deep_a > -half) & (deep_b > 0.0) & (_dot(n_a, n_b) ** 2 < 1.0 - SINE * SINE)
        good &= self._before(at, b, x + deep_a[:, None] * _along(n_b, n_a)) < self._tiny  # the faces end at each other
        beside = self._before(at, a, x + (deep_b + half)[:, None] * _along(n_a, n_b))  # a, where it stands on b
        behind = np.clip(0.5 - 0.5 * beside / half, 0.0, 1.0)  # that part of a particle's own square
        good &= behind > ROUNDING
        found, first = np.unique(which[good], return_index=True)
        return found, n_b[good][first], n_a[good][first], behind[good][first]

    def _faces(self, at: Reals, a: Wall, b: Wall, x: Reals, way: Reals) -> list[tuple[Reals, Reals]]:
        """For walls a and b, the normals [n, d] of their faces where these meet, before which the places x + way are,
        and how deep [n] the points x are behind these. A place before a corner of a wall, or before one that is round,
        has another normal: what is at right angles to it, from where both meet, leaves the wall in a spacing.
        """
        normals = [self._normals(at, wall, x + way) for wall in (a, b)]
        deep = [_dot(way, normal) - self._before(at, wall, x + way) for wall, normal in zip((a, b), normals)]
        for _ in range(2):
            along = [_along(*normals), _along(*normals[::-1])]
            edge = x + deep[0][:, None] * along[1] + deep[1][:, None] * along[0]
            for k, wall in enumerate((a, b)):
                face = edge + self.scene.spacing * _unit(along[k])
                before, there = self._before(at, wall, face), self._before(at, wall, edge)
                off = (before < np.inf) & (before > there + self._tiny)
                normals[k][off] = self._normals(at, wall, face[off])
                deep[k][off] = _dot(edge[off] - x[off], normals[k][off])
        return list(zip(normals, deep))

    def _normals(self, at: Reals, wall: Wall, x: Reals) -> Reals:
        """[n, d] of a wall, into the fluid, at points x[n, d]."""
        moves = STEP * self.scene.spacing * np.eye(x.shape[1])
        slopes = [self._before(at, wall, x + move) - self._before(at, wall, x - move) for move in moves]
        return _unit(np.stack(slopes, axis=1))

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


def _along(normal: Reals, other: Reals) -> Reals:
    """[n, d]: along the face of a normal, as far as it is from another face."""
    cosine = _dot(normal, other)[:, None]
    return (other - cosine * normal) / np.maximum(1.0 - cosine * cosine, SINE * SINE)


def _unit(x: Reals) -> Reals:
    return x / np.maximum(np.sqrt(_dot(x, x)), 1e-300)[:, None]


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
