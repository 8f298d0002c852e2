"""Memory before it is taken: whoever takes more than there is is ended by the system or by a library, each in its
own way and none with a word.
"""

import math
import resource
from collections.abc import Callable, Iterator
from pathlib import Path

from hpcpic.core.errors import HpcpicError

MIB = 1 << 20
PROC, CGROUPS = Path("/proc"), Path("/sys/fs/cgroup")
LIMITS = {  # controller in /proc/self/cgroup, "" in version 2 -> files of its limit and its use
    "": ("memory.max", "memory.current"),
    "memory": ("memory.limit_in_bytes", "memory.usage_in_bytes"),
}
CACHED = ("inactive_file", "active_file")  # counts as used, and is given back on demand


def free() -> float:
    """Bytes that this machine and the control groups of this process (container, batch job) still give; inf where
    nothing tells.
    """
    machine = _numbers(PROC / "meminfo")
    return min([1024.0 * (machine.get("MemAvailable:", math.inf) + machine.get("SwapFree:", 0)), *_free_of_groups()])


def _free_of_groups() -> Iterator[float]:
    """Free bytes of every control group around this process that has a limit."""
    for controller, folder in groups():
        if controller not in LIMITS:
            continue
        limit, used = (read_text(folder / name).strip() for name in LIMITS[controller])
        if limit not in ("", "max"):
            stat = _numbers(folder / "memory.stat")
            cached = sum(stat.get(f"total_{name}", stat.get(name, 0)) for name in CACHED)
            yield max(0.0, float(limit) - float(used) + cached)


def groups() -> Iterator[tuple[str, Path]]:
    """(controller, folder) of every control group around this process, inner ones first; "" is that of version 2."""
    for line in read_text(PROC / "self/cgroup").splitlines():
        _, controller, path = line.split(":", 2)
        root = CGROUPS / controller
        own = root / path.lstrip("/")
        for folder in (own, *own.parents):  # in a container those of the host are not there
            if folder.is_relative_to(root):
                yield controller, folder


def held() -> float:
    """Bytes that this process holds; 0 where nothing tells."""
    return _pages()[1]


def require_room(needed: Callable[[], float]) -> None:
    """HpcpicError when this process may not take `needed` bytes of address space more (RLIMIT_AS, ulimit -v)."""
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit == resource.RLIM_INFINITY:
        return
    left, wanted = limit - _pages()[0], needed()
    if left < wanted:
        raise HpcpicError(
            f"no memory: the limit of this process (ulimit -v) leaves {max(left, 0) / MIB:.0f} MiB of address space, "
            f"and the run takes about {wanted / MIB:.0f} MiB"
        )


def _pages() -> list[float]:
    """Bytes of address space, and of memory, of this process."""
    words = read_text(PROC / "self/statm").split() or ["0", "0"]
    return [float(word) * resource.getpagesize() for word in words[:2]]


def _numbers(path: Path) -> dict[str, float]:
    """The lines "name number ..." of a file."""
    return {words[0]: float(words[1]) for words in map(str.split, read_text(path).splitlines())}


def read_text(path: Path) -> str:
    """The text of a file; empty where there is none."""
    try:
        return path.read_text()
    except OSError:
        return ""
