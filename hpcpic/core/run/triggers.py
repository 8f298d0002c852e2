"""When something is observed: triggers, and the observers that hang on them."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from hpcpic.core.errors import ConfigError

_UNITS = {"s": 1.0, "m": 60.0, "h": 3600.0}


@dataclass(frozen=True, slots=True)
class Every:
    """Every so many steps, step 0 included; 0 is never."""

    steps: int

    def due(self, step: int, time: float = 0.0) -> bool:
        return self.steps > 0 and step % self.steps == 0

    def ahead(self, step: int) -> float:
        """Steps from this one to the next that is due."""
        return self.steps - step % self.steps if self.steps else math.inf

    def done(self, time: float) -> None:
        """Nothing to remember."""


@dataclass(slots=True)
class EveryTime:
    """The first step at or after each multiple of so many seconds of physical time that lies behind `since`."""

    seconds: float
    since: float = -math.inf

    def due(self, step: int, time: float) -> bool:
        return self._multiple(time) > self._multiple(self.since)

    def ahead(self, step: int) -> float:
        """At any step the time may come."""
        return 1

    def done(self, time: float) -> None:
        self.since = time

    def _multiple(self, time: float) -> float:
        return math.floor(time / self.seconds * (1 + 1e-12)) if math.isfinite(time) else time


@dataclass(slots=True)
class EverySeconds:
    """Every so many seconds of wall time. Clocks differ: one rank asks, and tells the others."""

    seconds: float
    last: float = field(default_factory=time.monotonic)

    def due(self) -> bool:
        return self.seconds > 0 and time.monotonic() - self.last >= self.seconds

    def done(self, physical: float = 0.0) -> None:
        self.last = time.monotonic()


@dataclass(slots=True)
class Observer:
    """Calls `observe()` when the trigger is due, and at the end of a finished run if that step was not yet
    seen.
    """

    name: str
    trigger: Every | EveryTime
    observe: Callable[[], None]
    seen: int | None = None

    def look(self, step: int, time: float = 0.0, at_end: bool = False) -> bool:
        wanted = self.trigger.due(step, time) or (at_end and self.trigger != Every(0))
        if not wanted or self.seen == step:
            return False
        self.seen = step
        self.trigger.done(time)
        self.observe()
        return True


def parse_interval(text: str) -> Every | EverySeconds:
    """ "500" or "500 steps" -> Every(500); "30s", "15m", "2h" -> EverySeconds. Raises ConfigError."""
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*(s|m|h|steps)?\s*", text)
    if match and match[2] in _UNITS:
        return EverySeconds(float(match[1]) * _UNITS[match[2]])
    if match and match[1].isdigit():
        return Every(int(match[1]))
    raise ConfigError(f"{text!r} is no interval: write 500 (steps), 30s, 15m or 2h")


def parse_wall(text: str) -> float:
    """ "HH:MM:SS", "MM:SS" or seconds -> seconds. Raises ConfigError."""
    if not re.fullmatch(r"(\d+:){0,2}\d+(\.\d+)?", text):
        raise ConfigError(f"{text!r} is not a duration: write HH:MM:SS, MM:SS or seconds")
    seconds = 0.0
    for part in text.split(":"):
        seconds = 60 * seconds + float(part)
    return seconds
