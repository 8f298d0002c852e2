"""The origin of a run: versions, machine, command."""

import os
import platform
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from hpcpic.version import __version__

PACKAGES = ("numpy", "numba", "mpi4py", "h5py", "pyfftw", "scipy", "mpich", "openmpi")


def provenance(mpi_library: str = "") -> dict[str, Any]:
    """The origin of a run: versions, git state, machine, command line. No environment variables."""
    return {
        "versions": {"hpcpic": __version__, "python": platform.python_version(), **_versions()},
        "git": _git(Path(__file__).resolve().parents[2]),
        "mpi": " ".join(mpi_library.split()),
        "cpu": cpu(),
        "cores": os.cpu_count(),
        "host": platform.node(),
        "system": platform.platform(),
        "command": list(sys.argv),
        "python": sys.executable,
    }


def _versions() -> dict[str, str]:
    found = {}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def _git(folder: Path) -> dict[str, Any] | None:
    """Commit of the package's repository, and whether files differ from it; None for an installed copy."""
    if not (folder.parent / ".git").exists():
        return None

    def ask(*words: str) -> str:
        run = subprocess.run(["git", "-C", folder, *words], capture_output=True, text=True, timeout=10, check=True)
        return run.stdout.strip()

    try:
        return {"commit": ask("rev-parse", "HEAD"), "dirty": bool(ask("status", "--porcelain", "--", "."))}
    except (OSError, subprocess.SubprocessError):
        return None


def cpu() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next(
        (line.partition(":")[2].strip() for line in lines if line.startswith("model name")),
        platform.machine(),
    )
