"""Flat faces of walls."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Face:
    """A flat piece of a wall: a point on it, its normal into the fluid, the box that holds it (m)."""

    point: NDArray[np.float64]
    normal: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
