"""A lattice Boltzmann step by its definition, on whole arrays: what the generated kernels are compared with."""

import itertools

import numpy as np

from lbmdem.fluid.fluid import equilibrium
from lbmdem.physics.velocity_sets import Lattice

SMALL = 0.02  # size of random populations: beyond linear, and far from negative densities


def random_populations(lattice: Lattice, shape: tuple[int, ...], seed: int = 1) -> np.ndarray:
    """h[q, ...], of the size of the weights so that no population is negative."""
    rng = np.random.default_rng(seed)
    return lattice.w.reshape(-1, *[1] * len(shape)) * SMALL * 10 * rng.standard_normal((lattice.q, *shape))


def velocity(lattice: Lattice, h: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    rho = 1.0 + h.sum(axis=0)
    j = np.tensordot(h, lattice.e.astype(float), axes=(0, 0)) + 0.5 * force
    return rho, j / rho[..., None]


def two_rates(lattice: Lattice, h: np.ndarray, even: float, odd: float, force: np.ndarray) -> np.ndarray:
    """Ginzburg's TRT with Guo's force."""
    rho, u = velocity(lattice, h, force)
    away = h - equilibrium(lattice, rho, u)
    e = lattice.e.astype(float)
    along = np.moveaxis(u @ e.T, -1, 0)
    push = (e @ force).reshape(-1, *[1] * rho.ndim)
    w = lattice.w.reshape(-1, *[1] * rho.ndim)
    source = w * (3 * (push - u @ force) + 9 * along * push)
    opposite = lattice.opposite
    plus = 0.5 * (even * (away + away[opposite]) - (1 - even / 2) * (source + source[opposite]))
    minus = 0.5 * (odd * (away - away[opposite]) - (1 - odd / 2) * (source - source[opposite]))
    return h - plus - minus


def central(lattice: Lattice, h: np.ndarray, even: float, force: np.ndarray) -> np.ndarray:
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


def stream(lattice: Lattice, g: np.ndarray, solid: np.ndarray) -> np.ndarray:
    """Periodic streaming, half-way bounce back off solid nodes."""
    new = np.zeros_like(g)
    axes = tuple(range(lattice.dimensions))
    for i in range(lattice.q):
        move = tuple(int(c) for c in lattice.e[i][::-1])
        behind = np.roll(solid, move, axes)
        new[i] = np.where(behind, g[lattice.opposite[i]], np.roll(g[i], move, axes))
    new[:, solid] = 0
    return new
