"""How much of given velocities is heat: what is left of them beside a flow that varies from place to place."""

import math

import numpy as np
from numpy.typing import NDArray

IN_CELL = 32.0  # particles by which a thermal spread is known to 13 %, and in many cells to as much less
COLD = 0.05  # of what velocities change by across a cell: a spread that is curvature of a wave, or plays no part
MOST_SAMPLED = 1 << 16  # particles of arrays whose spread is found


def thermal_spread(x: NDArray | None, v: NDArray) -> float:
    """Thermal spread of velocities v[n]: their deviation from the straight line through those of a cell, with about
    IN_CELL to a cell. The order of particles has no part in it, nor what waves make of it; where a line leaves under
    COLD of what it explains, a wave is all that there is. Without their places x[n, d] the standard deviation.
    """
    if x is None or len(x) != len(v):
        return float(v.std())
    if len(v) > MOST_SAMPLED:
        some = np.random.default_rng(1).choice(len(v), MOST_SAMPLED, replace=False)
        x, v = x[some], v[some]
    extent = np.ptp(x, axis=0)
    wide = extent[extent > 0]
    edge = float(np.prod(wide) * IN_CELL / len(x)) ** (1 / max(1, len(wide)))
    place = (x - x.min(axis=0)) / edge
    _, cell, n = np.unique(place.astype(np.int64), axis=0, return_inverse=True, return_counts=True)
    cell = cell.ravel()

    def about_mean(values: NDArray) -> NDArray:
        return values - (np.bincount(cell, values) / n)[cell]

    def summed(a: NDArray, b: NDArray) -> NDArray:
        return np.bincount(cell, a * b)

    beside, own = [about_mean(one) for one in (place - np.floor(place)).T], about_mean(v - v[0])
    squares = np.stack([np.stack([summed(a, b) for a in beside], axis=-1) for b in beside], axis=-1)
    slopes = np.stack([summed(a, own) for a in beside], axis=-1)
    sizes, axes = np.linalg.eigh(squares)
    known = sizes > 1e-9 * n[:, None]  # of the square of an edge: fewer places in a cell than fix a line
    line = float(np.sum(np.einsum("cij,ci->cj", axes, slopes)[known] ** 2 / sizes[known]))
    rest, free = float(own @ own) - line, np.maximum(n - 1 - known.sum(axis=1), 0).sum()
    if not free:
        return float(v.std())
    return math.sqrt(max(rest, 0.0) / free) if rest > COLD**2 * line else 0.0
