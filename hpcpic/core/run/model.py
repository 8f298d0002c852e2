"""The model that a simulator makes of a case, as the core uses it. Nothing to inherit; mypy checks that a class has it
all (each app.py returns its class as a `Make`).
"""

from collections.abc import Callable, Mapping
from typing import Any, Protocol

from hpcpic.core.comm.world import World
from hpcpic.core.files.arrays import Column, Counts, FieldArray, ParticleArray, Shard
from hpcpic.core.files.sealed import Reader
from hpcpic.core.space.domain import Domain
from hpcpic.core.tasks.graph import Pool
from hpcpic.core.timers import Timers


class Ending(Protocol):
    """When a run ends: the configuration of a case says so, and the model that is made of it."""

    @property
    def n_steps(self) -> int | None: ...  # of the whole run; None: it ends at the first step at or after `end_time`
    @property
    def end_time(self) -> float: ...  # s


class Model(Ending, Protocol):
    """A state after `iteration` steps at `time` [s], and the step to the next. All ranks make it, step it and look at
    it together; `guard` alone is of one rank.
    """

    @property
    def iteration(self) -> int: ...
    @property
    def time(self) -> float: ...  # s
    @property
    def time_step(self) -> float: ...  # of the last or the next step, s
    @property
    def work_unit(self) -> str: ...  # "particle" or "node"
    @property
    def work_items(self) -> int: ...  # particles or nodes of all ranks
    @property
    def local_items(self) -> int | None: ...  # those of this rank, where ranks may have unequal shares
    @property
    def periods(self) -> Mapping[str, int]: ...  # steps between "series", "field", "particle", "openpmd", "checkpoint"
    @property
    def time_periods(self) -> Mapping[str, float]: ...  # s between these, where not given in steps; 0 or absent: never
    @property
    def scalar_units(self) -> Mapping[str, str]: ...  # of each value of `scalars`
    @property
    def particle_name(self) -> str: ...  # "particle" or "grain": in the name of their file
    @property
    def domain(self) -> Domain: ...

    def step(self) -> None: ...
    def advance(self, most: int) -> None: ...  # one step, or several at once, `most` at most
    def scalars(self) -> Mapping[str, float]: ...  # of this time, over all ranks
    def fields(self) -> Mapping[str, FieldArray]: ...
    def particles(self) -> Mapping[str, ParticleArray]: ...  # by species, fluid and wall, or set of grains
    def state(self) -> Mapping[str, Shard]: ...  # all that the next step reads, in an order that no cut changes
    def columns(self, reader: Reader) -> Mapping[str, Column]: ...  # what the arrays of a checkpoint must be
    def restore(self, reader: Reader) -> None: ...  # the state of a checkpoint in place of the present one
    def guard(self) -> str | None: ...  # why this rank's state is no solution
    def worst(self) -> list[str]: ...  # lines on the worst particles and nodes of this rank
    def close(self) -> None: ...  # frees what MPI holds


class Counting(Model, Protocol):
    """A model whose periods have "histogram"."""

    def histograms(self) -> Mapping[str, Counts]: ...  # by name, over all ranks


class Sampled(Model, Protocol):
    """A model with scalars that are means over the time since the last sample of the series."""

    def sampled(self) -> None: ...  # the series has the scalars of this time: their means begin anew. Collective


Make = Callable[[Any, World, Pool, Timers], Model]  # (config, world, pool, timers)
