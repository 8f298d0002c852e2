"""What a search may cost: pilots are foretold, and counted in pilots of the case's own cost."""

from __future__ import annotations

import math
from collections.abc import Mapping

from hpcpic.core.app.knobs import Knob
from hpcpic.core.study.pilot import Pilot, Pilots, Settings

PILOTS = 20  # that all may take, or this share of the run itself, or so many seconds:
SHARE = 0.5
THRIFT = 6.0  # what is spared below it is nobody's time
LEAST, KEPT = 6.0, 0.5  # pilots: the search has half of all, or all but KEPT up to LEAST; the rest is to verify
CLOCKED = 0.02  # s of the case's pilot: above it clocks count too


class Budget:
    """The allowance of search and verification together, and what is left of it."""

    def __init__(
        self, pilots: Pilots, base: Pilot, time: float, more: tuple[str, ...], most: float | None = None
    ) -> None:
        """base: the case's own pilot until `time` [s]; more: settings of all; most: pilots that were asked for."""
        self.pilots, self.base, self.time, self.more = pilots, base, time, more
        usual = max(PILOTS, SHARE * pilots.knobs.time / time, THRIFT / max(base.seconds, 1e-6))
        self.allowance = most or usual
        self.foreseen = pilots.foreseen(base.sizes, time, {})

    @property
    def share(self) -> float:
        """Pilots of the allowance that the search may take; the rest is for the verification."""
        return max(0.5 * self.allowance, min(LEAST, self.allowance - KEPT))

    @staticmethod
    def asking(share: float) -> int:
        """The allowance that gives the search this share."""
        return math.ceil(2.0 * share if share > LEAST else share + KEPT)

    @property
    def used(self) -> float:
        """All that was run, by the estimate, or by the clock if that says more."""
        base, clocked = self.base, self.base.seconds > CLOCKED
        return sum(
            max(pilot.price / base.price, pilot.seconds / base.seconds if clocked else 0.0)
            for pilot in self.pilots.done.values()
        )

    @property
    def left(self) -> float:
        return self.allowance - self.used

    def cost(self, knobs: tuple[Knob, ...], sizes: Mapping[str, float], others: Settings) -> float:
        """What a pilot will cost: by theory, or by the estimate if that says more; nothing where it was run."""
        if self.pilots.named(sizes, self.time, others, self.more)[1] in self.pilots.done:
            return 0.0
        theory = math.prod((self.base.sizes[knob.name] / sizes[knob.name]) ** knob.cost for knob in knobs)
        if theory > self.left:
            return theory  # told, and not even set up
        return max(theory, self.pilots.foreseen(sizes, self.time, others) / self.foreseen)

    def affordable(self, cost: float) -> bool:
        """True if the search may run pilots of this cost."""
        return self.used + cost <= self.share
