"""Signed distances of points x[n, 3] from closed surfaces of triangles: negative inside."""

import math

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]
FLATTEST = 1e-6  # height over length of a triangle, below which rounding in the file has turned its normal
BITS = 10  # of each coordinate, by which the triangles are put in order


class Surface:
    """A closed surface: corners[m, 3, 3] of its triangles in m, boxes of a tree around them (see triangle_kernels),
    and normals[m, 7, 3] outward at the face, the corners and the edges: sums of those of the faces that meet there, at
    corners by their angles. The side of them on which a point lies is that of the surface (Baerentzen & Aanaes 2005,
    10.1109/TVCG.2005.49).
    """

    def __init__(self, vertices: Reals, faces: NDArray[np.int64]) -> None:
        ways = vertices[np.roll(faces, -1, axis=1)] - vertices[faces]  # along the edges, from each corner
        across = np.cross(ways[:, 0], ways[:, 1])
        sizes = np.sqrt(np.sum(across * across, axis=1))
        lengths = np.sqrt(np.sum(ways * ways, axis=2))
        sound = sizes > FLATTEST * lengths.max(axis=1) ** 2
        faces, ways, lengths = faces[sound], ways[sound], lengths[sound]
        order = _along_a_curve(vertices[faces].mean(axis=1))
        faces, ways, lengths = faces[order], ways[order], lengths[order]
        outward = (across[sound] / sizes[sound, None])[order]
        cosines = -np.sum(ways * np.roll(ways, 1, axis=1), axis=2) / (lengths * np.roll(lengths, 1, axis=1))
        angles = np.array([math.acos(c) for c in np.clip(cosines, -1.0, 1.0).ravel().tolist()]).reshape(-1, 3)
        ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2)
        edges = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)[1].reshape(-1, 3)
        at_corners = _summed(faces, angles[:, :, None] * outward[:, None])
        at_edges = _summed(edges, np.repeat(outward[:, None], 3, axis=1))
        self.corners = vertices[faces]
        self.normals = np.concatenate([outward[:, None], at_corners[faces], at_edges[edges]], axis=1)
        self.low, self.high = _boxes(self.corners.min(axis=1), np.minimum), _boxes(self.corners.max(axis=1), np.maximum)

    def distances(self, x: Reals, reach: float = math.inf) -> Reals:
        """Distances[n] of points x[n, 3], m; beyond `reach` in m only that they are so far, with their sign."""
        return self._looked_up(x, reach)[0]

    def directions(self, x: Reals) -> Reals:
        """Ways[n, 3] in which the distances of points x[n, 3] grow, of any length: away from the nearest point."""
        apart, ways = self._looked_up(x, math.inf)
        return np.where(apart[:, None] < 0.0, -ways, ways)

    def _looked_up(self, x: Reals, reach: float) -> tuple[Reals, Reals]:
        from hpcpic.core.space.triangle_kernels import distances  # cases without triangles load no compiler

        apart, ways = np.empty(len(x)), np.empty((len(x), 3))
        x = np.ascontiguousarray(x, np.float64)
        distances(x, self.corners, self.normals, self.low, self.high, reach, apart, ways)
        return apart, ways


def _summed(where: NDArray[np.int64], values: Reals) -> Reals:
    """Sums[n, 3] of values[m, 3, 3] by the numbers where[m, 3]."""
    sums = np.zeros((where.max() + 1, 3))
    np.add.at(sums, where, values)
    return sums


def _along_a_curve(x: Reals) -> NDArray[np.int64]:
    """The order of points x[n, 3] along a Z-curve: those next to each other in it are near each other."""
    low, extent = x.min(axis=0), float(np.ptp(x, axis=0).max()) or 1.0
    cells = ((x - low) / extent * (2**BITS - 1)).astype(np.int64)
    code = np.zeros(len(x), np.int64)
    for bit in range(BITS):
        for k in range(3):
            code |= (cells[:, k] >> bit & 1) << 3 * bit + k
    return np.argsort(code, kind="stable")


def _boxes(ends: Reals, of: np.ufunc) -> Reals:
    """Ends [2 n, 3] of the boxes of all nodes of a tree with the ends[m, 3] of its triangles, m <= n, a power of two;
    the boxes of nodes without triangles are nowhere.
    """
    n = 1 << max(0, len(ends) - 1).bit_length()
    nodes = np.full((2 * n, 3), np.inf if of is np.minimum else -np.inf)
    nodes[n : n + len(ends)] = ends
    while n > 1:
        nodes[n // 2 : n] = of(nodes[n : 2 * n : 2], nodes[n + 1 : 2 * n : 2])
        n //= 2
    return nodes
