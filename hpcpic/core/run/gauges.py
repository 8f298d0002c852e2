"""Gauges in the fields of a grid: means of the interpolated field over a point, line, plane or box, and extremes.

A mean is a sum over nodes with weights that are a product of one along each axis. Sums are exact, so that a reading
has the same bits however the rows are shared among ranks.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.case.gauge import AXES, Gauge
from hpcpic.core.comm.world import World
from hpcpic.core.files.arrays import FieldArray
from hpcpic.core.space.domain import Domain


def _hat_integral(s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Integral from -1 to s of the hat function 1 - |s|."""
    s = np.clip(s, -1.0, 1.0)
    return np.where(s < 0, 0.5 * (1 + s) ** 2, 1 - 0.5 * (1 - s) ** 2)


def axis_weights(n: int, offset: float, periodic: bool, low: float, high: float) -> NDArray[np.float64]:
    """Weights [n] of the mean from low to high of the line through the values at nodes i + offset, lengths in
    spacings; low = high: of the value there. Beyond the first and last node of an axis that does not repeat the
    field is taken as constant.
    """
    nodes = np.arange(n, dtype=np.float64) + offset
    ends = np.array([low, high])
    beyond = np.zeros(2)
    if not periodic:
        clipped = np.clip(ends, nodes[0], nodes[-1])
        beyond = np.abs(ends - clipped)
        if low == high or clipped[0] == clipped[1]:
            return _point_weights(nodes, clipped[0], None)
        ends = clipped
    elif low == high:
        return _point_weights(nodes, low, n)
    images = (-n, 0, n) if periodic else (0,)
    parts = [_hat_integral(ends[1] - nodes - k) - _hat_integral(ends[0] - nodes - k) for k in images]
    weights = np.sum(parts, axis=0)
    weights[0] += beyond[0]
    weights[-1] += beyond[1]
    return weights / (high - low)


def _point_weights(nodes: NDArray[np.float64], at: float, period: int | None) -> NDArray[np.float64]:
    distance = np.abs(nodes - at)
    return np.maximum(0.0, 1.0 - (np.minimum(distance, period - distance) if period else distance))


class Gauges:
    """The gauges of a case on this rank's rows of a domain (axes in storage order, slowest first)."""

    def __init__(self, gauges: Sequence[Gauge], domain: Domain, world: World) -> None:
        self._world, self._places = world, [(gauge, *_place(gauge, domain, world.rank)) for gauge in gauges]

    def __bool__(self) -> bool:
        return bool(self._places)

    def values(self, fields: Mapping[str, FieldArray], holds: NDArray[np.bool_] | None = None) -> dict[str, float]:
        """The readings of the gauges, by column; not a number where none of its nodes `holds` a value. Collective.

        fields: of this rank. holds: nodes of this rank whose values count; by default all.
        """
        values: dict[str, float] = {}
        for gauge, nodes, weights in self._places:
            field = fields[gauge.what].values[nodes].astype(np.float64)
            counted = weights if holds is None else weights * holds[nodes]
            components = field.shape[weights.ndim :]
            names = [f"{gauge.name}_{axis}" for axis in AXES[: components[0]]] if components else [gauge.name]
            read = self._mean if gauge.take == "mean" else self._extreme
            found = read(gauge, field.reshape(weights.size, len(names)), counted.ravel())
            values |= dict(zip(names, found.tolist()))
        return values

    def _mean(self, gauge: Gauge, field: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
        sums = self._world.sum_exact(np.column_stack([weights, field * weights[:, None]]))
        return sums[1:] / sums[0] if sums[0] > 0 else np.full(len(sums) - 1, np.nan)

    def _extreme(self, gauge: Gauge, field: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
        sign = 1.0 if gauge.take == "maximum" else -1.0
        most = self._world.max_array((sign * field[weights > 0]).max(axis=0, initial=-np.inf))
        return np.where(np.isfinite(most), sign * most, np.nan)


def _place(gauge: Gauge, domain: Domain, rank: int) -> tuple[tuple[NDArray, ...], NDArray[np.float64]]:
    """Index of the nodes of this rank that the gauge reads, and their weights."""
    first, end = domain.row_range(rank)
    indices, factors = [], []
    middle, size = gauge.at[::-1], (gauge.size or (0.0,) * domain.ndim)[::-1]
    for axis, (x, width, dx) in enumerate(zip(middle, size, domain.spacing)):
        periodic = domain.periodic[axis]
        ends = [(x + sign * width / 2) / dx for sign in (-1, 1)]
        weights = axis_weights(domain.points[axis], domain.offset, periodic, *ends)
        rows = np.flatnonzero(weights)
        if axis == 0:
            rows = rows[(rows >= first) & (rows < end)]
        factors.append(weights[rows])
        indices.append(rows - first if axis == 0 else rows)
    product = factors[0]
    for factor in factors[1:]:
        product = np.multiply.outer(product, factor)
    return np.ix_(*indices), product
