"""Checkpoints: one logical file, independent of ranks, complete and verified, or absent.

checkpoints/NNNNNNNN.h5 is a plain HDF5 file with contiguous data sets, written by all ranks (see core.files.image), with a
manifest behind its end:

    HDF5 | manifest (JSON) | magic (16 bytes) | length of the manifest (8) | BLAKE2b of the manifest (32)

The manifest holds names, shapes, types and places of the data sets and the BLAKE2b of every CHUNK of them and of all the
bytes between them, so a single flipped bit anywhere is found, by any number of ranks together. It is in the same file
because one rename then makes the whole checkpoint appear.
"""

import contextlib
import hashlib
import json
import logging
import math
import os
import re
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

import hpcpic
from hpcpic.core.errors import FileError
from hpcpic.core.files import image
from hpcpic.core.files.arrays import Shard
from hpcpic.core.files.rundir import RunDir, temporary
from hpcpic.core.files.together import ALONE, Alone, together

if TYPE_CHECKING:
    import h5py

    from hpcpic.core.comm.world import World

__all__ = ["Reader", "Shard", "digest", "newest", "write"]

log = logging.getLogger(__name__)

SCHEMA = 1
MAGIC = b"hpcpic-manifest\n"
FOOTER = struct.Struct("<16sQ32s")
CHUNK = 4 << 20
BLOCK = 16 << 20
DIGEST = 16
KEPT = 2
NAME = re.compile(r"\d{8,}\.h5")
STRUCTURE = "the structure of the file"


