"""The grid of cells over the domain: layers across the first storage axis, rows of cells in them."""

import numpy as np
from numpy.typing import NDArray

from sph.setup.scene import Scene

FINE = 8  # fine cells of an edge, along the last axis
PADS = 2  # layers and rows outside the domain, for walls and images


class CellGrid:
    """Layers and rows of thickness `edge` m over the domain, with PADS more on each side.

    scale[d]: layers, rows and fine cells per m; edges: what kernels.runs.find is told of them.
    """

    def __init__(self, scene: Scene, edge: float) -> None:
        lengths = (scene.high - scene.low)[list(scene.axes)]
        self.edge = edge
        self.layers, self.rows = (int(np.ceil(length / edge)) + 2 * PADS for length in lengths[:2])
        if len(lengths) == 2:
            self.rows = 1
        self.scale = np.full(len(lengths), 1.0 / edge)
        self.scale[-1] *= FINE
        self.edges = np.array([edge, edge, edge / FINE, PADS, 0.0])

    def layer(self, x: NDArray[np.float64]) -> NDArray[np.int64]:
        """Layer of positions along the first storage axis, m, as the kernels find it."""
        at = np.floor(x * self.scale[0]) + PADS
        return np.clip(at, 0, self.layers - 1).astype(np.int64)
