"""What a program foretells of a run before it starts, in the form that check, estimate and the report read."""

import math
from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Array:
    """One array of one rank, of the rank with the most rows."""

    name: str
    shape: tuple[int, ...]
    dtype: str

    @property
    def bytes(self) -> int:
        size = int("".join(c for c in self.dtype if c.isdigit())) // 8
        return math.prod(self.shape) * size


@dataclass(frozen=True, slots=True)
class Estimate:
    """memory: item -> bytes per rank; disk: item -> bytes of the whole run; seconds of one step and of the run."""

    memory: Mapping[str, float]
    disk: Mapping[str, float]
    step_seconds: float
    seconds: float
