"""A run folder as arrays with names, coordinates and units."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from functools import cached_property, partial
from importlib import import_module
from typing import TYPE_CHECKING, Any, cast

from hpcpic.core.api import arrays
from hpcpic.core.api.numbers import finite, whole, words
from hpcpic.core.api.simulation import Simulation
from hpcpic.core.api.texts import assignments
from hpcpic.core.app import use
from hpcpic.core.app.app import App
from hpcpic.core.errors import ConfigError, Diverged, FileError, HpcpicError
from hpcpic.core.files import reader
from hpcpic.core.simd import frozen

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

    from hpcpic.core.report.compare import Comparison


class Run:
    """One run: finished, under way, stopped or killed, made here or on another machine.

    `summary` is run.json; `status` and `digest` are taken from it. Files are read when they are asked for, and then
    kept until `restart`: open a run that is under way, or that others restart, again to see more of it. Raises
    FileError for what the folder does not hold. `open_run` makes one of a folder, and `Case.run` does.
    """

    def __init__(self, files: reader.Run, app: App | None = None) -> None:
        if isinstance(files, str | os.PathLike):
            raise ConfigError(f"Run({files!r}): a run folder is opened by open_run({files!r})")
        self._files, self._app = files, cast(App, app)
        self.path = files.path

    @classmethod
    def open(cls, folder: str | os.PathLike[str], app: App) -> Run:
        return cls(reader.open_run(os.fspath(folder), app.name), app)

    def __repr__(self) -> str:
        steps = self.summary.get("steps")  # which run.json tells when a run has ended
        ended = "" if steps is None else f", {steps} steps"
        return f"<{self._app.name} run {str(self.path)!r}: {self.status}{ended}>"

    def __reduce__(self) -> tuple[Callable[..., Run], tuple[str, str]]:
        """For pickle: where the folder is. It is opened there, on this machine or one that has it at that path."""
        return _opened_again, (self._app.name, str(self.path.absolute()))

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
        return tuple(self._files.field_snapshots.units) if self._files.rundir.fields.exists() else ()

    @property
    def species(self) -> tuple[str, ...]:
        """The species, fluids and walls, or sets of grains that snapshots hold."""
        return tuple(self._files.particle_snapshots.species) if self._files.rundir.particles.exists() else ()

    @property
    def field_times(self) -> list[float]:
        """Times of the snapshots of fields, s."""
        return self._files.field_snapshots.times.tolist() if self._files.rundir.fields.exists() else []

    @property
    def particle_times(self) -> list[float]:
        """Times of the snapshots of particles, s."""
        return self._files.particle_snapshots.times.tolist() if self._files.rundir.particles.exists() else []

    def fields(self, name: str, *, time: float | None = None, step: int | None = None) -> xarray.DataArray:
        """A field at the snapshot nearest to a time, at a step, or at the last one, of those that hold it; with the
        places of its points. All of them in one array: fields of `field_times`, by
        xarray.concat(fields, "time", coords="different", compat="equals").
        """
        snapshots = self._files.field_snapshots
        index = _index(snapshots, step, time, name)
        values, unit = snapshots.read(name, index), snapshots.units.get(name, "")
        return arrays.field(name, values, snapshots.spacing, snapshots.first, unit, self._moment(snapshots, index))

    def particles(
        self, name: str | None = None, *, time: float | None = None, step: int | None = None
    ) -> xarray.Dataset:
        """The particles of a species, fluid or set of grains likewise; without a name those of the only one. What an
        inlet has brought in has the name of the inlet: `species` lists all.
        """
        snapshots = self._files.particle_snapshots
        if name is None and len(snapshots.species) == 1:
            (name,) = snapshots.species
        if name is None:
            raise ConfigError(f"particles: name one of {', '.join(snapshots.species) or 'none'}")
        index = _index(snapshots, step, time)
        units, at = {"position": "m", **snapshots.units}, self._moment(snapshots, index)
        return arrays.particles(snapshots.read(name, index), units, snapshots.time_offsets, at)

    def histogram(self, name: str) -> xarray.DataArray:
        """A histogram of the case as a density over `time` [s] and the middles of its bins; its integral over all axes
        is the number of real particles in the bins. `beyond`: how many particles lay in none. Where a restart has
        changed the bins, the rows since then.
        """
        return arrays.histogram(name, self._files.histogram(name))

    @staticmethod
    def _moment(snapshots: reader.Snapshots, index: int) -> dict[str, Any]:
        return arrays.moment(snapshots.times[index], snapshots.steps[index])

    @property
    def figures(self) -> tuple[str, ...]:
        """Names that `plot` knows."""
        return tuple(self._app.plots()) if self._app.plots else ()

    def compare(self, other: Run) -> Comparison:
        """This run (a) beside another (b), as the verb `compare` does: `compare(other).beyond(1e-12)` is [] of two that
        are alike. Raises ConfigError of what is no run of the same program.
        """
        from hpcpic.core.report.compare import compared

        if not isinstance(other, Run) or other._app.name != self._app.name:
            raise ConfigError(f"a run of {self._app.name} is compared with another one (got {other!r})")
        return compared(self._files, other._files, self._app)

    def plot(self, name: str = "", step: int | None = None) -> Figure:
        """One of the `figures` of the run, as `plot` draws it; notebooks show it. Raises ConfigError where the run
        lacks what is drawn, or has no figure of that name.
        """
        from hpcpic.core.app.figures import PAPER, NoData, png

        plots = self._app.plots() if self._app.plots else {}
        if name not in plots:
            raise ConfigError(f"{f'no figure {name!r}' if name else 'which figure?'}; there are {', '.join(plots)}")
        use.keep_own()
        use.import_kept(self.summary, self._files.rundir.given)
        try:
            figure: Any = plots[name].make(self._files, step)
        except NoData as error:
            raise ConfigError(f"{name}: {error}") from error
        figure.set_facecolor(PAPER)  # of notebooks in the dark
        figure._repr_png_ = lambda: png(figure)  # without pyplot nobody has told IPython how to show a figure
        return figure

    def restart(
        self,
        changes: Mapping[str, Any] | None = None,
        *,
        until: float | None = None,
        threads: int | None = None,
        wall: str | float | None = None,
        checkpoint_every: str | int | None = None,
        quiet: bool = False,
    ) -> Run:
        """Do what the verb `restart` does: go on from the newest good checkpoint, and open the folder again. Collective
        under mpirun, on any number of ranks.

        changes: keys that do not belong to the state, as the number of steps or outputs, with new values. until: the
        end [s] instead of the case's. The others are those of `Case.run`. Raises ConfigError, FileError and Diverged as
        that does.
        """
        from hpcpic.core.cli.job import Flags, job
        from hpcpic.core.cli.restart import prepare_restart
        from hpcpic.core.comm.meeting import meet

        until = None if until is None else finite(until, "until")
        sets = tuple(assignments(changes or {}, _keep_nothing))
        flags = Flags(threads_of(threads), words(wall), words(checkpoint_every), quiet=quiet, summary=not quiet)
        frozen.require_unchanged()
        use.keep_own()
        meet("restart()")
        prepare = partial(prepare_restart, str(self.path), until, sets)
        try:
            return ended(job(lambda: self._app, prepare, flags, raises=True), self.path, self._app)
        finally:  # what was read before is not kept
            self.__dict__.pop("series", None)
            self._files = reader.Run(self._files.rundir)

    def simulation(self, *, threads: int | None = None) -> Simulation:
        """The simulation in memory, at the state of the newest good checkpoint: use it in a `with`. The run stays as it
        is. Collective. Raises ConfigError and FileError.
        """
        from hpcpic.core.cli.restart import case_of, facts_of

        threads = threads_of(threads)
        use.keep_own()
        use.import_to_go_on(facts_of(self._files.rundir), self._files.rundir.given)
        config, tree, _ = case_of(self._app, self._files.rundir, None, (), 1)
        return Simulation(self._app, config, threads, checkpoints=(self._files.rundir, tree))


def _opened_again(program: str, folder: str) -> Run:
    """A run that was pickled."""
    found: Run = import_module(program).open_run(folder)
    return found


def ended(code: int, folder: str | os.PathLike[str], app: App) -> Run:
    """A run that this process has made, by its exit code. Raises what it ended with."""
    run = Run.open(folder, app)
    if code in _RAISED:
        raise _RAISED[code](f"{run.path}: {run.summary.get('reason', '')}")
    return run


def threads_of(given: int | None) -> int | None:
    """Threads per rank; None for the default. Raises ConfigError."""
    return None if given is None else whole(given, "threads")


def _index(snapshots: reader.Snapshots, step: int | None, time: float | None, name: str | None = None) -> int:
    """Number of the snapshot at a step, nearest to a time, or the last one, of those that hold the array `name`. Raises
    ConfigError and FileError.
    """
    if step is not None and time is not None:
        raise ConfigError("say step=N or time=T, not both")
    step = None if step is None else whole(step, "step", 0)
    return snapshots.index(step, None if time is None else finite(time, "time"), name)


def _keep_nothing(key: str, given: Mapping[str, Any]) -> str:
    raise ConfigError(f"{key}: a restart goes on from a checkpoint, not from arrays")


_RAISED: Mapping[int, type[HpcpicError]] = {4: Diverged, 6: FileError}
