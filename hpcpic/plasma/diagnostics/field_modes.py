"""Complex amplitudes of modes of the field that a case asks for, with sums whose bits depend on no order of nodes."""

import math

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.world import World
from hpcpic.core.space.domain import Domain
from hpcpic.plasma.case.config import mode_columns
from hpcpic.plasma.setup.scene import Scene


class FieldModes:
    """E_k of the modes [n], [nx, ny] or [nx, ny, nz] of output.modes: E.k/|k| = sum over k of Re(E_k exp(i k.x)),
    k = 2 pi n / L, so that a wave exp(i k.x - i w t) turns E_k by -w t; |E_k| is the `mode_n` of the series.
    """

    def __init__(self, scene: Scene, domain: Domain, world: World) -> None:
        self.scene, self.world, self.modes = scene, world, scene.config.output.modes
        self.rows = slice(*domain.row_range(world.rank))

    def units(self) -> dict[str, str]:
        return {column: "V/m" for mode in self.modes for column in mode_columns(mode)}

    def values(self, e: NDArray[np.float64]) -> dict[str, float]:
        """By column, V/m; e[rows, ..., d]: E at the nodes of this rank. Collective."""
        terms = [part.ravel() for mode in self.modes for part in self._terms(mode, e)]
        sums = self.world.sum_exact(np.stack(terms, axis=1)).tolist()
        return dict(zip(self.units(), sums))

    def _terms(self, mode: tuple[int, ...], e: NDArray[np.float64]) -> tuple[NDArray, NDArray]:
        """What each node adds to the real and the imaginary part."""
        points = self.scene.points
        k = np.array([n / length for n, length in zip(mode, self.scene.lengths)])
        angles = [2 * math.pi / m * (n * np.arange(m) % m) for n, m in zip(mode, points)]
        waves = [(np.cos(angle), np.sin(angle)) for angle in angles]
        waves[-1] = waves[-1][0][self.rows], waves[-1][1][self.rows]
        cosine, sine = waves[0]  # of k.x
        for axis in waves[1:]:
            c, s = (wave.reshape(-1, *(1,) * cosine.ndim) for wave in axis)
            cosine, sine = c * cosine - s * sine, s * cosine + c * sine
        mirror = all(2 * n % m == 0 for n, m in zip(mode, points))  # exp(i k.x) is real: the mode is its own mirror
        along = sum(part * e[..., axis] for axis, part in enumerate(k / math.hypot(*k)))
        along = along * ((1 if mirror else 2) / math.prod(points))
        return along * cosine, -along * sine
