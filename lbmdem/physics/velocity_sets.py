"""Lattices of discrete velocities: tables from which kernels are written.

The rest population has index 0; the others come in opposite pairs (i, i + 1) with i odd, and the first of a pair points
to larger storage indices: its last component that is not zero, in physical order (x, y, z), is positive. The storage
scheme relies on that (kernels.layout).
"""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

CS2 = 1.0 / 3.0  # square of the speed of sound, in lattice units


@dataclass(frozen=True)
class Lattice:
    """Velocities e[q, d] in physical order and weights w[q]; opposite[i] is the index of -e[i]."""

    name: str
    dimensions: int
    velocities: tuple[tuple[int, ...], ...]
    weights: tuple[float, ...]

    @property
    def q(self) -> int:
        return len(self.weights)

    @property
    def e(self) -> NDArray[np.int64]:
        return np.array(self.velocities, np.int64)

    @property
    def w(self) -> NDArray[np.float64]:
        return np.array(self.weights)

    @property
    def opposite(self) -> NDArray[np.int64]:
        return np.array([0, *(i + 1 if i % 2 else i - 1 for i in range(1, self.q))], np.int64)

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """(i, index of -e[i]) with e[i] pointing to larger storage indices."""
        return [(i, i + 1) for i in range(1, self.q, 2)]


def make(name: str, dimensions: int, weights: Mapping[int, float]) -> Lattice:
    """The lattice of all velocities with components -1, 0, 1 whose square is a key of `weights`."""
    cube = itertools.product((-1, 0, 1), repeat=dimensions)
    chosen = [v for v in cube if sum(c * c for c in v) in weights]
    plus = sorted((v for v in chosen if v[::-1] > (0,) * dimensions), key=lambda v: (sum(c * c for c in v), v[::-1]))
    velocities = [(0,) * dimensions]
    for v in plus:
        velocities += [v, tuple(-c for c in v)]
    return Lattice(name, dimensions, tuple(velocities), tuple(weights[sum(c * c for c in v)] for v in velocities))


D2Q9 = make("D2Q9", 2, {0: 4 / 9, 1: 1 / 9, 2: 1 / 36})
D3Q19 = make("D3Q19", 3, {0: 1 / 3, 1: 1 / 18, 2: 1 / 36})
LATTICES = {lattice.name: lattice for lattice in (D2Q9, D3Q19)}


def equilibrium(lattice: Lattice, rho: NDArray, u: NDArray) -> NDArray[np.float64]:
    """Second-order equilibrium without the weights, h[q, ...], of rho[...] and u[..., d]."""
    along = np.moveaxis(u @ lattice.e.T.astype(float), -1, 0)
    square = (u * u).sum(axis=-1)
    polynomial = along / CS2 + 0.5 * (along / CS2) ** 2 - 0.5 * square / CS2
    w = lattice.w.reshape(-1, *[1] * rho.ndim)
    return w * ((rho - 1.0) + rho * polynomial)
