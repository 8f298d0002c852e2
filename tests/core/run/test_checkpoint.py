"""A checkpoint is complete and verified, or absent, and does not know how many ranks there are."""

import errno
import hashlib
import json
import logging
import os
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest

from hpcpic.core.errors import FileError
from hpcpic.core.files import image, sealed
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.files.together import ALONE
from hpcpic.core.run import checkpoint
from hpcpic.core.run.checkpoint import Shard, newest
from hpcpic.core.space.domain import block_ranges


def whole(seed: int, n: int = 1000) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    return {
        "ions/id": np.arange(n),
        "ions/x": rng.standard_normal((n, 2)),
        "ions/v": rng.standard_normal((n, 3)).astype(np.float32),
        "deep/down/none": np.empty((0, 4)),
        "one": np.array([2.5]),  # some ranks have nothing of it
        "rho": rng.standard_normal((7, 5)),
    }


def shards(arrays: dict[str, np.ndarray], rank: int = 0, ranks: int = 1) -> dict[str, Shard]:
    """The part of one rank; later ranks have earlier rows, so ranks and rows are in opposite order."""
    parts = {}
    for name, array in arrays.items():
        low, high = block_ranges(len(array), ranks)[ranks - 1 - rank]
        parts[name] = Shard(array[low:high], low, len(array))
    return parts


def sha256(arrays: dict[str, np.ndarray]) -> str:
    return hashlib.sha256(b"".join(array.tobytes() for array in arrays.values())).hexdigest()


@pytest.fixture
def rundir(tmp_path: Path) -> RunDir:
    return RunDir(tmp_path)


def assert_holds(reader: checkpoint.Reader, arrays: dict[str, np.ndarray]) -> None:
    assert reader.names == list(arrays)
    for name, array in arrays.items():
        found = reader.read(name)
        assert found.dtype == array.dtype and np.array_equal(found, array), name


def test_what_is_read_is_what_was_written(rundir: RunDir) -> None:
    arrays = whole(1)
    checkpoint.write(ALONE, rundir, 12, 0.1 + 0.2, shards(arrays), {"config_hash": "ab", "charge": 0.1})
    reader = newest(rundir)
    assert_holds(reader, arrays)
    assert (reader.step, reader.time) == (12, 0.1 + 0.2)
    assert reader.attributes == {"config_hash": "ab", "charge": 0.1}


