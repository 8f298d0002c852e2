"""Checksums of the state between two steps: from when its particles are put in order, at the end of one, to when the
next has found its rates nothing may change it. A bit that turns while a run writes, waits and sums over pairs is told.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.tasks.arena import Arena

WHAT = (
    "positions",
    "velocities",
    "densities",
    "masses",
    "sums over time of forces on walls, states of bodies or of inlets and outlets",
)


class Checksums:
    """Sums of the bits of a rank's particles, which kernels that read them add up on the way, and copies of `summed`,
    some small arrays.
    """

    def __init__(self, dimensions: int, arena: Arena, summed: Sequence[NDArray]) -> None:
        self.arena, self.summed = arena, summed
        self.lines = np.repeat(np.arange(4), [dimensions, dimensions, 1, 1])  # of the state: which of WHAT they are
        self.kept = np.zeros(len(self.lines), np.int64), b""
        self.trouble: str | None = None

    def _copies(self) -> bytes:
        return b"".join(array.tobytes() for array in self.summed)

    def keep(self) -> None:
        """The state has just been sorted, and is what it is to be until the next step changes it."""
        self.kept = self.arena["bits_sorted"][:, : len(self.lines)].sum(axis=0), self._copies()

    def compare(self, step: int) -> None:
        """Before a step changes the state, from the bits that it has found."""
        bits, copies = self.arena["bits_found"].sum(axis=0), self._copies()
        if copies == self.kept[1] and np.array_equal(bits, self.kept[0]):
            return
        changed = [WHAT[k] for k in np.unique(self.lines[bits != self.kept[0]])] or [WHAT[-1]]
        self.trouble = f"{', '.join(changed)} changed by themselves before step {step}: damaged memory"
