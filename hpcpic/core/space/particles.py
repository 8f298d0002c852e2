"""Particles as named columns, and as records of bytes for messages."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import DTypeLike, NDArray

Columns = dict[str, NDArray]


def record_type(columns: Mapping[str, NDArray]) -> np.dtype:
    """Packed structure of one row of all columns, in their order."""
    return np.dtype([(name, column.dtype, column.shape[1:]) for name, column in columns.items()])


def pack_rows(columns: Mapping[str, NDArray], index: NDArray | slice) -> NDArray[np.uint8]:
    """Rows `index` of all columns as records uint8[m, record bytes]."""
    layout = record_type(columns)
    chosen = {name: column[index] for name, column in columns.items()}
    records = np.empty(len(next(iter(chosen.values()))), layout)
    for name, values in chosen.items():
        records[name] = values
    return records.view(np.uint8).reshape(len(records), layout.itemsize)


def unpack_rows(records: NDArray[np.uint8], layout: np.dtype) -> Columns:
    """The columns in records uint8[m, record bytes], as views of them."""
    rows = np.ascontiguousarray(records).reshape(-1).view(layout)
    return {name: rows[name] for name in layout.names or ()}


class Particles:
    """n particles: columns[name] are views [n, *shape] of arrays that grow by themselves.

    "id" (int64) is always one of them. A view is valid until the number of particles changes.
    """

    def __init__(self, columns: Mapping[str, tuple[DTypeLike, Sequence[int]]], capacity: int = 0) -> None:
        kinds = {"id": (np.int64, ())} | dict(columns)
        self._storage = {name: np.zeros((capacity, *shape), dtype) for name, (dtype, shape) in kinds.items()}
        self._layout = record_type(self._storage)
        self.n = 0
        self.record_bytes: int = self._layout.itemsize

    @property
    def columns(self) -> Columns:
        return {name: array[: self.n] for name, array in self._storage.items()}

    @property
    def capacity(self) -> int:
        return len(self._storage["id"])

    def append(self, rows: Mapping[str, NDArray]) -> None:
        """Add particles at the end; all columns must be there."""
        if rows.keys() != self._storage.keys():
            raise ValueError(f"columns {sorted(rows)} are not {sorted(self._storage)}")
        n = self.n + len(rows["id"])
        if n > self.capacity:
            self._reserve(n + n // 8)
        for name, values in rows.items():
            self._storage[name][self.n : n] = values
        self.n = n

    def _reserve(self, capacity: int) -> None:
        for name, column in self.columns.items():
            self._storage[name] = np.zeros((capacity, *column.shape[1:]), column.dtype)
            self._storage[name][: self.n] = column

    def take(self, which: NDArray) -> Columns:
        """Remove the particles of a mask or an index list and return them; the others keep their order."""
        gone = np.zeros(self.n, bool)
        gone[which] = True
        taken = {name: column[which] for name, column in self.columns.items()}
        stay = np.flatnonzero(~gone)
        for column in self.columns.values():
            column[: len(stay)] = column[stay]
        self.n = len(stay)
        return taken

    def pack(self, index: NDArray) -> NDArray[np.uint8]:
        """Records uint8[m, record_bytes] of the particles of a mask or an index list."""
        return pack_rows(self.columns, index)

    def unpack(self, records: NDArray[np.uint8]) -> Columns:
        """Columns of records, as `append` takes them."""
        return unpack_rows(records, self._layout)

    def sort(self, order: NDArray[np.int64]) -> None:
        """Put the particles in the order given, a permutation of 0 .. n - 1."""
        for column in self.columns.values():
            column[:] = column[order]
