"""Start this program in processes of its own, with or without MPI."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from hpcpic.core.errors import ConfigError


def launcher() -> str | None:
    """The mpirun of this Python: another MPI's would start ranks that do not see each other."""
    beside = Path(sys.executable).with_name("mpirun")
    return str(beside) if beside.exists() else shutil.which("mpirun")


def launch(program: Sequence[str], arguments: Sequence[str], ranks: int, **settings: object) -> int:
    """Run the program and wait; its exit code. Raises ConfigError without a launcher for several ranks.

    A Ctrl-C, which the program hears too, gives it the time to write its checkpoint.
    """
    words = [*program, *arguments]
    if ranks > 1:
        mpirun = launcher()
        if mpirun is None:
            raise ConfigError("there is no mpirun: install mpich or openmpi, or use --ranks 1")
        words = [mpirun, "-n", str(ranks), *words]
    process = subprocess.Popen(words, **settings)  # type: ignore[call-overload]
    try:
        return process.wait()
    except KeyboardInterrupt:
        return process.wait()
