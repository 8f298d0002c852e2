"""Rows of named columns as records of bytes for messages, and back."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

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
