"""Memory that phases share: each finds its own arrays, whatever the others have grown to."""

import numpy as np
import pytest

from sph.particles.workspace import Workspace


class Tasks:
    def __init__(self):
        self.arrays = {}

    def set(self, **arrays):
        self.arrays |= arrays


@pytest.mark.parametrize("sizes", [(10, 100), (100, 10), (7, 7)])
def test_a_phase_has_the_arrays_it_asked_for(sizes):
    tasks = Tasks()
    workspace = Workspace(tasks)
    for _ in range(2):  # one phase may have grown since the other had its turn
        for n, phase, kind in ((sizes[0], "numbers", np.float64), (sizes[1], "words", np.int32)):
            workspace.need(phase, order=((n,), np.int32), **{phase: ((n,), kind)})
            assert tasks.arrays["order"].shape == tasks.arrays[phase].shape == (n,)
            assert not np.shares_memory(tasks.arrays["order"], tasks.arrays[phase])
            tasks.arrays["order"][:] = np.arange(n)
            tasks.arrays[phase][:] = 1
            assert (tasks.arrays["order"] == np.arange(n)).all()
