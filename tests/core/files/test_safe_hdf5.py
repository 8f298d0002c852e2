"""A malicious HDF5 file is refused by name; no byte outside it is read, nothing large is allocated."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from hpcpic.core.errors import FileError
from hpcpic.core.files.safe_hdf5 import open_checked

SHAPE = (4,)


def external_storage(file: h5py.File) -> None:
    file.create_dataset("x", SHAPE, np.float64, external=[("secret", 0, 32)])


def external_link(file: h5py.File) -> None:
    file["x"] = h5py.ExternalLink("other.h5", "/x")


def soft_link(file: h5py.File) -> None:
    file["y"] = np.zeros(SHAPE)
    file["x"] = h5py.SoftLink("/y")


def soft_cycle(file: h5py.File) -> None:
    file["x"] = h5py.SoftLink("/x")


def virtual(file: h5py.File) -> None:
    layout = h5py.VirtualLayout(SHAPE, np.float64)
    layout[:] = h5py.VirtualSource("other.h5", "x", SHAPE)
    file.create_virtual_dataset("x", layout)


def group(file: h5py.File) -> None:
    file.create_group("x")


def other_type(file: h5py.File) -> None:
    file["x"] = np.zeros(SHAPE, np.float32)


def other_byte_order(file: h5py.File) -> None:
    file["x"] = np.zeros(SHAPE, ">f8")


def other_shape(file: h5py.File) -> None:
    file["x"] = np.zeros(5)


def other_rank(file: h5py.File) -> None:
    file["x"] = np.zeros((4, 1))


def strings(file: h5py.File) -> None:
    file.create_dataset("x", SHAPE, h5py.string_dtype())


def lists(file: h5py.File) -> None:
    file.create_dataset("x", SHAPE, h5py.vlen_dtype(np.float64))


def compound(file: h5py.File) -> None:
    file.create_dataset("x", SHAPE, [("a", "f8"), ("b", "i4")])


def empty(file: h5py.File) -> None:
    file["x"] = h5py.Empty("f8")


def unknown_filter(file: h5py.File) -> None:
    file.create_dataset("x", data=np.zeros(SHAPE), chunks=SHAPE, compression="lzf")


def bomb(file: h5py.File) -> None:
    file.create_dataset("x", (1 << 40,), np.float64, chunks=(1 << 20,))


def zipped_bomb(file: h5py.File) -> None:
    file.create_dataset("x", data=np.zeros(1 << 22), compression="gzip", compression_opts=9)


REFUSED: list[tuple[Callable[[h5py.File], None], str, tuple[int | None, ...]]] = [
    (external_storage, "in another file", SHAPE),
    (external_link, "is a ExternalLink", SHAPE),
    (soft_link, "is a SoftLink", SHAPE),
    (soft_cycle, "is a SoftLink", SHAPE),
    (virtual, "virtual", SHAPE),
    (group, "not a data set", SHAPE),
    (other_type, "has type float32, expected float64", SHAPE),
    (other_byte_order, "has type >f8, expected float64", SHAPE),
    (other_shape, r"has shape \(5,\), expected \(4,\)", SHAPE),
    (other_rank, r"has shape \(4, 1\), expected \(4,\)", SHAPE),
    (strings, "does not hold plain numbers", SHAPE),
    (lists, "does not hold plain numbers", SHAPE),
    (compound, "does not hold plain numbers", SHAPE),
    (empty, "does not hold plain numbers", SHAPE),
    (unknown_filter, "uses the filter 32000", SHAPE),
    (bomb, "declares 8796093022208 bytes in a file of", (None,)),
    (zipped_bomb, "declares 33554432 bytes in a file of", (None,)),
]


@pytest.mark.parametrize(("make", "why", "shape"), REFUSED, ids=lambda value: getattr(value, "__name__", ""))
def test_what_is_not_expected_is_refused_by_name(
    tmp_path: Path, make: Callable[[h5py.File], None], why: str, shape: tuple[int | None, ...]
) -> None:
    (tmp_path / "secret").write_bytes(b"s" * 32)
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = np.ones(SHAPE)
    path = tmp_path / "bad.h5"
    with h5py.File(path, "w") as file:
        make(file)
    with pytest.raises(FileError, match=rf"bad.h5: x: .*{why}"), open_checked(path) as checked:
        checked.dataset("x", np.float64, shape)


def test_links_on_the_way_are_refused_too(tmp_path: Path) -> None:
    path = tmp_path / "bad.h5"
    with h5py.File(path, "w") as file:
        file["real/x"] = np.zeros(4)
        file["way"] = h5py.SoftLink("/real")
    with open_checked(path) as checked:
        assert checked.dataset("real/x", np.float64, SHAPE).shape == SHAPE
        for ask in (lambda: checked.dataset("way/x", np.float64, SHAPE), checked.names):
            with pytest.raises(FileError, match=r"way.*SoftLink, which is not followed"):
                ask()


def test_plain_and_compressed_data_are_read(tmp_path: Path) -> None:
    path = tmp_path / "good.h5"
    values = np.random.default_rng(1).random((50, 3))
    with h5py.File(path, "w") as file:
        file["a/plain"] = values
        file.create_dataset("a/zipped", data=values, compression="gzip", shuffle=True, fletcher32=True)
        file["a"].attrs.update({"units": "m", "list": ["u", "v"], "n": 3, "box": [1.0, 2.0], "old": np.bytes_("kg")})
    with open_checked(path) as checked:
        assert checked.names("a") == ["plain", "zipped"]
        for name in ("a/plain", "a/zipped"):
            assert np.array_equal(checked.dataset(name, np.float64, (None, 3))[:], values)
        assert [checked.attribute("a", key) for key in ("units", "list", "n", "old")] == [
            "m",
            ["u", "v"],
            3,
            "kg",
        ]
        assert checked.attribute("a", "box").tolist() == [1.0, 2.0]


@pytest.mark.parametrize("value", [np.nan, [1.0, np.inf], h5py.Empty("f8"), "x" * 70000], ids=str)
def test_attributes_are_finite_and_short(tmp_path: Path, value: object) -> None:
    path = tmp_path / "bad.h5"
    with h5py.File(path, "w", libver="latest") as file:
        file.attrs["a"] = value if not isinstance(value, str) else np.bytes_(value)
    with open_checked(path) as checked, pytest.raises(FileError, match="attribute a"):
        checked.attribute("/", "a")
    with open_checked(path) as checked, pytest.raises(FileError, match="attribute b is not there"):
        checked.attribute("/", "b")


def test_files_that_are_no_hdf5_are_refused(tmp_path: Path) -> None:
    (tmp_path / "text").write_text("hello")
    os.mkfifo(tmp_path / "pipe")
    for name, why in [
        ("text", "cannot be read as HDF5"),
        ("pipe", "not a regular"),
        ("none", "no such file"),
    ]:
        with pytest.raises(FileError, match=rf"{name}: {why}"), open_checked(tmp_path / name):
            pass


def test_filter_plugins_are_off_before_hdf5_starts() -> None:
    code = (
        "from hpcpic.core.files.safe_hdf5 import import_h5py; import os, sys;"
        "assert 'h5py' not in sys.modules;"
        "h5py = import_h5py(); assert os.environ['HDF5_PLUGIN_PRELOAD'] == '::';"
        "assert not h5py.h5z.filter_avail(32015)"  # zstd, which is always a plugin
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