@dataclass(frozen=True, slots=True)
class _Array:
    """One data set: its shape, its type, and the address of its first byte."""

    shape: tuple[int, ...]
    dtype: np.dtype
    address: int

    @property
    def row_bytes(self) -> int:
        return math.prod(self.shape[1:]) * self.dtype.itemsize

    @property
    def slot(self) -> image.Slot:
        return image.Slot(0, self.row_bytes, max(1, self.shape[0]), (self.address,))

    @property
    def size(self) -> int:
        return self.shape[0] * self.row_bytes

    @property
    def n_chunks(self) -> int:
        return -(-self.size // CHUNK)


def write(
    world: "World | Alone",
    rundir: RunDir,
    step: int,
    time: float,
    shards: Mapping[str, Shard],
    attributes: Mapping[str, Any] | None = None,
) -> Path:
    """Write the state at `step`, all ranks together; then keep the newest two.

    `attributes` are what JSON can hold. Raises FileError on all ranks (disk full, no permission, a read-back that
    differs); the temporary file is gone then and the older checkpoints are untouched.
    """
    final = rundir.checkpoints / f"{step:08d}.h5"
    made = temporary(final, world.bcast(str(os.getpid()).encode()).decode())
    doing = f"cannot write the checkpoint {final}"
    _layout(world, shards)
    facts = {
        "step": step,
        "time": float(time),
        "time_hex": float(time).hex(),
        "attributes": dict(attributes or {}),
    }
    try:
        arrays = _lay_out(world, made, shards, facts, doing)
        slots = {name: array.slot for name, array in arrays.items()}
        with together(world, doing):
            image.write_shards(made, slots, shards)
            _read_back(made, slots, shards)
            _sync(made)
        _seal(world, made, arrays, facts, doing)
        with together(world, doing):
            if world.rank == 0:
                os.replace(made, final)
                _sync(final.parent)
                _forget_old(rundir.checkpoints, step)
    except BaseException:
        if world.rank == 0:
            made.unlink(missing_ok=True)
        raise
    return final


def _layout(world: "World | Alone", shards: Mapping[str, Shard]) -> NDArray[np.int64]:
    """Per array the (offset, rows) of every rank [arrays, ranks, 2]; raises ValueError on all ranks unless they tile the whole."""
    places = np.zeros((len(shards), world.size, 2), np.int64)
    for k, shard in enumerate(shards.values()):
        places[k, world.rank] = shard.offset, len(shard.local)
    places = world.sum_int(places)
    for (name, shard), place in zip(shards.items(), places, strict=True):
        occupied = place[place[:, 1] > 0]
        occupied = occupied[np.argsort(occupied[:, 0])]
        ends = np.concatenate([[0], occupied.sum(axis=1)])
        starts = np.concatenate([occupied[:, 0], [shard.total]])
        if not np.array_equal(ends, starts):
            raise ValueError(
                f"{name}: the parts of the ranks do not cover rows 0..{shard.total} once: {place.tolist()}"
            )
    return places


def _lay_out(
    world: "World | Alone", made: Path, shards: Mapping[str, Shard], facts: Mapping[str, Any], doing: str
) -> dict[str, _Array]:
    """Make the file with room for every array; where they are, on all ranks."""
    arrays: dict[str, _Array] = {}

    def build(file: "h5py.File") -> dict[str, image.Slot]:
        file.attrs["step"], file.attrs["time"] = facts["step"], facts["time"]
        file.attrs["schema"], file.attrs["version"] = SCHEMA, hpcpic.__version__
        slots = {}
        for name, shard in shards.items():
            shape = (shard.total, *shard.local.shape[1:])
            slots[name] = image.contiguous(file, name, shape, shard.local.dtype)
            arrays[name] = _Array(shape, shard.local.dtype, slots[name].addresses[0])
        return slots

    with together(world, doing):
        if world.rank == 0:
            made.parent.mkdir(exist_ok=True)
            _sweep(made.parent)
            image.create(made, build)
    return _arrays(json.loads(world.bcast(json.dumps(_described(arrays)).encode())))


def _described(arrays: Mapping[str, _Array]) -> dict[str, Any]:
    return {
        name: {"shape": a.shape, "dtype": a.dtype.str, "address": a.address} for name, a in arrays.items()
    }


def _arrays(described: Mapping[str, Any]) -> dict[str, _Array]:
    """Back from JSON. Raises ValueError, KeyError or TypeError when it is not what `_described` makes."""
    arrays = {}
    for name, entry in described.items():
        array = _Array(tuple(map(int, entry["shape"])), np.dtype(str(entry["dtype"])), int(entry["address"]))
        if array.dtype.kind not in "iufcb" or not array.shape or min(*array.shape, array.address) < 0:
            raise ValueError(f"{name}: not an array of plain numbers")
        arrays[name] = array
    return arrays


def _read_back(made: Path, slots: Mapping[str, image.Slot], shards: Mapping[str, Shard]) -> None:
    """Compare this rank's part of the file with the memory it came from. Raises FileError."""
    with open(made, "rb") as file:
        for name, shard in shards.items():
            for address, content in image.parts(slots[name], shard):
                for start in range(0, len(content), CHUNK):
                    expected = content[start : start + CHUNK]
                    if os.pread(file.fileno(), len(expected), address + start) != expected:
                        raise FileError(f"{name} reads back differently from what was written")


def _seal(
    world: "World | Alone", made: Path, arrays: Mapping[str, _Array], facts: Mapping[str, Any], doing: str
) -> None:
    """Append the manifest; the file is on the disk afterwards."""
    with together(world, doing):
        end = os.path.getsize(made)
        own = _hash_own(made, arrays, end, world.rank, world.size)
    hashes = world.sum_int(own.view(np.int64)).view(np.uint8)
    manifest = {
        "schema": SCHEMA,
        "version": hpcpic.__version__,
        **facts,
        "size": end,
        "arrays": _described(arrays),
        "chunk": CHUNK,
        "blake2b": hashes.tobytes().hex(),
    }
    with together(world, doing):
        if world.rank == 0:
            text = json.dumps(manifest).encode()
            footer = FOOTER.pack(MAGIC, len(text), hashlib.blake2b(text, digest_size=32).digest())
            with open(made, "ab") as file:
                file.write(text + footer)
                file.flush()
                os.fsync(file.fileno())


def _hash_own(path: Path, arrays: Mapping[str, _Array], end: int, rank: int, ranks: int) -> NDArray[np.uint8]:
    """[1 + chunks, DIGEST]: BLAKE2b of the bytes outside the arrays, then of their chunks; zero where another rank's turn."""
    hashes = np.zeros((1 + sum(array.n_chunks for array in arrays.values()), DIGEST), np.uint8)
    with open(path, "rb") as file:
        if rank == 0:
            hashes[0] = _digest_of(file.fileno(), _gaps(arrays, end))
        for k, (low, high) in enumerate(_chunks(arrays), start=1):
            if k % ranks == rank:
                hashes[k] = _digest_of(file.fileno(), [(low, high)])
    return hashes


def _chunks(arrays: Mapping[str, _Array]) -> Iterator[tuple[int, int]]:
    for array in arrays.values():
        for start in range(0, array.size, CHUNK):
            yield array.address + start, array.address + min(start + CHUNK, array.size)


def _gaps(arrays: Mapping[str, _Array], end: int) -> Iterator[tuple[int, int]]:
    """The stretches of [0, end) outside the arrays."""
    at = 0
    for array in sorted((array for array in arrays.values() if array.size), key=lambda array: array.address):
        yield at, array.address
        at = array.address + array.size
    yield at, end


def _digest_of(descriptor: int, stretches: Any) -> NDArray[np.uint8]:
    state = hashlib.blake2b(digest_size=DIGEST)
    for low, high in stretches:
        for start in range(low, high, CHUNK):
            state.update(os.pread(descriptor, min(CHUNK, high - start), start))
    return np.frombuffer(state.digest(), np.uint8)


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _found(folder: Path) -> list[Path]:
    """Checkpoints, newest first."""
    if not folder.is_dir():
        return []
    files = [path for path in folder.iterdir() if NAME.fullmatch(path.name)]
    return sorted(files, key=lambda path: int(path.stem), reverse=True)


def _sweep(folder: Path) -> None:
    """Remove what killed writers left; whoever writes here holds the lock of the run."""
    for path in folder.glob("*.tmp"):
        path.unlink(missing_ok=True)


def _forget_old(folder: Path, step: int) -> None:
    """Keep the newest two up to `step`; later ones belong to a future that a restart has replaced."""
    past = [path for path in _found(folder) if int(path.stem) <= step]
    for path in _found(folder):
        if path not in past[:KEPT]:
            with contextlib.suppress(OSError):  # an old checkpoint too many does no harm
                path.unlink()


class Reader:
    """A checkpoint whose manifest is sound; `newest` hands out only those whose every byte is verified.

    `step`, `time`, `attributes`, `version`, `names` (in the order they were written).
    """

    def __init__(self, path: Path) -> None:
        """Raises FileError when it is cut off, damaged or of a newer program."""
        self.path = path
        manifest = _manifest(path)
        try:
            if manifest["schema"] != SCHEMA:
                raise FileError(
                    f"{path}: written by version {manifest['version']} in format {manifest['schema']}; "
                    f"this is version {hpcpic.__version__}, which reads format {SCHEMA}"
                )
            self._arrays = _arrays(manifest["arrays"])
            self._end = int(manifest["size"])
            self._hashes = np.frombuffer(bytes.fromhex(manifest["blake2b"]), np.uint8).reshape(-1, DIGEST)
            self.step = int(manifest["step"])
            self.time = float.fromhex(manifest["time_hex"])
            self.attributes: dict[str, Any] = dict(manifest["attributes"])
            self.version = str(manifest["version"])
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise FileError(f"{path}: the manifest is not one of ours ({error})") from error
        if any(array.address + array.size > self._end for array in self._arrays.values()):
            raise FileError(f"{path}: an array reaches beyond the end of the file")
        if len(self._hashes) != 1 + sum(array.n_chunks for array in self._arrays.values()):
            raise FileError(
                f"{path}: the manifest has another number of checksums than the arrays have chunks"
            )

    @property
    def names(self) -> list[str]:
        return list(self._arrays)

    def total(self, name: str) -> int:
        """Rows of an array."""
        return self._array(name).shape[0]

    def read(self, name: str, lo: int = 0, hi: int | None = None) -> NDArray:
        """Rows [lo, hi) of an array. Raises FileError."""
        array = self._array(name)
        hi = array.shape[0] if hi is None else hi
        if not 0 <= lo <= hi <= array.shape[0]:
            raise FileError(f"{self.path}: {name} has {array.shape[0]} rows, asked for {lo}..{hi}")
        rows = np.empty((hi - lo, *array.shape[1:]), array.dtype)
        target = image.as_bytes(rows)
        with open(self.path, "rb") as file:
            file.seek(array.address + lo * array.row_bytes)
            if file.readinto(target) != len(target):
                raise FileError(f"{self.path}: {name}: the file ends too early")
        return rows

    def _array(self, name: str) -> _Array:
        if name not in self._arrays:
            raise FileError(f"{self.path}: no array {name}; there are {', '.join(self._arrays)}")
        return self._arrays[name]

    def faults(self, rank: int = 0, ranks: int = 1) -> NDArray[np.bool_]:
        """Which of the checksums that are this rank's turn differ."""
        own = _hash_own(self.path, self._arrays, self._end, rank, ranks)
        wrong = (own != self._hashes).any(axis=1)
        turn = np.arange(len(own)) % ranks == rank
        return wrong & turn

    def names_of(self, faults: NDArray[np.bool_]) -> list[str]:
        """The arrays that the checksums at these places are of."""
        owners = [STRUCTURE] + [name for name, array in self._arrays.items() for _ in range(array.n_chunks)]
        return list(dict.fromkeys(owners[k] for k in np.flatnonzero(faults)))


def _manifest(path: Path) -> dict[str, Any]:
    try:
        with open(path, "rb") as file:
            size = os.fstat(file.fileno()).st_size
            if size < FOOTER.size:
                raise FileError(f"{path}: cut off, or not a checkpoint")
            magic, length, expected = FOOTER.unpack(os.pread(file.fileno(), FOOTER.size, size - FOOTER.size))
            if magic != MAGIC or length > size - FOOTER.size:
                raise FileError(f"{path}: cut off, or not a checkpoint")
            text = os.pread(file.fileno(), length, size - FOOTER.size - length)
    except OSError as error:
        raise FileError(f"{path}: {error.strerror}") from error
    if hashlib.blake2b(text, digest_size=32).digest() != expected:
        raise FileError(f"{path}: damaged (checksum of the manifest)")
    try:
        manifest = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise FileError(f"{path}: the manifest is not one of ours") from error
    if not isinstance(manifest, dict) or manifest.get("size") != size - FOOTER.size - length:
        raise FileError(f"{path}: damaged (length)")
    return manifest


def newest(rundir: RunDir, world: "World | Alone" = ALONE) -> Reader:
    """The newest checkpoint of which every byte is as written, with a warning for each newer one that is not.

    All ranks of `world` call it, share the verification and get the same one. Raises FileError listing the reasons
    when there is none.
    """
    listed = "\n".join(path.name for path in _found(rundir.checkpoints)) if world.rank == 0 else ""
    reasons = []
    for name in world.bcast(listed.encode()).decode().split():
        try:
            return _verified(rundir.checkpoints / name, world)
        except FileError as error:
            reasons.append(error.message)
            log.warning("checkpoint not used: %s", error.message)
    if not reasons:
        raise FileError(f"{rundir.path}: no checkpoint in {rundir.checkpoints}; start again with `run`")
    raise FileError(f"{rundir.path}: no checkpoint can be used:\n  " + "\n  ".join(reasons))


def _verified(path: Path, world: "World | Alone") -> Reader:
    with together(world):
        reader = Reader(path)
        wrong = reader.faults(world.rank, world.size)
    wrong = world.sum_int(wrong.astype(np.int64)) > 0
    if wrong.any():
        raise FileError(f"{path}: damaged: {', '.join(reader.names_of(wrong))}")
    return reader


def digest(world: "World | Alone", shards: Mapping[str, Shard]) -> str:
    """SHA-256 (hex) of the bytes of the arrays in dict order, each in global order; the same on all ranks.

    Streamed to rank 0 in blocks, so it needs no memory to speak of and does not depend on who holds what.
    """
    state = hashlib.sha256()
    for shard, place in zip(shards.values(), _layout(world, shards), strict=True):
        content = image.as_bytes(shard.local)
        row_bytes = math.prod(shard.local.shape[1:]) * shard.local.dtype.itemsize
        for low in range(0, shard.total * row_bytes, BLOCK):
            state.update(
                _block(world, content, place * row_bytes, low, min(low + BLOCK, shard.total * row_bytes))
            )
    return world.bcast(state.hexdigest().encode()).decode()


def _block(
    world: "World | Alone", content: memoryview, place: NDArray[np.int64], low: int, high: int
) -> memoryview | NDArray:
    """Bytes [low, high) of the whole on rank 0; `place` is (offset, length) in bytes of every rank."""
    if world.size == 1:
        return content[low:high]
    starts = np.clip(place[:, 0], low, high)
    ends = np.clip(place.sum(axis=1), low, high)
    counts = np.maximum(ends - starts, 0)
    own = np.frombuffer(content, np.uint8)
    first = starts[world.rank] - place[world.rank, 0]
    part = own[first : first + counts[world.rank]]
    whole = np.empty(high - low, np.uint8)
    target = [whole, (counts, starts - low)] if world.rank == 0 else None
    world.comm.Gatherv(part, target)
    return whole
