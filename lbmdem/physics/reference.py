"""The lattice Boltzmann method in plain numpy, by its definitions: read this first. Tests compare the kernels with it.

A step collides all nodes, moves each population along its direction, and lets solids send back what ran into them.
Populations are zero-centred: h[i] = f_i - w_i. Arrays are h[q, ...] with the nodes in storage order: (y, x) or
(z, y, x), and in `Links` (plane, row, x), where 2D has one row. Numbers in brackets: Mansouri et al. (2011).
"""

import itertools
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lbmdem.physics.forcing import GUO, Forcing
from lbmdem.physics.velocity_sets import Lattice, equilibrium
from lbmdem.physics.wall_rules import RULES, applicable, coefficients

SMALL = 0.2  # random populations over their weights: beyond linear, and far from negative densities


def random_populations(lattice: Lattice, shape: tuple[int, ...], seed: int = 1) -> NDArray:
    """h[q, ...], of the size of the weights so that no population is negative."""
    noise = np.random.default_rng(seed).standard_normal((lattice.q, *shape))
    return SMALL * weights(lattice, len(shape)) * noise


def weights(lattice: Lattice, dimensions: int) -> NDArray:
    """w[q, 1, ...] beside h[q, ...]."""
    return lattice.w.reshape(-1, *[1] * dimensions)


def velocity(lattice: Lattice, h: NDArray, force: ArrayLike, forcing: Forcing = GUO) -> tuple[NDArray, NDArray]:
    """Density and velocity [..., d]: rho = sum f_i, rho u = sum f_i e_i + share F."""
    rho = 1.0 + h.sum(axis=0)
    momentum = np.tensordot(h, lattice.e.astype(float), axes=(0, 0)) + forcing.share * np.asarray(force)
    return rho, momentum / rho[..., None]


def two_rates(lattice: Lattice, h: NDArray, even: float, odd: float, force: NDArray, forcing: Forcing = GUO) -> NDArray:
    """Two relaxation times (Ginzburg 2005), for the even and the odd part of opposite populations; BGK [4] when equal.

    The source is w_i (3 (e_i - u) + 9 (e_i . u) e_i) . F (Guo et al. 2002, (20)).
    """
    rho, u = velocity(lattice, h, force, forcing)
    away = h - equilibrium(lattice, rho, u)
    e = lattice.e.astype(float)
    along = np.moveaxis(u @ e.T, -1, 0)
    push = (e @ force).reshape(-1, *[1] * rho.ndim)
    source = weights(lattice, rho.ndim) * (3 * (push - u @ force) + 9 * along * push)
    opposite = lattice.opposite
    plus = 0.5 * (even * (away + away[opposite]) - forcing.factor(even) * (source + source[opposite]))
    minus = 0.5 * (odd * (away - away[opposite]) - forcing.factor(odd) * (source - source[opposite]))
    return h - plus - minus


def central(lattice: Lattice, h: NDArray, even: float, force: NDArray) -> NDArray:
    """Central moments, node by node with a matrix: second order relaxed, its trace and all above at the Maxwellian."""
    d = lattice.dimensions
    powers = [p for p in itertools.product(range(3), repeat=d) if np.count_nonzero(p) < 3]
    result = np.empty_like(h)
    rho_all, u_all = velocity(lattice, h, force)
    for node in np.ndindex(h.shape[1:]):
        rho, u = rho_all[node], u_all[node]
        matrix = np.array([np.prod((lattice.e - u) ** np.array(p), axis=1) for p in powers])
        moments = dict(zip(powers, matrix @ (h[:, *node] + lattice.w)))
        second = [tuple(2 * (k == a) for k in range(d)) for a in range(d)]
        mean = sum(moments[p] for p in second) / d
        for p in powers:
            order, squares = sum(p), sum(n == 2 for n in p)
            if order == 1:
                moments[p] += force[p.index(1)]
            elif p in second:
                moments[p] = rho / 3 + (1 - even) * (moments[p] - mean)
            elif order == 2:
                moments[p] = (1 - even) * moments[p]
            elif order == 3:
                moments[p] = 0.5 * force[p.index(1)] / 3
            elif order == 4:
                moments[p] = rho / 9 if squares == 2 else 0.0
        result[:, *node] = np.linalg.solve(matrix, [moments[p] for p in powers]) - lattice.w
    return result


