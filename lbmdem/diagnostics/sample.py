"""The sample that a flow seeps through: the ends of the fixed grains, and control slices between them."""

import numpy as np
from numpy.typing import NDArray


def sample_ends(x: NDArray, radius: NDArray, height: float) -> tuple[float, float]:
    """Lower and upper end (m) of grains with centres x[n, d] along the last axis; those of the box without grains."""
    if not len(radius):
        return 0.0, height
    return float((x[:, -1] - radius).min()), float((x[:, -1] + radius).max())


def slice_edges(low: float, high: float, largest: float, count: int) -> NDArray[np.float64]:
    """Ends [count + 1] of equal control slices of a sample from low to high (m).

    They keep away from the looser ends of the sample by the largest diameter, or by a tenth of its height if that is
    less.
    """
    inset = min(largest, 0.1 * (high - low))
    return np.linspace(low + inset, high - inset, count + 1)
