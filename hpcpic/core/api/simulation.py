"""A simulation in memory: step it, look at it, throw it away."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, NoReturn, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.api import arrays
from hpcpic.core.api.numbers import finite, whole
from hpcpic.core.api.texts import settings_of
from hpcpic.core.app.app import App
from hpcpic.core.errors import ConfigError, Diverged
from hpcpic.core.run.signals import Reason, whole_steps
from hpcpic.core.run.triggers import Every, EveryTime, Observer
from hpcpic.core.simd import frozen

if TYPE_CHECKING:
    import xarray

    from hpcpic.core.case.config import Tree
    from hpcpic.core.files.rundir import RunDir
    from hpcpic.core.run.model import Model

Look = TypeVar("Look", bound="Callable[[Simulation], object]")


class Simulation:
    """The state of a case, from its start on. Under mpirun its methods are collective: all ranks call them, in one
    order. Where a rank calls another one all raise ConfigError; who waits for half a minute says so on standard error.

    >>> import hpcpic
    >>> with hpcpic.Case("plasma-oscillation").simulation(threads=1) as sim:
    ...     sim.advance(steps=3)
    ...     sim.iteration
    3

    Its digest after the last step is that of `run`, whatever the ranks, threads and observers. It goes on as its case
    says: nothing of it can be set, and what it gives are copies that cannot be written to.
    """

    _open = False
    _looking = False  # an observer is being called

    def __init__(
        self, app: App, config: Any, threads: int | None = None, checkpoints: tuple[RunDir, Tree] | None = None
    ) -> None:
        """checkpoints: the run whose newest one it goes on from, and its case."""
        from hpcpic.core import memory
        from hpcpic.core.comm.meeting import agree, meet
        from hpcpic.core.comm.world import World
        from hpcpic.core.run.guard import Guard
        from hpcpic.core.tasks.graph import Pool
        from hpcpic.core.timers import Timers

        frozen.require_unchanged()
        meet("simulation()")
        agree(settings_of(config))
        self.world = World.start()
        self.threads = threads or self.world.default_threads()
        make = app.load()
        self._pool = Pool(self.threads, self.world.cpus(self.threads))
        try:
            memory.require_room(lambda: sum(app.estimate(config, self.world.size, self.threads, {}).memory.values()))
            self.model = make(config, self.world, self._pool, Timers())
            if checkpoints:
                self._take_up(app, *checkpoints)
        except BaseException:
            self._pool.close()
            raise
        self._guard = Guard(self.world, self.model.guard, self.model.iteration)
        self._observers: list[Observer] = []
        self._open = True
        self._series = _series_of(self.model, begun=checkpoints is not None)

    def __setattr__(self, name: str, value: Any) -> None:
        if self._open and not name.startswith("_"):
            raise AttributeError(
                f"{name}: a simulation goes on as its case says; case.changed({{...}}).simulation() makes another one, "
                "which `start` lets begin from arrays"
            )
        super().__setattr__(name, value)

    def _take_up(self, app: App, rundir: RunDir, tree: Tree) -> None:
        from hpcpic.core.run import checkpoint

        reader = checkpoint.newest(rundir, self.world)
        checkpoint.require_same_case(reader, app.name, app.fixed_settings(tree))
        checkpoint.hold(reader, self.model.columns(reader), self.world)
        self.model.restore(reader)

    def __repr__(self) -> str:
        state = "" if self._open else ", closed"
        return f"<simulation: {self.iteration} steps, t = {self.time:.6g} s{state}>"

    def __reduce__(self) -> NoReturn:
        raise TypeError(
            "a simulation can be neither pickled nor copied: its threads and messages are of this process. A case can, "
            "and a run, and what particles() and fields() give"
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.close(collectively=kind is None or self.world.size == 1)

    def close(self, *, collectively: bool = True) -> None:
        """Free memory and threads. After an exception on one rank of several, what MPI holds stays with MPI."""
        if not self._open:
            return
        self._refuse_in_observer("close()")
        try:
            if collectively:
                self._meet("close()")
                self.model.close()
        finally:
            self._open = False
            self._pool.close()

    @property
    def time(self) -> float:
        """Physical time of the state, s."""
        return self.model.time

    @property
    def time_step(self) -> float:
        """Length of a step, s; in SPH, which chooses each anew, of the last one, 0 before the first."""
        return self.model.time_step

    @property
    def iteration(self) -> int:
        """Steps done."""
        return self.model.iteration

    @property
    def rank(self) -> int:
        return self.world.rank

    def every(self, *, steps: int | None = None, seconds: float | None = None) -> Callable[[Look], Look]:
        """Call the function with this simulation each so many steps, or at the first step at or after each multiple of
        so many seconds of physical time; at the start too. All ranks call it, after a whole step. Raises ConfigError.
        """
        if (steps is None) == (seconds is None):
            raise ConfigError("every: say steps=N or seconds=T, one of them")
        if seconds is not None and finite(seconds, "every: seconds") <= 0:
            raise ConfigError(f"every: seconds: greater than 0 (got {seconds!r})")
        trigger = EveryTime(float(seconds)) if seconds is not None else Every(whole(steps, "every: steps"))

        def observed(look: Look) -> Look:
            def observe() -> None:
                look(self)

            self._observers.append(Observer(getattr(look, "__name__", "observer"), trigger, observe))
            return look

        return observed

    def _meet(self, call: str) -> None:
        """All ranks make this call of an open simulation. Raises ConfigError."""
        if not self._open:
            raise ConfigError("this simulation is closed: case.simulation() makes another one")
        if self.world.size > 1:
            from hpcpic.core.comm.meeting import meet

            meet(call)

    def _refuse_in_observer(self, call: str) -> None:
        """Steps of an observer would be hidden from the others. Raises ConfigError."""
        if self._looking:
            raise ConfigError(
                f"{call} called in an observer, which only looks: put sim.advance(steps=N) into a loop, and after it "
                "what is to happen each N steps"
            )

    def step(self) -> None:
        """One step, past the end of the case too."""
        self.advance(steps=1)

    def advance(self, *, steps: int | None = None, until: float | None = None) -> None:
        """So many steps, or until the first step at or after a physical time [s], both past the end of the case too; by
        default to that end, where there is one ahead. Ctrl-C is heard after a whole step. Raises ConfigError, as of a
        time that is past, and Diverged.
        """
        self._meet("advance()")
        self._refuse_in_observer("step() or advance()")
        frozen.require_unchanged()
        if steps is not None and until is not None:
            raise ConfigError("advance: say steps=N or until=T, not both")
        steps = None if steps is None else whole(steps, "advance: steps", 0)
        until = None if until is None else finite(until, "advance: until")
        last, end = self._goal(steps, until)
        if until is not None and (last < self.iteration or end < self.time - self.model.time_step):
            raise ConfigError(f"advance: until: the simulation is at {self.time:g} s already (got {until:g})")
        self._look()
        while self.iteration < last and self.time < end:
            self._go(last)
            self._look()
            if self._guard.due(self.iteration):
                self._require_sound()
        self._require_sound()

    def _goal(self, steps: int | None, until: float | None) -> tuple[float, float]:
        """(iteration, time): the first that is reached ends the advance."""
        model = self.model
        if steps is not None:
            return model.iteration + steps, math.inf
        if model.n_steps is None:
            return math.inf, model.end_time if until is None else until
        if until is None:
            return model.n_steps, math.inf
        return math.ceil(until / model.time_step * (1 - 1e-12)), math.inf

    @property
    def _ends_here(self) -> bool:
        """Whether this is the step at which a run of the case ends."""
        last, end = self._goal(None, None)
        return self.iteration == last or self.time - self.time_step < end <= self.time

    def _go(self, last: float) -> None:
        """One step, or as many as the model takes at once without an observer in between."""
        unseen = [observer.trigger.ahead(self.iteration) for observer in (*self._series, *self._observers)]
        most = min([last - self.iteration, self._guard.ahead(self.iteration), *unseen])
        with whole_steps():
            self.model.advance(1 if self.model.n_steps is None else int(most))

    def _look(self) -> None:
        for series in self._series:
            series.look(self.iteration, self.time, at_end=self._ends_here)
        self._looking = True
        try:
            for observer in self._observers:
                observer.look(self.iteration, self.time)
        finally:
            self._looking = False

    def _require_sound(self) -> None:
        verdict = self._guard.agree(self.iteration, Reason.NONE, False)
        if verdict.diverged:
            raise Diverged(f"step {self.iteration}, t = {self.time:.6g} s, rank {verdict.rank}: {verdict.diverged}")

    def scalars(self) -> dict[str, float]:
        """The scalars of the series, in the units of `scalar_units`. Means over time of `wall-pressure` gauges are
        those since the last sample that a run of the case would have taken; a call begins none anew.
        """
        self._meet("scalars()")
        return {name: float(value) for name, value in self.model.scalars().items()}

    @property
    def scalar_units(self) -> Mapping[str, str]:
        return self.model.scalar_units

    def digest(self) -> str:
        """SHA-256 of the state in global order: the same on any ranks and threads."""
        self._meet("digest()")
        from hpcpic.core.run import checkpoint

        return checkpoint.digest(self.world, self.model.state())

    @property
    def field_names(self) -> tuple[str, ...]:
        """The fields that there are."""
        self._meet("field_names")
        return tuple(self.model.fields())

    @property
    def species(self) -> tuple[str, ...]:
        """The species, fluids and walls, or sets of grains that there are."""
        self._meet("species")
        return tuple(self.model.particles())

    def fields(self, name: str) -> xarray.DataArray:
        """A field on the whole grid, on every rank, with the places of its points; a copy that is read only."""
        self._meet(f"fields({name!r})")
        found = self.model.fields()
        if name not in found:
            there = f"there are {', '.join(found)}" if found else "there are none here, but particles()"
            raise ConfigError(f"no field {name!r}; {there}")
        domain, field = self.model.domain, found[name]
        values = self._everywhere(np.ascontiguousarray(field.values))
        first = [domain.offset * step for step in domain.spacing]
        return arrays.field(name, _kept(values), domain.spacing, first, field.unit, self._moment())

    def particles(self, name: str | None = None) -> xarray.Dataset:
        """All particles of one species, fluid or set of grains, on every rank, in the order of their numbers; without a
        name those of the only one. A copy that is read only, in double precision, which holds any state exactly;
        snapshots of SPH hold all but the positions in single precision.
        """
        self._meet(f"particles({name!r})" if name else "particles()")
        found = self.model.particles()
        if name is None and len(found) == 1:
            (name,) = found
        if name is None or name not in found:
            raise ConfigError(f"particles: name one of {', '.join(found) or 'none'} (got {name!r})")
        own = found[name]
        columns = {"id": own.ids, "position": own.position, **own.columns}
        whole = {key: self._everywhere(np.ascontiguousarray(values)) for key, values in columns.items()}
        order = np.argsort(whole["id"], kind="stable")
        units = {"position": "m", **own.units}
        kept = {key: _kept(values[order]) for key, values in whole.items()}
        return arrays.particles(kept, units, own.time_offsets, self._moment())

    def _moment(self) -> dict[str, Any]:
        return arrays.moment(self.time, self.iteration)

    def _everywhere(self, rows: NDArray) -> NDArray:
        """The rows of all ranks in their order, on every rank."""
        world, whole = self.world, self.world.gather_rows(rows)
        if world.size == 1:
            return rows if whole is None else whole
        content = world.bcast(None if whole is None else whole.tobytes())
        return np.frombuffer(bytearray(content), rows.dtype).reshape(-1, *rows.shape[1:])


def _series_of(model: Model, begun: bool) -> list[Observer]:
    """An observer that begins means over time anew when a run would sample its series, so that the state is that of a
    run; none where there are no such means.
    """
    from hpcpic.core.run.outputs import begin_means, trigger_of

    trigger = trigger_of(model, "series", begun)
    if trigger is None or not hasattr(model, "sampled"):
        return []
    return [Observer("series", trigger, partial(begin_means, model), seen=model.iteration if begun else None)]


def _kept(values: NDArray) -> NDArray:
    """A view that is read only, as the simulation would not go on with what is written to it."""
    values = values.view()
    values.flags.writeable = False
    return values