def stream(lattice: Lattice, g: NDArray, solid: NDArray[np.bool_]) -> NDArray:
    """f_i(x) = g_i(x - e_i) in a periodic box; from a solid x - e_i comes half-way bounce back, g_j(x), j = -i."""
    new, axes = np.zeros_like(g), tuple(range(lattice.dimensions))
    for i in range(lattice.q):
        move = tuple(int(c) for c in lattice.e[i][::-1])
        behind = np.roll(solid, move, axes)
        new[i] = np.where(behind, g[lattice.opposite[i]], np.roll(g[i], move, axes))
    new[:, solid] = 0
    return new


Crossing = Callable[[NDArray, int, NDArray], tuple[int, float, NDArray, NDArray]]


class Links:
    """A periodic box (planes, rows, x) without force whose links to solids are done one by one, by any wall rule.

    solid[plane, row, x]: -1 fluid, else the number of a body. Directions e[q, 3] and nodes are (x, row, plane).
    """

    def __init__(self, lattice: Lattice, shape: tuple[int, int, int], even: float, odd: float) -> None:
        self.lattice, self.rates = lattice, (even, odd)
        flat = lattice.dimensions == 2
        self.e = np.insert(lattice.e, 1, 0, axis=1) if flat else lattice.e
        self.solid = np.full(shape, -1)
        self.h = random_populations(lattice, shape, seed=3)

    def collided(self) -> NDArray:
        """Post-collision populations; those of solid nodes mean nothing."""
        planar = self.h[:, :, 0] if self.lattice.dimensions == 2 else self.h
        g = two_rates(self.lattice, planar, *self.rates, np.zeros(self.lattice.dimensions))
        return g.reshape(self.h.shape)

    def links(self) -> Iterator[tuple[NDArray, int, NDArray]]:
        """All (fluid node, direction, solid node)."""
        nodes = np.argwhere(self.solid == -1)[:, ::-1]
        for i in range(1, self.lattice.q):
            for x, beyond in zip(nodes, self.wrapped(nodes + self.e[i])):
                if self.at(self.solid, beyond) != -1:
                    yield x, i, beyond

    def wrapped(self, x: NDArray) -> NDArray:
        """Nodes in the box."""
        return np.mod(x, self.solid.shape[::-1])

    def at(self, values: NDArray, x: NDArray) -> NDArray:
        """Values of a node."""
        return values[..., x[2], x[1], x[0]]

    def step(self, rule: str, crossing: Crossing) -> dict[int, NDArray]:
        """One step; force and torque [6] on each body. crossing(x, i, beyond): body, q, arm, velocity of the wall."""
        g = self.collided()
        new = np.array([np.roll(g[i], e[::-1], axis=(0, 1, 2)) for i, e in enumerate(self.e)])
        forces: dict[int, NDArray] = {}
        for x, i, beyond in self.links():
            body, q, arm, u = crossing(x, i, beyond)
            value, force = self.returned(g, x, i, q, u, rule)
            new[(self.lattice.opposite[i], *x[::-1])] = value
            forces[body] = forces.get(body, np.zeros(6)) + np.concatenate((force, np.cross(arm, force)))
        self.h = new
        return forces

    def returned(self, g: NDArray, x: NDArray, i: int, q: float, u: NDArray, rule: str) -> tuple[float, NDArray]:
        """The population that comes back, and the force of the link on the wall by exchange of momentum [7]."""
        j, e = self.lattice.opposite[i], self.e[i]
        y = self.wrapped(x - e)
        z = self.wrapped(y - e)
        behind = 0 if self.at(self.solid, y) != -1 else 1 if self.at(self.solid, z) != -1 else 2
        factors = coefficients(applicable(RULES[rule].number, behind), q)
        push = 6 * self.lattice.w[i] * (e @ u)
        out = self.at(g[i], x)
        read = (out, self.at(g[i], y), self.at(g[j], x), self.at(g[i], z), self.at(g[j], y), -push)
        value = sum(factor * population for factor, population in zip(factors, read) if factor)
        return value, e * (out + value) - u * (out - value)
