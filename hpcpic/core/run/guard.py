"""All ranks agree every few steps, by one small reduction, whether they go on: divergence, reasons to stop, wall clock,
checkpoint.

The agreement takes at most 0.1 % of the time, or 1 % where a divergence would else go on for more than 100 steps, and
a reason to stop is acted upon within about 0.2 s. The number of steps to the next one is computed from reduced values,
so it is the same on all ranks.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from hpcpic.core.comm.world import World
from hpcpic.core.run.signals import Reason

LOOK_SHARE = 1e-3  # of the time, that looks may take
MOST_LOOK_SHARE = 1e-2  # where a divergence would else be seen too late
MOST_STEPS = 50  # between looks: with what is looked at as seldom, a divergence is seen within 100
MOST_GROWTH = 10  # of the interval, from one look to the next
REACTION_SECONDS = 0.2
_TEXT_LENGTH = 512


@dataclass(frozen=True, slots=True)
class Verdict:
    """The agreement of all ranks: the same on every rank."""

    reason: Reason
    checkpoint: bool
    write: bool  # rank 0 has rows for the series
    diverged: str | None  # why, in one line
    rank: int  # the rank that says so; -1: none


class Guard:
    """`check()` returns why this rank's part of the state is no solution any more, or None."""

    def __init__(self, world: World, check: Callable[[], str | None], step: int) -> None:
        self.world = world
        self.check = check
        self.interval = 0.0  # longest time between two looks [s], this rank
        self.step_seconds = 0.0  # mean over the last interval, on the slowest rank
        self._cost_ns = 0  # of the last look, waiting included
        self._step = step
        self._next = step
        self._clock = time.perf_counter()

    def due(self, step: int) -> bool:
        return step >= self._next

    def ahead(self, step: int) -> int:
        """Steps from this one to the next look."""
        return max(1, self._next - step)

    def agree(self, step: int, reason: Reason, checkpoint: bool, write: bool = False) -> Verdict:
        """Collective. `reason`, `checkpoint` and `write` are this rank's wishes."""
        start = time.perf_counter()
        steps = step - self._step
        step_ns = int(1e9 * (start - self._clock) / steps) if steps else 0
        if steps:
            self.interval = max(self.interval, start - self._clock)
        trouble = self.check()
        trouble_rank = self.world.rank if trouble else -1
        # The last rank to arrive waits for nobody: its look shows the price, so the minimum over ranks
        # counts.
        mine = [reason, checkpoint, trouble_rank, step_ns, -self._cost_ns, write]
        agreed = [int(n) for n in self.world.max_array(np.array(mine, dtype=np.int64))]
        self._plan(step, agreed[3], -agreed[4])
        trouble_there = self._tell(agreed[2], trouble) if agreed[2] >= 0 else None
        self._clock = time.perf_counter()
        self._cost_ns = int(1e9 * (self._clock - start))
        return Verdict(Reason(agreed[0]), bool(agreed[1]), bool(agreed[5]), trouble_there, agreed[2])

    def _plan(self, step: int, step_ns: int, cost_ns: int) -> None:
        steps = cost_ns / max(step_ns, 1)  # that a look costs
        cheap = max(steps / MOST_LOOK_SHARE, min(steps / LOOK_SHARE, MOST_STEPS))
        prompt = 1e9 * REACTION_SECONDS / max(step_ns, 1)
        grown = MOST_GROWTH * (step - self._step)  # the first looks cost more than others
        most = min(math.ceil(cheap), int(prompt), grown)
        self._next = step + max(1, most)
        self.step_seconds = 1e-9 * step_ns
        self._step = step

    def _tell(self, rank: int, trouble: str | None) -> str:
        """The sentence of one rank, on all ranks: as numbers, through the same reduction."""
        letters = np.zeros(_TEXT_LENGTH, dtype=np.int64)
        if rank == self.world.rank and trouble:
            text = trouble.encode()[:_TEXT_LENGTH]
            letters[: len(text)] = np.frombuffer(text, dtype=np.uint8)
        letters = self.world.max_array(letters)
        return bytes(letters[letters > 0].astype(np.uint8)).decode(errors="replace")


class ConservedSums:
    """Sums that nothing in a scene can change, as they are seen now and then: one that jumps tells damaged memory.

    names: of the sums in the series. rounding: what a step may change them by, in parts of their scale.
    """

    def __init__(self, names: tuple[str, ...], rounding: float) -> None:
        self.names, self.rounding = names, rounding
        self.trouble: str | None = None
        self._last: tuple[dict[str, float], float, int] | None = None

    def see(self, scalars: Mapping[str, float], scale: float, step: int) -> None:
        """The scalars at a step; scale: of the terms of the sums, and of what is added to them in a step."""
        values = {name: scalars[name] for name in self.names}
        if self._last:
            before, least, since = self._last
            allowed = self.rounding * (abs(step - since) + 1) * max(scale, least)
            for name, value in values.items():
                if abs(value - before[name]) > allowed:
                    jump = f"{name} jumped from {before[name]:.6g} to {value:.6g} between steps {since} and {step}"
                    self.trouble = f"{jump}, which nothing in the scene can do: damaged memory"
        self._last = values, scale, step
