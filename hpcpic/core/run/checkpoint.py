"""Checkpoints: one logical file, independent of ranks, complete and verified, or absent.

All ranks write their part of checkpoints/NNNNNNNN.h5 (core.files.image, core.files.sealed) under a temporary
name; a rename makes it appear. It is read on any number of ranks.
"""

import contextlib
import hashlib
import json
import logging
import math
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hpcpic.core.errors import ConfigError, FileError
from hpcpic.core.files import image, sealed
from hpcpic.core.files.arrays import Column, Shard
from hpcpic.core.files.atomic import discard, temporary
from hpcpic.core.files.rundir import RunDir
from hpcpic.core.files.sealed import CHUNK, Array, Reader
from hpcpic.core.files.together import ALONE, Alone, together
from hpcpic.core.space.domain import block_ranges
from hpcpic.version import __version__

if TYPE_CHECKING:
    import h5py

    from hpcpic.core.comm.world import World
    from hpcpic.core.run.model import Ending

__all__ = ["Reader", "Shard", "digest", "hold", "newest", "require_later_end", "require_same_case", "write"]

log = logging.getLogger(__name__)

BLOCK = 16 << 20
KEPT = 2
NAME = re.compile(r"\d{8,}\.h5")


def write(
    world: "World | Alone",
    rundir: RunDir,
    step: int,
    time: float,
    shards: Mapping[str, Shard],
    attributes: Mapping[str, Any] | None = None,
) -> Path:
    """Write the state at `step`, all ranks together; then keep the newest two.

    `attributes` are what JSON can hold. Raises FileError on all ranks (disk full, no permission, a read-back
    that differs); the temporary file is gone then and the older checkpoints are untouched.
    """
    final = rundir.checkpoints / f"{step:08d}.h5"
    made = temporary(final, world.bcast(str(os.getpid()).encode()).decode())
    doing = f"cannot write the checkpoint {final}"
    _layout(world, shards)
    facts = {"step": step, "time": float(time), "time_hex": float(time).hex(), "attributes": dict(attributes or {})}
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
            discard(made)
        raise
    return final


def _layout(world: "World | Alone", shards: Mapping[str, Shard]) -> NDArray[np.int64]:
    """(offset, rows) of every array and rank [arrays, ranks, 2]; ValueError unless they tile it."""
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
) -> dict[str, Array]:
    """Make the file with room for every array; where they are, on all ranks."""
    arrays: dict[str, Array] = {}

    def build(file: "h5py.File") -> dict[str, image.Slot]:
        file.attrs["step"], file.attrs["time"] = facts["step"], facts["time"]
        file.attrs["schema"], file.attrs["version"] = sealed.SCHEMA, __version__
        slots = {}
        for name, shard in shards.items():
            shape = (shard.total, *shard.local.shape[1:])
            slots[name] = image.contiguous(file, name, shape, shard.local.dtype)
            arrays[name] = Array(shape, shard.local.dtype, slots[name].addresses[0])
        return slots

    with together(world, doing):
        if world.rank == 0:
            if made.parent.is_symlink():  # removed, not followed, as all links put in the way
                log.warning("%s was a link to %s: a folder takes its place", made.parent, os.readlink(made.parent))
                made.parent.unlink()
            made.parent.mkdir(exist_ok=True)
            _sweep(made.parent)
            image.create(made, build)
    return sealed.arrays_of(json.loads(world.bcast(json.dumps(sealed.describe(arrays)).encode())))


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
    world: "World | Alone", made: Path, arrays: Mapping[str, Array], facts: Mapping[str, Any], doing: str
) -> None:
    """Hash what is in the file, shared among ranks, and append the manifest."""
    with together(world, doing):
        own = sealed.hash_own(made, arrays, os.path.getsize(made), world.rank, world.size)
    hashes = world.sum_int(own.view(np.int64)).view(np.uint8)
    with together(world, doing):
        if world.rank == 0:
            sealed.seal(made, arrays, facts, hashes)


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


def newest_step(rundir: RunDir) -> int | None:
    """The step of the newest checkpoint, unverified; None when there is none."""
    return next((int(path.stem) for path in _found(rundir.checkpoints)), None)


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


