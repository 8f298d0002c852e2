"""HDF5 files laid out in memory, whose raw data the ranks write themselves.

On a full disk HDF5 dies of a signal (chunked data) or loses values without a word (contiguous data). So it
never meets the disk when we write: it works on an Image, the structure of the file; the space is allocated
first, which is where a full disk shows, cleanly; every rank writes its rows at the addresses HDF5 has chosen;
the structure is changed last, and while it changes a journal behind the end of the file holds the changes.
The result is one ordinary HDF5 file. A process killed at any moment leaves the old contents readable, and
`settle` makes of it a file that can grow again: as before the change, or as after it.
"""

import hashlib
import json
import math
import os
import struct
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.files.arrays import Shard
from hpcpic.core.files.safe_hdf5 import import_h5py
from hpcpic.core.files.together import Alone, together

if TYPE_CHECKING:
    import h5py

    from hpcpic.core.comm.world import World

LIBVER = ("v110", "v110")  # extensible arrays: an appended chunk moves no entry of an older one
ALIGN = 4096
ALIGN_FROM = 65536
JOURNAL_END = struct.Struct("<8sQ16s")  # mark, bytes of the journal with this, digest of what is before
JOURNAL_MARK = b"hpcjourn"
REGION = struct.Struct("<QQ")  # address, bytes; they follow


