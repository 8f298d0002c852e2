"""A run folder as arrays with names, coordinates and units."""

from __future__ import annotations

import os
from functools import cached_property
from typing import TYPE_CHECKING, Any

from hpcpic.core.api import arrays
from hpcpic.core.app.app import App
from hpcpic.core.errors import ConfigError
from hpcpic.core.files import reader

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure


class Run:
    """One run: finished, under way, stopped or killed, made here or on another machine.

    `summary` is run.json; `status` and `digest` are taken from it. Raises FileError for what the folder does not hold.
    """

    def __init__(self, files: reader.Run, app: App) -> None:
        self._files, self._app = files, app
        self.path = files.path

    @classmethod
    def open(cls, folder: str | os.PathLike[str], app: App) -> Run:
        return cls(reader.open_run(os.fspath(folder), app.name), app)

    def __repr__(self) -> str:
        return f"<{self._app.name} run {str(self.path)!r}: {self.status}, {self.summary.get('steps', 0)} steps>"

    @property
    def summary(self) -> dict[str, Any]:
        """run.json: status, exit code, provenance, derived numbers, timers, conservation."""
        return self._files.summary

    @property
    def status(self) -> str:
        return str(self.summary.get("status", "unknown"))

    @property
    def digest(self) -> str | None:
        """SHA-256 of the final state; None while there is none."""
        return self.summary.get("state_digest")

    @property
    def case_text(self) -> str:
        """The case as used, with every default filled in: running it again gives the same run."""
        return self._files.config

    @cached_property
    def series(self) -> xarray.Dataset:
        """The scalars over `time` [s], with `step` beside it; `.to_dataframe()` gives a table."""
        import xarray

        series = self._files.series
        variables = {name: ("time", values, {"units": series.units.get(name, "")}) for name, values in series.items()}
        coordinates = {"time": ("time", series.time, {"units": "s"}), "step": ("time", series.step)}
        return xarray.Dataset(variables, coordinates)

    @property
    def field_names(self) -> tuple[str, ...]:
        return tuple(self._files.field_snapshots.names)

    @property
    def species(self) -> tuple[str, ...]:
        """The species, fluids and walls, or sets of grains that snapshots hold."""
        return tuple(self._files.particle_snapshots.species)

    @property
    def field_times(self) -> list[float]:
        """Times of the snapshots of fields, s."""
        return self._files.field_snapshots.times.tolist()

    @property
    def particle_times(self) -> list[float]:
        """Times of the snapshots of particles, s."""
        return self._files.particle_snapshots.times.tolist()

    def fields(self, name: str, *, time: float | None = None, step: int | None = None) -> xarray.DataArray:
        """A field at the snapshot nearest to a time, at a step, or at the last one, with the places of its points."""
        snapshots = self._files.field_snapshots
        index = snapshots.index(step, time)
        attributes = self._attributes(snapshots, index) | {"units": snapshots.units.get(name, "")}
        return arrays.field(
            name, snapshots.read(name, index), snapshots.spacing, snapshots.first, attributes
        )

    def particles(
        self, name: str | None = None, *, time: float | None = None, step: int | None = None
    ) -> xarray.Dataset:
        """The particles of a species, fluid or set of grains likewise; without a name those of the only one."""
        snapshots = self._files.particle_snapshots
        if name is None and len(snapshots.species) == 1:
            (name,) = snapshots.species
        if name is None:
            raise ConfigError(f"particles: name one of {', '.join(snapshots.species) or 'none'}")
        index = snapshots.index(step, time)
        units = {"position": "m", **snapshots.units}
        return arrays.particles(snapshots.read(name, index), units, self._attributes(snapshots, index))

    def histogram(self, name: str) -> xarray.DataArray:
        """A histogram of the case as a density over `time` [s] and the middles of its bins; its integral over all axes
        is the number of real particles in the bins. `beyond`: how many particles lay in none.
        """
        return arrays.histogram(name, self._files.histogram(name))

    @staticmethod
    def _attributes(snapshots: reader.Snapshots, index: int) -> dict[str, Any]:
        return {"time": float(snapshots.times[index]), "step": int(snapshots.steps[index])}

    @property
    def figures(self) -> tuple[str, ...]:
        """Names that `plot` knows."""
        return tuple(self._app.plots()) if self._app.plots else ()

    def plot(self, name: str, step: int | None = None) -> Figure:
        """One figure of the run, as `plot` draws it; notebooks show it. Raises ConfigError where the run lacks what is
        drawn.
        """
        from hpcpic.core.app.figures import PAPER, NoData, png

        plots = self._app.plots() if self._app.plots else {}
        if name not in plots:
            raise ConfigError(f"no figure {name!r}; there are {', '.join(plots)}")
        try:
            figure: Any = plots[name].make(self._files, step)
        except NoData as error:
            raise ConfigError(f"{name}: {error}") from error
        figure.set_facecolor(PAPER)  # of notebooks in the dark
        figure._repr_png_ = lambda: png(figure)  # without pyplot nobody has told IPython how to show a figure
        return figure
