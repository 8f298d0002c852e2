"""How much memory there is, of a machine and its control groups written down as files."""

import math
import resource

import pytest

from hpcpic.core import memory
from hpcpic.core.errors import HpcpicError

MIB = 1 << 20


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """Writes files of /proc and /sys/fs/cgroup."""
    monkeypatch.setattr(memory, "PROC", tmp_path / "proc")
    monkeypatch.setattr(memory, "CGROUPS", tmp_path / "groups")

    def write(**files):
        for name, text in files.items():
            path = tmp_path / name.replace("__", "/").replace("_dot_", ".")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)

    return write


MEMINFO = "MemTotal: 900 kB\nMemFree: 10 kB\nMemAvailable: 500 kB\nHugePages_Total: 0\nSwapFree: 12 kB\n"
OLD_STAT = "inactive_file 1\ntotal_inactive_file 80\ntotal_active_file 20\n"
STAT = "anon 5\ninactive_file 100\nactive_file 20\n"


def test_a_machine_that_tells_nothing_gives_all(machine):
    assert memory.free() == math.inf and memory.held() == 0


def test_a_machine_gives_what_is_available_and_its_swap(machine):
    machine(proc__meminfo=MEMINFO, proc__self__statm="700 30 1 1 1")
    assert memory.free() == 512 * 1024 and memory.held() == 30 * resource.getpagesize()


@pytest.mark.parametrize("path", ["/job/step", "/../seen/from/the/host"])
def test_the_nearest_limit_of_a_group_counts_and_files_it_keeps_do_not(machine, path):
    machine(proc__meminfo=MEMINFO, proc__self__cgroup=f"1:cpu:/x\n0::{path}\n")
    own = "groups__job__step" if "job" in path else "groups"
    machine(**{f"{own}__memory_dot_max": "max\n", f"{own}__memory_dot_current": "1\n"})
    assert memory.free() == 512 * 1024
    above = "groups__job" if "job" in path else "groups"
    machine(**{f"{above}__memory_dot_max": "9000\n", f"{above}__memory_dot_current": "8000\n"})
    machine(**{f"{above}__memory_dot_stat": STAT})
    assert memory.free() == 1000 + 120


def test_groups_of_the_first_version(machine):
    machine(proc__self__cgroup="4:memory:/job\n0::/\n", groups__memory__job__memory_dot_limit_in_bytes="5000")
    machine(groups__memory__job__memory_dot_usage_in_bytes="4900", groups__memory__job__memory_dot_stat=OLD_STAT)
    assert memory.free() == 100 + 100
    machine(groups__memory__job__memory_dot_usage_in_bytes="6000")
    assert memory.free() == 0


def test_a_limit_of_address_space_is_told_before_libraries_meet_it(monkeypatch):
    limits = {"now": resource.RLIM_INFINITY}
    monkeypatch.setattr(resource, "getrlimit", lambda kind: (limits["now"], resource.RLIM_INFINITY))
    memory.require_room(lambda: 1e18)
    limits["now"] = 1 << 50
    memory.require_room(lambda: float(1 << 40))
    with pytest.raises(HpcpicError, match=r"leaves \d+ MiB .* takes about 2147483648 MiB"):
        memory.require_room(lambda: float(1 << 51))
