"""Seconds and calls per named section of the step."""

from collections.abc import Iterator
from contextlib import contextmanager
from time import perf_counter


class Timers:
    """Wall-clock sections, nested as one likes: a section's time includes the sections inside it."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget all sections and restart the wall clock."""
        self._totals: dict[str, list[float]] = {}
        self._start = perf_counter()

    @contextmanager
    def section(self, name: str) -> Iterator[None]:
        """Add the time of the body to `name`, also when the body raises."""
        begin = perf_counter()
        try:
            yield
        finally:
            total = self._totals.setdefault(name, [0.0, 0])
            total[0] += perf_counter() - begin
            total[1] += 1

    def totals(self) -> dict[str, tuple[float, int]]:
        """Seconds and calls of each section, in the order of their first end."""
        return {name: (seconds, int(calls)) for name, (seconds, calls) in self._totals.items()}

    @property
    def wall(self) -> float:
        """Seconds since creation or the last reset."""
        return perf_counter() - self._start
