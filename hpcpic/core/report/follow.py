"""A run that goes on, looked at again whenever its files change: --follow of plot and report."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from hpcpic.core.app.use import import_kept

if TYPE_CHECKING:
    from hpcpic.core.files.reader import Run

FILES = ("run.json", "series.h5", "*.vtkhdf")  # of a run folder: what is drawn
POLL_S = 0.5
LEAST_PAUSE_S = 2.0
PAUSES = 5.0  # times what drawing took: a sixth of a core, which the run wants

follow_option = click.option(
    "--follow", is_flag=True, help="Draw again whenever the run has written something, until it ends (or Ctrl-C)."
)


def states_of(folder: str, program: str, follow: bool) -> Iterator[Run]:
    """The run as it stands now; with `follow` again after each change of its files, the last time when it has ended.

    What the run has used of Python is imported. Raises FileError where no run of the program is, and ConfigError.
    """
    from hpcpic.core.files.reader import open_run

    while True:
        began = time.monotonic()
        seen = _stamps(folder) if follow else []  # before reading: what is written meanwhile is a change
        run = open_run(folder, program)
        import_kept(run.summary, run.rundir.given)
        goes_on = _goes_on(run)  # before reading too: what is drawn of a run that has ended is all of it
        yield run
        if not follow or not goes_on:
            return
        now = time.monotonic()
        rested = now + max(LEAST_PAUSE_S, PAUSES * (now - began))
        while _goes_on(open_run(folder, program)) and (_stamps(folder) == seen or time.monotonic() < rested):
            time.sleep(POLL_S)


def _goes_on(run: Run) -> bool:
    return run.summary.get("status") == "running"


def _stamps(folder: str) -> list[tuple[str, int, int]]:
    """Name, size and time of change of each file."""
    found = (path for pattern in FILES for path in sorted(Path(folder).glob(pattern)))
    return [(path.name, status.st_size, status.st_mtime_ns) for path in found for status in [path.stat()]]
