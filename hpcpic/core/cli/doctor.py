"""doctor: is this machine set up to run well? Exit code 3 when it is not."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import click

from hpcpic.core.app.app import PYTHON, AppLoader
from hpcpic.core.app.text import table
from hpcpic.core.cli.launch import launcher
from hpcpic.core.errors import CheckFailed
from hpcpic.core.run.summary import several

LEAST_SHARED = 64  # MiB that MPI itself wants at times
PROBE = 1 << 20  # bytes: some kernels take as much
_OTHER_SIZE = 9
_SIZE_OF_TWO = f"from mpi4py import MPI; import sys; sys.exit(0 if MPI.COMM_WORLD.size == 2 else {_OTHER_SIZE})"


@dataclass(frozen=True, slots=True)
class Finding:
    what: str
    value: str
    verdict: str = "ok"
    cure: str = ""


def make_doctor_command(app_loader: AppLoader) -> click.Command:
    @click.command("doctor")
    @click.option("--threads", type=click.IntRange(1), help="Threads per rank that you mean to use.")
    def doctor(threads: int | None) -> None:
        """MPI, launcher, threads, HDF5, FFTW, versions, the cache of compiled kernels, shared memory.

        `mpirun -n N` in front tells how those ranks share the cores.
        """
        from hpcpic.core.comm.world import World

        world = World.start()
        shared = list(_cores(world, threads))
        if world.rank == 0:
            findings = [*_mpi(world), *shared, *_libraries(), *_cache(), *_memory(), *_environment()]
            table(("what", "found", "verdict", "cure"), [(f.what, f.value, f.verdict, f.cure) for f in findings])
            failed = [f.what for f in findings if f.verdict == "fail"]
            problem = world.max(float(len(failed)))
            if failed:
                raise CheckFailed(f"not in order: {', '.join(failed)}")
        else:
            problem = world.max(0.0)
        if problem:
            sys.exit(3)

    return doctor


def _mpi(world: Any) -> Iterator[Finding]:
    from hpcpic.core.comm.library import library, thread_level

    yield Finding("MPI", library())
    level = thread_level()
    yield Finding(
        "MPI and threads",
        level,
        "ok" if level == "MULTIPLE" else "warn",
        "" if level == "MULTIPLE" else "an MPI with THREAD_MULTIPLE",
    )
    mpirun = launcher()
    if mpirun is None:
        yield Finding("launcher", "none", "fail", "pip install mpich")
    elif world.size > 1:
        yield Finding("launcher", f"{mpirun}, {world.size} ranks")
    else:
        yield _try_launcher(mpirun)


def _try_launcher(mpirun: str) -> Finding:
    """Do two ranks started by it see each other?"""
    marks, wishes = ("PMI", "OMPI", "MPI"), "OMPI_ALLOW"  # of a launcher above us; what Open MPI wants from root
    clean = {key: value for key, value in os.environ.items() if key.startswith(wishes) or not key.startswith(marks)}
    words = [mpirun, "-n", "2", *PYTHON, "-c", _SIZE_OF_TWO]
    try:
        done = subprocess.run(words, env=clean, capture_output=True, text=True, timeout=30, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        return Finding("launcher", f"{mpirun}: {error}", "fail", "pip install --force-reinstall mpich")
    if done.returncode == _OTHER_SIZE:
        return Finding("launcher", f"{mpirun} is of another MPI", "fail", f"use {sys.prefix}/bin/mpirun")
    if done.returncode:
        message = " ".join(done.stderr.replace("-" * 20, " ").split()).partition(". ")[0]
        return Finding("launcher", f"{mpirun} starts no two ranks: {message[:200]}", "fail", "what it asks for")
    return Finding("launcher", mpirun)


def _cores(world: Any, threads: int | None) -> Iterator[Finding]:
    """Collective."""
    chosen = threads or world.default_threads()
    total, allowed, there = os.cpu_count() or 1, len(os.sched_getaffinity(0)), world.cores()
    yield Finding("cores", f"{total}, of which {allowed} for this rank")
    shape = f"{several(world.node_size, 'rank')} x {several(chosen, 'thread')} on {several(there, 'core')} of this node"
    many = world.node_size * chosen > there
    yield Finding("load", shape, "fail" if many else "ok", f"at most {there} ranks x threads" if many else "")


def _libraries() -> Iterator[Finding]:
    import platform
    from importlib.metadata import PackageNotFoundError, version

    from hpcpic.core.files.safe_hdf5 import import_h5py

    yield Finding("Python", platform.python_version())
    for name in ("numpy", "numba", "scipy", "mpi4py", "pyfftw", "matplotlib"):
        try:
            yield Finding(name, version(name))
        except PackageNotFoundError:
            yield Finding(name, "missing", "fail", f"pip install {name}")
    h5py = import_h5py()
    yield Finding("HDF5", f"{h5py.version.hdf5_version} (h5py {h5py.__version__})")


def _cache() -> Iterator[Finding]:
    """Finding on the cache of compiled kernels: it can be written, and no other user can change it."""
    from hpcpic.core.simd.caches import private_folder

    try:
        folder = private_folder()
        folder.write("probe", bytes(PROBE))
        folder.remove("probe")
    except OSError as error:
        why = f"{error.filename}: {error.strerror}"
        yield Finding("kernel cache", why, "warn", "HPCPIC_CACHE_DIR: a folder that only you can write to")
    else:
        yield Finding("kernel cache", str(folder.path))


def _memory() -> Iterator[Finding]:
    """Findings on the shared memory of a node, and on what killed ranks have left there."""
    from hpcpic.core.comm import shared_memory
    from hpcpic.core.memory import MIB

    left = shared_memory.free()
    few = left < LEAST_SHARED * MIB
    cure = "a larger one (docker run --shm-size=1g): ranks may end by a bus error" if few else ""
    value = f"{shared_memory.FOLDER}, {left / MIB:.0f} MiB free" if math.isfinite(left) else "none"
    yield Finding("shared memory", value, "warn" if few else "ok", cure)
    behind = list(shared_memory.left_behind())
    if behind:
        size = sum(path.stat().st_size for path in behind) / MIB
        cure = f"rm {' '.join(map(str, behind[:3]))}{' ...' if behind[3:] else ''} while no run goes on"
        yield Finding("of killed ranks", f"{several(len(behind), 'segment')}, {size:.0f} MiB", "warn", cure)


def _environment() -> Iterator[Finding]:
    for name in ("OMP_NUM_THREADS", "NUMBA_DISABLE_JIT", "MPIR_CVAR_ASYNC_PROGRESS"):
        value = os.environ.get(name, "")
        if name == "NUMBA_DISABLE_JIT" and value not in ("", "0"):
            yield Finding(name, value, "fail", f"unset {name}: kernels are interpreted")
        if name == "MPIR_CVAR_ASYNC_PROGRESS" and value not in ("", "0"):
            yield Finding(name, value, "warn", f"unset {name}: a progress thread takes a core")
