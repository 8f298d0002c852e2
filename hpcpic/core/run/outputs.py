"""What a run writes while it goes: series, fields, particles. Output never changes the state.

A full disk ends the output, not the physics: the writer that failed is put aside with a warning, and the run
ends with the code of file errors.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from typing import Any

from hpcpic.core.comm.world import World
from hpcpic.core.errors import FileError
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.run.progress import Progress
from hpcpic.core.run.summary import Conserved
from hpcpic.core.run.triggers import Every, EveryTime, Observer
from hpcpic.core.timers import Timers

log = logging.getLogger("hpcpic.output")

WRITING_SHARE = 0.02  # of the time, that small snapshots may take


def trigger_of(app: Any, kind: str, begun: bool) -> Every | EveryTime | None:
    """When the app asks for this kind of output: `periods` are in steps, `time_periods` in seconds of physical
    time; None: never. begun: the present time has been seen.
    """
    steps, seconds = app.periods.get(kind, 0), getattr(app, "time_periods", {}).get(kind, 0.0)
    if seconds:
        return EveryTime(seconds, app.time) if begun else EveryTime(seconds)
    return Every(steps) if steps else None


class Outputs:
    """`after`: the step of a restart; what was written later than that is dropped.

    `rest()` is called before a snapshot is written, which may take any time.
    """

    def __init__(
        self,
        app: Any,
        world: World,
        rundir: RunDir,
        timers: Timers,
        *,
        progress: Progress,
        conserved: Conserved,
        rest: Callable[[], None],
        after: int | None = None,
    ) -> None:
        self.app, self.world, self.rundir, self.timers = app, world, rundir, timers
        self.progress, self.conserved = progress, conserved
        self.rest, self.after = rest, after
        self.broken: list[str] = []
        self._series: Any = None
        self._writers: dict[str, Any] = {}
        makers: Mapping[str, Callable[[], Callable[[], None]]] = {
            "series": self._series_observer,
            "field": self._field_observer,
            "particle": self._particle_observer,
            "openpmd": self._openpmd_observer,
        }
        self.observers = [
            Observer(kind, trigger, self._kept_going(kind, make()), seen=after)
            for kind, make in makers.items()
            if (trigger := trigger_of(app, kind, after is not None))
        ]

    def look(self, step: int, time: float, at_end: bool = False) -> None:
        for observer in self.observers:
            # The series fails on rank 0 alone, and its values are made by all ranks: it is never skipped.
            if observer.name == "series" or observer.name not in self.broken:
                observer.look(step, time, at_end)

    @property
    def due(self) -> bool:
        """Whether this rank has rows to write."""
        return self._series is not None and "series" not in self.broken and self._series.due

    def flush(self) -> None:
        """The series and the snapshots so far are in the files afterwards. Collective."""
        if self._series is not None and "series" not in self.broken:
            self._kept_going("series", self._series.flush)()
        for kind, writer in self._writers.items():
            if kind not in self.broken:
                with self.timers.section(f"output {kind}"):
                    self._kept_going(kind, writer.flush)()

    def _kept_going(self, kind: str, observe: Callable[[], None]) -> Callable[[], None]:
        def attempt() -> None:
            try:
                observe()
            except FileError as error:
                self.broken.append(kind)
                log.warning("no %s output from step %d on: %s", kind, self.app.iteration, error.message)

        return attempt

    def _series_observer(self) -> Callable[[], None]:
        app = self.app
        if self.world.rank == 0:
            from hpcpic.core.files.series import SeriesWriter

            self._series = SeriesWriter(self.rundir, app.scalar_units, after=self.after)

        def observe() -> None:
            values = app.scalars()
            if "energy_total" in self.conserved.names:
                self.progress.scalars(values)
            self.conserved.add(values)
            if self._series is not None and "series" not in self.broken:
                with self.timers.section("output series"):
                    self._series.append(app.iteration, app.time, values)

        return observe

    def _field_observer(self) -> Callable[[], None]:
        from hpcpic.core.files.snapshot import FieldsWriter

        app = self.app
        writer = FieldsWriter(self.world, self.rundir.fields, after=self.after, time_share=WRITING_SHARE)
        self._writers["field"] = writer

        def observe() -> None:
            fields = app.arrays("field")
            self.rest()
            with self.timers.section("output field"):
                writer.append(app.iteration, app.time, app.domain, fields)

        return observe

    def _particle_observer(self) -> Callable[[], None]:
        from hpcpic.core.files.snapshot import ParticlesWriter

        app = self.app
        path = self.rundir.path / f"{getattr(app, 'particle_name', 'particle')}s.vtkhdf"
        writer = ParticlesWriter(self.world, path, after=self.after, time_share=WRITING_SHARE)
        self._writers["particle"] = writer

        def observe() -> None:
            species = app.arrays("particle")
            self.rest()
            with self.timers.section("output particle"):
                writer.append(app.iteration, app.time, species)

        return observe

    def _openpmd_observer(self) -> Callable[[], None]:
        from hpcpic.core.files.openpmd import OpenPMDWriter

        app = self.app
        writer = OpenPMDWriter(self.world, self.rundir.openpmd, app.time_step, after=self.after)

        def observe() -> None:
            fields, species = app.arrays("field"), app.arrays("particle")
            self.rest()
            with self.timers.section("output openpmd"):
                writer.append(app.iteration, app.time, app.domain, fields, species)

        return observe
