"""The format of a checkpoint: plain HDF5 with contiguous data sets, sealed by a manifest behind its end.

    HDF5 | manifest (JSON) | magic (16 bytes) | length of the manifest (8) | BLAKE2b of the manifest (32)

The manifest holds names, shapes, types and places of the data sets and the BLAKE2b of every CHUNK of them and
of all the bytes between them, so a single flipped bit anywhere is found, by any number of ranks together. It
is in the same file because one rename then makes the whole checkpoint appear.
"""

import hashlib
import json
import math
import os
import struct
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.errors import FileError
from hpcpic.core.files import image
from hpcpic.core.files.image import Slot
from hpcpic.version import __version__

SCHEMA = 1
MAGIC = b"hpcpic-manifest\n"
FOOTER = struct.Struct("<16sQ32s")
CHUNK = 4 << 20
DIGEST = 16
STRUCTURE = "the structure of the file"


@dataclass(frozen=True, slots=True)
class Array:
    """One data set: its shape, its type, and the address of its first byte."""

    shape: tuple[int, ...]
    dtype: np.dtype
    address: int

    @property
    def row_bytes(self) -> int:
        return math.prod(self.shape[1:]) * self.dtype.itemsize

    @property
    def slot(self) -> Slot:
        return Slot(0, self.row_bytes, max(1, self.shape[0]), (self.address,))

    @property
    def size(self) -> int:
        return self.shape[0] * self.row_bytes

    @property
    def n_chunks(self) -> int:
        return -(-self.size // CHUNK)


def describe(arrays: Mapping[str, Array]) -> dict[str, Any]:
    return {name: {"shape": a.shape, "dtype": a.dtype.str, "address": a.address} for name, a in arrays.items()}


def arrays_of(described: Mapping[str, Any]) -> dict[str, Array]:
    """Back from JSON. Raises ValueError, KeyError or TypeError when it is not what `describe` makes."""
    arrays = {}
    for name, entry in described.items():
        array = Array(tuple(map(int, entry["shape"])), np.dtype(str(entry["dtype"])), int(entry["address"]))
        if array.dtype.kind not in "iufcb" or not array.shape or min(*array.shape, array.address) < 0:
            raise ValueError(f"{name}: not an array of plain numbers")
        arrays[name] = array
    return arrays


def hash_own(path: Path, arrays: Mapping[str, Array], end: int, rank: int, ranks: int) -> NDArray[np.uint8]:
    """[1 + chunks, DIGEST]: BLAKE2b of what is between the arrays, then of their chunks; 0: others' turn."""
    hashes = np.zeros((1 + sum(array.n_chunks for array in arrays.values()), DIGEST), np.uint8)
    with open(path, "rb") as file:
        if rank == 0:
            hashes[0] = _digest_of(file.fileno(), _gaps(arrays, end))
        for k, (low, high) in enumerate(_chunks(arrays), start=1):
            if k % ranks == rank:
                hashes[k] = _digest_of(file.fileno(), [(low, high)])
    return hashes


def _chunks(arrays: Mapping[str, Array]) -> Iterator[tuple[int, int]]:
    for array in arrays.values():
        for start in range(0, array.size, CHUNK):
            yield array.address + start, array.address + min(start + CHUNK, array.size)


def _gaps(arrays: Mapping[str, Array], end: int) -> Iterator[tuple[int, int]]:
    """The stretches of [0, end) outside the arrays."""
    at = 0
    for array in sorted((array for array in arrays.values() if array.size), key=lambda array: array.address):
        yield at, array.address
        at = array.address + array.size
    yield at, end


def _digest_of(descriptor: int, stretches: Iterable[tuple[int, int]]) -> NDArray[np.uint8]:
    state = hashlib.blake2b(digest_size=DIGEST)
    for low, high in stretches:
        for start in range(low, high, CHUNK):
            state.update(os.pread(descriptor, min(CHUNK, high - start), start))
    return np.frombuffer(state.digest(), np.uint8)


def seal(path: Path, arrays: Mapping[str, Array], facts: Mapping[str, Any], hashes: NDArray[np.uint8]) -> None:
    """Append the manifest and bring the file to the disk. Raises OSError."""
    manifest = {
        "schema": SCHEMA,
        "version": __version__,
        **facts,
        "size": os.path.getsize(path),
        "arrays": describe(arrays),
        "chunk": CHUNK,
        "blake2b": hashes.tobytes().hex(),
    }
    text = json.dumps(manifest).encode()
    footer = FOOTER.pack(MAGIC, len(text), _blake2b(text))
    with open(path, "ab") as file:
        file.write(text + footer)
        file.flush()
        os.fsync(file.fileno())


def _blake2b(text: bytes) -> bytes:
    return hashlib.blake2b(text, digest_size=32).digest()


class Reader:
    """A checkpoint whose manifest is sound; `newest` hands out only those whose every byte is verified.

    `step`, `time`, `attributes`, `version`, `names` (in the order they were written).
    """

    def __init__(self, path: Path) -> None:
        """Raises FileError when it is cut off, damaged or of a newer program."""
        self.path = path
        manifest = manifest_of(path)
        try:
            if manifest["schema"] != SCHEMA:
                raise FileError(
                    f"{path}: written by version {manifest['version']} in format {manifest['schema']}; "
                    f"this is version {__version__}, which reads format {SCHEMA}"
                )
            self._arrays = arrays_of(manifest["arrays"])
            self._end = int(manifest["size"])
            self._hashes = np.frombuffer(bytes.fromhex(manifest["blake2b"]), np.uint8).reshape(-1, DIGEST)
            self.step = int(manifest["step"])
            self.time = float.fromhex(manifest["time_hex"])
            self.attributes: dict[str, Any] = dict(manifest["attributes"])
            self.version = str(manifest["version"])
            if self.step < 0 or not math.isfinite(self.time):
                raise ValueError(f"step {self.step}, time {self.time}")
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise FileError(f"{path}: the manifest is not one of ours ({error})") from error
        if any(array.address + array.size > self._end for array in self._arrays.values()):
            raise FileError(f"{path}: an array reaches beyond the end of the file")
        if len(self._hashes) != 1 + sum(array.n_chunks for array in self._arrays.values()):
            raise FileError(f"{path}: the manifest has another number of checksums than the arrays have chunks")

    @property
    def names(self) -> list[str]:
        return list(self._arrays)

    def total(self, name: str) -> int:
        """Rows of an array."""
        return self._array(name).shape[0]

    def shape(self, name: str) -> tuple[int, ...]:
        return self._array(name).shape

    def dtype(self, name: str) -> np.dtype:
        return self._array(name).dtype

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

    def _array(self, name: str) -> Array:
        if name not in self._arrays:
            raise FileError(f"{self.path}: no array {name}; there are {', '.join(self._arrays)}")
        return self._arrays[name]

    def faults(self, rank: int = 0, ranks: int = 1) -> NDArray[np.bool_]:
        """Which of the checksums that are this rank's turn differ."""
        own = hash_own(self.path, self._arrays, self._end, rank, ranks)
        wrong = (own != self._hashes).any(axis=1)
        turn = np.arange(len(own)) % ranks == rank
        return wrong & turn

    def names_of(self, faults: NDArray[np.bool_]) -> list[str]:
        """The arrays that the checksums at these places are of."""
        owners = [STRUCTURE] + [name for name, array in self._arrays.items() for _ in range(array.n_chunks)]
        return list(dict.fromkeys(owners[k] for k in np.flatnonzero(faults)))


def manifest_of(path: Path) -> dict[str, Any]:
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
    if _blake2b(text) != expected:
        raise FileError(f"{path}: damaged (checksum of the manifest)")
    try:
        manifest = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise FileError(f"{path}: the manifest is not one of ours") from error
    if not isinstance(manifest, dict) or manifest.get("size") != size - FOOTER.size - length:
        raise FileError(f"{path}: damaged (length)")
    return manifest