def newest(rundir: RunDir, world: "World | Alone" = ALONE) -> Reader:
    """The newest checkpoint of which every byte is as written, with a warning for each newer one that is not.

    All ranks of `world` call it, share the verification and get the same one. Raises FileError listing the
    reasons when there is none.
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


def hold(reader: Reader, columns: Mapping[str, Column], world: "World | Alone" = ALONE) -> None:
    """Collective: FileError unless the checkpoint has these arrays and no others, of these shapes, types and values."""
    for name in dict.fromkeys((*columns, *reader.names)):
        if name not in columns:
            raise FileError(f"{reader.path}: {name}: this scene has no such array, but {', '.join(columns)}")
        column = columns[name]
        shape, dtype = reader.shape(name), reader.dtype(name)
        fits = len(shape) == len(column.shape) and all(b in (None, a) for a, b in zip(shape, column.shape, strict=True))
        if not fits or dtype != np.dtype(column.dtype):
            asked = ", ".join("any" if n is None else str(n) for n in column.shape)
            raise FileError(
                f"{reader.path}: {name}: expected {np.dtype(column.dtype)} [{asked}], found {dtype} "
                f"[{', '.join(map(str, shape))}]"
            )
    with together(world):
        for name, column in columns.items():
            low, high = block_ranges(reader.total(name), world.size)[world.rank]
            row_bytes = math.prod(reader.shape(name)[1:]) * reader.dtype(name).itemsize
            rows = max(2, BLOCK // max(1, row_bytes))
            for first in range(low, high, rows):
                first = max(0, first - 1)  # in what order rows are shows beside the one before
                fault = column.fault(reader.read(name, first, min(first + rows + 1, high)), first)
                if fault:
                    raise FileError(f"{reader.path}: {name}{fault}")


def require_same_case(reader: Reader, program: str, settings: Mapping[str, str]) -> None:
    """FileError unless the checkpoint is of this program; ConfigError, which lists what differs, unless the settings
    (key -> value) that belong to its state are these.
    """
    made_by = reader.attributes.get("program")
    if made_by != program:
        raise FileError(f"{reader.path}: a checkpoint of {made_by or 'another program'}, not of {program}")
    before: dict[str, str] = reader.attributes["settings"]
    differing = [key for key in {**before, **settings} if before.get(key) != settings.get(key)]
    if differing:
        raise ConfigError(
            [f"{reader.path}: the state was made with other settings; a restart cannot change them:"]
            + [f"  {key}: {before.get(key, 'not set')} then, {settings.get(key, 'not set')} now" for key in differing]
        )


def require_later_end(reader: Reader, ending: "Ending", folder: str) -> None:
    """ConfigError where the run in the folder is to end before the checkpoint."""
    step = reader.time / max(reader.step, 1)  # on average
    if ending.n_steps is None:  # its last step ends a little after the end
        end, beyond = ending.end_time, ending.end_time < reader.time - 2.0 * step
    else:
        end, beyond = ending.n_steps * step, ending.n_steps < reader.step
    if beyond:
        raise ConfigError(
            f"{folder}: the checkpoint is of step {reader.step}, t = {reader.time:g} s, "
            f"beyond the end asked for, t = {end:g} s"
        )


def digest(world: "World | Alone", shards: Mapping[str, Shard]) -> str:
    """SHA-256 (hex) of the bytes of the arrays in dict order, each in global order; the same on all ranks.

    Streamed to rank 0 in blocks, so it needs no memory to speak of and does not depend on who holds what.
    """
    state = hashlib.sha256()
    for shard, place in zip(shards.values(), _layout(world, shards), strict=True):
        content = image.as_bytes(shard.local)
        row_bytes = math.prod(shard.local.shape[1:]) * shard.local.dtype.itemsize
        for low in range(0, shard.total * row_bytes, BLOCK):
            state.update(_block(world, content, place * row_bytes, low, min(low + BLOCK, shard.total * row_bytes)))
    return world.bcast(state.hexdigest().encode()).decode()


def _block(world: "World | Alone", content: memoryview, place: NDArray[np.int64], low: int, high: int) -> memoryview:
    """Bytes [low, high) of the whole on rank 0; `place` is (offset, length) in bytes of every rank."""
    if world.size == 1:
        return content[low:high]
    starts = np.clip(place[:, 0], low, high)
    ends = np.clip(place.sum(axis=1), low, high)
    counts = np.maximum(ends - starts, 0)
    own = np.asarray(content)
    first = starts[world.rank] - place[world.rank, 0]
    part = own[first : first + counts[world.rank]]
    whole = np.empty(high - low, np.uint8)
    target = [whole, (counts, starts - low)] if world.rank == 0 else None
    world.comm.Gatherv(part, target)
    return whole.data
