"""Outputs of a run while it goes: series, fields, particles. They never change the state.

A full disk ends the output, not the physics: the writer that failed is put aside with a warning, and the run
ends with the code of file errors.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, cast

from hpcpic.core.comm.world import World
from hpcpic.core.errors import FileError
from hpcpic.core.files.arrays import ParticleArray
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.run.progress import Progress
from hpcpic.core.run.summary import Conserved
from hpcpic.core.run.triggers import Every, EveryTime, Observer
from hpcpic.core.timers import Timers

if TYPE_CHECKING:
    from hpcpic.core.run.model import Counting, Model, Sampled

log = logging.getLogger("hpcpic.output")

WRITING_SHARE = 0.02  # of the time, that small snapshots may take


def trigger_of(model: Model, kind: str, begun: bool) -> Every | EveryTime | None:
    """When the model asks for this kind of output: `periods` are in steps, `time_periods` in seconds of physical
    time; None: never. begun: the present time has been seen.
    """
    steps, seconds = model.periods.get(kind, 0), model.time_periods.get(kind, 0.0)
    if seconds:
        return EveryTime(seconds, model.time) if begun else EveryTime(seconds)
    return Every(steps) if steps else None


def begin_means(model: Model) -> None:
    """Tell the model that the series has its scalars of this time. Collective."""
    if hasattr(model, "sampled"):
        cast("Sampled", model).sampled()


class Outputs:
    """`after`: the step of a restart; what was written later than that is dropped.

    `rest()` is called before a snapshot is written, which may take any time.
    """

    def __init__(
        self,
        model: Model,
        world: World,
        rundir: RunDir,
        timers: Timers,
        *,
        progress: Progress,
        conserved: Conserved,
        rest: Callable[[], None],
        after: int | None = None,
    ) -> None:
        self.model, self.world, self.rundir, self.timers = model, world, rundir, timers
        self.progress, self.conserved = progress, conserved
        self.rest, self.after = rest, after
        self.broken: list[str] = []
        self._series: Any = None
        self._writers: dict[str, Any] = {}
        self.observers = [
            Observer(kind, trigger, self._kept_going(kind, self._observer(kind)), seen=after)
            for kind in ("series", "field", "particle", "openpmd", "histogram")
            if (trigger := trigger_of(model, kind, after is not None))
        ]

    def look(self, step: int, time: float, at_end: bool = False) -> None:
        for observer in self.observers:
            # The series fails on rank 0 alone, and its values are made by all ranks: it is never skipped.
            if observer.name == "series" or observer.name not in self.broken:
                observer.look(step, time, at_end)

    @property
    def due(self) -> bool:
        """True if this rank has rows of the series to write."""
        return self._series is not None and "series" not in self.broken and self._series.due

    def flush(self) -> None:
        """The series and the snapshots so far are in the files afterwards. Collective."""
        self.flush_series()
        for kind, writer in self._writers.items():
            if kind not in self.broken:
                with self.timers.section(f"output {kind}"):
                    self._kept_going(kind, writer.flush)()

    def flush_series(self) -> None:
        """On rank 0 the rows of the series so far are in its files afterwards: before any snapshot is, so that a run
        that is killed has the scalars of what its snapshots show. Collective: the folder is followed first.
        """
        self.follow()
        if self._series is not None and "series" not in self.broken:
            self._kept_going("series", self._series.flush)()

    def follow(self) -> bool:
        """Write from now on where the folder of the run is: True if it was moved. Collective."""
        name = os.fsdecode(self.world.bcast(os.fsencode(self.rundir.moved_to())))
        if name:
            log.warning("the run folder %s was moved: going on in %s", self.rundir.path, name)
            self.rundir.rename(name)
            for writer in self._writers.values():
                writer.path = self.rundir.path / writer.path.name
        return bool(name)

    def _kept_going(self, kind: str, observe: Callable[[], None]) -> Callable[[], None]:
        def attempt() -> None:
            try:
                observe()
            except FileError as error:
                if kind == "openpmd" and self.follow():  # no other step waits in this writer, to be lost
                    return attempt()
                self.broken.append(kind)
                log.warning("no %s output from step %d on: %s", kind, self.model.iteration, error.message)

        return attempt

    def _observer(self, kind: str) -> Callable[[], None]:
        """The function that is called when this kind of output is due. Collective."""
        if kind == "series":
            return self._series_observer()
        model, writer = self.model, self._writer(kind)
        self._writers[kind] = writer

        def observe() -> None:
            content = self._content(kind)
            self.rest()
            if kind == "openpmd":  # a file of its own for each step, which is written at once
                self.flush_series()
            with self.timers.section(f"output {kind}"):
                writer.append(model.iteration, model.time, *content)

        return observe

    def _writer(self, kind: str) -> Any:
        """The writer of this kind of snapshots; its module is imported when it is needed."""
        world, rundir, after = self.world, self.rundir, self.after
        if kind == "field":
            from hpcpic.core.files.snapshot import FieldsWriter

            return FieldsWriter(world, rundir.fields, after, WRITING_SHARE, self.flush_series)
        if kind == "particle":
            from hpcpic.core.files.snapshot import ParticlesWriter

            path = rundir.path / f"{self.model.particle_name}s.vtkhdf"
            return ParticlesWriter(world, path, after, WRITING_SHARE, self.flush_series)
        if kind == "histogram":
            from hpcpic.core.files.histograms import FILE, HistogramsWriter

            return HistogramsWriter(world, rundir.path / FILE, after, self.flush_series)
        from hpcpic.core.files.openpmd import OpenPMDWriter

        return OpenPMDWriter(world, rundir.openpmd, self.model.time_step, after=after)

    def _content(self, kind: str) -> tuple[Any, ...]:
        """The arguments of a writer of this kind for the present state."""
        model = self.model
        if kind == "histogram":
            return (cast("Counting", model).histograms(),)  # it has the period
        if kind == "particle":
            return (self._particles(),)
        fields = model.domain, model.fields()
        return fields if kind == "field" else (*fields, self._particles())

    def _particles(self) -> dict[str, ParticleArray]:
        """The particles by species, as files hold them."""
        return {name: own.as_kept() for name, own in self.model.particles().items()}

    def _series_observer(self) -> Callable[[], None]:
        model = self.model
        if self.world.rank == 0:
            from hpcpic.core.files.series import SeriesWriter

            self._series = SeriesWriter(self.rundir, model.scalar_units, after=self.after)

        def observe() -> None:
            values = model.scalars()
            begin_means(model)
            if "energy_total" in self.conserved.names:
                self.progress.scalars(values)
            self.conserved.add(values)
            if self._series is not None and "series" not in self.broken:
                with self.timers.section("output series"):
                    self._series.append(model.iteration, model.time, values)

        return observe