class Image:
    """A file as HDF5 sees it: what is on disk (nothing for a new file) under the writes made since.

    Has the methods of a binary file that h5py asks for.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._disk = open(path, "rb") if path else None  # noqa: SIM115 - until close()
        self.old_size = self.size = os.fstat(self._disk.fileno()).st_size if self._disk else 0
        self._at = 0
        self._writes: list[tuple[int, bytes]] = []

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._at = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self.size}[whence]
        return self._at

    def tell(self) -> int:
        return self._at

    def readinto(self, buffer: Any) -> int:
        view = memoryview(buffer).cast("B")
        low, high = self._at, self._at + len(view)
        content = os.pread(self._disk.fileno(), len(view), low) if self._disk else b""
        view[:] = content.ljust(len(view), b"\0")
        for start, piece in self._writes:
            first, last = max(start, low), min(start + len(piece), high)
            if first < last:
                view[first - low : last - low] = piece[first - start : last - start]
        self._at = high
        return len(view)

    def read(self, count: int) -> bytes:
        buffer = bytearray(count)
        self.readinto(buffer)
        return bytes(buffer)

    def write(self, content: Any) -> int:
        piece = bytes(content)
        self._writes.append((self._at, piece))
        self._at += len(piece)
        self.size = max(self.size, self._at)
        return len(piece)

    def truncate(self, size: int | None = None) -> int:
        self.size = self._at if size is None else size
        return self.size

    def flush(self) -> None:
        """Nothing: what was written stays here until it is stored."""

    def close(self) -> None:
        if self._disk:
            self._disk.close()

    def reserve(self, descriptor: int) -> None:
        """Take all space that is needed, and write what lies behind the old end. Raises OSError."""
        os.posix_fallocate(descriptor, 0, self.size + len(self._journal()))
        for start, content in self._regions():
            cut = min(max(self.old_size - start, 0), len(content))
            write_all(descriptor, content[cut:], start + cut)

    def commit(self, descriptor: int) -> None:
        """Write what lies before the old end, all of it: see `settle`. Raises OSError."""
        write_all(descriptor, self._journal(), self.size)
        for start, content in self._changed():
            write_all(descriptor, content, start)
        os.ftruncate(descriptor, self.size)

    def _changed(self) -> list[tuple[int, bytearray]]:
        """The regions before the old end."""
        cut = ((start, content[: max(0, self.old_size - start)]) for start, content in self._regions())
        return [(start, content) for start, content in cut if content]

    def _journal(self) -> bytes:
        regions = self._changed()
        text = b"".join(REGION.pack(start, len(content)) + content for start, content in regions)
        return text + JOURNAL_END.pack(JOURNAL_MARK, len(text) + JOURNAL_END.size, _digest(text))

    def _regions(self) -> list[tuple[int, bytearray]]:
        """Disjoint regions in ascending order, so that the superblock comes first."""
        regions: list[tuple[int, bytearray]] = []
        for start, piece in sorted(self._writes, key=lambda write: write[0]):
            if regions and start <= regions[-1][0] + len(regions[-1][1]):
                low, content = regions[-1]
                content.extend(bytes(max(0, start + len(piece) - low - len(content))))
            else:
                regions.append((start, bytearray(len(piece))))
        for start, piece in self._writes:  # in the order they were made
            low, content = next(region for region in reversed(regions) if region[0] <= start)
            content[start - low : start - low + len(piece)] = piece
        return regions


@dataclass(frozen=True, slots=True)
class Slot:
    """The place in the file of a stretch of rows of one data set.

    Row r of the stretch is row first + r of the data set; `addresses` are those of the chunk that holds row
    `first` and of the following ones, each of `chunk_rows` rows. A contiguous data set is one chunk.
    """

    first: int
    row_bytes: int
    chunk_rows: int
    addresses: tuple[int, ...]

    def pieces(self, low: int, high: int) -> Iterator[tuple[int, int, int]]:
        """(address, low, high): the rows [low, high) of the stretch, cut where the file is not contiguous."""
        base = self.first // self.chunk_rows
        while low < high:
            chunk, inside = divmod(self.first + low, self.chunk_rows)
            end = min(high, low + self.chunk_rows - inside)
            yield self.addresses[chunk - base] + inside * self.row_bytes, low, end
            low = end


@contextmanager
def structure(image: Image, mode: str) -> Iterator["h5py.File"]:
    """The HDF5 structure of an image; mode "w" or "r+"."""
    h5py = import_h5py()
    with h5py.File(
        image, mode, libver=LIBVER, alignment_threshold=ALIGN_FROM, alignment_interval=ALIGN, rdcc_nbytes=0
    ) as file:
        yield file


def contiguous(group: "h5py.Group", name: str, shape: tuple[int, ...], dtype: Any) -> Slot:
    """A data set of fixed shape whose values the ranks write."""
    dataset = _create(group, name, shape, shape, None, np.dtype(dtype))
    row_bytes = math.prod(shape[1:]) * np.dtype(dtype).itemsize
    return Slot(0, row_bytes, max(1, shape[0]), (dataset.id.get_offset() or 0,))


def growing(
    group: "h5py.Group", name: str, row_shape: tuple[int, ...], dtype: Any, chunk: tuple[int, ...]
) -> "h5py.Dataset":
    """A data set [0, *row_shape] that grows along its first axis."""
    return _create(group, name, (0, *row_shape), (None, *row_shape), chunk, np.dtype(dtype))


def _create(group: Any, name: str, shape: tuple, limit: tuple, chunk: tuple | None, dtype: np.dtype) -> Any:
    h5py = import_h5py()
    plan = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    if chunk:
        plan.set_chunk(chunk)
    plan.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)  # addresses exist before the data
    plan.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
    plan.set_obj_track_times(False)  # the same data give the same bytes
    space = h5py.h5s.create_simple(shape, tuple(h5py.h5s.UNLIMITED if n is None else n for n in limit))
    where = subgroup(group, name.rpartition("/")[0])
    kind = h5py.h5t.py_create(dtype, logical=True)
    return h5py.Dataset(h5py.h5d.create(where.id, name.rpartition("/")[2].encode(), kind, space, dcpl=plan))


def subgroup(group: "h5py.Group", path: str) -> "h5py.Group":
    """The group at a path, made part by part: HDF5 puts the time into groups that it makes itself."""
    for part in filter(None, path.split("/")):
        group = group.require_group(part)
    return group


def extend(dataset: "h5py.Dataset", rows: int) -> None:
    """Let the data set have at least so many rows."""
    if len(dataset) < rows:
        dataset.resize(rows, axis=0)


def rows_slot(dataset: "h5py.Dataset", first: int, rows: int) -> Slot:
    """The slot of rows [first, first + rows), which are made to exist; chunks cut the first axis."""
    extend(dataset, first + rows)
    chunk_rows = dataset.chunks[0]
    rest = (0,) * (dataset.ndim - 1)
    numbers = range(first // chunk_rows, -(-(first + rows) // chunk_rows))
    row_bytes = math.prod(dataset.shape[1:]) * dataset.dtype.itemsize
    return Slot(first, row_bytes, chunk_rows, _addresses(dataset, [(k * chunk_rows, *rest) for k in numbers]))


def layer_slots(dataset: "h5py.Dataset", first: int, count: int, axis: int) -> list[Slot]:
    """Slots of dataset[first], dataset[first + 1], ...: a chunk has all of one, or rows along `axis` (0: one row)."""
    extend(dataset, first + count)
    shape, layers, size = dataset.shape, dataset.chunks[0], dataset.dtype.itemsize
    rows, chunk_rows = (shape[axis], dataset.chunks[axis]) if axis else (1, 1)
    row_bytes, layer_bytes = math.prod(shape[axis + 1 :]) * size, math.prod(shape[1:]) * size
    rest, chunks, slots = (0,) * (len(shape) - 1 - axis), {}, []
    for layer in range(first, first + count):
        corner = layer - layer % layers
        if corner not in chunks:
            starts = [(corner, row) if axis else (corner,) for row in range(0, rows, chunk_rows)]
            chunks[corner] = _addresses(dataset, [(*start, *rest) for start in starts])
        shift = layer % layers * layer_bytes
        slots.append(Slot(0, row_bytes, chunk_rows, tuple(address + shift for address in chunks[corner])))
    return slots


def _addresses(dataset: "h5py.Dataset", corners: list[tuple[int, ...]]) -> tuple[int, ...]:
    return tuple(dataset.id.get_chunk_info_by_coord(corner).byte_offset for corner in corners)


def share_slots(world: "World | Alone", slots: Mapping[str, Slot] | None) -> dict[str, Slot]:
    """The slots of rank 0, on all ranks."""
    numbers = {name: (s.first, s.row_bytes, s.chunk_rows, s.addresses) for name, s in (slots or {}).items()}
    described = json.loads(world.bcast(json.dumps(numbers).encode()))
    return {name: Slot(first, row, rows, tuple(at)) for name, (first, row, rows, at) in described.items()}


def create(path: Path, build: Callable[["h5py.File"], Mapping[str, Slot]]) -> dict[str, Slot]:
    """Lay out a new file (one rank) and allocate its space. Raises OSError; nothing is left then."""
    image = Image()
    with structure(image, "w") as file:
        slots = dict(build(file))
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)
    try:
        image.reserve(descriptor)
        os.ftruncate(descriptor, image.size)
    except BaseException:
        path.unlink()
        raise
    finally:
        os.close(descriptor)
    return slots


def append(
    world: "World | Alone",
    path: Path,
    grow: Callable[["h5py.File"], Mapping[str, Slot]],
    shards: Mapping[str, Shard],
    announce: Callable[["h5py.File"], None],
) -> None:
    """Add data to a file, all ranks together: either everything is there afterwards, or the file is as
    before.

    `grow` (rank 0) makes room and says where each shard goes; `announce` (rank 0) then changes what makes
    readers look at the new data. Raises FileError on all ranks.
    """
    image: Image | None = None
    slots: dict[str, Slot] | None = None
    try:
        with together(world, f"cannot append to {path}"):
            if world.rank == 0:
                image = Image(path)
                with structure(image, "r+") as file:
                    slots = dict(grow(file))
                with _descriptor(path) as descriptor:
                    image.reserve(descriptor)
        slots = share_slots(world, slots)
        with together(world, f"cannot append to {path}"):
            write_shards(path, slots, shards)
    except Exception:
        if image is not None:
            with suppress(OSError):  # what was moved away is told by the error that is on its way
                os.truncate(path, image.old_size)
        raise
    finally:
        if image is not None:
            image.close()
    with together(world, f"cannot append to {path}"):
        if image is not None:
            with _descriptor(path) as descriptor:
                image.commit(descriptor)
            change(path, announce)


def change(path: Path, edit: Callable[["h5py.File"], None]) -> None:
    """Edit a file through HDF5 on one rank: first what is new at its end, then what changes in place.

    Raises OSError; the file is then as before.
    """
    image = Image(path)
    try:
        with structure(image, "r+") as file:
            edit(file)
        with _descriptor(path) as descriptor:
            try:
                image.reserve(descriptor)
            except OSError:
                os.ftruncate(descriptor, image.old_size)
                raise
            image.commit(descriptor)
    finally:
        image.close()


def settle(path: Path) -> None:
    """End what a killed writer began: changes whose journal is complete are made, else all is as before them."""
    with open(path, "r+b") as file:
        size = file.seek(0, os.SEEK_END)
        start, journal = _journal_of(file, size)
        at = 0
        while at < len(journal):
            address, length = REGION.unpack_from(journal, at)
            at += REGION.size + length
            write_all(file.fileno(), journal[at - length : at], address)
        file.truncate(start if journal else _end(file, size))


def _journal_of(file: BinaryIO, size: int) -> tuple[int, bytes]:
    """Start of the journal at the end of a file, and its regions; none when there is no complete one."""
    file.seek(max(0, size - JOURNAL_END.size))
    end = file.read()
    if len(end) == JOURNAL_END.size and end.startswith(JOURNAL_MARK):
        _, length, digest = JOURNAL_END.unpack(end)
        file.seek(max(0, size - length))
        text = file.read(max(0, length - JOURNAL_END.size))
        if _digest(text) == digest:
            return size - length, text
    return size, b""


def _digest(text: bytes) -> bytes:
    return hashlib.blake2b(text, digest_size=16).digest()


def _end(file: BinaryIO, size: int) -> int:
    """The end of the file that its superblock (version 2, 3; byte 28) tells, or its size when it tells none."""
    file.seek(0)
    head = file.read(36)
    if head[:8] == b"\x89HDF\r\n\x1a\n" and head[8] in (2, 3):
        (end,) = struct.unpack_from("<Q", head, 28)
        if 0 < end < size:
            return int(end)
    return size


def write_shards(path: Path, slots: Mapping[str, Slot], shards: Mapping[str, Shard]) -> None:
    """Write this rank's rows at their addresses. Raises OSError."""
    with _descriptor(path) as descriptor:
        for name, shard in shards.items():
            for address, content in parts(slots[name], shard):
                write_all(descriptor, content, address)


def parts(slot: Slot, shard: Shard) -> Iterator[tuple[int, memoryview]]:
    """(address, bytes) of a shard."""
    content = as_bytes(shard.local)
    for address, low, high in slot.pieces(shard.offset, shard.offset + len(shard.local)):
        first = (low - shard.offset) * slot.row_bytes
        yield address, content[first : first + (high - low) * slot.row_bytes]


def as_bytes(array: NDArray) -> memoryview:
    """The bytes of an array in C order."""
    return np.ascontiguousarray(array).reshape(-1).view(np.uint8).data


def write_all(descriptor: int, content: Any, address: int) -> None:
    """pwrite until all is written. Raises OSError."""
    view = memoryview(content)
    while len(view):
        written = os.pwrite(descriptor, view, address)
        view, address = view[written:], address + written


@contextmanager
def _descriptor(path: Path) -> Iterator[int]:
    descriptor = os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        yield descriptor
    finally:
        os.close(descriptor)
