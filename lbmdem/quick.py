"""The quick condition (Mansouri et al., section 5.2): where the stress between grains vanishes."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def critical_gradient(density_ratio: float, porosity: float) -> float:
    """i_c = (rho_s - rho_w)(1 - n) / rho_w."""
    return (density_ratio - 1.0) * (1.0 - porosity)


def crossing(gradient: NDArray, stresses: Sequence[NDArray]) -> float:
    """The gradient at which the stress on the floor vanishes: a straight line, by least squares, through the stress of
    the two lowest slices, extended to the floor, while it is between 0.2 and 0.9 of what it was.
    """
    floor = 1.5 * stresses[0] - 0.5 * stresses[1]
    share = floor / floor[0]
    used = (share > 0.2) & (share < 0.9)
    slope, offset = np.polyfit(gradient[used], share[used], 1)
    return float(-offset / slope)


def lifted(gradient: NDArray, force: NDArray, weight: float) -> float:
    """The gradient at which the fluid carries the weight less buoyancy: force is that of the fluid on all grains, along
    the flow and in its units; a line through the upper half, where the flow has settled.
    """
    used = gradient > 0.5 * gradient.max()
    slope, offset = np.polyfit(gradient[used], force[used], 1)
    return float((weight - offset) / slope)
