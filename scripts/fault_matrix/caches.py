"""Rows 80 to 85: caches that are full, damaged or another user's, modules in the current folder, little shared memory,
and limits and habits of the shell.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import pickle
import resource
import shutil
import subprocess
from collections.abc import Callable
from itertools import cycle
from pathlib import Path

from fault_matrix.bench import Bench, Done, Skipped, expect
from fault_matrix.checkpoints import fill, mounted
from fault_matrix.rows import row
from hpcpic.core.simd.compile import kernel_store

STRANGER = 12345  # number of another user
CLONE_NEWNS = 0x20000  # of unshare(2): mounts of this process alone
SHARED_MEMORY = "12m"  # MPI starts with it, and the columns of 1024^2 are more
ROWS_OF_1024 = ("--set", "grid.points=[1024, 1024]", "--set", "simulation.cycles=3")
DAMAGES: tuple[Callable[[bytes], bytes], ...] = (
    lambda content: b"",
    lambda content: content[: len(content) // 2],
    lambda content: bytes(len(content)),
    lambda content: content[:-9] + bytes([content[-9] ^ 1]) + content[-8:],
)


def same(bench: Bench, done: Done, warnings: int, what: str = "") -> None:
    """Finished in the state of the run that nothing befell, with so many lines of warning more that say `what`."""
    expect(done.code == 0 and "Traceback" not in done.err, done)
    expect(bench.facts()["state_digest"] == bench.digest(), "another state than without the fault")
    usual = bench.usual_warnings()
    lines = [line for line in done.err.splitlines() if "WARNING" in line and not any(text in line for text in usual)]
    told = [line for line in lines if what in line]
    expect(len(told) == warnings, f"{len(told)} warnings: {done}")


def copied_cache(bench: Bench) -> Path:
    """A cache root of its own with all that was compiled so far."""
    bench.digest()
    root = bench.folder / "cache"
    mine = root / str(os.getuid())
    mine.mkdir(mode=0o700, parents=True)
    for program in ("", "hpcpic.plasma" if bench.program == "hpcpic" else bench.program):
        folder = kernel_store(program).folder  # the cache holds those of other versions, too
        assert folder is not None
        shutil.copytree(folder.path, mine / folder.path.name, dirs_exist_ok=True)
    root.chmod(0o700)
    return root


def kernels(root: Path) -> list[Path]:
    return sorted([*root.rglob("*.kernel"), *root.rglob("*.bin")])


@row(80, "the disk of the cache is full, or cannot be written", "one warning, same bits")
def full_cache(bench: Bench) -> str:
    cache = bench.folder / "cache"
    cache.mkdir()
    for options, what in (((), "No space left"), (("ro",), "Read-only file system")):
        with mounted(cache, "1m", "mode=700", *options):
            if not options:
                fill(cache)
            same(bench, bench.run(env={"HPCPIC_CACHE_DIR": str(cache)}), 1, what)
        shutil.rmtree(bench.run_folder)
    return "compiled in memory twice, warned once, same bits"


@row(81, "every file of the cache is empty, cut, zero or flipped", "one warning, same bits; sound again after that")
def damaged_cache(bench: Bench) -> str:
    root = copied_cache(bench)
    env = {"HPCPIC_CACHE_DIR": str(root)}
    for path, damage in zip(kernels(root), cycle(DAMAGES)):
        path.write_bytes(damage(path.read_bytes()))
    same(bench, bench.run(env=env), 1, "damaged files")
    shutil.rmtree(bench.run_folder)
    same(bench, bench.run(env=env), 0, "damaged files")
    compiled = bench.facts()["compiled_functions"]
    expect(compiled == 0, f"{compiled} compiled again")
    return f"{len(kernels(root))} files made anew, warned once, same bits; the next run loads them"


class _Planted:
    """Unpickled, it makes a file."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple:
        return (Path.touch, (self.mark,))


@row(82, "another user has put code in the cache", "not executed, one warning; doctor says so")
def planted_cache(bench: Bench) -> str:
    if os.getuid() != 0:
        raise Skipped("only root can give a folder away")
    root, mark = copied_cache(bench), bench.folder / "executed"
    content = pickle.dumps((_Planted(mark), ()))
    for path in kernels(root):
        path.write_bytes(hashlib.sha256(content).digest() + content)
    os.chown(root, STRANGER, STRANGER)
    env = {"HPCPIC_CACHE_DIR": str(root)}
    same(bench, bench.run(env=env), 1, "another user")
    done = bench.call(("doctor", "--threads", "1"), env=env)
    expect("another user" in done.out, done)
    expect(not mark.exists(), "it was executed")
    return "not executed, warned once, same bits; doctor says so"


@row(83, "modules in the current folder with names that the program imports", "not executed by sweep and doctor")
def current_folder(bench: Bench) -> str:
    for name in (bench.program, "click", "numpy", "numba", "mpi4py", "json"):
        (bench.folder / f"{name}.py").write_text(f"open('executed-{name}', 'w'); raise SystemExit(0)\n")
    short = "simulation.cycles=20" if bench.program == "hpcpic" else "simulation.end_time=0.01"
    sweep = bench.call(("sweep", str(bench.case), "--set", short, "-o", "sweep", "--threads", "1"))
    expect(sweep.code == 0 and (bench.folder / "sweep/0000/run.json").exists(), sweep)
    doctor = bench.call(("doctor", "--threads", "1"))
    expect("starts no two ranks" not in doctor.out, doctor)
    executed = [path.name for path in bench.folder.glob("executed-*")]
    expect(not executed, executed)
    return "none executed"


def little_shared_memory() -> None:
    """In this process and those it starts."""
    if ctypes.CDLL(None).unshare(CLONE_NEWNS):
        os._exit(77)
    subprocess.run(["mount", "--make-rprivate", "/"], check=True)
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={SHARED_MEMORY}", "tmpfs", "/dev/shm"], check=True)


@row(84, f"{SHARED_MEMORY} of /dev/shm, as in a container", "no bus error: one warning if it is too little, same bits")
def shared_memory(bench: Bench) -> str:
    large = ROWS_OF_1024 if bench.program == "hpcpic" else ()
    expected = bench.digest(*large[1::2])
    done = bench.run(*large, before=little_shared_memory)
    if done.code == 77:
        raise Skipped("mounting is not permitted here")
    expect(done.code == 0 and bench.facts()["state_digest"] == expected, done)
    expect(done.err.count("/dev/shm") == bool(large), done)
    return "columns travel as messages, warned once, same bits" if large else "same bits"


def limited() -> None:
    resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64))


@row(85, "umask 000 and 077, 64 open files, decimal commas", "same bits, no warning")
def habits(bench: Bench) -> str:
    shells: tuple[tuple[Callable[[], object], dict[str, str]], ...] = (
        (lambda: os.umask(0), {}),
        (lambda: os.umask(0o077), {}),
        (limited, {}),
        (lambda: None, {"LC_ALL": "de_DE.UTF-8", "LANG": "de_DE.UTF-8"}),
    )
    for before, env in shells:
        same(bench, bench.run(before=before, env=env), 0)
        shutil.rmtree(bench.run_folder)
    return "four times the same bits"
