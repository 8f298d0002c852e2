"""The quick condition (Mansouri et al., section 5.2): where the stress between grains vanishes.

The lines of the slices meet where the flow between them carries the grains between them: there the gradient INSIDE,
from slice to slice, is (rho_s - rho_w)(1 - n)/rho_w with the porosity n between the middles of the outermost, as
piezometers in a column of sand would tell. The gradient over the whole sample is another by what its looser ends do.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

LINEAR = 0.3, 0.8  # of the first stress of the lowest slice: before, the bed still rings; later, contacts open
PLANES = 512  # at which cross-sections are summed


def centres(edges: NDArray) -> NDArray[np.float64]:
    return 0.5 * (edges[1:] + edges[:-1])


def gradient_inside(pressures: Sequence[NDArray], z: NDArray, weight: float) -> NDArray[np.float64]:
    """Hydraulic gradient by the pressures in slices at heights z: a line by least squares; weight: rho g, N/m3."""
    away = z - z.mean()
    return -(away @ np.array(pressures)) / (away @ away) / weight


def critical_gradient(density_ratio: float, porosity: float) -> float:
    """i_c = (rho_s - rho_w)(1 - n) / rho_w."""
    return (density_ratio - 1.0) * (1.0 - porosity)


def porosity_between(z: NDArray, radius: NDArray, low: float, high: float, area: float) -> float:
    """Share of the space from low to high that no sphere fills; centres at heights z[n], area across it: m2."""
    planes = low + (high - low) * (np.arange(PLANES) + 0.5) / PLANES
    cut = [math.pi * np.maximum(radius**2 - (z - plane) ** 2, 0.0).sum() for plane in planes]
    return 1.0 - float(np.mean(cut)) / area


def lines(gradient: NDArray, stresses: Sequence[NDArray]) -> NDArray[np.float64]:
    """Slope and value at no gradient [slices, 2], by least squares over the linear part."""
    share = stresses[0] / stresses[0][0]
    used = (share > LINEAR[0]) & (share < LINEAR[1])
    return np.array([np.polyfit(gradient[used], stress[used], 1) for stress in stresses])


def meeting(gradient: NDArray, stresses: Sequence[NDArray]) -> tuple[float, float]:
    """The point nearest to the lines of all slices: the gradient at which they differ least, and their mean there."""
    slope, offset = lines(gradient, stresses).T
    away = slope - slope.mean()
    at = -float(away @ (offset - offset.mean()) / (away @ away))
    return at, float(offset.mean() + at * slope.mean())


def zeros(gradient: NDArray, stresses: Sequence[NDArray]) -> NDArray[np.float64]:
    """The gradient at which each slice's line is zero."""
    slope, offset = lines(gradient, stresses).T
    return -offset / slope


def lifted(gradient: NDArray, force: NDArray, weight: float) -> float:
    """The gradient at which the fluid carries the weight less buoyancy: force is that of the fluid on all grains, along
    the flow and in its units; a line through the upper half, where the flow has settled.
    """
    used = gradient > 0.5 * gradient.max()
    slope, offset = np.polyfit(gradient[used], force[used], 1)
    return float((weight - offset) / slope)
