"""The shapes of a particle: how many nodes it reaches along an axis, how much room its kernels need.

A shape of order m is the m-fold convolution of a box one cell wide with a point: NGP, CIC and TSC reach 1, 2 and 3
nodes along an axis, and the transform of the shape of n nodes is sinc(k dx/2)^n (Birdsall & Langdon, chapters 4 and 8).
The weights themselves stand in kernels.weights, for single particles, and in the kernels named here, for vectors.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# Cells (CIC) or nodes (NGP, TSC) of a tile with what vectors read beyond them, by axes of the grid
LINEAR_CELLS = {1: 256 + 8, 2: 256 + 8, 3: 512 + 8}
NODAL_CELLS = {1: 17 * 24 + 8, 2: 17 * 24 + 8, 3: 9 * 9 * 16 + 8}
# Mean over places of the sum over nodes of W(node) W(node + j), j = 0, and twice that of j = 1, 2: by nodes
OVERLAPS = {1: (1.0,), 2: (2 / 3, 1 / 3), 3: (11 / 20, 13 / 30, 1 / 60)}


@dataclass(frozen=True, slots=True)
class Shape:
    """One shape. nodes: reached along an axis. ghosts: layers of nodes below and above a slab that it reaches.

    vector_kernels: files of kernels/ that gather and deposit by vectors.
    """

    name: str
    nodes: int
    ghosts: tuple[int, int]
    vector_kernels: tuple[str, ...]

    def charge_scratch(self, dimensions: int) -> int:
        """Sums of charge that a block keeps for a tile: one per node that a particle reaches, in 1D as in 2D."""
        return (NODAL_CELLS if self.nodes % 2 else LINEAR_CELLS)[dimensions] * self.nodes ** max(dimensions, 2)

    def field_scratch(self, dimensions: int) -> int:
        """Coefficients of the field that a block keeps for a tile: as many for each component of E, in 1D as in 2D."""
        return max(dimensions, 2) * self.charge_scratch(dimensions)

    def own_share(self, axes: int) -> float:
        """Mean of the sum of W^2 over the nodes: what a node has of one particle, where each has one on average."""
        return OVERLAPS[self.nodes][0] ** axes

    def of_random_places(self, angle: NDArray) -> NDArray:
        """What the nodes have of the mean square that random places give a wave that turns by `angle` from node to
        node: the sum over its aliases of S^2(k_p) (Birdsall & Langdon, chapter 8), in closed form.
        """
        return np.polynomial.chebyshev.chebval(np.cos(angle), OVERLAPS[self.nodes])

    def cold_response(self, angle: float) -> float:
        """What a grid of centred differences leaves of the squared frequency of a cold wave that turns by `angle` from
        node to node, beside Poisson's equation on it: the sum over the wave's aliases of S^2(k_p) k_p sin(angle)/dx
        over K^2 (Birdsall & Langdon, chapter 8), in closed form. Particles are even and dense.
        """
        linear = math.cos(0.5 * angle) ** 2  # of NGP and CIC alike
        return linear * (2.0 + linear) / 3.0 if self.nodes == 3 else linear


SHAPES = {
    shape.name: shape
    for shape in (
        Shape("NGP", 1, (0, 1), ("nodal", "nearest")),
        Shape("CIC", 2, (0, 1), ("linear",)),
        Shape("TSC", 3, (1, 2), ("nodal", "quadratic")),
    )
}
