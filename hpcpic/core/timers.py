"""Seconds and calls per named section of the step."""

from collections.abc import Iterator
from contextlib import contextmanager
from time import perf_counter


class Timers:
    """Wall-clock sections, nested as one likes: a section's time is without the sections inside it, so they add up."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget all sections and restart the wall clock."""
        self._totals: dict[str, list[float]] = {}
        self._start = perf_counter()
        self._inside = 0.0  # seconds of the sections inside the one that is open

    @contextmanager
    def section(self, name: str) -> Iterator[None]:
        """Add the time of the body to `name`, also when the body raises."""
        begin, before, self._inside = perf_counter(), self._inside, 0.0
        try:
            yield
        finally:
            spent = perf_counter() - begin
            total = self._totals.setdefault(name, [0.0, 0])
            total[0] += spent - self._inside
            total[1] += 1
            self._inside = before + spent

    def totals(self) -> dict[str, tuple[float, int]]:
        """Seconds and calls of each section, in the order of their first end."""
        return {name: (seconds, int(calls)) for name, (seconds, calls) in self._totals.items()}

    @property
    def wall(self) -> float:
        """Seconds since creation or the last reset."""
        return perf_counter() - self._start
