"""Sums of integers on the nodes of a slab, to which the task blocks contribute: charge, and moments of a species."""

from collections.abc import Sequence

from hpcpic.core.comm.halo import Exchange, Fold
from hpcpic.core.comm.tags import Channel
from hpcpic.core.comm.world import World
from hpcpic.core.space.domain import Domain, block_ranges
from hpcpic.core.space.fields import Field
from hpcpic.core.tasks.arena import Arena
from hpcpic.core.tasks.graph import Bound, Graph, Pool
from hpcpic.plasma.kernels.mesh import collect
from hpcpic.plasma.particles.tiles import Patches


class SlabSums:
    """field.values[group, rows + ghosts, columns] (3D: planes + ghosts first) = sum of the patches of all blocks, with
    ghost rows added to the nodes that they stand for. Integers: the order of adding does not show.
    """

    def __init__(
        self, world: World, pool: Pool, domain: Domain, groups: int, ghosts: tuple[int, int], channel: Channel
    ) -> None:
        self.world, self.pool = world, pool
        around = (ghosts, *((ghosts,) if domain.ndim == 3 else ()), (0, 0))[: domain.ndim]
        self.field = Field(domain, world.rank, dtype="int64", leading=(groups,), ghosts=around)
        self.fold = Fold(world, domain, self.field, channel)

    def graph(self, patches: Patches, before: Sequence[list[Bound]] = (), after: Sequence[Bound] = ()) -> Graph:
        """Stages of tasks `before` that fill the patches, the sums, the messages, and tasks `after` that read them."""
        values, flat = self.field.values, self.field.domain.ndim == 1
        arena = Arena(())
        arena.set(
            ring=not flat,
            patches=patches.values,
            places=patches.places,
            parts_of_rows=values.reshape(len(values), 1 if flat else -1, values.shape[-1]),
        )
        rows = arena["parts_of_rows"].shape[1]
        with self.world.first_on_node():
            sums = [arena.bind(collect, first=a, last=b) for a, b in shares(rows, self.pool)]
            return around(self.fold, [*before, sums], after)


def around(exchange: Exchange, before: Sequence[list[Bound]], after: Sequence[Bound]) -> Graph:
    """Stages of tasks before an exchange of ghosts, the exchange, the tasks `after`."""
    graph = Graph()
    pieces: list[tuple[int, int]] = []
    for stage, tasks in enumerate(before):
        done, pieces = pieces, [(stage, k) for k in range(len(tasks))]
        for piece, bound in zip(pieces, tasks):
            graph.task(bound, ins=done, outs=[piece])
    exchange.add_to(graph, "ghosts", inner=pieces, ghosts=["ghosts"])
    for bound in after:
        graph.task(bound, ins=[*pieces, "ghosts"])
    return graph.freeze()


def shares(rows: int, pool: Pool) -> list[tuple[int, int]]:
    """Ranges of rows for the threads."""
    return [(a, b) for a, b in block_ranges(rows, pool.threads) if b > a]
