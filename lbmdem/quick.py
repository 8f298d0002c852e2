"""The quick condition (Mansouri et al., section 5.2): where the stress between grains vanishes."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def critical_gradient(density_ratio: float, porosity: float) -> float:
    """i_c = (rho_s - rho_w)(1 - n) / rho_w."""
    return (density_ratio - 1.0) * (1.0 - porosity)


def crossing(gradient: NDArray, stresses: Sequence[NDArray]) -> float:
    """The gradient at which straight lines through stress against gradient meet, by least squares.

    Each stress is fitted where it is above a fifth of its first value: near the end contacts open.
    """
    slopes, offsets = [], []
    for stress in stresses:
        used = np.abs(stress) > 0.2 * np.abs(stress[0])
        slope, offset = np.polyfit(gradient[used], stress[used] / stress[0], 1)
        slopes.append(slope)
        offsets.append(offset)
    a, b = np.array(slopes), np.array(offsets)
    return float(-(a @ b) / (a @ a))
