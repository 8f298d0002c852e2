"""Knobs of one case, quantities of interest and costs, as a simulator gives them to `tradeoff` and `stability`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from hpcpic.core.case.config import Path

if TYPE_CHECKING:
    import numpy as np

    from hpcpic.core.files.series import Series


def itself(size: float) -> float:
    return size


def reseeded(seed: int) -> tuple[str, ...]:
    """The --set list of another random state."""
    return (f"simulation.random_seed={seed}",)


@dataclass(frozen=True, slots=True)
class Knob:
    """A continuous setting. In theory its error goes as size^order and the cost of a run as size^-cost.

    size(config): of a completed case, in `unit`. key: where the setting stands. limit: the derived number that ends
    the stability of the scheme when this knob is turned. shown(size): the number that is printed, a count for example.
    noisy: sampling: its error is drawn anew with every size, and falls as size^order in the mean only.
    overruled: why its limit is never met in this case, and what would be right; "" where it may be. largest: the size
    beyond which the scene is another, and beyond: why.
    """

    name: str
    text: str
    unit: str
    key: Path
    size: Callable[[Any], float]
    order: float
    cost: float
    limit: str = ""
    shown: Callable[[float], float] = itself
    noisy: bool = False
    overruled: str = ""
    largest: float = math.inf
    beyond: str = ""


@dataclass(frozen=True, slots=True)
class Choice:
    """A discrete setting: key, the value here, and others, as case files write them.

    acts_on: the knob whose error it changes; "" for an error of its own, as that of single precision.
    """

    name: str
    key: Path
    here: str
    others: tuple[str, ...]
    acts_on: str = ""


@dataclass(frozen=True, slots=True)
class Quantity:
    """A quantity of interest. measure(series): one number or several, from a run until `time` [s].

    exact: its value in the exact solution, where that is known. Raises ArithmeticError or ValueError where the
    series does not show it. why: it is the one that the case is about. column: of the series, if it is of one.
    noise(series): half the 95 % interval, if it is a mean over time. field: it is the field that is seen at the end.
    asked: the user named it, and accepts with that what else may be wrong.
    """

    name: str
    text: str
    time: float
    measure: Callable[[Series], np.ndarray | float]
    exact: float | None = None
    why: str = ""
    column: str = ""
    noise: Callable[[Series], float] | None = None
    field: bool = False
    asked: bool = False


@dataclass(frozen=True, slots=True)
class Seen:
    """The field of a snapshot that is looked at beside the quantity: its name, the box [m], and the --set list of a run
    until `time` [s] that writes it at the end. cells: of the case along each axis.
    """

    name: str
    low: tuple[float, ...]
    high: tuple[float, ...]
    cells: tuple[int, ...]
    snapshot: Callable[[float], tuple[str, ...]]


@dataclass(frozen=True, slots=True)
class Knobs:
    """All that can be turned in one completed case, and the costs.

    settings(sizes, time): the --set list that gives the knobs these sizes, or the nearest finer ones there are, in a
    run until `time` [s]. time: end of the case itself. pilot: settings of every pilot: series densely, no snapshots.
    quantities(): what can be asked for, the one that the case is about first.
    work(config): what the run costs, counted instead of timed, in work_unit.
    horizon: time [s] in which an instability shows. growth(series): how much larger than at the start the quantity has
    become that an unstable scheme blows up. seed(n): settings of another random state; None where the scene draws no
    random numbers. shaken(n): likewise, of a start off by a little, where chaos is to be seen in a scene
    that draws none. quieter: settings of the same scene whose start has less noise of particles; empty where there are
    none. seen: the field that is looked at beside a quantity.
    """

    knobs: tuple[Knob, ...]
    choices: tuple[Choice, ...]
    quantities: Callable[[], Sequence[Quantity]]
    settings: Callable[[Mapping[str, float], float], tuple[str, ...]]
    time: float
    pilot: tuple[str, ...]
    work: Callable[[Any], float]
    work_unit: str
    horizon: float
    growth: Callable[[Series], float]
    seed: Callable[[int], tuple[str, ...]] | None = None
    shaken: Callable[[int], tuple[str, ...]] | None = None
    quieter: tuple[str, ...] = ()
    seen: Seen | None = None
