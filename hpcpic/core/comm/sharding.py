"""Rows keyed by id, from wherever they are to dense ranges of ids per rank: for checkpoints and digests."""

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import DTypeLike, NDArray

from hpcpic.core.comm.migrate import send_anywhere
from hpcpic.core.comm.tags import Channel, tag
from hpcpic.core.comm.world import World
from hpcpic.core.errors import Diverged
from hpcpic.core.simd.compile import njit
from hpcpic.core.space.domain import block_ranges

Chunk = tuple[NDArray, Mapping[str, NDArray]]  # ids[m], columns[m, ...]
Layout = Mapping[str, tuple[DTypeLike, Sequence[int]]]  # type and shape of a row


@njit
def mark(ids, low, total, seen):
    """Count each id in seen[id - low], up to 2; returns how many are not in 0 .. total - 1."""
    strange = 0
    for k in range(ids.size):
        at = np.int64(ids[k]) - low
        if 0 <= at < seen.size:
            seen[at] = 1 + (seen[at] > 0)
        strange += not 0 <= at + low < total
    return strange


@njit
def scatter(ids, low, rows, result):
    """result[id - low, w] = rows[k, w] for the ids that are there."""
    for k in range(ids.size):
        at = np.int64(ids[k]) - low
        if 0 <= at < result.shape[0]:
            for word in range(rows.shape[1]):
                result[at, word] = rows[k, word]


def by_id(world: World, chunks: Iterable[Chunk], layout: Layout, total: int) -> dict[str, NDArray]:
    """Collective: the columns in id order, of the ids block_ranges(total, ranks)[rank] on each rank.

    The ids 0 .. total - 1 must each be in one chunk of one rank, once; else Diverged, on all ranks. Memory
    beyond the result is a byte per row, and what a chunk takes.
    """
    ranges = block_ranges(total, world.size)
    low, high = ranges[world.rank]
    ends = np.array([end for _, end in ranges])
    result = {name: np.empty((high - low, *shape), dtype) for name, (dtype, shape) in layout.items()}
    seen, strange = np.zeros(high - low, np.uint8), 0
    types = np.dtype([("id", np.int64, ())] + [(name, *layout[name]) for name in layout])

    def take(ids: NDArray, columns: Mapping[str, NDArray]) -> int:
        found = mark(ids, low, total, seen)
        for name, values in columns.items():
            scatter(ids, low, _words(values), _words(result[name]))
        return found

    with world.first_on_node():
        take(np.zeros(0, np.int64), {name: column[:0] for name, column in result.items()})
    for ids, columns in _rounds(world, chunks, result):
        strange += take(ids, columns)
        if world.size > 1:
            outgoing = _outgoing(world, np.searchsorted(ends, ids, side="right"), {"id": ids, **columns})
            for records in send_anywhere(world, outgoing, types.itemsize, tag(0, Channel.SHARDS)):
                arrived = _unpacked(records, types)
                take(arrived.pop("id"), arrived)
    lost, doubled, strange = world.sum_int(np.array([(seen == 0).sum(), (seen > 1).sum(), strange]))
    if lost or doubled or strange:
        raise Diverged(f"of the ids below {total}, {lost} are lost and {doubled} doubled; {strange} are no ids")
    return result


def _rounds(world: World, chunks: Iterable[Chunk], like: Mapping[str, NDArray]) -> Iterator[Chunk]:
    """The chunks of this rank, and empty ones until no rank has any."""
    stream = iter(chunks)
    nothing = np.zeros(0, np.int64), {name: column[:0] for name, column in like.items()}
    while True:
        chunk = next(stream, None)
        if not world.any(chunk is not None):
            return
        ids, columns = chunk or nothing
        yield np.asarray(ids, np.int64), columns


def _words(rows: NDArray) -> NDArray:
    """Rows of any shape and type as [n, words of a row]."""
    word = min(rows.dtype.itemsize, 8)
    words = int(np.prod(rows.shape[1:], dtype=np.int64)) * (rows.dtype.itemsize // word)
    return np.ascontiguousarray(rows).reshape(-1).view(f"u{word}").reshape(len(rows), words)


def _outgoing(world: World, owners: NDArray, columns: Mapping[str, NDArray]) -> dict[int, NDArray[np.uint8]]:
    """By rank, its rows of all columns: one column after the other, the widest type first, so all aligned."""
    result = {}
    owners[owners == world.size] = world.rank  # no ids at all; `mark` says so
    for peer in np.unique(owners[owners != world.rank]):
        index = np.flatnonzero(owners == peer)
        blocks = [columns[name][index].reshape(-1).view(np.uint8) for name in _aligned(columns)]
        result[int(peer)] = np.concatenate(blocks).reshape(len(index), -1)
    return result


def _aligned(columns: Mapping[str, NDArray]) -> list[str]:
    return sorted(columns, key=lambda name: -columns[name].dtype.itemsize)


def _unpacked(records: NDArray[np.uint8], types: np.dtype) -> dict[str, NDArray]:
    content, n, start = records.reshape(-1), len(records), 0
    empty = {name: np.empty((0, *types[name].shape), types[name].base) for name in types.names or ()}
    result = {}
    for name in _aligned(empty):
        end = start + n * types[name].itemsize
        result[name] = content[start:end].view(empty[name].dtype).reshape(n, *types[name].shape)
        start = end
    return result
