"""Fields and particles as xarray objects with coordinates and units, from memory and from files alike."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import xarray

    from hpcpic.core.files.histograms import Histogram

AXES = "xyz"
VECTOR = "component"


def moment(time: float, step: int) -> dict[str, Any]:
    """Coordinates by which `xarray.concat(..., "time")` puts states one after the other."""
    return {"time": ((), float(time), {"units": "s"}), "step": ((), int(step))}


def field(
    name: str,
    values: NDArray,
    spacing: Sequence[float],
    first: Sequence[float],
    unit: str,
    at: Mapping[str, Any],
) -> xarray.DataArray:
    """values[..., y, x] or with components last; spacing and place of the first point [m] in the order of the axes; at:
    its `moment`.
    """
    import xarray

    d = len(spacing)
    axes = list(AXES[:d][::-1])
    coordinates: dict[str, Any] = {
        axis: (axis, start + step * np.arange(n), {"units": "m"})
        for axis, n, step, start in zip(axes, values.shape, spacing, first)
    }
    if values.ndim > d:
        axes.append(VECTOR)
        coordinates[VECTOR] = list(AXES[: values.shape[-1]])
    return xarray.DataArray(values, {**coordinates, **at}, axes, name, {"units": unit})


def histogram(name: str, read: Histogram) -> xarray.DataArray:
    """density[time, bins, ...] at the middles of the bins."""
    import xarray

    coordinates: dict[str, Any] = {
        axis: (axis, 0.5 * (edges[1:] + edges[:-1]), {"units": read.units[axis]}) for axis, edges in read.edges.items()
    }
    coordinates |= {"time": ("time", read.time, {"units": "s"}), "step": ("time", read.step)}
    coordinates["beyond"] = ("time", read.beyond)
    return xarray.DataArray(read.density, coordinates, ["time", *read.edges], name, {"units": read.unit})


def particles(
    columns: Mapping[str, NDArray], units: Mapping[str, str], offsets: Mapping[str, float], at: Mapping[str, Any]
) -> xarray.Dataset:  # fmt: skip
    """columns[name][n, ...], one of them `id`, by which particles are named; vectors have the axes x, y, z. offsets:
    s by which a column is of a later time than the others, where it is. at: their `moment`.
    """
    import xarray

    variables: dict[str, Any] = {}
    for name, values in columns.items():
        if name == "id":
            continue
        dims = ["particle", *([VECTOR] if values.ndim == 2 and values.shape[1] <= len(AXES) else ())]
        dims += [f"{name}_{k}" for k in range(len(dims), values.ndim)]
        late = {"time_offset": offsets[name]} if offsets.get(name) else {}
        variables[name] = (dims, values, {"units": units.get(name, ""), **late})
    coordinates: dict[str, Any] = {"particle": columns["id"]}
    if any(VECTOR in dims for dims, *_ in variables.values()):
        widest = max(values.shape[1] for dims, values, _ in variables.values() if VECTOR in dims)
        coordinates[VECTOR] = list(AXES[:widest])
    return xarray.Dataset(variables, {**coordinates, **at})
