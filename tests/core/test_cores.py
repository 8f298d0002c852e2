"""Cores that a run may use, and what is said of more threads than that."""

import os

import pytest

from hpcpic.core import cores, memory
from hpcpic.core.comm.world import World
from hpcpic.core.cores import allotted, crowded


@pytest.mark.parametrize(
    "groups, files, granted",
    [
        ("0::/job\n", {"job/cpu.max": "max 100000"}, 64),
        ("0::/job/step\n", {"job/cpu.max": "250000 100000"}, 2),  # of a group around it, in part
        ("0::/job\n", {"job/cpu.max": "50000 100000"}, 1),
        ("0::/job\n", {"job/cpu.max": "9900000 100000"}, 64),
        ("3:cpu,cpuacct:/job\n0::/\n", {"cpu,cpuacct/job/cpu.cfs_quota_us": "300000",
                                        "cpu,cpuacct/job/cpu.cfs_period_us": "100000"}, 3),
        ("3:cpu:/\n", {"cpu/cpu.cfs_quota_us": "-1", "cpu/cpu.cfs_period_us": "100000"}, 64),
    ],
)  # fmt: skip
def test_a_group_gives_no_more_cores_than_time(tmp_path, monkeypatch, groups, files, granted):
    monkeypatch.setattr(memory, "PROC", tmp_path)
    monkeypatch.setattr(memory, "CGROUPS", tmp_path / "groups")
    for name, text in {"self/cgroup": groups, **{f"groups/{name}": text for name, text in files.items()}}.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text + "\n" * (not text.endswith("\n")))
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(64)))
    assert allotted() == granted and allotted(2) == min(2, granted)


def test_a_run_takes_no_more_threads_than_its_group_gives_time_of(monkeypatch):
    monkeypatch.setattr(cores, "_quotas", lambda: [])
    free = World.alone().default_threads()
    monkeypatch.setattr(cores, "_quotas", lambda: [1.5])
    assert free == len(os.sched_getaffinity(0)) and World.alone().default_threads() == 1


def test_only_what_does_not_fit_is_crowded():
    assert not crowded(2, 4, 8) and not crowded(1, 1, 1)
    assert crowded(1, 9, 8).startswith("1 rank x 9 threads want 9 cores, and this machine allots 8")


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_run_that_is_crowded_says_so_once(toy, ranks):
    there = allotted()
    many = there // ranks + 1
    done = toy("run", "ring.conf", "-o", "a", "--threads", str(many), ranks=ranks, steps=2)
    assert done.returncode == 0 and done.stderr.count(f"this machine allots {there}") == 1
    assert len([text for text in toy.facts("a")["warnings"] if "allots" in text]) == 1
    for verb in ("check", "estimate"):
        words = (verb, "ring.conf", "--ranks", "1", "--threads")
        assert toy(*words, str(there + 1)).stdout.count(f"this machine allots {there}") == 1
        assert "allots" not in toy(*words, "1").stdout
