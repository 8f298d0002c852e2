"""What the command line knows of a simulator. Each field is a function, so that nothing heavy is imported
early.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hpcpic.core.app.figures import Plot
    from hpcpic.core.app.forecast import Estimate
    from hpcpic.core.app.knobs import Knobs
    from hpcpic.core.case.derived import Derived
    from hpcpic.core.case.schema import Section
    from hpcpic.core.comm.world import World


PYTHON = (sys.executable, "-P")  # starts this Python; what lies in the current folder is not imported


@dataclass(frozen=True, slots=True)
class App:
    """One simulator. `config` below is an instance of the schema.

    derived(config, ranks): the numbers `check` prints. estimate(config, ranks, threads, rates): memory, disk,
    time. load(): the class with the closed shape. until(config, t): the --set list that ends the run at time
    t [s]. time_step(config): that of the start [s]. grow(config, factor): the --set list of a scene so many
    times as large, for weak scaling; ValueError where it cannot grow. free: keys, or groups of keys, that a
    restart may change. bench(quick): kernel rates of this machine. bench_ranks(quick, world): what ranks need for each
    other, collective. plan(config, ranks, threads): lines on
    kernels, arrays and messages. plots(): the figures of a run by name. knobs(config): what `tradeoff` and
    `stability` may turn. command: what starts this program.
    """

    name: str
    title: str
    schema: Callable[[], type[Section]]
    cases: Callable[[], Mapping[str, Path]]
    derived: Callable[[Any, int], list[Derived]]
    estimate: Callable[[Any, int, int, Mapping[str, float]], Estimate]
    load: Callable[[], type]
    until: Callable[[Any, float], tuple[str, ...]]
    time_step: Callable[[Any], float] | None = None
    grow: Callable[[Any, int], tuple[str, ...]] | None = None
    free: tuple[str, ...] = ()
    bench: Callable[[bool], Mapping[str, float]] | None = None
    bench_ranks: Callable[[bool, World], Mapping[str, float]] | None = None
    plan: Callable[[Any, int, int], list[str]] | None = None
    plots: Callable[[], Mapping[str, Plot]] | None = None
    knobs: Callable[[Any], Knobs] | None = None
    command: tuple[str, ...] = field(default=())

    @property
    def program(self) -> tuple[str, ...]:
        """The words that start this program with this Python."""
        return self.command or (*PYTHON, "-m", self.name)

    def may_change(self, key: str) -> bool:
        """Whether a restart may change this setting: it does not belong to the state."""
        return any(key == free or key.startswith((f"{free}.", f"{free}[")) for free in self.free)


AppLoader = Callable[[], App]


def named(module: str, name: str) -> Callable[[], Any]:
    """A function that imports what it gives when it is called: a command pays for what it uses."""
    return lambda: getattr(import_module(module), name)


def later(module: str, name: str) -> Callable[..., Any]:
    """A function that is imported when it is called."""

    def call(*args: Any) -> Any:
        return getattr(import_module(module), name)(*args)

    return call