def test_a_checkpoint_is_on_the_disk_before_its_name_and_the_older_one_goes_last(
    rundir: RunDir, disk_order: list, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every rank's part, then the manifest that vouches for it, then the name; after a loss of power the newest name
    is that of a whole checkpoint, or an older one still has its own.
    """
    unlink = Path.unlink

    def noted(path: Path, **settings: bool) -> None:
        disk_order.append(("remove", path.name, 0))
        unlink(path, **settings)

    for step in (1, 2):
        checkpoint.write(ALONE, rundir, step, 0.0, shards(whole(1)))
    monkeypatch.setattr(Path, "unlink", noted)
    del disk_order[:]
    path = checkpoint.write(ALONE, rundir, 3, 0.0, shards(whole(1)))
    (parts, first, early), (manifest, second, late), *rest = disk_order
    assert parts == manifest == "sync" and first == second and early < late == path.stat().st_size
    assert rest[0] == ("rename", path.name, late)
    assert [what[:2] for what in rest[1:]] == [("sync", "checkpoints"), ("remove", "00000001.h5")]


@pytest.mark.parametrize("ranks", [1, 2, 3, 7])
def test_any_number_of_ranks_reads_its_part(rundir: RunDir, ranks: int) -> None:
    arrays = whole(2)
    checkpoint.write(ALONE, rundir, 1, 0.0, shards(arrays))
    reader = newest(rundir)
    for name, array in arrays.items():
        parts = [reader.read(name, low, high) for low, high in block_ranges(reader.total(name), ranks)]
        assert np.array_equal(np.concatenate(parts), array)
    with pytest.raises(FileError, match=r"has 7 rows, asked for 3..8"):
        reader.read("rho", 3, 8)


def test_it_is_ordinary_hdf5(rundir: RunDir) -> None:
    import h5py

    arrays = whole(3)
    path = checkpoint.write(ALONE, rundir, 5, 2.5, shards(arrays))
    with h5py.File(path, "r") as file:
        assert file.attrs["step"] == 5 and file.attrs["time"] == 2.5
        for name, array in arrays.items():
            assert np.array_equal(file[name][()], array)


def test_the_same_state_gives_the_same_bytes(tmp_path: Path) -> None:
    paths = []
    for run in ("a", "b"):
        (tmp_path / run).mkdir()
        paths.append(checkpoint.write(ALONE, RunDir(tmp_path / run), 5, 2.5, shards(whole(3))))
        time.sleep(1.01)  # HDF5 knows whole seconds
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_two_are_kept_and_a_replaced_future_is_not(rundir: RunDir) -> None:
    def steps() -> list[int]:
        return sorted(int(path.stem) for path in rundir.checkpoints.iterdir())

    for step in (10, 20, 30):
        checkpoint.write(ALONE, rundir, step, 0.0, shards(whole(step)))
    assert steps() == [20, 30]
    checkpoint.write(ALONE, rundir, 25, 0.0, shards(whole(25)))  # after a restart from 20
    assert steps() == [20, 25]
    checkpoint.write(ALONE, rundir, 25, 0.0, shards(whole(26)))
    assert_holds(newest(rundir), whole(26))


def test_no_flipped_bit_passes(rundir: RunDir) -> None:
    path = checkpoint.write(ALONE, rundir, 1, 0.0, shards(whole(4, 3)))
    sound = path.read_bytes()
    newest(rundir)
    rng = np.random.default_rng(5)
    silent = []
    end = sealed.manifest_of(path)["size"]
    structure = [*rng.integers(0, 4096, 100), *range(end - 40, end)]  # superblock, headers before and behind arrays
    tail = len(sound) - 1 - rng.integers(0, 700, 100)  # manifest and footer
    for place in [*structure, *tail, *rng.integers(4096, len(sound), 200)]:
        damaged = bytearray(sound)
        damaged[place] ^= 1 << rng.integers(8)
        path.write_bytes(damaged)
        try:
            newest(rundir)
        except FileError:
            continue
        silent.append(place)
    assert silent == []


def test_no_truncation_and_no_zeroed_page_passes(rundir: RunDir) -> None:
    path = checkpoint.write(ALONE, rundir, 1, 0.0, shards(whole(6)))
    sound = path.read_bytes()
    for length in [0, 1, 55, 56, 57, *np.random.default_rng(7).integers(0, len(sound), 40), len(sound) - 1]:
        path.write_bytes(sound[:length])
        with pytest.raises(FileError, match=r"cut off|damaged"):
            newest(rundir)
    path.write_bytes(sound[:8192] + bytes(4096) + sound[12288:])
    with pytest.raises(FileError, match=r"damaged: ions/"):
        newest(rundir)


def test_damage_falls_back_and_then_lists_all_reasons(rundir: RunDir, caplog: pytest.LogCaptureFixture) -> None:
    paths = [checkpoint.write(ALONE, rundir, step, 0.0, shards(whole(step))) for step in (1, 2)]
    os.truncate(paths[1], 1000)
    with caplog.at_level(logging.WARNING):
        assert_holds(newest(rundir), whole(1))
    assert "00000002.h5: cut off" in caplog.text
    with open(paths[0], "r+b") as file:
        file.seek(paths[0].stat().st_size // 2)
        byte = file.read(1)
        file.seek(-1, os.SEEK_CUR)
        file.write(bytes([byte[0] ^ 16]))
    with pytest.raises(FileError, match=r"00000002.h5: cut off[^\n]*\n.*00000001.h5: damaged: ions/") as failure:
        newest(rundir)
    assert failure.value.exit_code == 6


def test_none_is_an_error_with_a_cure(rundir: RunDir) -> None:
    with pytest.raises(FileError, match=r"no checkpoint in .*; start again"):
        newest(rundir)


def test_a_newer_format_is_refused_with_both_versions(rundir: RunDir, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(sealed, "SCHEMA", 99)
        patch.setattr("hpcpic.core.files.sealed.__version__", "7.0")
        checkpoint.write(ALONE, rundir, 1, 0.0, shards(whole(1)))
    with pytest.raises(FileError, match=r"written by version 7.0 in format 99; this is version \d.*format 1"):
        newest(rundir)


@pytest.mark.parametrize(
    "change",
    [
        {"arrays": {"x": {"shape": [1 << 62, 4], "dtype": "<f8", "address": 0}}},
        {"arrays": {"x": {"shape": [4], "dtype": "|O", "address": 0}}},
        {"arrays": {"x": {"shape": [-1], "dtype": "<f8", "address": 0}}},
        {"arrays": {"x": {"shape": [1], "dtype": "<f8", "address": -8}}},
        {"arrays": []},
        {"blake2b": "00"},
        {"blake2b": "zz"},
        {"size": 10},
        {"step": None},
    ],
)
def test_a_forged_manifest_is_refused(rundir: RunDir, change: dict) -> None:
    reseal(checkpoint.write(ALONE, rundir, 1, 0.0, shards(whole(1))), change)
    with pytest.raises(FileError):
        newest(rundir)


def reseal(path: Path, change: dict) -> None:
    """Another manifest, with its checksum."""
    content = path.read_bytes()
    _, length, _ = sealed.FOOTER.unpack(content[-sealed.FOOTER.size :])
    end = len(content) - sealed.FOOTER.size - length
    manifest = json.loads(content[end : end + length])
    text = json.dumps({**manifest, **change}).encode()
    footer = sealed.FOOTER.pack(sealed.MAGIC, len(text), hashlib.blake2b(text, digest_size=32).digest())
    path.write_bytes(content[:end] + text + footer)


def test_an_array_that_reaches_into_the_manifest_is_refused_though_its_checksums_hold(rundir: RunDir) -> None:
    path = checkpoint.write(ALONE, rundir, 1, 0.0, shards({"x": np.zeros(3)}))
    end = sealed.manifest_of(path)["size"]
    for beyond in (0, 8):  # the manifest begins with the same bytes whatever it says
        arrays = {"x": sealed.Array((16,), np.dtype("u1"), end - 16 + beyond)}
        hashes = sealed.hash_own(path, arrays, end, 0, 1)
        reseal(path, {"arrays": sealed.describe(arrays), "blake2b": hashes.tobytes().hex()})
        if beyond:
            with pytest.raises(FileError, match="beyond the end"):
                newest(rundir)
        else:
            newest(rundir)


def test_arrays_of_another_shape_or_type_than_the_scene_has_are_refused(rundir: RunDir) -> None:
    checkpoint.write(ALONE, rundir, 1, 0.0, shards({"x": np.zeros((3, 2))}))
    reader = newest(rundir)
    for shape in ((3, 2), (None, 2), (None, None)):
        checkpoint.hold(reader, {"x": checkpoint.Column(float, shape)})
    for dtype, shape in ((np.float32, (3, 2)), (np.int64, (3, 2)), (float, (4, 2)), (float, (3,)), (float, (3, 2, 1))):
        with pytest.raises(FileError, match=r"x: expected .*, found float64 \[3, 2\]"):
            checkpoint.hold(reader, {"x": checkpoint.Column(dtype, shape)})


def test_a_failed_write_leaves_the_old_ones_and_no_temporary(rundir: RunDir, monkeypatch: pytest.MonkeyPatch) -> None:
    checkpoint.write(ALONE, rundir, 1, 0.0, shards(whole(1)))

    def lie(descriptor: int, content: bytes, address: int) -> None:
        os.pwrite(descriptor, bytes(len(content)), address)

    with monkeypatch.context() as patch:
        patch.setattr(image, "write_all", lie)
        with pytest.raises(FileError, match="reads back differently"):
            checkpoint.write(ALONE, rundir, 2, 0.0, shards(whole(2)))
    assert [path.name for path in rundir.checkpoints.iterdir()] == ["00000001.h5"]
    assert_holds(newest(rundir), whole(1))


def test_parts_that_do_not_cover_the_whole_are_a_bug(rundir: RunDir) -> None:
    with pytest.raises(ValueError, match=r"x: the parts of the ranks do not cover rows 0..5 once"):
        checkpoint.write(ALONE, rundir, 1, 0.0, {"x": Shard(np.zeros(4), 0, 5)})
    with pytest.raises(ValueError, match="do not cover"):
        checkpoint.digest(ALONE, {"x": Shard(np.zeros(4), 1, 4)})


def test_digest_is_sha256_of_the_arrays(monkeypatch: pytest.MonkeyPatch) -> None:
    arrays = whole(8)
    strided = {**shards(arrays), "rho": Shard(np.asfortranarray(arrays["rho"]), 0, 7)}
    assert checkpoint.digest(ALONE, strided) == sha256(arrays)
    monkeypatch.setattr(checkpoint, "BLOCK", 100)  # smaller than an array, no multiple of a row
    assert checkpoint.digest(ALONE, strided) == sha256(arrays)
    arrays["rho"][3, 3] = np.nextafter(arrays["rho"][3, 3], 9)
    assert checkpoint.digest(ALONE, shards(arrays)) != checkpoint.digest(ALONE, strided)


def common_folder(world) -> RunDir:
    made = tempfile.mkdtemp() if world.rank == 0 else ""
    return RunDir(world.bcast(made.encode()).decode())


@pytest.mark.mpi(min_size=2)
def test_file_and_digest_do_not_depend_on_ranks(monkeypatch: pytest.MonkeyPatch) -> None:
    from hpcpic.core.comm.world import World

    world = World.start()
    monkeypatch.setattr(checkpoint, "BLOCK", 1000)
    monkeypatch.setattr(sealed, "CHUNK", 1000)  # chunks that cross the parts of the ranks
    arrays = whole(9)
    rundir, alone = common_folder(world), common_folder(world)
    own = shards(arrays, world.rank, world.size)
    path = checkpoint.write(world, rundir, 3, 0.3, own)
    if world.rank == 0:
        single = checkpoint.write(ALONE, alone, 3, 0.3, shards(arrays))
        assert single.read_bytes() == path.read_bytes()
    assert checkpoint.digest(world, own) == sha256(arrays)
    assert_holds(newest(rundir, world), arrays)


@pytest.mark.mpi(min_size=2)
@pytest.mark.parametrize("failing", [0, -1])
def test_a_rank_that_cannot_write_fails_all_with_the_same_error(failing: int, monkeypatch: pytest.MonkeyPatch) -> None:
    from hpcpic.core.comm.world import World

    world = World.start()
    rundir = common_folder(world)
    checkpoint.write(world, rundir, 1, 0.1, shards(whole(1), world.rank, world.size))

    def full(descriptor: int, content: bytes, address: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        if world.rank == failing % world.size:
            patch.setattr(image, "write_all", full)
        with pytest.raises(FileError) as failure:
            checkpoint.write(world, rundir, 2, 0.2, shards(whole(2), world.rank, world.size))
    assert "No space left on device" in failure.value.message and f"rank {failing % world.size}" in str(failure)
    assert world.bcast(failure.value.message.encode()) == failure.value.message.encode()
    world.barrier()
    assert [path.name for path in rundir.checkpoints.iterdir()] == ["00000001.h5"]
    assert_holds(newest(rundir, world), whole(1))


@pytest.mark.mpi(min_size=2)
def test_all_ranks_fall_back_together() -> None:
    from hpcpic.core.comm.world import World

    world = World.start()
    rundir = common_folder(world)
    for step in (1, 2):
        checkpoint.write(world, rundir, step, 0.0, shards(whole(step), world.rank, world.size))
    if world.rank == 0:
        path = rundir.checkpoints / "00000002.h5"
        content = bytearray(path.read_bytes())
        content[len(content) // 2] ^= 1
        path.write_bytes(content)
    world.barrier()
    assert_holds(newest(rundir, world), whole(1))
    world.barrier()
    if world.rank == 0:
        os.truncate(rundir.checkpoints / "00000001.h5", 10)
    world.barrier()
    with pytest.raises(FileError, match="no checkpoint can be used"):
        newest(rundir, world)


def hold_increasing(rundir: RunDir, world) -> None:
    """Numbers that increase are held; with one twice they are refused on all ranks, wherever it stands."""
    n = 13
    column = {"id": checkpoint.Column(np.int64, (n,), increasing=True)}
    for twice in range(n):
        ids = np.arange(n)
        ids[twice] = ids[max(0, twice - 1)]
        checkpoint.write(world, rundir, twice, 0.0, shards({"id": ids}, world.rank, world.size))
        if twice:
            with pytest.raises(FileError, match="each row above"):
                checkpoint.hold(newest(rundir, world), column, world)
        else:
            checkpoint.hold(newest(rundir, world), column, world)


def test_the_order_of_rows_is_held_across_blocks(rundir: RunDir, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checkpoint, "BLOCK", 32)
    hold_increasing(rundir, ALONE)


@pytest.mark.mpi(min_size=2)
def test_the_order_of_rows_is_held_across_ranks() -> None:
    from hpcpic.core.comm.world import World

    world = World.start()
    hold_increasing(common_folder(world), world)
