"""A simulator as the command line knows it. Its fields are functions, so that nothing heavy is imported early."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hpcpic.core.app.figures import Plot
    from hpcpic.core.app.forecast import Estimate
    from hpcpic.core.app.knobs import Knobs
    from hpcpic.core.case.config import Tree
    from hpcpic.core.case.derived import Derived
    from hpcpic.core.case.schema import Section
    from hpcpic.core.comm.world import World
    from hpcpic.core.run.model import Make


PYTHON = (sys.executable, "-P")  # starts this Python; what lies in the current folder is not imported


@dataclass(frozen=True, slots=True)
class App:
    """One simulator. `config` is an instance of its schema; a --set list is a tuple of KEY=VALUE."""

    name: str
    title: str
    schema: Callable[[], type[Section]]
    configure: Callable[[Tree], Any]  # the valid and complete config of a case; ConfigError with every fault
    cases: Callable[[], Mapping[str, Path]]  # the shipped ones, by name
    derived: Callable[[Any, int], list[Derived]]  # (config, ranks): the numbers that `check` prints
    estimate: Callable[[Any, int, int, Mapping[str, float]], Estimate]  # (config, ranks, threads, measured rates)
    load: Callable[[], Make]  # the class that makes the model of a case
    until: Callable[[Any, float], tuple[str, ...]]  # (config, t): the --set list that ends the run at time t [s]
    time_step: Callable[[Any], float] | None = None  # (config): at the start, s
    # (config, factor): the --set list of a scene so many times as large, for weak scaling; ValueError where it cannot
    # grow
    grow: Callable[[Any, int], tuple[str, ...]] | None = None
    mass: Callable[[Any], float] | None = None  # (config): of all particles, kg, where the series does not tell it
    # (config): after which the box repeats along each axis, m; infinite where it does not
    periods: Callable[[Any], tuple[float, ...]] | None = None
    stop_sem: Callable[[Any], float] = lambda config: 0.0  # (config): relative error of the mean step that ends a run
    free: tuple[str, ...] = ()  # keys, or groups of keys, that a restart may change
    bench: Callable[[bool], Mapping[str, float]] | None = None  # (quick): rates of the kernels on this machine
    bench_ranks: Callable[[bool, World], Mapping[str, float]] | None = None  # rates of messages; collective
    plan: Callable[[Any, int, int], list[str]] | None = None  # (config, ranks, threads): kernels, arrays, messages
    plots: Callable[[], Mapping[str, Plot]] | None = None  # the figures of a run by name
    knobs: Callable[[Any], Knobs] | None = None  # (config): what `tradeoff` and `stability` may turn
    knob_names: tuple[str, ...] = ()  # all that a case may have, for the help
    sections: Mapping[str, str] = field(default_factory=dict)  # what the sections of a step do, for the report
    command: tuple[str, ...] = ()  # what starts this program

    @property
    def program(self) -> tuple[str, ...]:
        """The words that start this program with this Python."""
        return self.command or (*PYTHON, "-m", self.name)

    def may_change(self, key: str) -> bool:
        """True if a restart may change this setting, which then does not belong to the state."""
        return any(key == free or key.startswith((f"{free}.", f"{free}[")) for free in self.free)

    def fixed_settings(self, tree: Tree) -> dict[str, str]:
        """key -> value of the settings of a case that belong to the state: a restart cannot change them."""
        from hpcpic.core.case.config import leaves
        from hpcpic.core.case.texts import value_text

        return {key: value_text(value) for key, value in leaves(tree.data) if not self.may_change(key)}


AppLoader = Callable[[], App]


def repeating(lengths: Sequence[float], axes: Collection[str]) -> tuple[float, ...]:
    """Periods, m, of a box of these lengths that repeats along some of x, y and z."""
    return tuple(length if axis in axes else math.inf for axis, length in zip("xyz", lengths))


def named(module: str, name: str) -> Callable[[], Any]:
    """A function that imports what it gives when it is called: a command pays for what it uses."""
    return lambda: getattr(import_module(module), name)


def later(module: str, name: str) -> Callable[..., Any]:
    """A function that is imported when it is called."""

    def call(*args: Any) -> Any:
        return getattr(import_module(module), name)(*args)

    return call
