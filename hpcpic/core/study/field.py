"""A field at the end of a pilot, seen through windows of a twelfth of the box: comparable between any resolutions.

An error of it shows what a scalar hides: errors that cancel in a sum do not cancel everywhere.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.app.knobs import Seen
from hpcpic.core.files.reader import Run
from hpcpic.core.files.rundir import RunDir

if TYPE_CHECKING:
    from pathlib import Path

WINDOWS = 6  # along each axis, or fewer:
RESOLVED = 8  # cells of the case in each, so that pilots four times as coarse resolve it
WIDTH = 0.5  # of a window over their distance: standard deviation of its Gaussian


def windows(points: NDArray, seen: Seen, axis: int) -> NDArray[np.float64]:
    """weight[window, point] along one axis."""
    low, high = seen.low[axis], seen.high[axis]
    count = max(1, min(WINDOWS, seen.cells[axis] // RESOLVED))
    step = (high - low) / count
    centres = low + step * (np.arange(count) + 0.5)
    return np.exp(-0.5 * ((points - centres[:, None]) / (WIDTH * step)) ** 2) / step


def seen_field(folder: Path, seen: Seen) -> NDArray[np.float64]:
    """The sum of the field in every window, as a vector. Raises FileError."""
    run = Run(RunDir(folder))
    return of_nodes(run, seen) if run.rundir.fields.exists() else of_particles(run, seen)


def of_nodes(run: Run, seen: Seen) -> NDArray[np.float64]:
    """Sums in the windows of a field on a grid, whose axes are stored last one first."""
    fields = run.field_snapshots
    values = np.asarray(run.field(seen.name), np.float64)
    d = len(fields.points)
    values = values.reshape(*fields.points, -1)
    for k, (n, spacing, first) in enumerate(zip(fields.points, fields.spacing, fields.first)):
        axis = d - 1 - k
        weight = spacing * windows(first + spacing * np.arange(n), seen, axis)
        values = np.moveaxis(np.tensordot(weight, values, (1, k)), 0, k)
    return values.ravel()


def of_particles(run: Run, seen: Seen) -> NDArray[np.float64]:
    """Sums in the windows of a property of particles, each of the same weight."""
    found = [run.particles(species) for species in run.particle_snapshots.species]
    place = np.concatenate([columns["position"] for columns in found])
    values = np.concatenate([np.asarray(columns[seen.name], np.float64) for columns in found])
    weights = np.ones((1, len(place)))
    for axis in range(len(seen.low)):
        along = windows(place[:, axis], seen, axis)
        weights = (weights[:, None, :] * along[None, :, :]).reshape(-1, len(place))
    return (weights @ values.reshape(len(place), -1) / len(place)).ravel()
