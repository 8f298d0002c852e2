"""Rows keyed by id, from wherever they are to dense ranges of ids per rank: for checkpoints and digests."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.comm.migrate import send_anywhere
from hpcpic.core.comm.tags import Channel, tag
from hpcpic.core.comm.world import World
from hpcpic.core.errors import Diverged
from hpcpic.core.space.domain import block_ranges
from hpcpic.core.space.particles import pack_rows, record_type, unpack_rows


def by_id(
    world: World, ids: NDArray[np.int64], columns: Mapping[str, NDArray], total: int
) -> dict[str, NDArray]:
    """Collective: the columns in id order, of the ids block_ranges(total, ranks)[rank] on each rank.

    The ids 0 .. total - 1 must each be on one rank, once; else Diverged, on all ranks.
    """
    ranges = block_ranges(total, world.size)
    low, high = ranges[world.rank]
    rows = {"id": np.asarray(ids, np.int64), **columns}
    owner = np.searchsorted([end for _, end in ranges], rows["id"], side="right")
    known = (rows["id"] >= 0) & (rows["id"] < total)
    outgoing = {int(peer): pack_rows(rows, known & (owner == peer)) for peer in np.unique(owner[known])}
    layout = record_type(rows)
    arrived = send_anywhere(world, outgoing, layout.itemsize, tag(0, Channel.SHARDS))
    result = {
        name: np.empty((high - low, *column.shape[1:]), column.dtype) for name, column in columns.items()
    }
    times = np.zeros(high - low, np.int64)
    for records in arrived:
        received = unpack_rows(records, layout)
        at = received.pop("id") - low
        np.add.at(times, at, 1)
        for name, values in received.items():
            result[name][at] = values
    lost, doubled, strange = world.sum_int(np.array([(times == 0).sum(), (times > 1).sum(), (~known).sum()]))
    if lost or doubled or strange:
        raise Diverged(
            f"of the ids below {total}, {lost} are lost and {doubled} doubled; {strange} are no ids"
        )
    return result
