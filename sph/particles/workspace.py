"""Memory that phases of a step use in turn."""

import math
from typing import TYPE_CHECKING

import numpy as np

from hpcpic.core.space.fields import ALIGNMENT, aligned_zeros

if TYPE_CHECKING:
    from sph.particles.particles import Tasks


class Workspace:
    """Arrays of phases that take turns, in the same memory: what one leaves is lost when the next begins."""

    def __init__(self, tasks: "Tasks") -> None:
        self._tasks = tasks
        self._phases: dict[str, dict[str, tuple[tuple[int, ...], type]]] = {}
        self._memory = aligned_zeros((0,), np.uint8)

    def need(self, phase: str, **arrays: tuple[tuple[int, ...], type]) -> None:
        """Arrays of a phase, name = (shape, type), into `tasks.arrays`; none other may be in use."""
        held = self._tasks.arrays
        if self._phases.get(phase) == arrays and all(held[name].shape == shape for name, (shape, _) in arrays.items()):
            return
        self._phases.pop(phase, None)
        self._phases[phase] = arrays  # the last: names that phases share are of the one that begins
        size = max(sum(map(_room_of, kinds.values())) for kinds in self._phases.values())
        if size > self._memory.nbytes:
            self._memory = aligned_zeros((size,), np.uint8)
        for kinds in self._phases.values():
            at = 0
            for name, (shape, kind) in kinds.items():
                end = at + math.prod(shape) * np.dtype(kind).itemsize
                self._tasks.set(**{name: self._memory[at:end].view(kind).reshape(shape)})
                at += _room_of((shape, kind))


def _room_of(array: tuple[tuple[int, ...], type]) -> int:
    """Bytes, in whole cache lines."""
    shape, kind = array
    return -(-math.prod(shape) * np.dtype(kind).itemsize // ALIGNMENT) * ALIGNMENT
