"""Where a run is in time."""

from dataclasses import dataclass

from hpcpic.core.errors import Diverged


@dataclass(slots=True)
class Clock:
    """Steps done, the time they have led to and the length of the last one (or of the one that is being done), s."""

    step: int = 0
    time: float = 0.0
    time_step: float = 0.0

    def diverged(self, reason: str) -> Diverged:
        """The error that ends a run here."""
        return Diverged(f"step {self.step}, t = {self.time:.6g} s: {reason}")
