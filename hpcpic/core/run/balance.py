"""Slabs that follow the work as it moves: a model that is laid out anew takes up its own state, as after a restart.

No bit depends on the cuts, so all that they decide is time. New ones are made when what the old ones have cost beyond
them is as much as laying out anew: at most twice what is best with the future known (ski rental).
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.migrate import send_anywhere
from hpcpic.core.comm.tags import Channel, tag
from hpcpic.core.comm.world import World
from hpcpic.core.files.arrays import Shard
from hpcpic.core.space.domain import Domain, better_cuts, fullest
from hpcpic.core.timers import Timers

PERIOD = 100  # steps between two looks


class StateInMemory:
    """The state of a model, which its `restore` reads as it does a checkpoint. Reads are collective."""

    def __init__(self, world: World, step: int, time: float, shards: Mapping[str, Shard]) -> None:
        self.step, self.time, self._world, self._shards = step, time, world, shards

    def read(self, name: str, lo: int = 0, hi: int | None = None) -> NDArray:
        """Rows [lo, hi) of an array, whichever ranks have them: other rows on each rank."""
        world, shard = self._world, self._shards[name]
        rows = np.ascontiguousarray(shard.local)
        hi = shard.total if hi is None else hi
        asked = np.zeros((world.size, 2), np.int64)
        asked[world.rank] = lo, hi
        parts = np.clip(world.sum_int(asked) - shard.offset, 0, len(rows)).tolist()
        found = np.empty((hi - lo, *rows.shape[1:]), rows.dtype)
        row_bytes = rows.dtype.itemsize * math.prod(rows.shape[1:])
        if row_bytes:
            content = rows.reshape(-1).view(np.uint8).reshape(-1, row_bytes)
            outgoing = {rank: content[a:b] for rank, (a, b) in enumerate(parts) if b > a}
            arrived = send_anywhere(world, outgoing, row_bytes, tag(self.step, Channel.RECUT))
            np.concatenate([*arrived, content[:0]], out=found.reshape(-1).view(np.uint8).reshape(-1, row_bytes))
        return found


class Movable(Protocol):
    """A model that can be laid out on other cuts. ns: of one core, by the rates of the forecast."""

    domain: Domain
    timers: Timers

    @property
    def iteration(self) -> int: ...
    @property
    def time(self) -> float: ...
    def row_costs(self) -> NDArray[np.float64] | None: ...  # ns of a step [rows]; None: the cuts are good as they are
    def laying_out(self) -> float: ...  # ns that new cuts take
    def lay_out(self, cuts: Sequence[int]) -> None: ...  # on these cuts, without a state
    def state(self) -> Mapping[str, Shard]: ...
    def close(self) -> None: ...


class Balance:
    """Cuts of a model that follow its work.

    restore: puts back a state into the model that has been laid out anew.
    """

    def __init__(self, world: World, model: Movable, restore: Callable[[StateInMemory], None]) -> None:
        self._world, self._model, self._restore = world, model, restore
        self._lost = 0.0  # ns, since the last cuts

    def follow(self) -> None:
        """Collective, after a step: other cuts if these have lost as much as they would take."""
        if self._world.size > 1 and self._model.iteration % PERIOD == 0:
            self.look(PERIOD)

    def look(self, steps: float = math.inf) -> None:
        """Collective: other cuts if these have lost as much as they would take, after so many steps since the last
        look. By default as many as it takes: after a restart.
        """
        model = self._model
        costs = model.row_costs()
        if costs is None:
            return
        cuts = better_cuts(costs, model.domain.cuts, minimum=1)
        if cuts:
            self._lost += steps * (fullest(costs, model.domain.cuts) - fullest(costs, cuts))
            if self._lost > model.laying_out():
                self.move(cuts)

    def move(self, cuts: Sequence[int]) -> None:
        """Collective: the state of the model on these cuts."""
        model, self._lost = self._model, 0.0
        with model.timers.section("balance"):
            state = StateInMemory(self._world, model.iteration, model.time, model.state())
            model.close()
            model.lay_out(cuts)
            self._restore(state)
