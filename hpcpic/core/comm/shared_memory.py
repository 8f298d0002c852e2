"""The memory file system through which ranks of a node share arrays. Who writes to more of it than there is ends by a
bus error, without a word.
"""

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

FOLDER = Path("/dev/shm")
SPARE = 2 << 20  # bytes for each rank that MPI's own segments may still come to
_OF_MPI = ("mpich_sh", "ucx_shm", "sm_segment.", "vader_segment.", "osc_", "psm2_shm.", "psm3_shm.")


def free() -> float:
    """Bytes left; inf where there is no such file system: MPI uses another."""
    try:
        found = os.statvfs(FOLDER)
    except OSError:
        return float("inf")
    return float(found.f_bavail * found.f_frsize)


def left_behind() -> Iterator[Path]:
    """Segments of this user that no process has open any more: ranks that were killed have left them."""
    used = "".join(_text(maps) for maps in Path("/proc").glob("[0-9]*/maps"))
    for path in sorted(FOLDER.glob("*")):
        with suppress(OSError):
            ours = path.name.startswith(_OF_MPI) and path.stat().st_uid == os.getuid()
            if ours and str(path) not in used:
                yield path


def _text(path: Path) -> str:
    """Nothing of a process that has gone, or is another user's."""
    try:
        return path.read_text(errors="replace")
    except OSError:
        return ""
