"""Checksums of the state between two steps: from when its particles are put in order, at the end of one, to when the
next has found its rates nothing may change it. A bit that turns while a run writes, waits and sums over pairs is told.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.tasks.arena import Arena

LINES = "positions", "velocities", "densities", "masses"


class Checksums:
    """Sums of the bits of a rank's particles, which kernels that read them add up on the way, and copies of `small`
    arrays, by what they are.
    """

    def __init__(self, dimensions: int, arena: Arena, small: Mapping[str, NDArray]) -> None:
        self.arena, self.small = arena, small
        self.lines = np.repeat(np.arange(4), [dimensions, dimensions, 1, 1])  # of the state: which of LINES they are
        self.kept = np.zeros(len(self.lines), np.int64), self._copies()
        self.trouble: str | None = None

    def _copies(self) -> list[bytes]:
        return [array.tobytes() for array in self.small.values()]

    def keep(self) -> None:
        """The state has just been sorted, and is what it is to be until the next step changes it."""
        self.kept = self.arena["bits_sorted"][:, : len(self.lines)].sum(axis=0), self._copies()

    def compare(self, step: int) -> None:
        """Before a step changes the state, from the bits that it has found."""
        bits, copies = self.arena["bits_found"].sum(axis=0), self._copies()
        if copies == self.kept[1] and np.array_equal(bits, self.kept[0]):
            return
        changed = [LINES[k] for k in np.unique(self.lines[bits != self.kept[0]])]
        changed += [name for name, now, before in zip(self.small, copies, self.kept[1]) if now != before]
        self.trouble = f"{', '.join(changed)} changed by themselves before step {step}: damaged memory"
