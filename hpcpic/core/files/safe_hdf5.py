"""Reading HDF5 that others may have made: nothing outside the file is touched, nothing unexpected is
allocated.

A plain h5py read follows external links, external raw storage and virtual data sets to any file of the
system, loads filter plugins, and allocates what the file declares. Here a data set is found through hard
links only and must have the type, the shape and the storage that the caller expects.
"""

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from hpcpic.core.errors import FileError

if TYPE_CHECKING:
    import h5py

ALLOWED_FILTERS = {1: "gzip", 2: "shuffle", 3: "fletcher32"}  # numbers of the HDF5 filter registry
MAX_COMPRESSION = 200  # declared bytes per byte of file; gzip reaches 1028:1 on zeros only
MAX_BYTES = 1 << 42
MAX_ATTRIBUTE_BYTES = 1 << 16


def import_h5py() -> ModuleType:
    """h5py, with the search for filter plugins switched off before HDF5 starts."""
    os.environ.setdefault("HDF5_PLUGIN_PRELOAD", "::")
    import h5py

    return h5py


class Checked:
    """An open file that hands out data sets after inspection only. Every refusal is a FileError naming it."""

    def __init__(self, file: "h5py.File", path: Path) -> None:
        self.file = file
        self.path = path
        self._size = os.path.getsize(path)

    def _refuse(self, name: str, why: str) -> FileError:
        return FileError(f"{self.path}: {name}: {why}; the file is damaged or not one of ours")

    def _find(self, name: str) -> Any:
        h5py = import_h5py()
        node: Any = self.file
        for part in [part for part in name.split("/") if part]:
            link = node.get(part, getlink=True) if isinstance(node, h5py.Group) else None
            if link is None:
                raise self._refuse(name, "not there")
            if not isinstance(link, h5py.HardLink):
                raise self._refuse(name, f"is a {type(link).__name__}, which is not followed")
            node = node[part]
        return node

    def names(self, group: str = "/") -> list[str]:
        """Names in a group. Soft and external links among them are refused."""
        node = self._find(group)
        if not isinstance(node, import_h5py().Group):
            raise self._refuse(group, "is not a group")
        found = sorted(node)
        for name in found:
            self._find(f"{group}/{name}")
        return found

    def has(self, name: str) -> bool:
        return name in self.file and self._find(name) is not None

    def dataset(self, name: str, dtype: Any, shape: tuple[int | None, ...]) -> "h5py.Dataset":
        """The data set, which must have this dtype (None: any number) and shape (None: any length)."""
        found = self._find(name)
        if not isinstance(found, import_h5py().Dataset):
            raise self._refuse(name, "is not a data set")
        if found.external is not None:
            raise self._refuse(name, "keeps its values in another file")
        if found.is_virtual:
            raise self._refuse(name, "is a virtual data set")
        self._check_type(name, found, dtype, shape)
        self._check_storage(name, found)
        return found

    def _check_type(self, name: str, found: "h5py.Dataset", dtype: Any, shape: tuple[int | None, ...]) -> None:
        if found.shape is None or found.dtype.kind not in "iufcb":
            raise self._refuse(name, f"does not hold plain numbers (type {found.dtype})")
        if dtype is not None and found.dtype != np.dtype(dtype):
            raise self._refuse(name, f"has type {found.dtype}, expected {np.dtype(dtype)}")
        fits = len(found.shape) == len(shape) and all(b in (None, a) for a, b in zip(found.shape, shape, strict=True))
        if not fits:
            expected = tuple("any" if length is None else length for length in shape)
            raise self._refuse(name, f"has shape {found.shape}, expected {expected}".replace("'", ""))

    def _check_storage(self, name: str, found: "h5py.Dataset") -> None:
        plan = found.id.get_create_plist()
        filters = [plan.get_filter(k)[0] for k in range(plan.get_nfilters())]
        unknown = [number for number in filters if number not in ALLOWED_FILTERS]
        if unknown:
            raise self._refuse(name, f"uses the filter {unknown[0]}, allowed are {', '.join(ALLOWED_FILTERS.values())}")
        limit = self._size * (MAX_COMPRESSION if 1 in filters else 1)
        if found.nbytes > min(limit, MAX_BYTES):
            raise self._refuse(name, f"declares {found.nbytes} bytes in a file of {self._size}")

    def attribute(self, name: str, key: str, default: Any = None) -> Any:
        """A finite number, an array of such, or a text. FileError when absent without a default, or anything else."""
        attributes = self._find(name).attrs
        if key not in attributes and default is not None:
            return default
        if key not in attributes:
            raise self._refuse(name, f"attribute {key} is not there")
        identifier = attributes.get_id(key)
        nothing = identifier.get_space().get_simple_extent_type() == import_h5py().h5s.NULL
        if nothing or identifier.get_storage_size() > MAX_ATTRIBUTE_BYTES:
            raise self._refuse(name, f"attribute {key} is empty or too long")
        value = attributes[key]
        if isinstance(value, bytes):
            return value.decode(errors="replace")
        if isinstance(value, str):
            return value
        array = np.asarray(value)
        if array.dtype.kind == "O" and all(isinstance(text, str) for text in array.flat):
            return [str(text) for text in array.flat]
        if array.dtype.kind not in "iufb" or not np.all(np.isfinite(array)):
            raise self._refuse(name, f"attribute {key} is neither text nor finite numbers")
        return value


@contextmanager
def open_checked(path: Path | str) -> Iterator[Checked]:
    """Open for reading. Whatever HDF5 makes of a bad file, the caller sees a FileError."""
    path = Path(path)
    try:
        if not stat.S_ISREG(os.stat(path).st_mode):
            raise FileError(f"{path}: not a regular file")
        h5py = import_h5py()
        with h5py.File(path, "r", locking=False) as file:
            yield Checked(file, path)
    except FileNotFoundError as error:
        raise FileError(f"{path}: no such file") from error
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, MemoryError) as error:
        raise FileError(f"{path}: cannot be read as HDF5 ({error})") from error
