"""Accelerations of the user's own on grains: found anew in each substep, as forces of contacts are."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.tasks.arena import Arena
from hpcpic.core.tasks.graph import Bound
from lbmdem.grains.grains import Grains
from lbmdem.kernels.driven import driven, substep_kernel

Own = tuple[Callable, NDArray[np.bool_]]  # a compiled acceleration, and which grains have it, by number


class OwnAccelerations:
    """Those of a scene; no grain has two."""

    def __init__(self, own: Sequence[Own], arena: Arena, grains: Grains) -> None:
        self._own, self._grains, parts = own, grains, arena.sizes["parts"]
        self._clocks = np.zeros((len(own), parts, 2))
        kernels = [substep_kernel(acceleration, k + 1, grains.dimensions) for k, (acceleration, _) in enumerate(own)]
        self.tasks: list[Bound] = [
            arena.bind(kernel, parts, clock=clock) for kernel, clock in zip(kernels, self._clocks)
        ]

    def start(self, force: NDArray | None, time: float) -> NDArray[np.float64]:
        """The forces [n, d] on own grains at a time (s), before substeps from then on: those given, and mass x these
        accelerations. Collective.
        """
        grains, n, d = self._grains, self._grains.n, self._grains.dimensions
        own = grains.columns["own"]
        own[:] = 0.0
        for k, (acceleration, chosen) in enumerate(self._own):
            rows = np.flatnonzero(chosen[grains.ids[:n]])
            own[rows, :d], own[rows, 3] = driven(acceleration, grains.x[rows], grains.v[rows], time), k + 1
        grains.share("own")
        self._clocks[:] = time, 0.0
        given = 0.0 if force is None else force
        return np.asarray(given + grains.mass[:n, None] * own[:n, :d])
