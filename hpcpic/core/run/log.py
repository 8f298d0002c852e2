"""Messages of a running program: of rank 0 on the screen and in log.txt, of others only warnings, with the rank."""

from __future__ import annotations

import logging
import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import TextIO

_FORMAT = "%(asctime)s %(levelname)s %(name)s: %(message)s"
ROOT = logging.getLogger("hpcpic")
COLLECTIVE = ("hpcpic.run", "hpcpic.output", "hpcpic.cache", "hpcpic.core.run.checkpoint")  # all ranks know it


class _Whole(logging.Handler):
    """One write per record, so that lines of several ranks do not mix."""

    def emit(self, record: logging.LogRecord) -> None:
        sys.stderr.flush()
        write_error(self.format(record) + "\n")


def write_error(text: str) -> None:
    """One write to standard error. One that is full, or whose reader has gone, changes nothing else."""
    with suppress(OSError):
        os.write(2, text.encode(errors="replace"))


def say(screen: TextIO, text: str) -> None:
    """Write on the screen. One that is full, or whose reader has gone, ends no run."""
    with suppress(OSError):
        screen.write(text)
        screen.flush()


class Collected(logging.Handler):
    """Keeps warnings, for the summary to repeat them."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.messages: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        text = record.getMessage()
        if text not in self.messages:
            self.messages.append(text)


def start(rank: int, size: int, level: int = logging.INFO) -> Collected:
    """Send records to the screen; returns where this rank's warnings are kept."""
    collected = Collected()
    screen = _Whole(level if rank == 0 else logging.WARNING)
    prefix = f"rank {rank}: " if rank and size > 1 else ""
    screen.setFormatter(logging.Formatter(prefix + _FORMAT, "%H:%M:%S"))
    if rank:
        screen.addFilter(lambda record: record.name not in COLLECTIVE)
    ROOT.setLevel(logging.INFO)
    ROOT.handlers = [screen, collected]
    ROOT.propagate = False
    return collected


def to_file(path: Path) -> logging.Handler:
    """Append the log to this file too from now on; close the returned handler at the end."""
    handler = logging.FileHandler(path, mode="a", encoding="utf-8")
    handler.setFormatter(logging.Formatter(_FORMAT, "%H:%M:%S"))
    ROOT.addHandler(handler)
    return handler
